//! `palpate prepare`: a body in one file is the body that its scene builds, and files that are none are refused.

use palpate::scene::LoadedScene;
use palpate_body::geometry::mesh_io::{LengthUnit, Solid};
use palpate_body::geometry::primitives::{liver_surface, toy_surface};
use palpate_body::prepare::body_check::check;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::inclusions::{Inclusion, Place};
use palpate_body::prepare::input::{Fineness, Input, shape};
use palpate_body::prepare::region::Reach;
use palpate_body::prepare::report::report;
use palpate_body::prepare::spacings;
use palpate_body::prepare::{Elements, Recipe, Region, Shape, prepare, refit};
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::geometry::{Moments, Surface};
use palpate_core::ids::Element;
use palpate_core::math::{Bounds, Mat3, Real, Vec3};
use palpate_core::model::{Body, Fibres, Material};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

#[path = "common/shared.rs"]
mod shared;
use shared::shared;

fn silent(_: &str, _: usize, _: usize) {}

fn palpate(arguments: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = assert_cmd::Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.args(arguments).timeout(std::time::Duration::from_secs(120)).assert()
}

fn stdout(outcome: &assert_cmd::assert::Assert) -> String {
    String::from_utf8_lossy(&outcome.get_output().stdout).into_owned()
}

fn stderr(outcome: &assert_cmd::assert::Assert) -> String {
    String::from_utf8_lossy(&outcome.get_output().stderr).into_owned()
}

/// An OBJ file of `surface` in millimetres.
fn obj(surface: &Surface) -> String {
    let mut text = String::new();
    surface.vertices.iter().for_each(|v| writeln!(text, "v {} {} {}", v.x * 1e3, v.y * 1e3, v.z * 1e3).unwrap());
    surface.triangles.iter().for_each(|t| writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
    text
}

fn load(scene: &Path, given: &[&str]) -> LoadedScene {
    LoadedScene::load(scene, &given.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()).unwrap()
}

/// A stiff place in the middle of the toy.
const NODULE: &str = "material.region=[{ centre = [0.0, 0.0, 0.13], radius = 0.015, youngs_modulus = 30000.0 }]";

#[test]
fn a_prepared_file_is_the_body_that_its_scene_builds_whoever_makes_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(path("toy.obj"), obj(&toy_surface(0.005))).unwrap();
    let made = |out: &str| {
        let levels =
            ["--levels", "22mm,13mm", "--display-vertices", "900", "--set", "material.density=1010", "--set", NODULE];
        let (mesh, out_path) = (path("toy.obj"), path(out));
        let arguments = [&["prepare", &mesh, "--unit", "mm", "-o", &out_path], &levels[..]].concat();
        let said = stdout(&palpate(&arguments).success());
        for word in ["level", "volume", "inertia", "step", "weight x, y, z", "in real time", "slowest mode", out] {
            assert!(said.contains(word), "{word}: {said}");
        }
        fs::read(path(out)).unwrap()
    };
    let bytes = made("one.palpate");
    assert!(bytes == made("another.palpate"), "the same input, the same bytes");

    let file = BodyFile::from_bytes(&bytes).unwrap();
    assert!(file.bytes() == bytes);
    assert_eq!(file.provenance.palpate, env!("CARGO_PKG_VERSION"));
    assert_eq!(file.provenance.inputs[0].name, "toy.obj");
    assert_eq!(file.provenance.inputs[0].checksum, xxhash_rust::xxh3::xxh3_64(&fs::read(path("toy.obj")).unwrap()));
    assert!(file.provenance.options.contains("--unit mm") && file.provenance.options.contains("--levels 22mm,13mm"));
    assert!(!String::from_utf8_lossy(&bytes).contains(&folder.path().display().to_string()), "no folder in the file");

    // The file as a scene, a scene that names it, and the scene that makes the same body from the mesh.
    let name = format!("body.file={:?}", path("toy.obj"));
    let keys =
        ["body.unit=mm", "body.display_vertices=900", "body.spacings=[0.022, 0.013]", "material.density=1010", NODULE];
    let from_mesh = load(Path::new("organ"), &[&[name.as_str(), "name=toy"], &keys[..]].concat());
    let from_mesh = from_mesh.build(&mut silent).unwrap();
    let itself = load(Path::new(&path("one.palpate")), &[]);
    assert_eq!((itself.scene.material.density, itself.scene.material.region.len()), (1010.0, 1));
    let itself_built = itself.build(&mut silent).unwrap();
    assert_eq!(itself_built.checksum(), from_mesh.checksum());
    fs::write(path("s.toml"), "name = \"toy\"\n[body]\nsource = \"prepared\"\nfile = \"one.palpate\"\n").unwrap();
    let named = load(Path::new(&path("s.toml")), &[]);
    assert_eq!((&named.scene.hold, &named.scene.material), (&itself.scene.hold, &itself.scene.material));
    assert_eq!(named.build(&mut silent).unwrap().checksum(), from_mesh.checksum());
    // What a recording keeps of such a scene needs no file.
    let recorded = palpate::scene::parse(&named.scene.to_toml(), "recorded").unwrap();
    assert_eq!(recorded, named.scene);

    let stiffer = load(Path::new(&path("s.toml")), &["material.youngs_modulus=9000"]).scene.material();
    assert!((stiffer.youngs_modulus() - 9000.0).abs() < 1e-6 && stiffer.density == 1010.0);
    let e = LoadedScene::load(Path::new(&path("s.toml")), &["body.scale=2.0".into()]).unwrap_err().to_string();
    assert!(e.contains("a prepared body is as it was prepared"), "{e}");
}

