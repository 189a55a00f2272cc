//! What a browser does, without one: cookies, and pages that speak over their WebSocket. Shared by the tests that need it.
#![allow(dead_code)] // each of them uses a part

use palpate_proto::{
    Attach, ControlReply, ControlRequest, Detach, Message as _, Session, SurfaceFrame, SurfaceTopology, ToolPose,
};
use palpate_proto::{Status, ToolWrench, control_request::Request};
use palpate_web::message::{self, Notice};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

/// An answer to a request.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|line| {
            let (key, value) = line.split_once(": ")?;
            key.eq_ignore_ascii_case(name).then_some(value)
        })
    }
}

/// Gets `path` from `host`, an address with its port.
pub fn get(host: &str, path: &str, headers: &[(&str, &str)]) -> Answer {
    let mut stream = TcpStream::connect(host).unwrap();
    let headers: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n").unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
    let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Answer { status, head, body: bytes[end + 4..].to_vec() }
}

/// Host with its port, and path, of an address.
pub fn split(address: &str) -> (String, String) {
    let rest = address.strip_prefix("http://").unwrap();
    let (host, path) = rest.split_once('/').unwrap();
    (host.replace("localhost", "127.0.0.1"), format!("/{path}"))
}

/// A browser with its cookie.
pub struct Visitor {
    pub host: String,
    pub cookie: String,
}

impl Visitor {
    /// Opens an address that lets one in.
    pub fn enter(address: &str) -> Self {
        let (host, path) = split(address);
        let answer = get(&host, &path, &[]);
        assert_eq!((answer.status, answer.header("location")), (303, Some("/")), "{answer:?}");
        let cookie = answer.header("set-cookie").unwrap();
        assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Lax"), "{cookie}");
        Self { host, cookie: cookie.split(';').next().unwrap().to_owned() }
    }

    pub fn get(&self, path: &str) -> Answer {
        get(&self.host, path, &[("Cookie", &self.cookie)])
    }

    /// Opens a WebSocket from a page of `origin`; the status of the answer where it is refused.
    pub fn socket(&self, origin: Option<&str>, cookie: Option<&str>) -> Result<WebSocket<TcpStream>, u16> {
        let mut request = format!("ws://{}/socket", self.host).into_client_request().unwrap();
        for (name, value) in [("origin", origin), ("cookie", cookie)] {
            value.map(|value| request.headers_mut().insert(name, HeaderValue::from_str(value).unwrap()));
        }
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(socket),
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(e) => panic!("{e}"),
        }
    }

    pub fn page(&self) -> Page {
        let origin = format!("http://{}", self.host);
        Page {
            socket: self.socket(Some(&origin), Some(&self.cookie)).unwrap(),
            sees: true,
            place: [0.05, 0.05, 0.12],
            sequence: 0,
        }
    }
}

/// A message to a page.
#[allow(clippy::large_enum_variant, reason = "one at a time")]
#[derive(Debug)]
pub enum Heard {
    Notice(Notice),
    Session(Session),
    Topology(SurfaceTopology),
    Frame(SurfaceFrame),
    Status,
    Wrench(ToolWrench),
    Reply(ControlReply),
    Closed(String),
    /// Nothing came within the socket's patience.
    Nothing,
}

/// A page with its WebSocket.
pub struct Page {
    pub socket: WebSocket<TcpStream>,
    /// Whether it says that it has decoded frames.
    pub sees: bool,
    /// Where its tool touches the body [m]: that of a ball of 20 mm in the middle of the cube's top.
    pub place: [f32; 3],
    sequence: u32,
}

