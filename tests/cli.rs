//! The command line: what a user types, and what it says when something is wrong.

#[path = "common/ports.rs"]
mod ports;

use assert_cmd::Command;
use palpate_core::model::element_kernel::Simd;
use std::fs;
use std::path::Path;

fn palpate(arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).timeout(std::time::Duration::from_secs(120)).assert()
}

fn stderr(outcome: &assert_cmd::assert::Assert) -> String {
    String::from_utf8_lossy(&outcome.get_output().stderr).into_owned()
}

fn trajectory(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/trajectories").join(format!("{name}.csv")).display().to_string()
}

#[test]
fn simulate_writes_samples_a_summary_and_a_recording_that_replays() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let recording = folder.path().join("run.mcap");
    palpate(&[
        "simulate",
        "cube",
        "--seconds",
        "2",
        "--trajectory",
        &trajectory("press"),
        "--set",
        "body.active_level=1",
        "--out",
        out.to_str().unwrap(),
        "--record",
        recording.to_str().unwrap(),
    ])
    .success();
    let summary: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!(summary["ticks"], 2000);
    assert!(summary["peak_physical_force"][0].as_f64().unwrap() > 0.1);

    let mut samples = csv::Reader::from_path(out.join("samples.csv")).unwrap();
    let header = samples.headers().unwrap().clone();
    let rows: Vec<Vec<f64>> = samples.deserialize().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 2000);
    assert!(rows.iter().all(|r| r.len() == header.len()));
    let column = |name: &str| {
        let at = header.iter().position(|h| h == name).unwrap_or_else(|| panic!("no column {name}"));
        rows.iter().map(move |r| r[at])
    };
    assert!(column("ball_force_z_N").fold(0.0, f64::max) > 0.1);
    assert_eq!(column("active_nodes_level1").next(), Some(216.0));
    assert_eq!(column("active_nodes_level2").next(), Some(0.0));
    // The probe under the ball is pushed down, and the parts of the energy add up.
    assert!(column("top_uz_m").fold(0.0, f64::min) < -0.003);
    let parts = column("kinetic_J").zip(column("elastic_J")).zip(column("gravity_J")).zip(column("total_J"));
    for (((kinetic, elastic), gravity), total) in parts {
        assert!((kinetic + elastic + gravity - total).abs() < 1e-12);
    }
    for name in ["ball_torque_x_Nm", "px_kgm_s", "lz_kgm2_s", "element_evaluations", "smallest_det_F"] {
        assert!(column(name).all(f64::is_finite), "{name}");
    }
    let said = palpate(&["replay", recording.to_str().unwrap()]).success();
    assert!(String::from_utf8_lossy(&said.get_output().stdout).contains("identical: 2000 ticks"));
}

#[test]
fn mistakes_are_named_with_file_line_and_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("my.toml");
    let run = |scene: &str, more: &[&str]| {
        let out = folder.path().join("out").display().to_string();
        let arguments = [&["simulate", scene, "--seconds", "0.01", "--out", &out][..], more].concat();
        stderr(&palpate(&arguments).failure())
    };
    fs::write(&scene, "name = \"x\"\n[body]\nsource = \"box\"\n\n[material]\nyoung = 5e3\n").unwrap();
    let e = run(scene.to_str().unwrap(), &[]);
    assert!(e.contains("my.toml") && e.contains("line 6") && e.contains("youngs_modulus"), "{e}");

    fs::write(&scene, "name = \"x\"\n[body]\nsource = \"box\"\n\n[material]\npoisson_ratio = 0.5\n").unwrap();
    let e = run(scene.to_str().unwrap(), &[]);
    assert!(e.contains("my.toml, line 6: material.poisson_ratio") && e.contains("0.49"), "{e}");

    fs::write(&scene, "name = \"x\"\n[body]\nsource = \"surface\"\nfile = \"lost.stl\"\nunit = \"mm\"\n").unwrap();
    let e = run(scene.to_str().unwrap(), &[]);
    assert!(e.contains("lost.stl"), "{e}");

    let e = run("liver", &["--set", "material.stiffness=3"]);
    assert!(e.contains("stiffness") && e.contains("youngs_modulus"), "{e}");
    let e = run("spleen", &[]);
    assert!(e.contains("spleen") && e.contains("liver, organs, toy, cube, grasp, squeeze, laparoscopy, organ"), "{e}");
    let e = run("cube", &["--trajectory", "nowhere.csv"]);
    assert!(e.contains("nowhere.csv"), "{e}");
    let bad = folder.path().join("bad.csv");
    fs::write(&bad, "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw,buttons\n0,0,0,0,oops,0,0,0,1,0\n").unwrap();
    let e = run("cube", &["--trajectory", bad.to_str().unwrap()]);
    assert!(e.contains("bad.csv, line 2") && e.contains("oops"), "{e}");

    // Neither a file nor a cause is named twice.
    let e = run("lost.toml", &[]);
    assert_eq!(e.matches("os error").count(), 1, "{e}");
    fs::write(folder.path().join("body.veg"), "*VERTICES").unwrap();
    for (name, reason) in [("body.veg", "this kind of file"), ("lost.stl", "os error")] {
        let file = folder.path().join(name).display().to_string();
        let e = stderr(&palpate(&["prepare", &file, "--unit", "mm", "--check"]).failure());
        let e = e.lines().last().unwrap_or_default();
        assert!(e.matches(name).count() == 1 && e.matches(reason).count() == 1, "{e}");
    }
}