fn recipe(material: Material, contrast: Real, holds: Vec<Region>, damping_ratio: Real) -> Recipe {
    let shape = Shape::closed(liver_surface(0.008), vec![0.03, 0.019]);
    Recipe {
        name: "liver".into(),
        inclusions: nodule(material, contrast),
        shape,
        material,
        holds,
        elements: Default::default(),
        damping_ratio,
    }
}

/// A place in the middle of the liver that is stiffer by `contrast`.
fn nodule(rest: Material, contrast: Real) -> Vec<Inclusion> {
    let Bounds { low, high } = liver_surface(0.008).bounds();
    let place = Reach::Ball((low + high) / 2.0, 0.02);
    let (youngs_modulus, poisson_ratio) = (contrast * rest.youngs_modulus(), rest.poisson_ratio());
    vec![Inclusion {
        place: place.into(),
        youngs_modulus,
        poisson_ratio,
        density: rest.density,
        neo_hookean: 0.0,
        fibres: Fibres::NONE,
    }]
}

/// The lowest part of the liver, up to `height` [m].
fn below(height: Real) -> Vec<Region> {
    let bounds = Bounds::new(Vec3::repeat(-1.0), Vec3::new(1.0, 1.0, height));
    vec![Region { bounds, stiffness: None, exact: false }]
}

/// How far the stabilisations of the levels of `a` are from those of `b`.
fn difference(a: &Body, b: &Body) -> Real {
    let both = a.levels().iter().zip(b.levels());
    both.map(|(a, b)| (a.stabilisation - b.stabilisation).abs()).fold(0.0, Real::max)
}