impl Page {
    pub fn hear(&mut self) -> Heard {
        loop {
            let message = match self.socket.read() {
                Ok(message) => message,
                Err(tungstenite::Error::Io(e)) if e.kind() == std::io::ErrorKind::WouldBlock => return Heard::Nothing,
                Err(e) => return Heard::Closed(e.to_string()),
            };
            let bytes = match &message {
                Message::Text(text) => return Heard::Notice(serde_json::from_str(text).unwrap()),
                Message::Close(frame) => {
                    return Heard::Closed(frame.as_ref().map(|f| f.reason.to_string()).unwrap_or_default());
                }
                Message::Binary(bytes) => bytes,
                _ => continue,
            };
            let content = &bytes[1..];
            return match bytes[0] {
                message::SESSION => Heard::Session(Session::decode(content).unwrap()),
                message::SURFACE_TOPOLOGY => Heard::Topology(SurfaceTopology::decode(content).unwrap()),
                message::SURFACE_FRAME => {
                    let frame = SurfaceFrame::decode(content).unwrap();
                    if self.sees {
                        self.send(&[&[message::SEEN], &frame.sequence.to_le_bytes()[..]].concat());
                    }
                    Heard::Frame(frame)
                }
                message::STATUS => Status::decode(content).map(|_| Heard::Status).unwrap(),
                message::TOOL_WRENCH => Heard::Wrench(ToolWrench::decode(content).unwrap()),
                message::CONTROL_REPLY => Heard::Reply(ControlReply::decode(content).unwrap()),
                kind => panic!("there is no kind {kind}"),
            };
        }
    }

    /// Waits until the surface is there: so is the server then.
    pub fn ready(mut self) -> Self {
        self.wait("a frame", |heard| matches!(heard, Heard::Frame(_)).then_some(()));
        self
    }

    /// What `wanted` makes of the first message that it likes, within a minute.
    pub fn wait<T>(&mut self, what: &str, mut wanted: impl FnMut(Heard) -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            let heard = self.hear();
            if let Heard::Closed(reason) = &heard {
                let reason = reason.clone();
                return wanted(heard).unwrap_or_else(|| panic!("closed while waiting for {what}: {reason}"));
            }
            if let Some(found) = wanted(heard) {
                return found;
            }
            assert!(began.elapsed() < Duration::from_secs(60), "waited in vain: {what}");
        }
    }

    pub fn send(&mut self, bytes: &[u8]) {
        // A page that was closed hears of it when it reads.
        let _ = self.socket.send(Message::Binary(bytes.to_vec().into()));
    }

    pub fn ask(&mut self, request: Request) -> ControlReply {
        let request = ControlRequest { request: Some(request) };
        self.send(&[&[message::CONTROL], &request.encode_to_vec()[..]].concat());
        self.wait("a reply", |heard| match heard {
            Heard::Reply(reply) => Some(reply),
            _ => None,
        })
    }

    /// Tool and epoch of the tool called `tool`; why it cannot be had.
    pub fn attach(&mut self, tool: &str) -> Result<(u32, u32), String> {
        let attach = Attach { client: "test".into(), tool: tool.into(), rate_hz: 30.0, ..Default::default() };
        let reply = self.ask(Request::Attach(attach));
        reply.attached.map(|attached| (attached.tool, attached.epoch)).ok_or(reply.error)
    }

    /// Gives a tool back.
    pub fn give_back(&mut self, (tool, epoch): (u32, u32)) {
        assert_eq!(self.ask(Request::Detach(Detach { tool, epoch, secret: 0 })).error, "");
    }

    /// Sends the pose `height` [m] above its place; gives its sequence.
    pub fn pose(&mut self, (tool, epoch): (u32, u32), height: f32) -> u32 {
        self.sequence += 1;
        let pose = ToolPose {
            epoch,
            sequence: self.sequence,
            time_ns: 1000 * u64::from(self.sequence),
            position: vec![self.place[0], self.place[1], self.place[2] + height],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            buttons: 0,
            opening: 0.0,
            ..Default::default()
        };
        self.send(&[&[message::POSE, tool as u8], &pose.encode_to_vec()[..]].concat());
        self.sequence
    }

    /// Sends poses 90 times a second from one height to another [m] for so many; gives the newest wrench, if any came.
    pub fn press(&mut self, tool: (u32, u32), from: f32, to: f32, poses: u32) -> Option<ToolWrench> {
        let mut newest = None;
        for i in 1..=poses {
            self.pose(tool, from + (to - from) * i as f32 / poses as f32);
            let until = Instant::now() + Duration::from_millis(11);
            while Instant::now() < until {
                if let Heard::Wrench(wrench) = self.hear() {
                    newest = Some(wrench);
                }
            }
        }
        newest
    }
}
