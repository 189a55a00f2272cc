//! What scenes say, and what they are refused for.

use super::body_keys::{BodyKeys, MaterialKeys};
use super::keys::ResolutionKeys;
use super::*;
use palpate_body::prepare::inclusions::Place;
use palpate_body::prepare::region::Reach;
use palpate_core::model::Material;

#[test]
fn every_bundled_scene_is_valid() {
    for (name, _) in BUNDLED {
        LoadedScene::load(Path::new(name), &[]).unwrap();
    }
}

#[test]
fn the_reference_names_every_key_with_its_default() {
    let text = include_str!("../../../config/scenes/reference.toml");
    let scene = parse(text, "reference.toml").unwrap();
    // What is left out of a minimal scene is what the reference says.
    let minimal = parse("name = \"reference\"\n[body]\nsource = \"box\"\n", "minimal").unwrap();
    let optional = Scene {
        hold: vec![],
        contact: vec![],
        obstacle: vec![],
        organ: vec![],
        probe: vec![],
        material: MaterialKeys { phi: None, psi: None, region: vec![], ..scene.material.clone() },
        resolution: ResolutionKeys { finest_level: None, ..scene.resolution.clone() },
        body: BodyKeys {
            file: None,
            files: vec![],
            unit: None,
            active_level: None,
            labels: None,
            display: None,
            display_unit: None,
            ..scene.body.clone()
        },
        tool: vec![scene.tool[0].clone()],
        ..scene.clone()
    };
    assert_eq!(optional, minimal);
    // Every key of a full scene stands in the reference, none is left out.
    let full = scene.to_toml();
    for key in full.lines().filter_map(|l| l.split_once(" = ")).map(|(k, _)| k) {
        assert!(text.lines().any(|l| l.split_once(" = ").is_some_and(|(k, _)| k == key)), "{key}");
    }
    for key in [
        "lambda",
        "mu",
        "phi",
        "psi",
        "file",
        "files",
        "unit",
        "display",
        "display_unit",
        "active_level",
        "finest_level",
        "stiffness",
        "rounding",
        "points",
        "displacement",
        "stay",
        "pivot",
    ] {
        assert!(full.contains(&format!("{key} = ")), "the reference leaves out {key}");
    }
}

#[test]
fn a_wrong_key_names_file_line_and_place() {
    let e = parse("name = \"x\"\n[body]\nsource = \"box\"\nsise = [1, 1, 1]\n", "my.toml").unwrap_err().to_string();
    assert!(e.contains("my.toml") && e.contains("line 4") && e.contains("sise") && e.contains("size"), "{e}");
}

#[test]
fn bad_values_are_reported_all_at_once_with_their_lines() {
    let text = "name = \"x\"\n[body]\nsource = \"liver\"\nspacings = [0.01, 0.02]\n\n[material]\npoisson_ratio = 0.7\n\
                youngs_modulus = -3.0\n[[tool]]\nname = \"t\"\nradius = 7.0\n";
    let e = parse(text, "my.toml").unwrap_err().to_string();
    for part in ["line 7: material.poisson_ratio", "line 8: material.youngs_modulus", "line 11: tool[0].radius"] {
        assert!(e.contains(part), "{e}");
    }
    assert!(e.contains("line 4: body.spacings") && e.contains("0.8 of the one before"), "{e}");
}

