//! The page over TLS.

use palpate_sdk::Endpoints;
use palpate_web::{Gateway, Options, Rights, Tls};
use rustls::pki_types::ServerName;
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;

/// The answer of the gateway at `address` to a request for `path`, by a browser that trusts `roots`.
fn get(address: SocketAddr, roots: &RootCertStore, path: &str) -> std::io::Result<String> {
    let config = ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots.clone())
        .with_no_client_auth();
    let name = ServerName::try_from("localhost").unwrap();
    let connection = ClientConnection::new(Arc::new(config), name).unwrap();
    let mut stream = StreamOwned::new(connection, TcpStream::connect(address)?);
    write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost:{}\r\nConnection: close\r\n\r\n", address.port())?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

#[test]
fn a_certificate_that_is_given_is_the_one_that_browsers_see() {
    let made = rcgen::generate_simple_self_signed(vec!["localhost".into()]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| folder.path().join(name));
    std::fs::write(&certificate, made.cert.pem()).unwrap();
    std::fs::write(&key, made.signing_key.serialize_pem()).unwrap();
    let options = Options {
        // No server is there: the page says so.
        endpoints: Endpoints { surface: "tcp/127.0.0.1:1".into(), ..Endpoints::default() },
        listen: "127.0.0.1:0".parse().unwrap(),
        tls: Some(Tls::Files { certificate, key }),
        origins: vec![],
        view_only: true,
    };
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let gateway = runtime.block_on(Gateway::start(options)).unwrap();
    let mut roots = RootCertStore::empty();
    roots.add(made.cert.der().clone()).unwrap();

    let address = gateway.invite(Rights::Viewer);
    let path = address.strip_prefix(&format!("https://localhost:{}", gateway.address().port())).unwrap();
    let door = get(gateway.address(), &roots, "/").unwrap();
    assert!(door.starts_with("HTTP/1.1 403"), "{door}");
    let entered = get(gateway.address(), &roots, path).unwrap();
    assert!(
        entered.starts_with("HTTP/1.1 303") && entered.contains("HttpOnly") && entered.contains("; Secure"),
        "{entered}"
    );
    // Who trusts another certificate gets nothing.
    let other = rcgen::generate_simple_self_signed(vec!["localhost".into()]).unwrap();
    let mut roots = RootCertStore::empty();
    roots.add(other.cert.der().clone()).unwrap();
    assert!(get(gateway.address(), &roots, "/").unwrap_err().to_string().contains("certificate"));
    runtime.block_on(gateway.stop());
}
