//! The example does what it says.

#[path = "../examples/press_a_cube.rs"]
#[allow(dead_code, reason = "its main function prints what is checked here")]
mod press_a_cube;

#[test]
fn a_pressed_cube_pushes_back_as_its_stiffness_says() {
    let force = press_a_cube::press_a_cube().unwrap();
    // Hertz: 4/3 · E/(1−ν²) · √(R δ³) = 0.76 N on a half space.
    assert!(force.z > 0.6 && force.z < 1.0 && force.x.abs() < 0.1, "{force}");
}
