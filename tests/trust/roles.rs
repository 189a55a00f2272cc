//! A server that asks for certificates: who is let in, and what each role may do.

#[path = "../../clients/sdk/tests/c_program/mod.rs"]
mod c_program;
#[path = "../../clients/devices/haply.rs"]
#[allow(dead_code, reason = "its main function reads arguments")]
mod haply;
#[path = "../../clients/sdk/tests/haply_service/mod.rs"]
mod haply_service;

use super::hand::{Hand, INSIDE, length};
use super::secured::{ROLES, SCENE, Secured, certificates};
use super::served::Served;
use super::stranger::stranger_with;
use palpate_proto::{self as proto, Message, control_request::Request, identity, keys};
use palpate_sdk::{Attachment, Connection, Endpoints, SdkError, WatchOptions};
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc;
use std::time::{Duration, Instant};
use zenoh::Wait;
use zenoh::sample::Sample;

const PROGRAM: &str = env!("CARGO_BIN_EXE_palpate");
const SESSION: &str = keys::DEFAULT_SESSION;

/// Sessions of `name` on both endpoints that keep to no contract.
fn strangers(secured: &Secured, name: &str) -> [zenoh::Session; 2] {
    let open = |endpoint: &String| stranger_with(endpoint, identity::settings(&secured.certificate(name)).unwrap());
    secured.served.endpoints.each_ref().map(open)
}

fn attachment(tool: &str) -> Attachment {
    Attachment { tool: tool.into(), ..Attachment::default() }
}

fn reset() -> Request {
    Request::Reset(proto::ResetBody {})
}

/// What a refusal says, which is no answer that never came.
fn words<T>(refused: Result<T, SdkError>) -> String {
    let error = refused.err().expect("a refusal");
    assert!(!matches!(error, SdkError::NoAnswer { .. }), "{error}");
    error.to_string()
}

/// The answer to `request` on `key`; `None`: there is none in a second.
fn asked(session: &zenoh::Session, key: String, request: Request) -> Option<proto::ControlReply> {
    let payload = proto::ControlRequest { request: Some(request) }.encode_to_vec();
    let replies = session.get(key).payload(payload).timeout(Duration::from_secs(1)).wait().unwrap();
    let reply = replies.recv().ok()?.into_result().ok()?;
    Some(proto::ControlReply::decode(&*reply.payload().to_bytes()).unwrap())
}

/// Keys on which anything comes to `sessions` from now on.
fn overheard(sessions: &[zenoh::Session], keys: &[String]) -> mpsc::Receiver<String> {
    let (heard, hear) = mpsc::channel();
    for (session, key) in sessions.iter().flat_map(|session| keys.iter().map(move |key| (session, key))) {
        let heard = heard.clone();
        let listen = move |sample: Sample| drop(heard.send(sample.key_expr().to_string()));
        session.declare_subscriber(key).callback(listen).background().wait().unwrap();
    }
    hear
}

#[test]
fn keys_are_their_owners_alone_and_certificates_that_are_there_stay() {
    let folder = tempfile::tempdir().unwrap();
    certificates(folder.path(), "anna = { role = \"viewer\" }", "certificates");
    let key = |of: &str| folder.path().join("certificates").join(of).join(identity::KEY);
    let owners: [PathBuf; 3] = ["authority", "server", "clients/anna"].map(key);
    let read = || owners.each_ref().map(|key| std::fs::read(key).unwrap());
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    for key in &owners {
        assert_eq!((mode(key), mode(key.parent().unwrap())), (0o600, 0o700), "{}", key.display());
    }
    let before = read();
    let said = certificates(folder.path(), "anna = { role = \"admin\" }\nbert = { role = \"viewer\" }", "certificates");
    assert!(said.contains("clients/anna: is there, and stays") && said.contains("clients/bert: made"), "{said}");
    assert!(before == read() && key("clients/bert").exists());
}

#[test]
fn who_has_no_certificate_or_that_of_another_authority_is_not_let_in() {
    let secured = Secured::start();
    certificates(secured.folder.path(), ROLES, "others");
    // The server's own certificate is none of a client.
    for identity in [None, Some("others/clients/root"), Some("certificates/server")] {
        let began = Instant::now();
        let error = Connection::open_surface(&secured.endpoints(identity)).err().expect("a refusal").to_string();
        println!("{identity:?}: {:?}: {error}", began.elapsed());
        assert!(error.contains("certificate"), "{identity:?}: {error}");
    }
    let missing = Connection::open_surface(&secured.endpoints(Some("nowhere"))).err().unwrap().to_string();
    assert!(missing.contains("nowhere/ca.pem"), "{missing}");
}