#[test]
fn a_region_of_the_material_is_a_ball_a_box_or_a_label() {
    let regions = |text: &str| {
        let head = "name = \"x\"\n[body]\nsource = \"liver\"\n[material]\npoisson_ratio = 0.4\n";
        parse(&format!("{head}[[material.region]]\nyoungs_modulus = 5e4\n{text}"), "my.toml")
    };
    let found = regions("centre = [0.1, 0.0, 0.2]\nradius = 0.004\n").unwrap().inclusions();
    assert_eq!(found[0].place, Reach::Ball(Vec3::new(0.1, 0.0, 0.2), 0.004).into());
    assert_eq!((found[0].youngs_modulus, found[0].poisson_ratio), (5e4, 0.4));
    regions("min = [0.0, 0.0, 0.0]\nmax = [0.1, 0.1, 0.1]\npoisson_ratio = 0.3\n").unwrap();
    let found = regions("label = -2\ndensity = 1200.0\n").unwrap().inclusions();
    assert_eq!((found[0].place, found[0].density), (Place::Labelled(-2), 1200.0));
    for text in [
        "",
        "centre = [0.1, 0.0, 0.2]\n",
        "min = [0.0, 0.0, 0.0]\nmax = [0.1, 0.0, 0.1]\n",
        "label = 1\ncentre = [0.1, 0.0, 0.2]\nradius = 0.01\n",
        "radius = 0.01\nmin = [0.0, 0.0, 0.0]\nmax = [0.1, 0.1, 0.1]\n",
    ] {
        let e = regions(text).unwrap_err().to_string();
        assert!(e.contains("material.region[0]") && e.contains("give a ball"), "{e}");
    }
}

#[test]
fn lame_parameters_give_the_material_of_youngs_modulus_and_poissons_ratio() {
    let scene = |material: &str, region: &str, organ: &str| {
        let place = "centre = [0.1, 0.0, 0.2]\nradius = 0.004";
        let text = format!(
            "name = \"x\"\n[body]\nsource = \"liver\"\n[material]\n{material}\n[[material.region]]\n{place}\n{region}\n\
             [[organ]]\nname = \"k\"\nbody.source = \"kidney\"\n[organ.material]\n{organ}\n"
        );
        parse(&text, "my.toml").unwrap()
    };
    let lame = |e: Real, nu: Real| {
        let Material { lambda, mu, .. } = Material::from_young(e, nu, 1.0);
        format!("lambda = {lambda:?}\nmu = {mu:?}")
    };
    let young = |e: Real, nu: Real| format!("youngs_modulus = {e:?}\npoisson_ratio = {nu:?}");
    let expected = scene(&young(8e3, 0.4), &young(5e4, 0.3), &young(10.0, 0.49));
    let found = scene(&lame(8e3, 0.4), &lame(5e4, 0.3), &lame(10.0, 0.49));
    // Viscosities and the springs of supports follow from them.
    assert_eq!(found.material(), expected.material());
    assert_eq!(found.of_organ(&found.organ[0]).material(), expected.of_organ(&expected.organ[0]).material());
    let near = |a: Real, b: Real| (a - b).abs() <= 1e-12 * b;
    let (found_region, expected_region) = (found.inclusions()[0], expected.inclusions()[0]);
    assert!(near(found_region.youngs_modulus, expected_region.youngs_modulus), "{found_region:?}");
    assert!(near(found_region.poisson_ratio, expected_region.poisson_ratio), "{found_region:?}");
    // A region without a Poisson's ratio has that of the rest, whichever pair gives it.
    let rest = scene(&lame(8e3, 0.4), "youngs_modulus = 5e4", "").inclusions()[0];
    assert!(near(rest.poisson_ratio, 0.4) && rest.youngs_modulus == 5e4, "{rest:?}");
    // What is recorded has one pair, and is read again.
    let recorded = found.to_toml();
    assert!(!recorded.contains("youngs_modulus") && parse(&recorded, "recorded").unwrap() == found, "{recorded}");
    let defaults = scene("", &young(5e4, 0.3), "");
    assert_eq!(defaults.material().youngs_modulus(), Material::from_young(5e3, 0.45, 1.0).youngs_modulus());
    assert_eq!(defaults.to_toml().matches("youngs_modulus = 5000.0\npoisson_ratio = 0.45").count(), 2);
}

