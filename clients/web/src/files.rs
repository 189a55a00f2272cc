//! The page's files, which are part of the program.

use std::io::Write;
use std::sync::OnceLock;

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, Response, StatusCode, header};
use flate2::{Compression, Crc, write::GzEncoder};

/// A file: its name in the address, its type, its bytes.
type File = (&'static str, &'static str, &'static [u8]);

const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! script {
    ($name:literal) => {
        ($name, SCRIPT, include_bytes!(concat!("../page/", $name)))
    };
}

/// What a visitor gets. The first is the page itself.
pub(crate) const FILES: &[File] = &[
    ("index.html", "text/html; charset=utf-8", include_bytes!("../page/index.html")),
    ("style.css", "text/css; charset=utf-8", include_bytes!("../page/style.css")),
    script!("start.js"),
    script!("main.js"),
    script!("worker.js"),
    script!("wire.js"),
    script!("surface.js"),
    script!("deformation.js"),
    script!("view.js"),
    script!("shading.js"),
    script!("orbit.js"),
    script!("obstacles.js"),
    script!("tools.js"),
    script!("hand.js"),
    script!("headset.js"),
    script!("panel.js"),
    script!("vendor/three.min.js"),
    script!("vendor/fzstd.min.js"),
];

/// What somebody gets who is not let in.
pub(crate) const DOOR: &[u8] = include_bytes!("../page/door.html");

/// Nothing from elsewhere, and nobody may frame the page; an address with a token goes to nobody.
pub(crate) const SAFE: [(header::HeaderName, &str); 4] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' data:; \
         connect-src 'self' ws: wss:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-cache"),
];

/// A file as it goes over the network.
struct Packed {
    bytes: Bytes,
    tag: String,
}

/// (files) each compressed once.
fn packed() -> &'static [Packed] {
    static PACKED: OnceLock<Vec<Packed>> = OnceLock::new();
    PACKED.get_or_init(|| {
        let pack = |(_, _, bytes): &File| {
            let mut crc = Crc::new();
            crc.update(bytes);
            let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
            let packed = gzip.write_all(bytes).and_then(|()| gzip.finish()).expect("memory takes all");
            Packed { bytes: packed.into(), tag: format!("\"{:08x}-{:x}\"", crc.sum(), bytes.len()) }
        };
        FILES.iter().map(pack).collect()
    })
}

/// Compresses the files, so that the first visitor does not wait for it.
pub(crate) fn prepare() {
    packed();
}

/// The file called `name`, for a browser that sends `headers`.
pub(crate) fn get(name: &str, headers: &HeaderMap) -> Response<Body> {
    let Some(at) = FILES.iter().position(|file| file.0 == name) else {
        return respond(StatusCode::NOT_FOUND, &[], Bytes::from_static(b"there is no such file"));
    };
    let ((_, kind, bytes), packed) = (FILES[at], &packed()[at]);
    let says = |name: header::HeaderName, word: &str| {
        headers.get_all(name).iter().any(|value| value.to_str().is_ok_and(|value| value.contains(word)))
    };
    let tag = (header::ETAG, &packed.tag[..]);
    if says(header::IF_NONE_MATCH, &packed.tag) {
        return respond(StatusCode::NOT_MODIFIED, &[tag], Bytes::new());
    }
    let kind = (header::CONTENT_TYPE, kind);
    let vary = (header::VARY, "accept-encoding");
    if says(header::ACCEPT_ENCODING, "gzip") {
        respond(StatusCode::OK, &[kind, tag, vary, (header::CONTENT_ENCODING, "gzip")], packed.bytes.clone())
    } else {
        respond(StatusCode::OK, &[kind, tag, vary], Bytes::from_static(bytes))
    }
}

/// An answer with `headers` and those of [`SAFE`].
pub(crate) fn respond(status: StatusCode, headers: &[(header::HeaderName, &str)], body: Bytes) -> Response<Body> {
    let mut response = Response::builder().status(status);
    for (name, value) in SAFE.iter().chain(headers) {
        response = response.header(name, *value);
    }
    response.body(Body::from(body)).expect("headers are text")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn all_files_of_the_page_are_here_and_take_less_than_400_kb() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("page");
        let mut found = Vec::new();
        for entry in [folder.clone(), folder.join("vendor")].iter().flat_map(|folder| folder.read_dir().unwrap()) {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(&folder).unwrap().to_str().unwrap().replace('\\', "/");
            let is_page = [".js", ".css", ".html"].iter().any(|end| name.ends_with(end)) && name != "door.html";
            found.extend((path.is_file() && is_page).then_some(name));
        }
        found.sort();
        let mut known: Vec<&str> = FILES.iter().map(|file| file.0).collect();
        known.sort();
        assert_eq!(known, found);
        let size: usize = packed().iter().map(|file| file.bytes.len()).sum();
        println!("{size} bytes compressed");
        assert!(size < 400_000, "{size}");
    }

    #[test]
    fn a_browser_that_has_a_file_gets_it_no_second_time() {
        let first = get("index.html", &HeaderMap::new());
        assert!(first.headers()[header::CONTENT_SECURITY_POLICY].to_str().unwrap().contains("script-src 'self'"));
        let mut headers = HeaderMap::new();
        headers.insert(header::IF_NONE_MATCH, first.headers()[header::ETAG].clone());
        assert_eq!(get("index.html", &headers).status(), StatusCode::NOT_MODIFIED);
        assert_eq!(get("../Cargo.toml", &headers).status(), StatusCode::NOT_FOUND);
    }
}