#[test]
fn the_demo_ends_by_itself_with_a_summary() {
    // Ports of its own, so that it runs beside other servers.
    let (force, surface) = free_endpoints();
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("demo.mcap");
    let outcome = palpate(&[
        "demo",
        "--scene",
        "cube",
        "--set",
        "body.active_level=1",
        "--seconds",
        "4",
        "--pattern",
        "press",
        "--force-endpoint",
        &force,
        "--surface-endpoint",
        &surface,
        "--record",
        recording.to_str().unwrap(),
    ])
    .success();
    let text = String::from_utf8_lossy(&outcome.get_output().stdout).into_owned();
    for part in ["tick lateness", "compute per tick", "pose to wrench", "bare round trip", "recorded", "force: peak"] {
        assert!(text.contains(part), "{part} in:\n{text}");
    }
    assert!(stderr(&outcome).contains("frames/s"));
    let said = palpate(&["replay", recording.to_str().unwrap()]).success();
    let said = String::from_utf8_lossy(&said.get_output().stdout).into_owned();
    assert!(said.contains("identical") && !said.contains("differs"), "{said}");
}

/// A server process that ends with the test.
struct Serving(std::process::Child);
impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn record_starts_and_stops_a_recording_on_a_running_server() {
    let (force, surface) = free_endpoints();
    let folder = tempfile::tempdir().unwrap();
    let server = std::process::Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["serve", "--scene", "cube", "--set", "body.active_level=0", "--set", "world.settle=0"])
        .args(["--force-endpoint", &force, "--surface-endpoint", &surface])
        .args(["--recordings", folder.path().to_str().unwrap()])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let serving = Serving(server);
    let record = |name: &str| palpate(&["record", name, "--seconds", "1", "--surface-endpoint", &surface]);
    // The client waits up to five seconds for the server to come up.
    let said = record("swing.mcap").success();
    let text = String::from_utf8_lossy(&said.get_output().stdout).into_owned();
    assert!(text.contains("swing.mcap") && text.contains("ticks from"), "{text}");
    let listed = palpate(&["list", "--connect", &surface]).success();
    assert_eq!(String::from_utf8_lossy(&listed.get_output().stdout), "main: cube; ball (free)\n");
    let set = |parameters: &[&str]| palpate(&[&["set", "--surface-endpoint", &surface], parameters].concat());
    set(&["stiffness.cube=2", "gravity=[0, 0, -1.5]", "shape.ball=ball"]).success();
    let listed = set(&[]).success();
    let listed = String::from_utf8_lossy(&listed.get_output().stdout).into_owned();
    assert!(listed.contains("gravity=[0.0, 0.0, -1.5] (-100 to 100)\n"), "{listed}");
    assert!(listed.contains("stiffness.cube=2 (0.05 to 20)\n"), "{listed}");
    assert!(listed.contains("shape.ball=0 (0 to 0)\n"), "{listed}");
    for (wrong, words) in [
        ("damping=2", "damping is 2: 0.1 to 1"),
        ("damping", "write name=value"),
        ("gravity=up", "a number"),
        ("shape.ball=saw", "no tool of that name"),
        ("shape.ball=0.5", "the number of a tool"),
        ("shape.ball=1", "shape.ball is 1: 0 to 0"),
    ] {
        let refused = stderr(&set(&[wrong]).failure());
        assert!(refused.contains(words), "{refused}");
    }
    let refused = stderr(&record("../swing.mcap").failure());
    assert!(refused.contains("below the server's recordings folder"), "{refused}");
    drop(serving);
    let file = folder.path().join("swing.mcap");
    let said = palpate(&["replay", file.to_str().unwrap()]).success();
    let text = String::from_utf8_lossy(&said.get_output().stdout).into_owned();
    let ticks: u64 = text.split("identical: ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((500..2000).contains(&ticks), "{text}");
    let gone = stderr(&palpate(&["record", "x.mcap", "--surface-endpoint", &surface]).failure());
    assert!(gone.contains(&surface), "{gone}");
    let gone = stderr(&palpate(&["list", "--connect", &surface]).failure());
    assert!(gone.contains(&surface), "{gone}");
}