#[test]
fn a_body_held_and_made_otherwise_than_prepared_is_the_body_prepared_so() {
    let soft = Material::from_young(4e3, 0.45, 1000.0);
    let prepared = || prepare(&recipe(soft, 5.0, below(0.04), 0.15), &mut silent).unwrap();
    let bytes = prepared().bytes().to_vec();
    for (what, material, contrast, height, damping, anew) in [
        ("as it was", soft, 5.0, 0.04, 0.15, false),
        ("damped otherwise", soft, 5.0, 0.04, 0.3, false),
        ("stiffer", Material::from_young(2e4, 0.45, 1000.0), 5.0, 0.04, 0.15, false),
        ("denser", Material::from_young(4e3, 0.45, 1200.0), 5.0, 0.04, 0.15, false),
        ("of another Poisson's ratio", Material::from_young(4e3, 0.3, 1000.0), 5.0, 0.04, 0.15, true),
        ("held elsewhere", soft, 5.0, 0.06, 0.15, true),
        ("stiffer in one place", soft, 8.0, 0.04, 0.15, true),
    ] {
        let mut said = false;
        let mut progress = |what: &str, _: usize, _: usize| said |= what.contains("calibrating anew");
        let refitted = refit(
            prepared(),
            "liver",
            material,
            &nodule(material, contrast),
            &below(height),
            Elements::Smoothed,
            damping,
            &mut progress,
        );
        let refitted = refitted.unwrap();
        let fresh = prepare(&recipe(material, contrast, below(height), damping), &mut silent).unwrap();
        let (off, mode) = (difference(&refitted, &fresh), refitted.slowest_mode() / fresh.slowest_mode() - 1.0);
        println!("{what}: stabilisations off by {off:.1e}, slowest mode by {mode:.1e}");
        assert!(off < 1e-3 && mode.abs() < 1e-3, "{what}");
        assert_eq!(said, anew, "{what}");
        assert!((refitted.mass() / fresh.mass() - 1.0).abs() < 1e-12);
        for (a, b) in refitted.maxwell().iter().zip(fresh.maxwell()) {
            assert!((a.modulus / b.modulus - 1.0).abs() < 1e-12 && (a.time / b.time - 1.0).abs() < 1e-3);
        }
        assert_eq!(refitted.bytes() == bytes, what == "as it was");
    }
}

#[test]
fn a_heavy_place_gives_every_level_its_mass_centre_and_inertia() {
    let soft = Material::from_young(4e3, 0.45, 1000.0);
    let (radius, denser) = (0.012, 15_000.0);
    let place = |density: Real| {
        let at = Moments::of_surface(&liver_surface(0.008)).centre + Vec3::new(0.02, 0.0, 0.0);
        vec![Inclusion {
            place: Reach::Ball(at, radius).into(),
            youngs_modulus: 4e3,
            poisson_ratio: 0.45,
            density,
            neo_hookean: 0.0,
            fibres: Fibres::NONE,
        }]
    };
    let shape = || Shape::closed(liver_surface(0.008), vec![0.019, 0.012]);
    let of = |density| Recipe { inclusions: place(density), shape: shape(), ..recipe(soft, 1.0, below(0.04), 0.15) };
    let body = prepare(&of(1000.0 + denser), &mut silent).unwrap();
    let plain = Moments::of_surface(&liver_surface(0.008));
    let Place::Within(Reach::Ball(centre, _)) = place(1.0)[0].place else { unreachable!() };
    let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    let ball = Moments { volume, centre, second: Mat3::identity() * (volume * radius * radius / 5.0) };
    let exact = Moments::combined(&[(plain, 1000.0), (ball, denser)]);
    for level in body.levels() {
        let found = Moments::of_points(&level.mesh.nodes, &level.node_mass);
        let off = (found.centre - exact.centre).norm() / exact.radius();
        let (mass, inertia) = (found.volume / exact.volume - 1.0, found.inertia_error(&exact));
        println!("{} nodes: mass {mass:+.1e}, centre {off:.1e}, inertia {inertia:+.1e}", level.mesh.nodes.len());
        assert!(mass.abs() < 2e-3 && off < 5e-3 && inertia.abs() < 1e-2);
    }
    let light = prepare(&of(1000.0), &mut silent).unwrap();
    assert!((body.centre_of_mass() - light.centre_of_mass()).norm() > 0.001);
    let inclusions = place(1000.0 + denser);
    let refitted =
        refit(light, "liver", soft, &inclusions, &below(0.04), Elements::Smoothed, 0.15, &mut silent).unwrap();
    assert!((refitted.mass() / body.mass() - 1.0).abs() < 1e-12 && difference(&refitted, &body) < 1e-3);
}