#[test]
fn elastic_constants_that_make_no_material_are_named_by_key_and_line() {
    for (text, key, why) in [
        ("lambda = 1e4\nmu = 1e3\nyoungs_modulus = 5e3", "lambda", "not keys of both pairs"),
        ("mu = 1e3\npoisson_ratio = 0.3", "mu", "not keys of both pairs"),
        ("lambda = 1e4", "lambda", "needs mu"),
        ("mu = 1e3", "mu", "needs lambda"),
        ("lambda = inf\nmu = 1e3", "lambda", "a finite number"),
        ("lambda = 1e4\nmu = nan", "mu", "a finite number"),
        ("lambda = 1e4\nmu = 0", "mu", "above 0 Pa; it is 0"),
        ("lambda = -1e4\nmu = 1e3", "lambda", "3 lambda + 2 mu above 0 Pa"),
        ("lambda = -1e2\nmu = 1e3", "lambda", "give 0 to 499000"),
        ("lambda = 1e6\nmu = 1e3", "lambda", "a Poisson's ratio of 0 to 0.499; that of 1000000 is 0.4995"),
        ("lambda = 1.0\nmu = 1.0", "mu", "2.5"),
        ("lambda = 1e10\nmu = 1e10", "mu", "must be 10 to 1000000000"),
        ("youngs_modulus = nan", "youngs_modulus", "a finite number"),
        ("youngs_modulus = inf", "youngs_modulus", "a finite number"),
    ] {
        let place = "centre = [0.1, 0.0, 0.2]\nradius = 0.004";
        for (head, table, place) in [
            ("[material]", "material", ""),
            ("[[material.region]]", "material.region[0]", place),
            ("[[organ]]\nname = \"k\"\nbody.source = \"kidney\"\n[organ.material]", "organ[0].material", ""),
        ] {
            let text = format!("name = \"x\"\n[body]\nsource = \"liver\"\n{head}\n{text}\n{place}\n");
            let e = parse(&text, "my.toml").unwrap_err().to_string();
            let expected = (e.contains(&format!(": {table}.{key}: ")), e.contains("my.toml, line "), e.contains(why));
            assert_eq!((expected, e.lines().count()), ((true, true, true), 1), "{e}");
        }
    }
    let nearly = |elements: &str| {
        parse(
            &format!("name = \"x\"\n[body]\nsource = \"liver\"\n[material]\npoisson_ratio = 0.499\n{elements}"),
            "my.toml",
        )
    };
    let e = nearly("elements = \"tetrahedra\"").unwrap_err().to_string();
    assert!(
        e.contains("material.poisson_ratio: give 0 to 0.49, not 0.499; up to 0.499 with elements = \"smoothed\""),
        "{e}"
    );
    assert!((nearly("").unwrap().material().poisson_ratio() - 0.499).abs() < 1e-12);
    let region = "name = \"x\"\n[body]\nsource = \"liver\"\n[[material.region]]\nlabel = 1\npoisson_ratio = 0.3\n";
    let e = parse(region, "my.toml").unwrap_err().to_string();
    assert!(e.contains("material.region[0]: give youngs_modulus, or lambda and mu"), "{e}");
    let e = LoadedScene::load(Path::new("liver"), &["material.lambda=1e4".into(), "material.mu=1e3".into()]);
    assert!(e.unwrap_err().to_string().contains("not keys of both pairs"));
    let whole = "material={lambda = 1e4, mu = 1e3}".to_string();
    assert_eq!(LoadedScene::load(Path::new("liver"), &[whole]).unwrap().scene.material().lambda, 1e4);
}

#[test]
fn regions_are_of_the_law_of_the_rest_unless_they_have_their_own_and_organs_of_their_own() {
    let scene = |law: &str, of_region: &str| {
        let region = format!("[[material.region]]\nlabel = 1\nyoungs_modulus = 5e4\n{of_region}");
        let organ =
            "[[organ]]\nname = \"y\"\n[organ.body]\nsource = \"kidney\"\n[organ.material]\nlaw = \"neo_hookean\"\n";
        let text = format!("name = \"x\"\n[body]\nsource = \"liver\"\n[material]\n{law}\n{region}\n{organ}");
        parse(&text, "my.toml")
    };
    let (neo_hookean, green) = ("law = \"neo_hookean\"", "law = \"st_venant_kirchhoff\"");
    for (law, of_region, expected) in [
        ("", "", [0.0, 0.0]),
        (neo_hookean, "", [1.0, 1.0]),
        (neo_hookean, green, [1.0, 0.0]),
        ("", neo_hookean, [0.0, 1.0]),
    ] {
        let scene = scene(law, of_region).unwrap();
        assert_eq!([scene.material().neo_hookean, scene.inclusions()[0].neo_hookean], expected);
        assert_eq!(scene.of_organ(&scene.organ[0]).material().neo_hookean, 1.0);
    }
    let e = scene("law = \"ogden\"", "").unwrap_err().to_string();
    assert!(e.contains("ogden") && e.contains("neo_hookean"), "{e}");
}

