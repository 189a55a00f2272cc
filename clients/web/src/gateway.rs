//! The gateway: a listener, the routes, and what all pages share.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Path, Query, State, WebSocketUpgrade};
use axum::http::{HeaderMap, Response, StatusCode, header};
use axum::routing::get;
use axum_server::Handle;
use palpate_sdk::Endpoints;
use serde::Deserialize;

use crate::access::{Access, VISIT};
use crate::upstream::{Link, Upstream};
use crate::{Rights, Tls, files, message, page, tls};

/// Pages at a time: a lecture hall. Each takes half a megabyte at most, and its frames some of the network.
const MOST_PAGES: usize = 64;
/// What may wait in a WebSocket's own buffer [bytes]: some frames, or a topology.
const BUFFER: usize = 1 << 20;
/// How long open pages have to end.
const GRACE: Duration = Duration::from_secs(1);

/// How a gateway is started.
#[derive(Clone, Debug)]
pub struct Options {
    /// The server.
    pub endpoints: Endpoints,
    /// Where to listen; port 0: any free one.
    pub listen: SocketAddr,
    /// Without it the gateway listens on loopback only.
    pub tls: Option<Tls>,
    /// Origins whose pages may open a WebSocket, beside this gateway's own: `https://lab.example`.
    pub origins: Vec<String>,
    /// Nobody gets the rights of an operator, and the server's force channel stays alone.
    pub view_only: bool,
}

/// What has happened since the gateway was started.
#[derive(Debug, Default)]
pub struct Counters {
    /// Pages that are open.
    pub pages: AtomicUsize,
    /// WebSockets that were refused.
    pub pages_refused: AtomicU64,
    /// Surface frames sent, to all pages.
    pub frames: AtomicU64,
    /// Surface frames that pages missed because they had not taken the last.
    pub frames_missed: AtomicU64,
    /// Poses taken.
    pub poses: AtomicU64,
    /// Poses that a newer one replaced before its turn.
    pub poses_superseded: AtomicU64,
    /// Poses of tools that their page did not hold, or older ones than the newest.
    pub poses_refused: AtomicU64,
    /// Messages that are none.
    pub malformed: AtomicU64,
}

/// What all pages share.
pub(crate) struct Shared {
    pub upstream: Upstream,
    pub counters: Counters,
    access: Mutex<Access>,
    cookie: String,
    secure: bool,
}

/// A gateway that runs until this is dropped.
pub struct Gateway {
    shared: Arc<Shared>,
    handle: Handle<SocketAddr>,
    address: SocketAddr,
    fingerprint: Option<String>,
    serving: tokio::task::JoinHandle<std::io::Result<()>>,
}

impl Gateway {
    /// Listens, and connects to the server in the background.
    ///
    /// # Errors
    /// The address is taken, or can be reached from elsewhere without TLS; the certificate cannot be read.
    pub async fn start(options: Options) -> anyhow::Result<Self> {
        let Options { endpoints, listen, tls, origins, view_only } = options;
        if tls.is_none() && !listen.ip().is_loopback() {
            bail!(
                "--listen {listen} can be reached from elsewhere, and without TLS anybody on the way reads the keys. Remedy: \
                 --tls-cert and --tls-key, or --tls-self-signed"
            );
        }
        let listener = TcpListener::bind(listen).with_context(|| format!("--listen {listen}"))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let secure = tls.is_some();
        let scheme = if secure { "https" } else { "http" };
        let names = ["localhost".to_owned(), "127.0.0.1".to_owned(), address.ip().to_string()];
        let tls = tls.map(|tls| tls::configuration(&tls, names.to_vec())).transpose()?;
        tokio::task::spawn_blocking(files::prepare).await?;
        let shared = Arc::new(Shared {
            upstream: Upstream::start(endpoints, !view_only),
            counters: Counters::default(),
            access: Mutex::new(Access::new(scheme, &origins)),
            // Browsers do not tell the ports of a host apart.
            cookie: format!("palpate-{}", address.port()),
            secure,
        });
        let router = Router::new()
            .route("/", get(index))
            .route("/who", get(who))
            .route("/socket", get(socket))
            .route("/picture/{surface}/{number}", get(picture))
            .route("/{*file}", get(file))
            .with_state(shared.clone())
            .into_make_service();
        let handle = Handle::new();
        let (serving, fingerprint) = match tls {
            Some((config, fingerprint)) => {
                let server = axum_server::from_tcp_rustls(listener, config)?.handle(handle.clone());
                (tokio::spawn(server.serve(router)), Some(fingerprint))
            }
            None => (tokio::spawn(axum_server::from_tcp(listener)?.handle(handle.clone()).serve(router)), None),
        };
        Ok(Self { shared, handle, address, fingerprint, serving })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// SHA-256 fingerprint of the certificate, as browsers show it; `None` without TLS.
    pub fn fingerprint(&self) -> Option<&str> {
        self.fingerprint.as_deref()
    }

    /// A new address that lets one browser in.
    pub fn invite(&self, rights: Rights) -> String {
        let scheme = if self.shared.secure { "https" } else { "http" };
        let host = match self.address.ip() {
            ip if ip.is_unspecified() || ip.is_loopback() => "localhost".to_owned(),
            IpAddr::V6(ip) => format!("[{ip}]"),
            ip => ip.to_string(),
        };
        format!("{scheme}://{host}:{}{}", self.address.port(), self.shared.invite(rights))
    }

    /// What has happened so far.
    pub fn counters(&self) -> &Counters {
        &self.shared.counters
    }

    /// Ends it: takes no more visitors, and gives open pages a second.
    pub async fn stop(self) {
        self.handle.graceful_shutdown(Some(GRACE));
        let _ = self.serving.await;
    }
}

impl Shared {
    fn access(&self) -> MutexGuard<'_, Access> {
        self.access.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Path of an address that lets one browser in.
    pub fn invite(&self, rights: Rights) -> String {
        format!("/?token={}", self.access().invite(rights))
    }

