//! Haply's Inverse3 in the hand: speaks to the Inverse service on this machine by its WebSocket, and renders the force at the rate
//! of the service. A button of a VerseGrip is the clutch.
//!
//!     cargo run --release -p palpate-sdk --example haply -- [URL [FORCE_ENDPOINT SURFACE_ENDPOINT SESSION [X Y Z]]]
//!
//! X Y Z \[m\] is the place in the body that the origin of the service's space is registered to.

use palpate_sdk::{
    Attachment, Clutch, Connection, Device, Endpoints, Frame, PoseSample, Registration, RenderMode, Renderer, Tool,
};
use serde_json::{Value, json};
use std::error::Error;
use std::net::TcpStream;
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket, stream::MaybeTlsStream};

/// Where the service listens by default.
const SERVICE: &str = "ws://localhost:10001";
/// Limits of the device.
const DEVICE: &str = include_str!("inverse3.toml");
/// Between two poses: the server takes no more.
const POSE_PERIOD: Duration = Duration::from_millis(1);
/// Before a tool that was lost is asked for again.
const AGAIN: Duration = Duration::from_secs(1);

/// The device, as the service has told of it so far: what does not change is left out of its messages.
struct Cursor {
    id: String,
    position: [f64; 3],
    velocity: [f64; 3],
    /// In the order of the service's frame: w, x, y, z.
    orientation: [f64; 4],
    clutch: bool,
}

impl Cursor {
    /// The first device in the service's first message.
    fn new(message: &Value) -> Result<Self, Box<dyn Error>> {
        let id = message["inverse3"][0]["device_id"].as_str().ok_or("the service knows no Inverse3")?;
        let [position, velocity] = [[0.0; 3]; 2];
        let mut cursor =
            Self { id: id.to_owned(), position, velocity, orientation: [1.0, 0.0, 0.0, 0.0], clutch: false };
        cursor.follow(message);
        Ok(cursor)
    }

    fn follow(&mut self, message: &Value) {
        let devices = message["inverse3"].as_array().into_iter().flatten();
        for state in devices.filter(|device| device["device_id"] == self.id.as_str()).map(|device| &device["state"]) {
            update(&mut self.position, &state["cursor_position"], ["x", "y", "z"]);
            update(&mut self.velocity, &state["cursor_velocity"], ["x", "y", "z"]);
        }
        let grips = ["verse_grip", "wireless_verse_grip"].into_iter().filter_map(|kind| message[kind].as_array());
        for state in grips.flatten().map(|grip| &grip["state"]) {
            update(&mut self.orientation, &state["orientation"], ["w", "x", "y", "z"]);
            // One button of a grip with a wire, three of one without.
            for button in [&state["button"], &state["buttons"]["a"]] {
                self.clutch = button.as_bool().unwrap_or(self.clutch);
            }
        }
    }
}

/// Takes over the numbers that `from` has.
fn update<const N: usize>(numbers: &mut [f64; N], from: &Value, names: [&str; N]) {
    for (number, name) in numbers.iter_mut().zip(names) {
        *number = from[name].as_f64().unwrap_or(*number);
    }
}

/// A tool in the hand.
struct Hand {
    tool: Tool,
    renderer: Renderer,
    clutch: Clutch,
    sent: Option<Instant>,
}

impl Hand {
    fn take(connection: &Connection, device: &Device, registration: &Registration) -> Result<Self, Box<dyn Error>> {
        Ok(Self {
            tool: connection.attach(&Attachment::of("haply", device, registration))?,
            renderer: Renderer::new(&registration.in_body(device), RenderMode::default()),
            clutch: Clutch::new(*registration),
            sent: None,
        })
    }