fn tools(text: &str) -> Result<Scene, SceneError> {
    parse(&format!("name = \"x\"\n[body]\nsource = \"liver\"\n{text}"), "my.toml")
}

#[test]
fn shapes_that_contradict_themselves_are_named_by_key_and_line() {
    let corners = "points = [[0,0,0],[1,0,0],[0,1,0],[0,0,1]]";
    let flat = "points = [[0,0,0],[1,0,0],[0,1,0],[1,1,0]]";
    for (text, key, why) in [
        ("shape = \"ball\"\nlength = 0.1", "length", "capsule"),
        ("shape = \"cylinder\"", "length", "needs one"),
        ("shape = \"cylinder\"\nlength = 0.01\nrounding = 0.006", "rounding", "half its length"),
        ("shape = \"convex\"", "points", "file"),
        ("shape = \"convex\"\nfile = \"a.stl\"", "unit", "mm"),
        (&format!("shape = \"convex\"\n{flat}"), "points", "plane"),
        (&format!("shape = \"convex\"\n{corners}\nfile = \"a.stl\"\nunit = \"m\""), "file", "either"),
        (corners, "points", "convex"),
        ("rounding = 0.001", "rounding", "cylinder"),
        ("shape = \"convex\"\npoints = [[0,0,2]]", "points[0][2]", "1"),
        ("shape = \"compound\"", "part", "1 to 8"),
        ("[[tool.part]]\nradius = 0.01", "part", "compound"),
        ("shape = \"compound\"\n[[tool.part]]\nshape = \"compound\"", "part[0].shape", "capsule"),
        ("shape = \"compound\"\n[[tool.part]]\norientation = [1,1,0,0]", "part[0].orientation", "quaternion"),
        ("shape = \"compound\"\n[[tool.part]]\n[[tool.part]]\nradius = 1.0", "part[1].radius", "0.1"),
        ("shape = \"compound\"\n[[tool.part]]\nhinge = {axis = [0,1,0], open = 0.3}", "grip", "grip = 0.05"),
        ("shape = \"compound\"\ngrip = 0.1\n[[tool.part]]\nradius = 0.01", "grip", "hinge"),
        (
            "shape = \"compound\"\ngrip = 0.1\n[[tool.part]]\nhinge = {axis = [0,0,0], open = 0.3}",
            "part[0].hinge.axis",
            "direction",
        ),
        (
            "shape = \"compound\"\ngrip = 0.1\n[[tool.part]]\nhinge = {axis = [0,1,0], open = 0.0}",
            "part[0].hinge.open",
            "closed",
        ),
        (
            "shape = \"compound\"\ngrip = 0.1\n[[tool.part]]\nhinge = {axis = [0,1,0], open = 4.0}",
            "part[0].hinge.open",
            "3.14",
        ),
    ] {
        let e = tools(&format!("[[tool]]\nname = \"t\"\n{text}\n")).unwrap_err().to_string();
        assert!(e.contains("my.toml, line ") && e.contains(&format!("tool[0].{key}: ")) && e.contains(why), "{e}");
    }
    let e = tools("[[tool]]\nname = \"t\"\nshape = \"cone\"\n").unwrap_err().to_string();
    assert!(e.contains("line 6") && e.contains("cylinder"), "{e}");
}