#[test]
fn files_that_are_no_prepared_bodies_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.palpate");
    let body = prepare(&recipe(Material::from_young(4e3, 0.45, 1000.0), 1.0, vec![], 0.0), &mut silent).unwrap();
    let scene = load(Path::new("organ"), &[]).scene.to_toml();
    let bytes = BodyFile { provenance: Provenance { scene, ..Provenance::default() }, body }.bytes();
    let refused = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        LoadedScene::load(&path, &[]).unwrap_err().to_string()
    };
    let changed = |at: usize, to: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = to;
        bytes
    };
    for (bytes, why) in [
        (b"solid organ\n".to_vec(), "palpate prepare"),
        (vec![], "palpate prepare"),
        (bytes[..10].to_vec(), "cut off"),
        (bytes[..bytes.len() - 1].to_vec(), "cut off"),
        ([bytes.clone(), vec![0]].concat(), "added to"),
        (changed(8, 11), "format 11, this palpate reads format 10: update palpate"),
        (changed(8, 0), "format 0, this palpate reads format 10: prepare it again"),
        (changed(bytes.len() / 2, bytes[bytes.len() / 2] ^ 1), "checksum"),
    ] {
        let e = refused(&bytes);
        assert!(e.contains("x.palpate") && e.contains(why), "{e}");
    }
    fs::write(&path, &bytes).unwrap();
    LoadedScene::load(&path, &[]).unwrap();
    let lost = stderr(&palpate(&["serve", "--scene", "lost.palpate"]).failure());
    assert!(lost.contains("lost.palpate"), "{lost}");
}

#[cfg(feature = "pictures")]
#[test]
fn prepare_refuses_with_a_remedy_and_draws_what_it_makes() {
    use palpate::scene::keys::ProbeKeys;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (mesh, out, picture) = (path("toy.obj"), path("toy.palpate"), path("toy.png"));
    fs::write(&mesh, obj(&toy_surface(0.006))).unwrap();
    let run = |more: &[&str]| palpate(&[&["prepare", &mesh, "-o", &out], more].concat());
    for (given, remedy) in [
        (&[][..], "--unit"),
        (&["--unit", "m"], "--unit mm"),
        (&["--unit", "ft"], "m, cm, mm, in"),
        (&["--unit", "mm", "--finest", "3"], "write it as in 3mm"),
        (&["--unit", "mm", "--levels", "10mm,9mm"], "at most 0.8 of the one before it"),
        (&["--unit", "mm", "--finest-in", "1,2,3"], "a box has 6"),
        (&["--unit", "mm", "--levels", "30mm,18mm", "--finest-in", "900,0,0,9"], "give a larger one"),
        (&["--unit", "mm", "--levels", "30mm,18mm", "--picture", "toy.jpg"], "toy.png"),
    ] {
        let e = stderr(&run(given).failure());
        assert!(e.contains(remedy), "{given:?}: {e}");
        assert!(!Path::new(&out).exists());
    }
    let unwritten = stderr(&palpate(&["prepare", &mesh, "--unit", "mm"]).failure());
    assert!(unwritten.contains("--out"), "{unwritten}");
    let region = ["--unit", "mm", "--levels", "30mm,18mm,10mm", "--finest-in", "0,0,140,45", "--picture", &picture];
    let said = stdout(&run(&region).success());
    assert!(said.contains("region") && said.contains(&out), "{said}");
    assert!(fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    let body = load(Path::new(&out), &[]).build(&mut silent).unwrap();
    assert!(body.level(1).is_whole() && !body.level(2).is_whole());
    // A probe is read on levels that reach it.
    let mut scene = load(Path::new(&out), &[]).scene;
    let at = |z: Real| ProbeKeys { name: "p".into(), position: [0.0, 0.0, z] };
    scene.probe = vec![at(0.13), at(0.05)];
    assert_eq!(scene.probes(&body).iter().map(Vec::len).collect::<Vec<_>>(), [3, 2]);
    // Held elsewhere, the levels that cover the body still agree, with the region's as they did.
    let before = body.level(1).stabilisation;
    let held = load(Path::new(&out), &["hold.0.max=[1.0, 1.0, 0.4]"]).build(&mut silent).unwrap();
    assert!(held.supports().len() > body.supports().len() && held.level(1).stabilisation == before);
    assert!(held.slowest_mode() != body.slowest_mode());
}

#[test]
fn regions_of_the_material_go_by_the_labels_of_the_volume_file() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = box_mesh(Vec3::new(0.1, 0.06, 0.06), [10, 6, 6]);
    let mut text = format!("$NOD\n{}\n", mesh.nodes.len());
    let is_stiff = |x: Real| x < 0.04;
    let centre = |corners: [Vec3; 4]| corners.iter().sum::<Vec3>() / 4.0;
    for (n, p) in mesh.nodes.iter().enumerate() {
        writeln!(text, "{} {} {} {}", n + 1, 1e3 * p.x, 1e3 * p.y, 1e3 * p.z).unwrap();
    }
    writeln!(text, "$ENDNOD\n$ELM\n{}", mesh.elements.len()).unwrap();
    for (e, element) in mesh.elements.iter().enumerate() {
        let [a, b, c, d] = element.map(|n| n + 1);
        let label = if is_stiff(centre(mesh.corners(e)).x) { 7 } else { 3 };
        writeln!(text, "{} 4 {label} 1 4 {a} {b} {c} {d}", e + 1).unwrap();
    }
    let file = folder.path().join("box.msh").display().to_string();
    fs::write(&file, text + "$ENDELM\n").unwrap();
    let out = folder.path().join("box.palpate").display().to_string();
    let stiff =
        |label: i64, young: Real| format!("material.region=[{{ label = {label}, youngs_modulus = {young:?} }}]");
    for levels in [&[][..], &["--levels", "25mm,14mm"]] {
        let head = ["prepare", file.as_str(), "--unit", "mm", "-o", out.as_str()];
        let region = stiff(7, 50e3);
        let said = stdout(&palpate(&[&head[..], levels, &["--set", region.as_str()]].concat()).success());
        assert!(said.contains("labels 'physical': 3 (60.0 %), 7 (40.0 %) of the volume"), "{said}");
        let region = stiff(8, 50e3);
        let refused = stderr(&palpate(&[&head[..], levels, &["--set", region.as_str()]].concat()).failure());
        assert!(refused.contains("label 8") && refused.contains("('physical') are 3, 7"), "{refused}");
        // As prepared, and of another stiffness where the label is.
        for young in [50e3, 20e3] {
            let body = load(Path::new(&out), &[&stiff(7, young)]).build(&mut silent).unwrap();
            for e in body.elements_of(body.finest()) {
                let corners = body.corners(e);
                let found = body.material_of(e).youngs_modulus();
                // What a cover has of the other side it may take from what is nearest to a place outside.
                let margin = if levels.is_empty() { -1e-9 } else { 0.01 };
                let inside = corners.iter().filter(|p| is_stiff(p.x + margin)).count();
                let least = if inside == 4 { young } else { body.material().youngs_modulus() };
                assert!(found > least * (1.0 - 1e-9) && found < young * (1.0 + 1e-9), "{found} of {least} to {young}");
                assert!(!levels.is_empty() || (is_stiff(centre(corners).x) == (found > 0.9 * young)), "{found}");
            }
        }
    }
    let other = ["prepare", file.as_str(), "--unit", "mm", "--check", "--labels", "organ"];
    let refused = stderr(&palpate(&other).failure());
    assert!(refused.contains("'organ'") && refused.contains("physical, elementary"), "{refused}");
}