#[test]
fn nobody_with_a_client_s_certificate_can_stand_in_for_the_server() {
    let folder = tempfile::tempdir().unwrap();
    certificates(folder.path(), ROLES, "certificates");
    let at = |name: &str| folder.path().join("certificates/clients").join(name);
    let surface = format!("quic/{}", UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap());
    let mut config = zenoh::Config::default();
    let own = [("mode", "\"router\"".to_owned()), ("listen/endpoints", format!("[{surface:?}]"))];
    let own = own.map(|(key, value)| (key.to_owned(), value));
    for (key, value) in own.into_iter().chain(identity::settings(&at("root")).unwrap()) {
        config.insert_json5(&key, &value).unwrap();
    }
    let _false_server = zenoh::open(config).wait().unwrap();
    let endpoints = Endpoints { surface, identity: Some(at("anna")), ..Endpoints::default() };
    let error = Connection::open_surface(&endpoints).err().expect("a refusal").to_string();
    assert!(error.contains("certificate"), "{error}");
}

#[test]
fn who_has_a_certificate_and_no_role_is_told_so() {
    let secured = Secured::start();
    certificates(secured.folder.path(), "emma = { role = \"admin\" }", "certificates");
    let emma = secured.connect("emma");
    for refused in [words(emma.session()), words(emma.control(reset())), words(emma.attach(&attachment("")))] {
        assert!(refused.contains("no role for the name of this certificate"), "{refused}");
    }
    assert!(asked(&strangers(&secured, "emma")[1], keys::control(SESSION, "reset", "root"), reset()).is_none());
}

#[test]
fn a_viewer_gets_frames_and_no_wrenches_and_moves_nothing() {
    let secured = Secured::start();
    let mut hand = Hand::of(secured.connect("root"), "right", [0.05, 0.05]);
    hand.press();
    let wall = secured.connect("wall");
    assert_eq!(wall.role().unwrap(), proto::Role { name: "wall".into(), role: "viewer".into(), ..Default::default() });
    assert!(words(wall.attach(&attachment(""))).contains("wall is viewer on this server, and may not attach"));
    assert!(words(wall.control(reset())).contains("may not reset"));
    let watch = wall.watch_surface(WatchOptions::default()).unwrap();
    let strangers = strangers(&secured, "wall");
    let keys_of_others = ["**".into(), keys::all_tool_poses(SESSION), keys::all_tool_wrenches(SESSION)];
    let wrenches = keys::tool_wrench(SESSION, 1);
    let heard = overheard(&strangers, &[&keys_of_others[..], &[wrenches, keys::status(SESSION)]].concat());
    for who in ["root", "wall", keys::ANYBODY] {
        assert!(asked(&strangers[1], keys::control(SESSION, "reset", who), reset()).is_none(), "{who}");
    }
    let began = hand.tick();
    hand.hold_until(INSIDE, "two seconds of pressing", |wrench, _| wrench.tick > began + 2000);
    assert!(watch.latest().is_some_and(|moment| moment.tick + 500 > began), "no frames");
    let heard: Vec<String> = heard.try_iter().collect();
    assert!(!heard.is_empty() && heard.iter().all(|key| *key == keys::status(SESSION)), "{heard:?}");
    assert_eq!(hand.attached, 1);
}

