//! Starts that are fit to be touched, and those that are refused.

use assert_cmd::Command;
use palpate::scene::unsettled::{Fault, Unsettled};
use palpate::scene::{BUNDLED, LoadedScene};
use std::path::Path;
use std::sync::Arc;

/// What becomes of the start of a scene.
fn check(scene: &str, overrides: &[&str]) -> Result<(), Unsettled> {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    let loaded = LoadedScene::load(Path::new(scene), &overrides).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.settled(&body, &mut |_, _, _| {});
    println!("{scene} {overrides:?}: {:.3?}", loaded.scene.starts(&body, &start));
    loaded.scene.check_settled(&body, &start)
}

#[test]
fn every_bundled_scene_starts_at_rest_where_it_was_put() {
    std::thread::scope(|scope| {
        // That of somebody's own organ has a file, which is not here, and starts as it is.
        let names = BUNDLED.map(|scene| scene.0).into_iter().filter(|name| *name != "organ");
        let checks: Vec<_> = names.map(|name| (name, scope.spawn(move || check(name, &[])))).collect();
        assert_eq!(checks.len(), BUNDLED.len() - 1);
        for (name, check) in checks {
            assert_eq!(check.join().unwrap(), Ok(()), "{name}");
        }
    });
}

#[test]
fn a_body_that_falls_is_crushed_or_still_swings_is_refused_with_what_to_do() {
    let small = "body.cells=[[3,3,3]]";
    let of = |overrides: &[&str]| check("cube", &[&[small], overrides].concat());
    assert_eq!(of(&[]), Ok(()));
    let free = of(&["hold=[]"]).unwrap_err();
    assert!(matches!(free.fault, Fault::Far { .. }), "{free}");
    assert!(free.to_string().contains("hold it ([[hold]])") && free.to_string().contains("unsettled = true"), "{free}");
    let floor = "obstacle=[{name='floor', motion={displacement=[0,0,0.01], period=1.0}}]";
    assert_eq!(of(&["hold=[]", floor]), Ok(()), "on a floor that breathes once it is served");
    let soft = of(&["material.youngs_modulus=500"]).unwrap_err();
    assert!(matches!(soft.fault, Fault::Inverted { .. } | Fault::Far { .. }), "{soft}");
    assert!(soft.to_string().contains("material.youngs_modulus"), "{soft}");
    let early = of(&["world.settle=0.005"]).unwrap_err();
    assert!(matches!(early.fault, Fault::Moving { .. }), "{early}");
    assert!(early.to_string().contains("after 0.005 s") && early.to_string().contains("world.settle"), "{early}");
    // What the scene asks for it gets.
    assert_eq!(of(&["hold=[]", "world.unsettled=true"]), Ok(()));
    assert_eq!(of(&["hold=[]", "world.settle=0"]), Ok(()));
}

#[test]
fn the_program_refuses_such_a_start_and_takes_it_where_the_scene_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    let simulate = |more: &[&str]| {
        let free = ["--set", "body.cells=[[3,3,3]]", "--set", "hold=[]", "--seconds", "0.01", "--out", &out];
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(["simulate", "cube"]).args(free).args(more).assert()
    };
    let refused = simulate(&[]).failure();
    let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(said.contains("bundled scene cube") && said.contains("cube has settled"), "{said}");
    simulate(&["--set", "world.unsettled=true"]).success();
}