    /// The force [N] for where the cursor is, in its frame. Errors: the tool is gone.
    fn feel(&mut self, cursor: &Cursor, frame: &Frame) -> Result<[f64; 3], Box<dyn Error>> {
        let now_ns = self.tool.now_ns();
        let device = PoseSample {
            position: frame.position_in(cursor.position),
            orientation: frame.orientation_in(cursor.orientation),
            linear_velocity: Some(frame.velocity_in(cursor.velocity)),
            buttons: cursor.clutch.into(),
            opening: 0.0,
        };
        let in_body = self.clutch.follow(&device, cursor.clutch, now_ns);
        if self.sent.is_none_or(|sent| sent.elapsed() >= POSE_PERIOD) {
            self.tool.send_pose(in_body)?;
            self.sent = Some(Instant::now());
        }
        self.tool.check(now_ns)?;
        if let Some(received) = self.tool.latest_wrench().filter(|received| received.fresh) {
            self.renderer.receive(&received.wrench, received.arrival_ns);
        }
        let velocity = in_body.linear_velocity.unwrap_or_default();
        let force = self.renderer.force(in_body.position, velocity, self.tool.now_ns());
        let force = self.clutch.registration().force_to_device(force).map(|f| f * self.clutch.force_scale());
        Ok(frame.force_out(force))
    }
}

type Service = WebSocket<MaybeTlsStream<TcpStream>>;

/// The next message of the service; `None` when it has closed.
fn hear(service: &mut Service) -> Result<Option<Value>, Box<dyn Error>> {
    loop {
        match service.read() {
            Ok(Message::Text(text)) => return Ok(Some(serde_json::from_str(&text)?)),
            Ok(Message::Close(_)) | Err(tungstenite::Error::ConnectionClosed) => return Ok(None),
            Ok(_) => {}
            Err(error) => return Err(error.into()),
        }
    }
}

/// Lets the device behind the service at `url` touch a server's body, its origin at `place` \[m\], until the service ends.
pub fn touch(url: &str, endpoints: &Endpoints, place: [f64; 3]) -> Result<(), Box<dyn Error>> {
    let (mut service, _) =
        tungstenite::connect(url).map_err(|error| format!("the Inverse service at {url}: {error}"))?;
    let Some(first) = hear(&mut service)? else { return Err("the Inverse service closes at once".into()) };
    let mut cursor = Cursor::new(&first)?;
    let connection = Connection::open(endpoints)?;
    let device: Device = toml::from_str(DEVICE)?;
    let (frame, registration) = (Frame::by_name("haply")?, Registration::default().place([0.0; 3], place));
    let mut hand = Some(Hand::take(&connection, &device, &registration)?);
    let mut again = Instant::now();
    // Its name for people, once.
    let mut session = Some(json!({ "configure": { "profile": { "name": "palpate:haply" } } }));
    loop {
        let felt = hand.as_mut().map(|hand| hand.feel(&cursor, &frame));
        let [x, y, z] = match felt {
            Some(Ok(force)) => force,
            lost => {
                // Without a force the device is free.
                if let Some(Err(error)) = lost {
                    eprintln!("no tool: {error}");
                    hand = None;
                    again = Instant::now() + AGAIN;
                } else if Instant::now() >= again {
                    hand = Hand::take(&connection, &device, &registration).ok();
                    again = Instant::now() + AGAIN;
                }
                [0.0; 3]
            }
        };
        let force = json!({ "set_cursor_force": { "vector": { "x": x, "y": y, "z": z } } });
        let mut message = json!({ "inverse3": [{ "device_id": cursor.id, "commands": force }] });
        if let Some(session) = session.take() {
            message["session"] = session;
        }
        // The service answers each message with where the device is now.
        match service.send(Message::text(message.to_string())) {
            Err(tungstenite::Error::ConnectionClosed | tungstenite::Error::AlreadyClosed) => return Ok(()),
            sent => sent?,
        }
        match hear(&mut service)? {
            Some(state) => cursor.follow(&state),
            None => return Ok(()),
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let identity = std::env::var_os("PALPATE_IDENTITY").map(Into::into);
    let mut endpoints = Endpoints { identity, ..Endpoints::default() };
    if let [_, force, surface, session, ..] = &arguments[..] {
        endpoints = Endpoints { force: force.clone(), surface: surface.clone(), session: session.clone(), ..endpoints };
    }
    let mut place = [0.0; 3];
    for (number, text) in place.iter_mut().zip(arguments.iter().skip(4)) {
        *number = text.parse()?;
    }
    touch(arguments.first().map_or(SERVICE, String::as_str), &endpoints, place)
}