/// What comes of the files at `paths`: the body's levels in words, or why they are refused.
/// A rod whose fibres wind around its axis, as muscle's do, in a VTK file.
fn wound(folder: &Path) -> String {
    let mesh = box_mesh(Vec3::new(0.1, 0.06, 0.06), [6, 4, 4]);
    let mut text = format!(
        "# vtk DataFile Version 3.0\nrod\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n",
        mesh.nodes.len()
    );
    mesh.nodes.iter().for_each(|p| writeln!(text, "{} {} {}", 1e3 * p.x, 1e3 * p.y, 1e3 * p.z).unwrap());
    let all = mesh.elements.len();
    writeln!(text, "CELLS {all} {}", 5 * all).unwrap();
    mesh.elements.iter().for_each(|[a, b, c, d]| writeln!(text, "4 {a} {b} {c} {d}").unwrap());
    writeln!(text, "CELL_TYPES {all}\n{}\nCELL_DATA {all}\nVECTORS fibre double", "10 ".repeat(all)).unwrap();
    for e in 0..all {
        let a = around_axis(mesh.corners(e).iter().sum::<Vec3>() / 4.0) * 5.0;
        writeln!(text, "{} {} {}", a.x, a.y, a.z).unwrap();
    }
    let file = folder.join("rod.vtk");
    fs::write(&file, text).unwrap();
    file.display().to_string()
}

