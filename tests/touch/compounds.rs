//! Tools of several round parts.

use super::shapes::block;
use super::*;
use palpate_core::contact::tool::Part;

/// Height of the reference point over the top [m] at which a part of `radius` there is as deep as the press at time `i` of 600.
fn lowered(radius: Real, depth: Real, i: u32) -> Real {
    radius + 5e-4 - (depth + 5e-4) * ease(Real::from(i) * TICK, 0.0, 0.3)
}

fn of_radius(radius: Real, place: Vec3) -> Part {
    Part::capsule(radius, 0.0).at(Pose { position: place, ..Pose::default() })
}

/// Force [N] and torque [N m] of one tool of these `parts`, pressed in by `depth` and held, and how many points press.
fn pressed(parts: Vec<Part>, radius: Real, depth: Real) -> (Vec3, Vec3, u32) {
    // Of a law that does not soften: what is compared with is linear.
    let mut cube = cube(&["material.damping_time=0.01", "material.law='neo_hookean'"]);
    cube.settings.tools[0].shape = ToolShape::compound(parts).unwrap();
    let mut press = simulation(&cube);
    tick(&mut press, attach());
    let mut out = (Vec3::zeros(), Vec3::zeros(), 0);
    for i in 0..600 {
        let place = TOP + Vec3::z() * lowered(radius, depth, i);
        let tool = tick(&mut press, at(place)).tools[0];
        out = (tool.state.physical_force, tool.state.physical_torque, tool.contact_points);
    }
    out
}

/// Upward force [N] of balls of `radius` at these places beside the top's middle [m], each a tool of its own.
fn apart(radius: Real, depth: Real, places: &[Vec3]) -> Vec<Real> {
    let names: Vec<_> = (0..places.len()).map(|i| format!("{{name='{i}', radius={radius}}}")).collect();
    let cube =
        cube(&[&format!("tool=[{}]", names.join(",")), "material.damping_time=0.01", "material.law='neo_hookean'"]);
    let mut press = simulation(&cube);
    press.advance(&inputs(&vec![Some(attach()); places.len()]));
    for i in 0..600 {
        let events = places.iter().map(|place| Some(at(TOP + place + Vec3::z() * lowered(radius, depth, i))));
        press.advance(&inputs(&events.collect::<Vec<_>>()));
    }
    press.tools().iter().map(|tool| tool.physical_force.z).collect()
}

#[test]
fn parts_of_one_tool_feel_what_as_many_tools_feel() {
    let row = |n: i32, apart: Real| {
        let place = move |i: i32| Vec3::x() * (Real::from(2 * i - n + 1) * 0.5 * apart);
        (0..n).map(place).collect::<Vec<_>>()
    };
    let mut grid = row(4, 0.024);
    grid.iter_mut().for_each(|p| p.y -= 0.015);
    grid.extend(row(4, 0.024).iter().map(|p| p + Vec3::y() * 0.015));
    // More parts than there is room for fine patches have coarser ones, none is left out.
    for (name, places, most) in [("two", row(2, 0.06), 0.01), ("three", row(3, 0.03), 0.01), ("eight", grid, 0.05)] {
        let (radius, depth) = (0.004, 0.0015);
        let tools = apart(radius, depth, &places);
        let parts = places.iter().map(|place| of_radius(radius, *place)).collect();
        let (force, torque, points) = pressed(parts, radius, depth);
        let sum: Real = tools.iter().sum();
        let arms: Vec3 = places.iter().zip(&tools).map(|(place, force)| place.cross(&(Vec3::z() * *force))).sum();
        println!(
            "{name}: {:.4} N on {points} points, as tools {sum:.4} N; torque {:.2?} of {:.2?} mN m",
            force.z,
            (torque * 1e3).as_slice(),
            (arms * 1e3).as_slice()
        );
        assert!((force.z / sum - 1.0).abs() < most, "{name}: {} of {sum} N", force.z);
        assert!((torque - arms).norm() < most * sum * 0.05, "{name}: {torque:?} of {arms:?}");
        assert!(points >= places.len() as u32 * 5);
    }
}

#[test]
fn what_is_inside_of_another_part_is_not_felt() {
    let alone = pressed(vec![of_radius(0.01, Vec3::zeros())], 0.01, 0.003).0.z;
    let with =
        pressed(vec![of_radius(0.01, Vec3::zeros()), of_radius(0.004, Vec3::new(0.001, 0.0, -0.002))], 0.01, 0.003);
    println!("{alone:.4} N alone, {:.4} N with a ball inside", with.0.z);
    assert!((with.0.z / alone - 1.0).abs() < 0.005);
    // What stands out of a block is felt like a ball alone.
    let block = block(Vec3::new(-0.003, -0.003, 0.0), Vec3::new(0.006, 0.006, 0.04), 0.0005);
    let tip = of_radius(0.005, Vec3::zeros());
    let (ball, tipped) = (pressed(vec![tip.clone()], 0.005, 0.002).0.z, pressed(vec![block, tip], 0.005, 0.002).0.z);
    println!("{ball:.4} N of a ball, {tipped:.4} N of one at the end of a block");
    assert!((tipped / ball - 1.0).abs() < 0.01);
}

/// Of a rod of 4 mm, 30 mm long, on a half-space of 10 kPa and ν 0.35, its depth [m] and its force [N], by boundary elements
/// (70 by 21 rectangles of constant pressure on all that may touch, Love's integrals).
const ON_A_HALF_SPACE: [(Real, Real); 3] = [(0.0005, 0.0653), (0.0015, 0.2324), (0.003, 0.5233)];

#[test]
fn a_lying_rod_is_felt_as_on_a_half_space_in_one_piece_and_in_two() {
    let lying = |length: Real, start: Real| {
        let turned = Pose { position: Vec3::x() * start, orientation: ALONG_X };
        Part::capsule(0.004, length).at(turned)
    };
    for (depth, exact) in ON_A_HALF_SPACE {
        let one = pressed(vec![lying(0.03, -0.015)], 0.004, depth).0.z;
        let two = pressed(vec![lying(0.015, -0.015), lying(0.015, 0.0)], 0.004, depth).0.z;
        println!(
            "{:.1} mm deep: {one:.4} N in one piece, {two:.4} N in two, {exact:.4} N on a half-space",
            1e3 * depth
        );
        assert!((one / exact - 1.0).abs() < 0.03 && (two / exact - 1.0).abs() < 0.05);
        assert!((two / one - 1.0).abs() < 0.03, "{two} of {one} N");
    }
}