#[test]
fn a_router_that_is_no_endpoint_is_refused_before_the_body_is_built() {
    for router in ["nonsense", "10.0.0.2:7447", ""] {
        let e = stderr(&palpate(&[&["serve"], &SMALL[..], &["--connect", router]].concat()).failure());
        assert_eq!(e.lines().count(), 1, "no work before it: {e}");
        assert!(e.contains(&format!("cannot connect to {router}: ")) && e.contains("Remedy: give --connect"), "{e}");
    }
}

/// Two endpoints of this machine that nobody listens on.
fn free_endpoints() -> (String, String) {
    (ports::free_endpoint(), ports::free_endpoint())
}

const SMALL: [&str; 6] = ["--scene", "cube", "--set", "body.active_level=0", "--set", "world.settle=0"];

#[test]
fn a_log_in_a_file_has_no_colours() {
    let (force, surface) = free_endpoints();
    let ends = ["--force-endpoint", &force, "--surface-endpoint", &surface, "--seconds", "0.2"];
    let said = stderr(&palpate(&[&["serve"], &SMALL[..], &ends].concat()).success());
    assert!(said.contains("INFO palpate") && !said.contains('\x1b'), "{said:?}");
}

#[test]
fn a_second_server_on_a_taken_port_says_which_option_gives_another() {
    let other = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = format!("tcp/{}", other.local_addr().unwrap());
    let (force, surface) = free_endpoints();
    for (force, surface, option) in [(&taken, &surface, "--force-endpoint"), (&force, &taken, "--surface-endpoint")] {
        let ends = ["--force-endpoint", force, "--surface-endpoint", surface, "--seconds", "0.2"];
        let e = stderr(&palpate(&[&["serve"], &SMALL[..], &ends].concat()).failure());
        let e = e.lines().last().unwrap_or_default();
        assert!(e.contains(&format!("cannot listen on {taken}: Address already in use")), "{e}");
        assert!(e.contains(&format!("give another with {option}")), "{e}");
    }
}

#[test]
fn places_that_cannot_be_written_are_refused_before_the_work_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    fs::write(at("plain"), "kept").unwrap();
    fs::write(at("ball.obj"), "v 0 0 0\n").unwrap();
    let refused = |arguments: &[&str], option: &str, remedy: &str| {
        let e = stderr(&palpate(arguments).failure());
        assert_eq!(e.lines().count(), 1, "no work before it: {e}");
        assert!(e.contains(option) && e.contains("Remedy: ") && e.contains(remedy), "{e}");
    };
    let simulate = ["simulate", "cube", "--seconds", "0.01", "--out"];
    for (record, remedy) in
        [("lost/x.mcap", "make the folder"), ("plain/x.mcap", "is no folder"), ("", "name a file in it")]
    {
        let record = at(record);
        refused(&[&["serve"], &SMALL[..], &["--record", &record]].concat(), "--record", remedy);
        refused(&["demo", "--scene", "cube", "--plain", "--record", &record], "--record", remedy);
        refused(&[&simulate[..], &[&at("out"), "--record", &record]].concat(), "--record", remedy);
        refused(&["prepare", &at("ball.obj"), "--unit", "mm", "-o", &record], "-o", remedy);
    }
    refused(&[&simulate[..], &[&at("plain")]].concat(), "--out", "must not be a file");
    refused(&[&simulate[..], &[&at("plain/out")]].concat(), "--out", "must not be a file");
    assert_eq!(fs::read_to_string(at("plain")).unwrap(), "kept");
}