#[test]
fn obstacles_that_contradict_themselves_are_named_by_key_and_line() {
    let obstacle =
        |keys: &str| tools(&format!("[[obstacle]]\nname = \"o\"\n{keys}")).map(|scene| scene.settings().obstacles);
    let floor = &obstacle("").unwrap()[0];
    assert_eq!((floor.friction, floor.motion), (0.5, None));
    for (keys, fault) in [
        ("normal = [0.0, 0.0, 0.0]", "obstacle[0].normal: give a direction"),
        ("length = 0.1", "obstacle[0].length: is for"),
        ("orientation = [1.0, 0.0, 0.0, 0.0]", "obstacle[0].orientation: a plane has a normal"),
        ("shape = \"ball\"\nnormal = [1.0, 0.0, 0.0]", "obstacle[0].normal: is for shape = \"plane\""),
        ("shape = \"compound\"", "obstacle[0].shape: an obstacle is"),
        (
            "motion = {displacement = [0.0, 0.0, 0.1], period = 0.2}",
            "obstacle[0].motion.period: it would move by 2.34 m/s",
        ),
        (
            "motion = {displacement = [0.0, 0.0, 0.1], period = 4.0, stay = 0.3}",
            "obstacle[0].motion.stay: rise, stay and fall",
        ),
    ] {
        let said = obstacle(keys).unwrap_err().to_string();
        assert!(said.contains(fault), "{keys}: {said}");
    }
    let said = tools("[[tool]]\nname = \"t\"\nshape = \"plane\"").unwrap_err().to_string();
    assert!(said.contains("tool[0].shape: a plane is for [[obstacle]]"), "{said}");
}

#[test]
fn organs_of_one_name_are_refused() {
    let organs = |names: [&str; 3]| {
        let [body, others @ ..] = names;
        let more = others.map(|name| {
            format!("[[organ]]\nname = \"{name}\"\nposition = [1.0, 0.0, 0.0]\nbody = {{source = \"box\"}}\n")
        });
        parse(&format!("name = \"{body}\"\n[body]\nsource = \"box\"\n{}", more.concat()), "my.toml")
    };
    assert!(organs(["a", "b", "c"]).is_ok());
    for (names, place) in [(["a", "b", "a"], "line 9: organ[1].name"), (["a", "b", "b"], "line 9: organ[1].name")] {
        let said = organs(names).unwrap_err().to_string();
        assert!(said.contains(place) && said.contains("is called"), "{said}");
    }
}

#[test]
fn holds_that_move_are_moved_as_their_scene_says_and_those_that_cannot_are_named() {
    let box_ = "name = \"x\"\n[body]\nsource = \"box\"\n";
    let hold = |keys: &str| {
        let region = "min = [0.0, 0.0, 0.0]\nmax = [1.0, 1.0, 0.0]\nrelative = true";
        let organ = format!(
            "[[organ]]\nname = \"o\"\nposition = [1.0, 0.0, 0.0]\nbody = {{source = \"box\"}}\n[[organ.hold]]\n{region}\n{keys}"
        );
        parse(&format!("{box_}[[hold]]\n{region}\n{keys}\n{organ}"), "my.toml")
    };
    let motion = "motion = {displacement = [0.0, 0.0, 0.01], period = 4.0}";
    let scene = hold(motion).unwrap();
    let motions = scene.settings().support_motions;
    assert_eq!(
        motions.iter().map(|of| (of.organ.index(), of.frame.position.x)).collect::<Vec<_>>(),
        [(0, 0.0), (1, 1.0)]
    );
    assert_eq!(motions[1].motion.at(1600), Vec3::z() * 0.01);
    assert!(
        scene.still_settings().support_motions.is_empty() && hold("").unwrap().settings().support_motions.is_empty()
    );
    for (keys, fault) in [
        (format!("exact = true\n{motion}"), "hold[0].motion: what does not move at all"),
        (format!("exact = true\n{motion}"), "organ[0].hold[0].motion: what does not move at all"),
        (
            "motion = {displacement = [0.0, 0.0, 0.1], period = 0.2}".into(),
            "hold[0].motion.period: it would move by 2.34 m/s",
        ),
    ] {
        let said = hold(&keys).unwrap_err().to_string();
        assert!(said.contains(fault), "{keys}: {said}");
    }
}