    /// What the browser with these headers may do.
    fn rights(&self, headers: &HeaderMap) -> Option<Rights> {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        let (_, cookie) = pairs.find(|(name, _)| *name == self.cookie)?;
        self.access().rights(cookie, Instant::now())
    }
}

#[derive(Deserialize)]
struct Entry {
    token: Option<String>,
}

/// The page, for who has a cookie; a cookie, for who has a token.
async fn index(State(shared): State<Arc<Shared>>, Query(entry): Query<Entry>, headers: HeaderMap) -> Response<Body> {
    let known = shared.rights(&headers).is_some();
    let Some(token) = entry.token else {
        return if known { files::get("index.html", &headers) } else { door() };
    };
    let home = (header::LOCATION, "/");
    let cookie = shared.access().enter(&token, Instant::now());
    match cookie {
        Some(cookie) => {
            let secure = if shared.secure { "; Secure" } else { "" };
            let age = VISIT.as_secs();
            let set = format!("{}={cookie}; Path=/; HttpOnly; SameSite=Lax; Max-Age={age}{secure}", shared.cookie);
            files::respond(StatusCode::SEE_OTHER, &[home, (header::SET_COOKIE, &set)], Bytes::new())
        }
        // The address by which it came in, once more.
        None if known => files::respond(StatusCode::SEE_OTHER, &[home], Bytes::new()),
        None => door(),
    }
}

fn door() -> Response<Body> {
    let kind = (header::CONTENT_TYPE, "text/html; charset=utf-8");
    files::respond(StatusCode::FORBIDDEN, &[kind], Bytes::from_static(files::DOOR))
}

/// Whether the browser is known: a page whose WebSocket is refused cannot see why.
async fn who(State(shared): State<Arc<Shared>>, headers: HeaderMap) -> Response<Body> {
    let status = if shared.rights(&headers).is_some() { StatusCode::NO_CONTENT } else { StatusCode::FORBIDDEN };
    files::respond(status, &[], Bytes::new())
}

async fn file(Path(name): Path<String>, headers: HeaderMap) -> Response<Body> {
    files::get(&name, &headers)
}

/// A picture on the organ, by the numbers of its surface and its own, for who has a cookie.
async fn picture(
    State(shared): State<Arc<Shared>>,
    Path((surface, number)): Path<(u32, u32)>,
    headers: HeaderMap,
) -> Response<Body> {
    if shared.rights(&headers).is_none() {
        return door();
    }
    let link = shared.upstream.link().borrow().clone();
    let (status, fault) = match link {
        Link::Waiting(fault) => (StatusCode::SERVICE_UNAVAILABLE, fault),
        Link::Open(world) if world.number != surface => (StatusCode::NOT_FOUND, "another surface is shown now".into()),
        Link::Open(world) => match world.pictures().await.map(|pictures| pictures.get(&number)) {
            Ok(Some(picture)) => {
                let kind = (header::CONTENT_TYPE, &picture.media_type[..]);
                return files::respond(StatusCode::OK, &[kind], picture.bytes.clone());
            }
            Ok(None) => (StatusCode::NOT_FOUND, format!("there is no picture {number} in PNG or JPEG")),
            Err(fault) => (StatusCode::BAD_GATEWAY, fault),
        },
    };
    files::respond(status, &[], fault.into())
}

/// Counts a page until it is dropped.
struct Seat(Arc<Shared>);

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.counters.pages.fetch_sub(1, Relaxed);
    }
}

async fn socket(State(shared): State<Arc<Shared>>, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response<Body> {
    let refuse = |status, why: &'static str| {
        shared.counters.pages_refused.fetch_add(1, Relaxed);
        files::respond(status, &[], Bytes::from_static(why.as_bytes()))
    };
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default();
    if !shared.access().admits(text(header::ORIGIN), text(header::HOST)) {
        return refuse(StatusCode::FORBIDDEN, "pages of this origin may not connect: see --origin");
    }
    let Some(rights) = shared.rights(&headers) else {
        return refuse(StatusCode::FORBIDDEN, "an address with a fresh token lets you in");
    };
    let before = shared.counters.pages.fetch_add(1, Relaxed);
    let seat = Seat(shared.clone());
    if before >= MOST_PAGES {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, "there are as many pages as there may be");
    }
    upgrade
        .max_message_size(message::LONGEST)
        .max_frame_size(message::LONGEST)
        .max_write_buffer_size(BUFFER)
        .on_upgrade(async move |socket| {
            page::serve(socket, rights, shared).await;
            drop(seat);
        })
}