#[test]
fn an_unknown_key_is_named_where_it_was_given_with_those_that_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    let run = |scene: &str, set: &[&str]| {
        let set = set.iter().flat_map(|s| ["--set", s]).collect::<Vec<_>>();
        stderr(&palpate(&[&["simulate", scene, "--seconds", "0.01", "--out", &out], &set[..]].concat()).failure())
    };
    for (given, known) in [
        ("material.densty=900", "`density`"),
        ("tool.radus=0.01", "`radius`"),
        ("materials.density=900", "`material`"),
        ("foo=1", "`world`"),
    ] {
        // It is the wrong one of several that is named, and no line of a text that nobody wrote.
        let e = run("cube", &["world.settle=0", given]);
        assert!(
            e.contains(&format!("--set {given}: unknown field")) && e.contains(known) && !e.contains("line"),
            "{e}"
        );
    }
    let e = run("cube", &["material.density=heavy"]);
    assert!(e.contains("--set material.density=heavy: invalid type"), "{e}");
    let scene = folder.path().join("my.toml");
    fs::write(&scene, "name = \"x\"\n[body]\nsource = \"box\"\n[materials]\n").unwrap();
    for set in [&[][..], &["world.settle=0"]] {
        let e = run(scene.to_str().unwrap(), set);
        assert!(e.contains("my.toml") && e.contains("unknown field `materials`") && e.contains("`material`"), "{e}");
    }
}

#[test]
fn help_lists_every_bundled_scene_and_the_values_of_every_choice() {
    let help = |command: &str| {
        let said = palpate(&[command, "--help"]).success();
        String::from_utf8_lossy(&said.get_output().stdout).split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let scenes = palpate::scene::BUNDLED.map(|(name, _)| name).join(", ");
    for command in ["demo", "serve", "simulate"] {
        assert!(help(command).contains(&format!("a bundled scene: {scenes}")), "{}", help(command));
    }
    for (command, option, wrong, known) in [
        ("prepare", "--unit", "ft", "m, cm, mm, in"),
        ("demo", "--pattern", "poke", "press, palpate, stroke, tap, tremor, turn, grasp"),
        ("demo", "--render", "fast", "raw, passive, local, local-passive"),
    ] {
        let e = stderr(&palpate(&[command, option, wrong]).failure());
        assert!(e.contains(wrong) && e.contains(&format!("[possible values: {known}]")), "{e}");
        assert!(known.split(", ").all(|name| help(command).contains(name)), "{}", help(command));
    }
    let forms = Simd::ALL.map(Simd::name).join(", ");
    assert!(help("replay").contains(&format!("[possible values: {forms}]")), "{}", help("replay"));
}

#[test]
fn a_recording_replays_on_each_form_of_the_kernel_that_the_cpu_has() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let simulate = ["simulate", "cube", "--seconds", "0.1", "--set", "body.active_level=0", "--set", "world.settle=0"];
    palpate(&[&simulate[..], &["--out", &at("out"), "--record", &at("run.mcap")]].concat()).success();
    for path in Simd::ALL {
        let outcome = palpate(&["replay", &at("run.mcap"), "--kernel", path.name()]);
        if path.is_available() {
            let said = outcome.success();
            let said = String::from_utf8_lossy(&said.get_output().stdout).into_owned();
            assert!(said.contains("identical: 100 ticks") && said.lines().count() == 1, "{said}");
        } else {
            let e = stderr(&outcome.failure());
            assert!(e.contains("this CPU cannot run it") && e.contains("portable"), "{e}");
        }
    }
    let e = stderr(&palpate(&["replay", &at("run.mcap"), "--kernel", "sse9"]).failure());
    assert!(e.contains("sse9") && e.contains("avx512"), "{e}");
}