#[test]
fn an_operator_has_tools_of_its_own_alone() {
    let secured = Secured::start();
    let anna = secured.connect("anna");
    assert_eq!(anna.role().unwrap().tools, [0]);
    assert!(words(anna.attach(&attachment("right"))).contains("no tool \"right\": there is left for you"));
    assert!(words(anna.control(reset())).contains("anna is operator on this server, and may not reset"));
    let mut hand = Hand::of(anna.clone(), "", [0.05, 0.05]);
    assert!(length(hand.press().force) > 0.1);
    assert!(words(anna.attach(&attachment(""))).contains("every tool is taken"));

    // Bert's tool, with all that Bert knows of it.
    let attach = |tool: &str| {
        Request::Attach(proto::Attach {
            tool: tool.into(),
            client: "bert".into(),
            rate_hz: 1000.0,
            ..Default::default()
        })
    };
    let attached = secured.connect("bert").control(attach("right")).unwrap().attached.unwrap();
    let send = |who: &zenoh::Session, sequence: u32| {
        let pose = proto::ToolPose {
            epoch: attached.epoch,
            secret: attached.secret,
            sequence,
            position: vec![0.05, 0.05, 0.2],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            ..Default::default()
        };
        who.put(keys::tool_pose(SESSION, 1), pose.encode_to_vec()).wait().unwrap();
    };
    let (of_anna, of_bert) = (strangers(&secured, "anna"), strangers(&secured, "bert"));
    let (answered, newest) = mpsc::channel();
    let listen = move |sample: Sample| {
        let wrench = proto::ToolWrench::decode(&*sample.payload().to_bytes()).unwrap();
        let _ = answered.send(wrench.pose_sequence);
    };
    of_bert[0].declare_subscriber(keys::tool_wrench(SESSION, 1)).callback(listen).background().wait().unwrap();
    let heard = overheard(&of_anna, &[keys::tool_wrench(SESSION, 1), keys::tool_wrench(SESSION, 0)]);
    for sequence in 1..200 {
        send(&of_anna[0], 1000 + sequence);
        send(&of_bert[0], sequence);
        hand.step(INSIDE);
    }
    let most = newest.try_iter().max();
    assert!((Some(1)..Some(1000)).contains(&most), "{most:?}");
    let heard: Vec<String> = heard.try_iter().collect();
    assert!(!heard.is_empty() && heard.iter().all(|key| *key == keys::tool_wrench(SESSION, 0)), "{heard:?}");
    for (who, tool) in [("bert", "right"), ("root", "right"), ("root", "")] {
        let key = keys::control(SESSION, "attach", who);
        assert!(asked(&of_anna[1], key, attach(tool)).is_none(), "anna in the name of {who}");
    }
    // A key says what is asked for on it, and in it there is room for nothing else.
    let reply = asked(&of_anna[1], keys::control(SESSION, "attach", "anna"), reset()).unwrap();
    assert!(reply.error.contains("a request to reset on"), "{reply:?}");
    assert!(asked(&of_anna[1], keys::all_control(SESSION), reset()).is_none());
}

#[test]
fn an_instructor_resets_and_records_and_does_not_touch() {
    let secured = Secured::start();
    let ines = secured.connect("ines");
    ines.control(reset()).unwrap();
    ines.set_parameters([("stiffness".to_owned(), vec![1.5])]).unwrap();
    let by_anna = secured.connect("anna").set_parameters([("stiffness".to_owned(), vec![1.0])]);
    assert!(words(by_anna).contains("anna is operator on this server, and may not set"));
    ines.control(Request::StartRecording(proto::StartRecording { path: "lesson.mcap".into() })).unwrap();
    std::thread::sleep(Duration::from_millis(200));
    let recorded = ines.control(Request::StopRecording(proto::StopRecording {})).unwrap().recording.unwrap();
    assert!(recorded.ticks > 0 && recorded.fault.is_empty(), "{recorded:?}");
    assert!(words(ines.attach(&attachment(""))).contains("ines is instructor on this server, and may not attach"));
    let [force, _] = strangers(&secured, "ines");
    let mut hand = Hand::of(secured.connect("anna"), "left", [0.05, 0.05]);
    hand.press();
    let heard = overheard(&[force], &["**".into(), keys::all_tool_wrenches(SESSION), keys::tool_wrench(SESSION, 0)]);
    let began = hand.tick();
    hand.hold_until(INSIDE, "half a second of pressing", |wrench, _| wrench.tick > began + 500);
    assert_eq!(heard.try_iter().collect::<Vec<_>>(), Vec::<String>::new());
}

#[test]
fn programs_show_the_certificates_that_they_are_given() {
    let secured = Secured::start();
    let [force, surface] = &secured.served.endpoints;
    let record = |name: &str| {
        let mut record = Command::new(PROGRAM);
        record.args(["record", "lesson.mcap", "--seconds", "0.2", "--surface-endpoint", surface, "--identity"]);
        let recorded = record.arg(secured.certificate(name)).output().unwrap();
        (recorded.status.success(), String::from_utf8_lossy(&recorded.stderr).into_owned())
    };
    let (is_recorded, said) = record("anna");
    assert!(!is_recorded && said.contains("anna is operator on this server, and may not record"), "{said}");
    assert!(record("ines").0);
    let program = secured.folder.path().join("touch");
    let sdk = Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/sdk");
    c_program::compile_example(&sdk, "touch", c_program::Linked::Shared, &program);
    let mut touch = Command::new(&program);
    touch.args([force, surface, SESSION, "0.05", "0.05", "0.111"]).env("PALPATE_IDENTITY", secured.certificate("anna"));
    let said = c_program::run(&mut touch);
    let felt = c_program::held_forces(&said).into_iter().fold(0.0, f64::max);
    assert!(felt > 0.1, "{said}");
}

