//! Certificates.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, anyhow};
use axum_server::tls_rustls::RustlsConfig;
use rustls::ServerConfig;
use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};

/// Where the certificate comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Tls {
    /// Files: certificates, leaf first, and the private key, both PEM.
    Files {
        /// The certificates.
        certificate: PathBuf,
        /// The key.
        key: PathBuf,
    },
    /// Made now, by nobody whom a browser trusts.
    SelfSigned,
}

/// The configuration, and the SHA-256 fingerprint of the certificate, as browsers show it.
pub(crate) fn configuration(tls: &Tls, names: Vec<String>) -> anyhow::Result<(RustlsConfig, String)> {
    let (certificates, key) = match tls {
        Tls::Files { certificate, key } => read(certificate, key)?,
        Tls::SelfSigned => {
            let made = rcgen::generate_simple_self_signed(names).context("making a certificate")?;
            let key = PrivatePkcs8KeyDer::from(made.signing_key.serialize_der()).into();
            (vec![made.cert.der().clone()], key)
        }
    };
    let leaf = certificates.first().ok_or_else(|| anyhow!("there is no certificate"))?;
    let provider = ring::default_provider();
    let hash = provider.cipher_suites.iter().find_map(|suite| match suite {
        rustls::SupportedCipherSuite::Tls13(suite) if suite.common.hash_provider.algorithm() == SHA256 => {
            Some(suite.common.hash_provider)
        }
        _ => None,
    });
    let digest = hash.map(|hash| hash.hash(leaf)).ok_or_else(|| anyhow!("there is no SHA-256"))?;
    let fingerprint: Vec<String> = digest.as_ref().iter().map(|byte| format!("{byte:02X}")).collect();
    let mut config = ServerConfig::builder_with_provider(Arc::new(provider))
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(certificates, key))
        .context("the certificate and its key")?;
    // A WebSocket needs version 1.1.
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok((RustlsConfig::from_config(Arc::new(config)), fingerprint.join(":")))
}

const SHA256: rustls::crypto::hash::HashAlgorithm = rustls::crypto::hash::HashAlgorithm::SHA256;

fn read(certificate: &Path, key: &Path) -> anyhow::Result<(Vec<CertificateDer<'static>>, PrivateKeyDer<'static>)> {
    let certificates = CertificateDer::pem_file_iter(certificate)
        .and_then(|all| all.collect::<Result<Vec<_>, _>>())
        .with_context(|| certificate.display().to_string())?;
    let key = PrivateKeyDer::from_pem_file(key).with_context(|| key.display().to_string())?;
    Ok((certificates, key))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn certificates_are_made_or_read_and_a_file_that_is_none_is_named() {
        let (_, fingerprint) = configuration(&Tls::SelfSigned, vec!["localhost".into(), "127.0.0.1".into()]).unwrap();
        assert_eq!(fingerprint.len(), 32 * 3 - 1);
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let made = rcgen::generate_simple_self_signed(vec!["localhost".into()]).unwrap();
        std::fs::write(path("cert.pem"), made.cert.pem()).unwrap();
        std::fs::write(path("key.pem"), made.signing_key.serialize_pem()).unwrap();
        let files = |certificate, key| Tls::Files { certificate: path(certificate), key: path(key) };
        configuration(&files("cert.pem", "key.pem"), vec![]).unwrap();
        let fault = |tls| format!("{:#}", configuration(&tls, vec![]).err().unwrap());
        assert!(fault(files("lost.pem", "key.pem")).contains("lost.pem"));
        assert!(fault(files("cert.pem", "cert.pem")).contains("cert.pem"));
        assert!(fault(files("key.pem", "key.pem")).contains("certificate"));
    }
}
