//! Files in and out of the program: what `palpate prepare` says of meshes, and that no output costs an input, a good file
//! or the exit code.

use palpate_body::geometry::mesh_io::{LengthUnit, Solid};
use palpate_body::geometry::primitives::sphere_surface;
use palpate_body::prepare::bodies::one_body;
use palpate_body::prepare::input::Input;
use palpate_core::geometry::Surface;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::Vec3;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

#[path = "common/shared.rs"]
mod shared;
use shared::shared;

/// The program in `folder`.
fn palpate<S: AsRef<OsStr>>(folder: &Path, arguments: &[S]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.current_dir(folder).args(arguments);
    command
}

/// What it says to standard output and standard error together, and whether it succeeds.
fn said(output: &Output) -> (String, bool) {
    let text = [&output.stdout[..], &output.stderr].concat();
    (String::from_utf8_lossy(&text).into_owned(), output.status.success())
}

/// An OBJ file of `parts` in metres.
fn obj(parts: &[&Surface]) -> String {
    let (mut text, mut first) = (String::new(), 1);
    for part in parts {
        part.vertices.iter().for_each(|v| writeln!(text, "v {} {} {}", v.x, v.y, v.z).unwrap());
        part.triangles
            .iter()
            .for_each(|t| writeln!(text, "f {} {} {}", t[0] + first, t[1] + first, t[2] + first).unwrap());
        first += part.vertices.len() as u32;
    }
    text
}

/// A box of 0.1 m.
fn cube() -> Surface {
    box_surface(Vec3::repeat(0.1), [2; 3])
}

/// A ball of `radius` [m] around `centre`.
fn ball(radius: f64, centre: Vec3) -> Surface {
    let mut ball = sphere_surface(radius, 0.4 * radius);
    ball.vertices.iter_mut().for_each(|v| *v += centre);
    ball
}

const COARSE: [&str; 4] = ["--unit", "m", "--levels", "40mm"];

#[test]
fn specks_are_counted_and_a_second_body_is_refused_or_left_out_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (speck, other) = (ball(1e-4, Vec3::new(0.2, 0.0, 0.0)), ball(0.03, Vec3::new(0.3, 0.0, 0.0)));
    fs::write(at.join("specks.obj"), obj(&[&speck, &cube()])).unwrap();
    fs::write(at.join("two.obj"), obj(&[&other, &cube(), &speck])).unwrap();
    let run =
        |arguments: &[&str]| said(&palpate(at, &[arguments, &COARSE[..], &["--check"]].concat()).output().unwrap());
    let (text, good) = run(&["prepare", "specks.obj"]);
    assert!(good && text.contains("specks.obj: 1 specks dropped, the largest 0.3"), "{text}");
    let (text, good) = run(&["prepare", "two.obj"]);
    let sizes = text.contains("one 173.205 mm across") && text.contains("another 10");
    assert!(!good && text.contains("two.obj: 2 bodies") && sizes && text.contains("--largest"), "{text}");
    let (text, good) = run(&["prepare", "two.obj", "--largest"]);
    assert!(good && text.contains("two.obj: 1 specks dropped") && text.contains("1 other bodies dropped"), "{text}");

    // A scene takes the same files.
    let scene = |file: &str| {
        let text =
            format!("name = \"a\"\n[body]\nsource = \"surface\"\nfile = \"{file}\"\nunit = \"m\"\nspacings = [0.04]\n");
        fs::write(at.join("a.toml"), text + "[world]\nsettle = 0.0\n").unwrap();
        said(&palpate(at, &["simulate", "a.toml", "--seconds", "0.001", "--out", "out"]).output().unwrap())
    };
    let (text, good) = scene("specks.obj");
    assert!(good && text.contains("specks.obj: 1 specks dropped"), "{text}");
    let (text, good) = scene("two.obj");
    assert!(!good && text.contains("two.obj: 2 bodies in one file"), "{text}");
}