#[test]
fn an_obstacle_in_the_body_is_refused_with_where() {
    let cube = |obstacle: &str| {
        let obstacle = format!("obstacle=[{{name='bone', {obstacle}}}]");
        LoadedScene::load(Path::new("cube"), &["body.cells=[[3,3,3]]".into(), obstacle])
            .unwrap()
            .build(&mut |_, _, _| {})
    };
    let said = |obstacle: &str| cube(obstacle).unwrap_err().to_string();
    let above = said("position=[0,0,0.02]");
    assert!(above.contains("\"bone\" overlaps the body at rest by 20.0 mm at ["), "{above}");
    assert!(said("shape='ball', radius=0.01, position=[0.05,0.05,0.05]").contains("overlaps"), "inside of it");
    assert!(said("shape='ball', radius=0.03, position=[0.05,0.05,-0.01]").contains("overlaps"), "half of it");
    let plate = "[[-0.1,-0.1,0.0],[0.2,-0.1,0.0],[-0.1,0.2,0.0],[0.2,0.2,0.0],[0,0,-0.02]]";
    let hull = |z: f64| format!("shape='convex', points={plate}, rounding=0.001, position=[0,0,{z}]");
    assert!(said(&hull(0.02)).contains("overlaps"), "a plate through it");
    for fits in ["position=[0,0,0.0005]", "shape='ball', radius=0.03, position=[0.05,0.05,-0.0299]", &hull(-0.001)] {
        assert!(cube(fits).is_ok(), "{fits}");
    }
}

#[test]
fn a_tool_from_a_file_is_in_the_scene_that_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::write(folder.path().join("tip.obj"), obj).unwrap();
    let path = folder.path().join("my.toml");
    let text = |file: &str| {
        format!(
            "name = \"x\"\n[body]\nsource = \"liver\"\n[[tool]]\nname = \"t\"\nshape = \"compound\"\n[[tool.part]]\n\
             radius = 0.003\n[[tool.part]]\nshape = \"convex\"\nfile = \"{file}\"\nunit = \"mm\"\nposition = [0, 0, 0.1]\n"
        )
    };
    std::fs::write(&path, text("tip.obj")).unwrap();
    let loaded = LoadedScene::load(&path, &[]).unwrap();
    let again = parse(&loaded.scene.to_toml(), "recorded").unwrap();
    assert_eq!(again, loaded.scene);
    assert_eq!(again.settings(), loaded.scene.settings());
    let shape = &again.settings().tools[0].shape;
    assert_eq!(shape.parts()[1].hull().0.len(), 4);
    assert!((shape.bounding_radius() - 0.1105).abs() < 2e-3, "{}", shape.bounding_radius());
    std::fs::write(&path, text("lost.obj")).unwrap();
    let e = LoadedScene::load(&path, &[]).unwrap_err().to_string();
    assert!(e.contains("my.toml: tool[0].part[1].file") && e.contains("lost.obj"), "{e}");
}

#[test]
fn overrides_reach_tables_lists_and_strings() {
    let given = ["material.density=900", "tool.0.radius=0.02", "body.file=a b.stl", "world.gravity=[0, -9.81, 0]"];
    let given = given.map(String::from);
    let loaded = LoadedScene::load(Path::new("liver"), &given).unwrap();
    assert_eq!(loaded.scene.material.density, 900.0);
    assert_eq!(loaded.scene.tool[0].radius, 0.02);
    assert_eq!(loaded.scene.body.file, Some(PathBuf::from("a b.stl")));
    let e = LoadedScene::load(Path::new("liver"), &["material.densty=900".into()]).unwrap_err().to_string();
    assert!(e.contains("densty") && e.contains("--set"), "{e}");
}

#[test]
fn a_missing_unit_or_file_says_what_to_write() {
    let scene = |extra: &str| {
        let text = format!("name = \"x\"\n[body]\nsource = \"surface\"\n{extra}");
        LoadedScene { scene: parse(&text, "s.toml").unwrap(), origin: "s.toml".into(), folder: PathBuf::new() }
    };
    let e = scene("").build(&mut |_, _, _| {}).unwrap_err().to_string();
    assert!(e.contains("body.file"), "{e}");
    let e = scene("file = \"a.stl\"\n").build(&mut |_, _, _| {}).unwrap_err().to_string();
    assert!(e.contains("body.unit"), "{e}");
    let e = scene("file = \"a.stl\"\nunit = \"mm\"\n").build(&mut |_, _, _| {}).unwrap_err().to_string();
    assert!(e.contains("a.stl") && e.contains("s.toml"), "{e}");
}