/// Unit direction at a place of that rod, 45° from its axis.
fn around_axis(p: Vec3) -> Vec3 {
    let arm = p - Vec3::new(0.0, 0.03, 0.03);
    let around = Vec3::x().cross(&arm).try_normalize(1e-9).unwrap_or(Vec3::y());
    (Vec3::x() + around).normalize()
}

#[test]
fn fibres_lie_as_the_volume_file_says_or_as_the_scene_does() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (wound(folder.path()), folder.path().join("rod.palpate").display().to_string());
    let law = ["material.law='transversely_isotropic'", "material.fibre_modulus=4e4"];
    for levels in [&[][..], &["--levels", "25mm,14mm"]] {
        let head = ["prepare", file.as_str(), "--unit", "mm", "-o", out.as_str()];
        let said = stdout(&palpate(&[&head[..], levels].concat()).success());
        assert!(said.contains("directions of fibres: 'fibre'"), "{said}");
        // Another scene's law on the body as prepared, along the file's directions.
        let body = load(Path::new(&out), &law).build(&mut silent).unwrap();
        let (mut off, mut all) = (0.0, 0.0);
        for e in body.elements() {
            let middle = body.corners(e).iter().sum::<Vec3>() / 4.0;
            let fibres = body.led(body.material_of(e), e).fibres;
            assert_eq!(fibres.modulus, 4e4);
            off += body.volume(e) * (1.0 - fibres.direction.dot(&around_axis(middle)).abs());
            all += body.volume(e);
        }
        // Given meshes have their own; a cover what its elements' middles lie in.
        assert!(off / all < if levels.is_empty() { 1e-12 } else { 0.1 }, "{}", off / all);
        // Regions and scenes may lead them otherwise.
        let region = "material.region=[{ min = [-1, -1, -1], max = [0.05, 1, 1], youngs_modulus = 5e3, fibre_direction = [0, 0, 2] }]";
        let body = load(Path::new(&out), &[law[0], law[1], region]).build(&mut silent).unwrap();
        let is_up = |e: &Element| body.led(body.material_of(*e), *e).fibres.direction == Vec3::z();
        let low = |e: &Element| body.corners(*e).iter().all(|p| p.x < 0.05);
        assert!(body.elements().filter(low).all(|e| is_up(&e)) && !body.elements().all(|e| is_up(&e)));
    }
    let scene = |more: &[&str]| load(Path::new("cube"), &[&law[..], more].concat()).build(&mut silent);
    let refused = scene(&[]).unwrap_err().to_string();
    assert!(refused.contains("fibre_direction") && refused.contains("vectors called fibre"), "{refused}");
    assert!(scene(&["material.fibre_direction=[1, 1, 0]"]).is_ok());
    for (keys, key, remedy) in [
        (&["material.fibre_modulus=4e4"][..], "material.law", "give transversely_isotropic"),
        (&law[..1], "material.fibre_modulus", "fibres add to Young's modulus"),
        (&[law[0], law[1], "material.fibre_direction=[0, 0, 0]"], "material.fibre_direction", "give a direction"),
        (&[law[0], law[1], "material.fibre_direction=[1e-300, 0, 0]"], "material.fibre_direction", "give a direction"),
        (&[law[0], "material.fibre_modulus=-1.0"], "material.fibre_modulus", "10"),
    ] {
        let given: Vec<String> = keys.iter().map(ToString::to_string).collect();
        let refused = LoadedScene::load(Path::new("cube"), &given).unwrap_err().to_string();
        assert!(refused.contains(key) && refused.contains(remedy), "{refused}");
    }
}