#[test]
fn no_output_takes_the_place_of_what_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("in.obj"), obj(&[&cube()])).unwrap();
    fs::hard_link(at.join("in.obj"), at.join("again.palpate")).unwrap();
    let mesh = palpate_core::geometry::primitives::box_mesh(Vec3::repeat(0.1), [2; 3]);
    let (mut node, mut ele) = (format!("{} 3\n", mesh.nodes.len()), format!("{} 4\n", mesh.elements.len()));
    mesh.nodes.iter().zip(1..).for_each(|(p, n)| writeln!(node, "{n} {} {} {}", p.x, p.y, p.z).unwrap());
    for (e, number) in mesh.elements.iter().zip(1..) {
        let [a, b, c, d] = e.map(|n| n + 1);
        writeln!(ele, "{number} {a} {b} {c} {d}").unwrap();
    }
    fs::write(at.join("box.node"), node).unwrap();
    fs::write(at.join("box.ele"), &ele).unwrap();
    let scene = "name = \"a\"\n[body]\nsource = \"surface\"\nfile = \"in.obj\"\nunit = \"m\"\nspacings = [0.04]\n";
    fs::write(at.join("a.toml"), scene).unwrap();
    let header = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw,buttons\n";
    fs::create_dir(at.join("out")).unwrap();
    fs::write(at.join("out/samples.csv"), header).unwrap();
    let simulate = ["simulate", "a.toml", "--seconds", "0.001", "--out", "out"];
    for (arguments, file) in [
        (&["prepare", "in.obj", "--unit", "m", "-o", "in.obj"][..], "in.obj"),
        (&["prepare", "in.obj", "--unit", "m", "-o", "again.palpate"], "in.obj"),
        (&["prepare", "in.obj", "--unit", "m", "-o", "a.toml", "--scene", "a.toml"], "a.toml"),
        (&["prepare", "box.node", "--unit", "m", "-o", "box.ele"], "box.ele"),
        (&[&simulate[..], &["--record", "in.obj"]].concat(), "in.obj"),
        (&[&simulate[..], &["--trajectory", "out/samples.csv"]].concat(), "out/samples.csv"),
        (&["serve", "--scene", "a.toml", "--record", "a.toml"], "a.toml"),
    ] {
        let before = fs::read(at.join(file)).unwrap();
        let (text, good) = said(&palpate(at, arguments).output().unwrap());
        assert!(!good && text.contains("the file that is read") && text.contains("Remedy: "), "{arguments:?}: {text}");
        assert_eq!(fs::read(at.join(file)).unwrap(), before, "{arguments:?}");
    }
}

#[test]
fn readers_that_go_and_full_devices_end_the_program_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("in.obj"), obj(&[&cube()])).unwrap();
    let prepare = [&["prepare", "in.obj", "-o", "a.palpate"][..], &COARSE].concat();
    let simulate = ["simulate", "a.palpate", "--seconds", "0.01", "--out", "out", "--set", "world.settle=0"];
    for (arguments, made) in [(&prepare[..], "a.palpate"), (&simulate[..], "out/summary.json")] {
        // Pipes whose reading ends are closed already.
        let closed = || std::io::pipe().unwrap().1;
        let status = palpate(at, arguments).stdout(closed()).stderr(closed()).status().unwrap();
        assert_eq!(status.code(), Some(0), "{arguments:?}");
        assert!(at.join(made).exists(), "{made}");
        if Path::new("/dev/full").exists() {
            let full = fs::File::options().write(true).open("/dev/full").unwrap();
            let output = palpate(at, arguments).stdout(full).stderr(Stdio::piped()).output().unwrap();
            let (text, _) = said(&output);
            assert_eq!(output.status.code(), Some(1), "{text}");
            assert!(text.contains("standard output: ") && !text.contains("panicked"), "{text}");
        }
    }
}

