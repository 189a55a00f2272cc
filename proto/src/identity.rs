//! Certificates of a server or a client: three files (PEM) in a folder, and what zenoh is told of them.

use std::path::Path;

/// Certificate of the authority that signs those of the server and of its clients.
pub const AUTHORITY: &str = "ca.pem";
/// Certificate of whoever owns the folder; of a client, its common name is the client's name.
pub const CERTIFICATE: &str = "certificate.pem";
/// The certificate's private key.
pub const KEY: &str = "key.pem";

/// Settings of a zenoh session that listens or connects with the certificates in `folder`: keys, and values in JSON5. Each end
/// shows its certificate, and takes none of another authority.
///
/// # Errors
/// What is wrong with the folder, for people.
pub fn settings(folder: &Path) -> Result<Vec<(String, String)>, String> {
    let file = |name: &str| {
        let path = folder.join(name);
        // Read, so that what may not be read is told apart from what zenoh does not understand.
        std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        path.to_str().map(|path| format!("{path:?}")).ok_or_else(|| format!("{}: not UTF-8", path.display()))
    };
    let (authority, certificate, key) = (file(AUTHORITY)?, file(CERTIFICATE)?, file(KEY)?);
    let setting = |name: &str, value: &str| (format!("transport/link/tls/{name}"), value.to_owned());
    Ok(vec![
        setting("root_ca_certificate", &authority),
        setting("enable_mtls", "true"),
        setting("listen_certificate", &certificate),
        setting("listen_private_key", &key),
        setting("connect_certificate", &certificate),
        setting("connect_private_key", &key),
        setting("verify_name_on_connect", "true"),
    ])
}