fn verdict(paths: &[PathBuf], unit: LengthUnit, scale: Real, holes: Real) -> Result<String, String> {
    let read = |path: &PathBuf| Input::read(path, unit, scale, holes, None).map_err(|e| e.to_string());
    let inputs: Vec<Input> = paths.iter().map(read).collect::<Result<_, _>>()?;
    let repairs: Vec<String> = inputs.iter().map(|input| input.repairs.to_string()).collect();
    let solids: Vec<Solid> = inputs.into_iter().map(|input| input.solid).collect();
    check(&solids, unit, scale, false, false).map_err(|e| e.to_string())?;
    let fineness = match &solids[0] {
        Solid::Surface(surface) => Fineness::Levels(spacings::automatic(surface.volume())[..2].to_vec()),
        Solid::Volume(_) => Fineness::Automatic,
    };
    let shape = shape(solids, &fineness, 2500)?;
    let name = paths[0].file_stem().unwrap().to_string_lossy().into_owned();
    let material = Material::from_young(5e3, 0.45, 1050.0);
    let body = prepare(
        &Recipe {
            name,
            shape,
            material,
            inclusions: vec![],
            holds: vec![],
            elements: Default::default(),
            damping_ratio: 0.15,
        },
        &mut silent,
    )
    .map_err(|e| e.to_string())?;
    let report = report(&body);
    if !report.levels[0].can_be_stepped() {
        return Err(report.warnings.join("; "));
    }
    let levels = report.levels.iter().map(|level| {
        assert!(level.volume.abs() < 0.05 && level.centre < 0.02, "{level:?}");
        format!("{} nodes, volume {:+.2} %, step {:.3} ms", level.nodes, 100.0 * level.volume, 1e3 * level.step)
    });
    Ok(format!("{}; repaired: {}", levels.collect::<Vec<_>>().join("; "), repairs.join(", ")))
}

#[test]
fn every_mesh_at_hand_makes_a_body_or_is_refused_with_the_reason() {
    let Some(meshes) = shared("meshes") else { return };
    let (m, mm) = (LengthUnit::Metre, LengthUnit::Millimetre);
    let raptors = "raptorTetra_8418.vtu raptorTetra_12580.vtu raptorTetra_19409.vtu";
    let mut wrong = Vec::new();
    for (files, unit, scale, refused) in [
        ("Liver.stl", mm, 1.0, None),
        ("Spleen.stl", mm, 1.0, None),
        ("Kidney_left.stl", mm, 1.0, None),
        ("gallbladder_collision.stl", mm, 1.0, None),
        ("instrument_shaft.stl", mm, 1.0, None),
        ("torus.obj", m, 0.02, None),
        ("truthcylinder1.obj", LengthUnit::Centimetre, 1.0, None),
        ("truthcylinder1.msh", LengthUnit::Centimetre, 1.0, None),
        ("raptor_8kp.obj", m, 0.02, Some("crosses itself")),
        ("liver.msh", m, 0.0308519, None),
        ("liver-smooth.obj", m, 0.0308519, Some("crosses itself")),
        ("cube_22_ascii_vol_gmshApp.msh", m, 0.1, None),
        ("single_tetra.msh", m, 0.1, None),
        (raptors, m, 0.02, None),
        ("raptorTetra_8418.vtu", m, 0.02, None),
        ("Armadillo_Tetra_4406.vtu", m, 0.02, None),
        ("armadillo_4k.ele", m, 0.05, None),
        ("beam3_tet.veg", m, 1.0, Some("not read here")),
        ("6_tetra_bad.msh", m, 0.1, Some("inside out")),
        ("bunny.obj", m, 1.0, Some("not closed")),
        ("dragon.stl", m, 1.0, Some("more than two triangles")),
        ("Liver.stl", m, 1.0, Some("--unit mm")),
        ("Kidney_left.stl", mm, 0.01, Some("--unit m,")),
    ] {
        let began = std::time::Instant::now();
        let paths: Vec<PathBuf> = files.split(' ').map(|file| meshes.join(file)).collect();
        let found = verdict(&paths, unit, scale, 0.0);
        println!("{files}, {:.1} s: {}", began.elapsed().as_secs_f64(), found.as_ref().unwrap_or_else(|e| e));
        let as_expected = match (refused, &found) {
            (None, Ok(_)) => true,
            (Some(why), Err(e)) => e.contains(why),
            _ => false,
        };
        if !as_expected {
            wrong.push(format!("{files}: {found:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let closed = verdict(&[meshes.join("bunny.obj")], m, 1.0, 0.05).unwrap();
    println!("bunny.obj, its holes closed: {closed}");
    assert!(closed.contains("holes closed"));
}