#[test]
fn a_device_of_haply_touches_with_the_certificate_of_its_bridge() {
    let secured = Secured::start();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", listener.local_addr().unwrap());
    let endpoints = secured.endpoints(Some("certificates/clients/anna"));
    // Above the middle of the top; the ball's centre is 20 mm above its lowest point.
    let bridge =
        std::thread::spawn(move || haply::touch(&url, &endpoints, [0.05, 0.05, 0.1]).map_err(|e| e.to_string()));
    // Down to 8 mm below the top, once a second: what a busy machine silences comes from outside again.
    let hand = |t: f64| (0.040 - 0.028 * (2.0 * t.fract()).min(1.0), false);
    let mut felt = 0.0;
    haply_service::run(&listener, 8.0, hand, |_, force| felt = f64::max(felt, force));
    assert_eq!(bridge.join().unwrap(), Ok(()));
    assert!(felt > 0.1, "{felt} N");
}

#[test]
fn whoever_connects_on_this_machine_may_do_everything_without_a_certificate() {
    let folder = tempfile::tempdir().unwrap();
    let socket = |name: &str| format!("unixsock-stream/{}", folder.path().join(name).display());
    let sockets = Endpoints { force: socket("force"), surface: socket("surface"), ..Endpoints::default() };
    let mut serve = Command::new(PROGRAM);
    serve.current_dir(folder.path());
    for served in [Served::start_with(Command::new(PROGRAM), &[]), Served::at(serve, &SCENE, &sockets)] {
        let mut hand = Hand::new(&served.endpoints);
        assert!(length(hand.press().force) > 0.1);
        let [force, surface] = served.endpoints.clone();
        let connection = Connection::open(&Endpoints { force, surface, ..Endpoints::default() }).unwrap();
        connection.control(reset()).unwrap();
        let role = connection.role().unwrap();
        assert_eq!((&*role.name, &*role.role, role.actions.len()), (keys::ANYBODY, "admin", keys::ACTIONS.len()));
    }
}

#[test]
fn other_machines_are_let_in_with_roles_or_insecurely_in_words_that_cannot_be_missed() {
    let serve = |more: &[&str]| {
        let ends = ["--force-endpoint", "tcp/0.0.0.0:0", "--surface-endpoint", "tcp/127.0.0.1:0", "--seconds", "0.2"];
        let served = Command::new(PROGRAM).arg("serve").args(SCENE).args(ends).args(more).output().unwrap();
        (served.status.success(), String::from_utf8_lossy(&served.stderr).into_owned())
    };
    let (is_served, said) = serve(&[]);
    assert!(!is_served && said.contains("--force-endpoint tcp/0.0.0.0:0: whoever reaches it"), "{said}");
    assert!(said.contains("palpate certificates") && !said.contains("reading shapes"), "{said}");
    let (is_served, said) = serve(&["--insecure"]);
    assert!(is_served && said.contains("WARN") && said.contains("THIS IS INSECURE"), "{said}");
    let folder = tempfile::tempdir().unwrap();
    let roles = folder.path().join("roles.toml");
    std::fs::write(&roles, "anna = { role = \"operator\", tools = [\"scalpel\"] }").unwrap();
    let (is_served, said) = serve(&["--roles", roles.to_str().unwrap(), "--identity", "nowhere"]);
    assert!(!is_served && said.contains("no tool \"scalpel\": the scene has left, right"), "{said}");
    let file = folder.path().join("zenoh.json5");
    for (text, refused) in [
        ("{ mode: 'peer' }", "mode is the server's own"),
        ("{ transport: { link: { tx: { batch_size: 32000 } } } }", ""),
    ] {
        std::fs::write(&file, text).unwrap();
        let (is_served, said) = serve(&["--insecure", "--zenoh-config", file.to_str().unwrap()]);
        assert!(is_served == refused.is_empty() && said.contains(refused), "{text}: {said}");
        assert!(is_served || !said.contains("reading shapes"), "refused after the work: {said}");
    }
}