#[test]
fn names_may_be_of_any_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (mesh, body) = (OsStr::from_bytes(b"m\xe9.obj"), OsStr::from_bytes(b"b\xe9.palpate"));
    fs::write(at.join(mesh), obj(&[&cube()])).unwrap();
    let text = OsStr::new;
    let prepare = [text("prepare"), mesh, text("-o"), body];
    let (told, good) = said(&palpate(at, &prepare).args(COARSE).output().unwrap());
    assert!(good, "{told}");
    let run = ["--seconds", "0.01", "--out", "out", "--record", "run.mcap", "--set", "world.settle=0"];
    let (told, good) = said(&palpate(at, &[text("simulate"), body]).args(run).output().unwrap());
    assert!(good, "{told}");
    let (told, good) = said(&palpate(at, &["replay", "run.mcap", "--kernel", "portable"]).output().unwrap());
    assert!(good && told.contains("identical"), "{told}");
}

/// What a report says of the body in the file at `path`: its volume, what was repaired, found and left out, and its labels.
fn verdict(path: &Path, unit: LengthUnit) -> Result<String, String> {
    let input = Input::read(path, unit, 1.0, 0.0, None).map_err(|e| e.to_string())?;
    let mut said = input.said();
    let (solid, dropped) = one_body(input.solid, 0.03, false).map_err(|e| e.to_string())?;
    said.extend(dropped);
    let volume = match solid {
        Solid::Surface(surface) => surface.volume(),
        Solid::Volume(mesh) => {
            said.push(format!("labels '{}': {:?}", mesh.labels.name, mesh.volumes().keys().collect::<Vec<_>>()));
            (0..mesh.mesh.elements.len()).map(|e| mesh.mesh.volume(e)).sum()
        }
    };
    said.push(format!("{:.4} L", 1e3 * volume));
    Ok(said.join("; "))
}

#[test]
fn every_case_of_a_file_is_read_or_refused_with_the_true_reason() {
    let Some(cases) = shared("cases") else { return };
    let (m, mm) = (LengthUnit::Metre, LengthUnit::Millimetre);
    for (file, unit, taken, word) in [
        ("small/specks_3.stl", mm, true, "3 specks dropped"),
        ("small/voids_63.stl", mm, true, "0.4907 L"),
        ("small/voids_65.stl", mm, true, "0.4907 L"),
        ("small/last_digit.stl", mm, true, "in the last digits; 0.4908 L"),
        ("small/end_solid.stl", mm, true, "0.4024 L"),
        ("small/labels_int.vtk", mm, true, "labels 'material': [20, 21]"),
        ("small/labels_int32.vtk", mm, true, "labels 'material': [20, 21]"),
        ("partitioned.msh", mm, true, "labels 'physical': [7, 8]"),
        ("strips.ply", mm, true, "0.4949 L"),
        ("strips.vtk", mm, true, "0.4949 L"),
        ("strips.vtp", mm, true, "0.4949 L"),
        ("strips_mixed.vtp", mm, true, "0.4949 L"),
        ("utf16.obj", mm, true, "0.5059 L"),
        ("decimal_comma.obj", mm, false, "line 1: a vertex needs three numbers: '-26,286556' has a decimal comma"),
        ("short_header.node", mm, true, "labels: none in the file; labels '': []; 1.0000 L"),
        ("separate.gltf", m, true, "0.4949 L"),
        ("quantised.gltf", m, true, "0.4949 L"),
        ("ball.off", mm, true, "0.4949 L"),
        ("block.inp", mm, true, "labels 'elset': 1 is ORGAN; labels 'elset': [1]; 1.0000 L"),
        ("hexahedra.vtk", mm, false, "VTK's type 12, cannot be read"),
        ("hollow_cube.stl", mm, true, "0.8750 L"),
    ] {
        let found = verdict(&cases.join(file), unit);
        let text = found.as_ref().unwrap_or_else(|e| e);
        assert!(found.is_ok() == taken && text.contains(word), "{file}: {text}");
    }
}
