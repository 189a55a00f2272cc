//! The C interface as a C program meets it: the header with the system's compiler, and the examples, linked with the static
//! and the shared library, against the stand-in server.
#![cfg(unix)] // the flags are those of cc

mod c_program;
mod fake_server;

use std::{
    path::Path,
    process::{Command, Stdio},
    sync::atomic::Ordering::Relaxed,
    time::Duration,
};

use c_program::{Linked, compile_example, held_forces, run};
use fake_server::{FLOOR_STIFFNESS, FakeServer, TOOL_RADIUS, height};

fn sdk() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn the_header_is_clean_c99_and_cxx() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("header.c");
    std::fs::write(&file, "#include \"palpate.h\"\nint main(void) { return palpate_version() == NULL; }\n").unwrap();
    for (compiler, standard, language) in [("cc", "-std=c99", "c"), ("c++", "-std=c++11", "c++")] {
        let flags = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", standard, "-x", language];
        run(Command::new(compiler).args(flags).arg("-I").arg(sdk().join("include")).arg(&file));
    }
}

#[test]
fn the_example_in_c_feels_the_floor() {
    let server = FakeServer::current();
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("touch");
    compile_example(sdk(), "touch", Linked::Static, &program);

    let endpoints = &server.endpoints;
    let (running, arguments) =
        (program.clone(), [&endpoints.force, &endpoints.surface, &endpoints.session].map(String::clone));
    let running = std::thread::spawn(move || run(Command::new(running).args(arguments)));
    while !running.is_finished() {
        server.publish_status(4711);
        std::thread::sleep(Duration::from_millis(20));
    }
    let said = running.join().unwrap();
    assert!(said.starts_with("session fake: floor, 1 tools, the first a ball called ball\n"), "{said}");
    assert!(said.contains("server at tick 4711, 1000.0 ticks a second, 1 clients, said 0."), "{said}");
    assert!(said.contains(concat!("library ", env!("CARGO_PKG_VERSION"))), "{said}");
    // It ends 1 mm above the floor, under a ball's radius. On a busy machine a wrench may be late and its force fade.
    let expected = FLOOR_STIFFNESS * (TOOL_RADIUS - 1e-3);
    let most = held_forces(&said).into_iter().fold(0.0, f64::max);
    assert!((most / expected - 1.0).abs() < 1e-3, "{expected} N expected\n{said}");

    assert!(said.contains("held, engaged, newest wrench"), "{said}");

    // Errors are text.
    let elsewhere = Command::new(&program).args([&endpoints.force, &endpoints.surface, "a/b"]).output().unwrap();
    assert!(!elsewhere.status.success());
    let complaint = String::from_utf8_lossy(&elsewhere.stderr);
    assert!(complaint.contains("connect: 'a/b' cannot be a session name"), "{complaint}");
}

#[test]
fn the_example_in_c_says_when_its_tool_is_gone() {
    let server = FakeServer::current();
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("touch");
    compile_example(sdk(), "touch", Linked::Shared, &program);
    let endpoints = &server.endpoints;
    // In the air no force tells that wrenches have stopped.
    server.mute.store(true, Relaxed);
    let elsewhere = ["0", "0", "0.1"];
    let mut command = Command::new(&program);
    command.args([&endpoints.force, &endpoints.surface, &endpoints.session]).args(elsewhere);
    let output = command.output().unwrap();
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && complaint.contains("send a pose: the tool is gone"), "{complaint}");
}

#[test]
fn the_example_in_c_shows_the_surface() {
    let server = FakeServer::current();
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("watch");
    compile_example(sdk(), "watch", Linked::Shared, &program);
    let endpoints = &server.endpoints;
    let watching = Command::new(&program)
        .args([&endpoints.surface, &endpoints.session, "3"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let watching = std::thread::spawn(|| watching.wait_with_output().unwrap());
    for sequence in 16.. {
        if watching.is_finished() {
            break;
        }
        assert!(sequence < 3000, "it watches on");
        server.publish_status(sequence);
        server.publish_frame(sequence, false);
        std::thread::sleep(Duration::from_millis(20));
    }
    let output = watching.join().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "session fake: floor, 2.000 kg");
    assert!(lines.len() == 5 && lines[4].ends_with("1000.0 ticks a second, 0 late"), "{said}");
    for frame in &lines[1..4] {
        assert!(frame.contains("4 vertices, 2 triangles") && frame.ends_with("its normal 1.000 up"), "{frame}");
        let number = |before: &str| frame.split_once(before).unwrap().1.split([':', ' ']).next().unwrap().to_owned();
        let sequence: u64 = number("frame ").parse().unwrap();
        let highest: f64 = number("highest ").parse().unwrap();
        assert!((highest - height(sequence)).abs() < 2e-5, "{frame}");
    }
}

#[test]
fn the_header_declares_every_function_of_the_library() {
    let names = |text: &str, before: &str| -> std::collections::BTreeSet<String> {
        let name = |rest: &str| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
        let found = text.match_indices(before).map(|(at, _)| (at, name(&text[at + before.len()..])));
        found
            .filter(|(at, name)| text[at + before.len() + name.len()..].starts_with('('))
            .map(|(_, name)| name)
            .collect()
    };
    let read = |file: &str| std::fs::read_to_string(sdk().join(file)).unwrap();
    let code: String = ["mod", "session", "watch"].map(|file| read(&format!("src/c_api/{file}.rs"))).concat();
    let header: String = read("include/palpate.h").split("/*").map(|part| part.split("*/").last().unwrap()).collect();
    let declared = names(&header, "palpate_");
    assert_eq!(declared, names(&code, "extern \"C\" fn palpate_"));
    assert!(declared.len() > 15, "{declared:?}");
}
