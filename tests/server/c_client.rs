//! A program in C on the real server.

#[path = "../../clients/sdk/tests/c_program/mod.rs"]
mod c_program;

use crate::serve;
use crate::viewers::Viewer;
use c_program::{Linked, compile_example, held_forces, run};
use palpate_sdk::{Connection, Moment, WatchOptions};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

#[test]
fn the_example_in_c_feels_the_real_body() {
    let running = serve();
    let program = running.folder.path().join("touch");
    compile_example(&Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/sdk"), "touch", Linked::Shared, &program);
    let viewer = Connection::open_surface(&running.endpoints).unwrap();
    let viewer = Viewer::watch(&viewer, WatchOptions::default());
    let endpoints = &running.endpoints;
    // The ball ends 8 mm deep in the middle of the top.
    let place = ["0.05", "0.05", "0.111"];
    let said = run(Command::new(&program).args([&endpoints.force, &endpoints.surface, &endpoints.session]).args(place));
    let force = |moment: &Arc<Moment>| moment.tools.first().map_or(0.0, |tool| f64::from(tool.force[2]));
    let shown = viewer.stop().iter().map(force).fold(0.0, f64::max);
    let felt = held_forces(&said).into_iter().fold(0.0, f64::max);
    println!("felt {felt} N, shown {shown} N");
    assert!(said.starts_with("session test: cube, 2 tools, the first a ball called left\n"), "{said}");
    assert!(said.contains("server at tick ") && said.contains(" 1 clients, said "), "{said}");
    assert!(felt > 0.1 && felt < 3.3, "{said}");
    // What it feels is what viewers see, within what the tissue yields between a press and a hold.
    assert!((felt / shown - 1.0).abs() < 0.1, "felt {felt} N, shown {shown} N\n{said}");
    assert_eq!(running.stop().restored_states, 0);
}
