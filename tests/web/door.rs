//! Who gets in.

use crate::browser::{Heard, get, split};
use crate::{Server, Web, free_endpoints};
use palpate_proto::{Detach, ResetBody, control_request::Request};
use palpate_web::message::{Notice, Wish};
use palpate_web::{Gateway, Options, Rights, Tls};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use tungstenite::Message;

#[test]
fn an_address_opens_once_for_one_browser() {
    let web = Web::start(&free_endpoints());
    let address = web.gateway().invite(Rights::Viewer);
    let (host, path) = split(&address);
    assert_eq!(get(&host, "/", &[]).status, 403);
    assert_eq!(get(&host, "/?token=0123", &[]).status, 403);
    assert_eq!(get(&host, "/who", &[]).status, 403);
    let visitor = crate::Visitor::enter(&address);
    assert_eq!(get(&host, &path, &[]).status, 403, "a second time");
    assert_eq!(visitor.get(&path).status, 303, "the same browser again");
    let page = visitor.get("/");
    assert_eq!(page.status, 200);
    assert!(String::from_utf8_lossy(&page.body).contains("main.js"));
    assert_eq!(page.header("referrer-policy"), Some("no-referrer"));
    assert!(page.header("content-security-policy").unwrap().contains("frame-ancestors 'none'"));
    assert_eq!(visitor.get("/who").status, 204);
    let three = get(&host, "/vendor/three.min.js", &[("Accept-Encoding", "gzip")]);
    assert_eq!((three.status, three.header("content-encoding")), (200, Some("gzip")));
    assert!(three.body.len() < 200_000);
}

#[test]
fn foreign_pages_and_strangers_get_no_socket() {
    let mut options = Options {
        endpoints: free_endpoints(),
        listen: "127.0.0.1:0".parse().unwrap(),
        tls: None,
        origins: vec!["https://lab.example".into()],
        view_only: false,
    };
    let web = Web::with(options.clone());
    let visitor = web.visitor(Rights::Operator);
    let (own, cookie) = (format!("http://{}", visitor.host), Some(&visitor.cookie[..]));
    for origin in [None, Some("http://evil.example"), Some("null"), Some("http://127.0.0.1:1")] {
        assert_eq!(visitor.socket(origin, cookie).unwrap_err(), 403, "{origin:?}");
    }
    for cookie in [None, Some("palpate=1"), Some(&visitor.cookie[..visitor.cookie.len() - 1])] {
        assert_eq!(visitor.socket(Some(&own), cookie).unwrap_err(), 403, "{cookie:?}");
    }
    assert!(visitor.socket(Some(&own), cookie).is_ok());
    assert!(visitor.socket(Some("https://lab.example"), cookie).is_ok());
    assert_eq!(web.gateway().counters().pages_refused.load(std::sync::atomic::Ordering::Relaxed), 7);
    // To be reached from elsewhere takes TLS.
    options.listen = "0.0.0.0:0".parse().unwrap();
    let e = web.runtime.block_on(Gateway::start(options.clone())).err().unwrap().to_string();
    assert!(e.contains("--tls-self-signed"), "{e}");
    options.tls = Some(Tls::SelfSigned);
    let gateway = web.runtime.block_on(Gateway::start(options)).unwrap();
    assert!(gateway.invite(Rights::Viewer).starts_with("https://localhost:"));
    assert_eq!(gateway.fingerprint().unwrap().len(), 95);
    web.runtime.block_on(gateway.stop());
}

#[test]
fn a_viewer_sees_all_and_moves_nothing() {
    let endpoints = free_endpoints();
    let _server = Server::start(&endpoints);
    let web = Web::start(&endpoints);
    let mut viewer = web.page(Rights::Viewer);
    let rights = viewer.wait("a welcome", |heard| match heard {
        Heard::Notice(Notice::Welcome { rights }) => Some(rights),
        _ => None,
    });
    assert_eq!(rights, Rights::Viewer);
    let session = viewer.wait("a session", |heard| match heard {
        Heard::Session(session) => Some(session),
        _ => None,
    });
    assert_eq!(session.tools.len(), 2);
    viewer.wait("a topology", |heard| matches!(heard, Heard::Topology(_)).then_some(()));
    for _ in 0..5 {
        viewer.wait("a frame", |heard| matches!(heard, Heard::Frame(_)).then_some(()));
    }
    let no = "this page may watch, not touch";
    assert_eq!(viewer.attach("left").unwrap_err(), no);
    assert_eq!(viewer.ask(Request::Reset(ResetBody {})).error, no);
    assert_eq!(viewer.ask(Request::Detach(Detach { tool: 0, epoch: 1, secret: 0 })).error, no);
    let refusal = |heard| match heard {
        Heard::Notice(Notice::Refused { fault }) => Some(fault),
        _ => None,
    };
    viewer.pose((0, 1), 0.01);
    assert_eq!(viewer.wait("a refusal", refusal), no);
    let wish = serde_json::to_string(&Wish::Invite { rights: Rights::Operator }).unwrap();
    viewer.socket.send(Message::Text(wish.clone().into())).unwrap();
    assert_eq!(viewer.wait("a refusal", refusal), "this page may watch, not invite");

    // An operator may do all that; even the pose of a tool in somebody else's hand moves nothing.
    let mut operator = web.page(Rights::Operator).ready();
    let held = operator.attach("left").unwrap();
    viewer.pose(held, -0.01);
    let mut other = web.page(Rights::Operator).ready();
    assert!(other.attach("left").unwrap_err().contains("held by page test"));
    other.pose(held, -0.01);
    assert_eq!(other.wait("a refusal", refusal), "this page does not hold tool 0");
    operator.socket.send(Message::Text(wish.into())).unwrap();
    let path = operator.wait("an invitation", |heard| match heard {
        Heard::Notice(Notice::Invitation { path, rights: Rights::Operator }) => Some(path),
        _ => None,
    });
    let guest = crate::Visitor::enter(&format!("http://{}{path}", web.gateway().address()));
    guest.page().ready().attach("right").unwrap();
}

#[test]
fn without_rights_to_give_nobody_touches() {
    let endpoints = free_endpoints();
    let _server = Server::start(&endpoints);
    let mut child = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["web", "--view-only", "--listen", "127.0.0.1:0", "--surface-endpoint", &endpoints.surface])
        // Nobody is there.
        .args(["--force-endpoint", "tcp/127.0.0.1:1"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("to watch: ").unwrap_or_else(|| panic!("{line}"));
    let mut page = crate::Visitor::enter(address).page();
    page.wait("a frame", |heard| matches!(heard, Heard::Frame(_)).then_some(()));
    assert_eq!(page.attach("left").unwrap_err(), "this page may watch, not touch");
    child.kill().unwrap();
    child.wait().unwrap();
}
