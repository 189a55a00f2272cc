//! `palpate certificates`: an authority, and what it signs: a certificate of the server, and one of each name in a roles file.

use anyhow::{Context, bail};
use clap::Args;
use palpate::say;
use palpate::server::Roles;
use palpate_proto::identity;
use rcgen::{BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa};
use rcgen::{Issuer, KeyPair, KeyUsagePurpose};
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use time::{Duration, OffsetDateTime};

#[derive(Args)]
pub struct CertificatesArgs {
    /// Who may do what (TOML): each name gets a certificate
    #[arg(long, value_name = "FILE")]
    roles: PathBuf,
    /// Name or address by which clients reach the server, beside localhost; may be given again
    #[arg(long = "host", value_name = "NAME|ADDRESS")]
    hosts: Vec<String>,
    /// Folder for the folders authority, server and clients/NAME; what is there already stays
    #[arg(long, default_value = "certificates", value_name = "FOLDER")]
    out: PathBuf,
    /// Days that certificates are valid, but for that of the authority
    #[arg(long, default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=MOST_DAYS as i64))]
    days: u32,
}

/// Days that the authority's certificate is valid: ten years, as who trusts it has to be given another by hand.
const MOST_DAYS: u32 = 3653;

/// By which every client reaches a server of its own machine.
const LOCAL: [&str; 3] = ["localhost", "127.0.0.1", "::1"];

pub fn run(args: CertificatesArgs) -> anyhow::Result<ExitCode> {
    let roles = Roles::read(&args.roles)?;
    fs::create_dir_all(args.out.join("clients")).with_context(|| args.out.display().to_string())?;
    let folder = args.out.join("authority");
    let authority = match folder.exists() {
        true => Authority::read(&folder)?,
        false => Authority::make(&folder)?,
    };
    let hosts = LOCAL.into_iter().map(String::from).chain(args.hosts);
    let server = CertificateParams::new(hosts.collect::<Vec<_>>()).context("--host")?;
    authority.sign(
        &args.out.join("server"),
        "palpate server",
        server,
        ExtendedKeyUsagePurpose::ServerAuth,
        args.days,
    )?;
    for name in roles.names() {
        let folder = args.out.join("clients").join(name);
        authority.sign(&folder, name, CertificateParams::default(), ExtendedKeyUsagePurpose::ClientAuth, args.days)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What signs certificates.
struct Authority {
    certificate: String,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    fn make(folder: &Path) -> anyhow::Result<Self> {
        let mut params = valid(CertificateParams::default(), "palpate authority", MOST_DAYS);
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let key = KeyPair::generate()?;
        let certificate = params.self_signed(&key)?.pem();
        write(folder, &[(identity::AUTHORITY, &certificate), (identity::KEY, &key.serialize_pem())])?;
        Ok(Self { certificate, issuer: Issuer::new(params, key) })
    }

    fn read(folder: &Path) -> anyhow::Result<Self> {
        let read = |name: &str| {
            let path = folder.join(name);
            fs::read_to_string(&path).with_context(|| path.display().to_string())
        };
        let certificate = read(identity::AUTHORITY)?;
        let key = KeyPair::from_pem(&read(identity::KEY)?).with_context(|| folder.display().to_string())?;
        let issuer = Issuer::from_ca_cert_pem(&certificate, key).with_context(|| folder.display().to_string())?;
        Ok(Self { certificate, issuer })
    }

    /// A certificate of `name` for `purpose` alone, with its key, in `folder`; one that is there stays.
    fn sign(
        &self,
        folder: &Path,
        name: &str,
        params: CertificateParams,
        purpose: ExtendedKeyUsagePurpose,
        days: u32,
    ) -> anyhow::Result<()> {
        if folder.exists() {
            return Ok(say!("{}: is there, and stays", folder.display())?);
        }
        let mut params = valid(params, name, days);
        params.use_authority_key_identifier_extension = true;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![purpose];
        let key = KeyPair::generate()?;
        let certificate = params.signed_by(&key, &self.issuer)?.pem();
        let files = [
            (identity::AUTHORITY, &*self.certificate),
            (identity::CERTIFICATE, &*certificate),
            (identity::KEY, &key.serialize_pem()),
        ];
        write(folder, &files)
    }
}

/// `params` for `name`, from yesterday on, as clocks differ, until `days` from now.
fn valid(mut params: CertificateParams, name: &str, days: u32) -> CertificateParams {
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, name);
    let now = OffsetDateTime::now_utc();
    params.not_before = now - Duration::DAY;
    params.not_after = now + Duration::DAY * days;
    params
}

/// Writes `files` into `folder`, which is made whole or not at all. Only the owner may look into it and read what is in it.
fn write(folder: &Path, files: &[(&str, &str)]) -> anyhow::Result<()> {
    let Some(parent) = folder.parent() else { bail!("{}: this is no folder's name", folder.display()) };
    let written = || -> std::io::Result<()> {
        let private = fs::Permissions::from_mode(0o700);
        let beside = tempfile::Builder::new().permissions(private).tempdir_in(parent)?;
        for (name, content) in files {
            let mut file =
                OpenOptions::new().write(true).create_new(true).mode(0o600).open(beside.path().join(name))?;
            file.write_all(content.as_bytes())?;
        }
        // Fails where something is there meanwhile, unless that is an empty folder.
        fs::rename(beside.path(), folder)
    };
    written().with_context(|| folder.display().to_string())?;
    Ok(say!("{}: made", folder.display())?)
}
