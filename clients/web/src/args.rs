//! What the command line says.

use std::net::SocketAddr;
use std::path::PathBuf;

use palpate_sdk::Endpoints;
use palpate_sdk::proto::keys;

use crate::{Options, Tls};

/// Which server, and where to listen.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Session name of the server
    #[arg(long, default_value = keys::DEFAULT_SESSION)]
    pub session: String,
    /// Where the server sends the surface from
    #[arg(long, visible_alias = "connect", default_value = keys::DEFAULT_SURFACE_ENDPOINT)]
    pub surface_endpoint: String,
    /// Where the server takes poses
    #[arg(long, default_value = keys::DEFAULT_FORCE_ENDPOINT)]
    pub force_endpoint: String,
    /// Folder of the page's certificate for the server, where that asks for one
    #[arg(long, value_name = "FOLDER")]
    pub identity: Option<PathBuf>,
    /// Address and port of the page; port 0: any free one
    #[arg(long, default_value = "127.0.0.1:8460", value_name = "ADDRESS:PORT")]
    pub listen: SocketAddr,
    /// Certificates, leaf first (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    pub tls_cert: Option<PathBuf>,
    /// Private key of the certificate (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    pub tls_key: Option<PathBuf>,
    /// Make a certificate now, which browsers ask you about once
    #[arg(long, conflicts_with = "tls_cert")]
    pub tls_self_signed: bool,
    /// Origin whose pages may connect beside this one's own, as in `https://lab.example`; may be given again
    #[arg(long = "origin", value_name = "ORIGIN")]
    pub origins: Vec<String>,
    /// Let everybody watch and nobody touch
    #[arg(long)]
    pub view_only: bool,
}

impl From<Args> for Options {
    fn from(args: Args) -> Self {
        let tls = match (args.tls_cert, args.tls_key) {
            (Some(certificate), Some(key)) => Some(Tls::Files { certificate, key }),
            _ => args.tls_self_signed.then_some(Tls::SelfSigned),
        };
        Self {
            endpoints: Endpoints {
                force: args.force_endpoint,
                surface: args.surface_endpoint,
                session: args.session,
                identity: args.identity,
            },
            listen: args.listen,
            tls,
            origins: args.origins,
            view_only: args.view_only,
        }
    }
}
