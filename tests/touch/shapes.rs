//! Tools that are no balls: cylinders, convex hulls and several parts at once.

use super::feel::momentum_errors;
use super::*;
use palpate_body::prepare::Region;
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::tool::Part;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::Bounds;

/// A box with the least corner `low` [m].
pub(super) fn block(low: Vec3, size: Vec3, rounding: Real) -> Part {
    let corners: Vec<Vec3> =
        (0..8).map(|i| low + Vec3::from_fn(|c, _| if i >> c & 1 == 0 { 0.0 } else { size[c] })).collect();
    Part::convex(&corners, rounding).unwrap()
}

/// Two jaws that gape `wide` at their tips, along x, and nearly close 40 mm above; the reference point is between the tips.
fn forceps(wide: Real) -> ToolShape {
    let jaw = |side: Real| {
        let half = 0.5 * wide * side;
        let out = Vec3::x() * (0.004 * side);
        let (tip, hinge) = (Vec3::new(half, 0.0, 0.0), Vec3::new(0.001 * side, 0.0, 0.04));
        let across = Vec3::y() * 0.006;
        let corners = [tip - across, tip + across, tip + out - across, tip + out + across].into_iter().chain([
            hinge - across,
            hinge + across,
            hinge + out - across,
            hinge + out + across,
        ]);
        Part::convex(&corners.collect::<Vec<_>>(), 0.001).unwrap()
    };
    let handle = Part::cylinder(0.004, 0.05, 0.001).at(Pose { position: Vec3::new(0.0, 0.0, 0.04), ..Pose::default() });
    ToolShape::compound(vec![jaw(-1.0), jaw(1.0), handle]).unwrap()
}

pub(super) fn quaternion(axis: Vec3, angle: Real) -> [Real; 4] {
    let v = axis.normalize() * (0.5 * angle).sin();
    [v.x, v.y, v.z, (0.5 * angle).cos()]
}

/// Lowers the only tool by `depth` within 0.3 s, `way(depth)` being its pose, holds it for 0.2 s and gives its force in
/// every tick, the torque at the end, and the contact points at the end.
fn lowered(cube: &Setup, depth: Real, way: impl Fn(Real) -> ToolEvent) -> (Vec<Vec3>, Vec3, u32) {
    let mut press = simulation(cube);
    tick(&mut press, attach());
    let mut forces = Vec::new();
    let (mut torque, mut points) = (Vec3::zeros(), 0);
    for i in 0..500 {
        let down = -0.002 + (depth + 0.002) * ease(Real::from(i) * TICK, 0.0, 0.3);
        let tool = tick(&mut press, way(down)).tools[0];
        (torque, points) = (tool.state.physical_torque, tool.contact_points);
        assert!(is_finite(&tool.state.physical_force) && is_finite(&torque));
        forces.push(tool.state.physical_force);
    }
    (forces, torque, points)
}

fn with_shape(shape: ToolShape, overrides: &[&str]) -> Setup {
    let mut cube = cube(&[&["material.damping_time=0.01"], overrides].concat());
    cube.settings.tools[0].shape = shape;
    cube
}

#[test]
fn a_flat_end_feels_its_force_in_its_middle_and_quietly() {
    let cylinder = ToolShape::from(Part::cylinder(0.012, 0.03, 0.001));
    let block: ToolShape = block(Vec3::new(-0.01, -0.01, 0.0), Vec3::new(0.02, 0.02, 0.03), 0.001).into();
    for (name, shape, vertices) in [
        ("cylinder", &cylinder, 5_500),
        ("block", &block, 5_500),
        // Far more points than the solver takes.
        ("cylinder", &cylinder, 14_000),
        ("block", &block, 14_000),
    ] {
        let rounding = if name == "block" { 0.001 } else { 0.0 };
        let cube = with_shape(shape.clone(), &[&format!("body.display_vertices={vertices}")]);
        let (forces, torque, points) = lowered(&cube, 0.004, |down| at(TOP + Vec3::z() * (rounding - down)));
        let held = forces[499];
        let noise = forces[400..].windows(2).map(|f| (f[1] - f[0]).norm()).fold(0.0, Real::max);
        println!(
            "{name}: {:.3} N on {points} points, sideways {:.1e}, arm {:.2} mm, {noise:.1e} N from tick to tick",
            held.z,
            held.xy().norm() / held.z,
            1e3 * torque.norm() / held.z
        );
        assert!(held.z > 0.5 && held.xy().norm() < 0.03 * held.z && points >= 4);
        // The display's triangles are larger than the tool, and all cut the same way.
        assert!(torque.norm() < 2.5e-3 * held.z, "{torque:?}");
        assert!(noise < 5e-3 * held.z, "{noise} N");
    }
}

#[test]
fn a_rim_and_an_edge_are_felt_inside_a_triangle_and_across_an_edge_of_the_surface() {
    // Display vertices stand every 25 mm: both the rim and the edge are shorter than a triangle.
    let coarse = ["body.cells=[[4,4,4]]", "body.active_level=0", "body.display_vertices=98"];
    let inside = TOP + Vec3::new(0.008, 0.016, 0.0);
    let across = TOP + Vec3::new(0.0125, 0.0, 0.0);
    let rounding = 0.0005;
    let rim = ToolShape::from(Part::cylinder(0.006, 0.02, rounding));
    let edge = ToolShape::from(block(Vec3::new(-0.004, 0.0, 0.0), Vec3::new(0.008, 0.01, 0.01), rounding));
    for (place_name, place) in [("inside", inside), ("across an edge", across)] {
        for (name, shape, turned, lift) in [
            // Tilted by 45°, the lowest place of the rim's core is this far below the reference point.
            ("rim", &rim, quaternion(Vec3::y(), 0.25 * std::f64::consts::PI), (0.0055 - rounding) * 0.5f64.sqrt()),
            // Stands on its edge along x.
            ("edge", &edge, quaternion(Vec3::x(), 0.25 * std::f64::consts::PI), 0.0),
        ] {
            let cube = with_shape(shape.clone(), &coarse);
            let (forces, _, points) =
                lowered(&cube, 0.003, |down| posed(place + Vec3::z() * (lift + rounding - down), turned));
            let first = forces.iter().position(|f| f.z > 1e-3).unwrap();
            let held = forces[400..].iter().map(|f| f.z).sum::<Real>() / 100.0;
            let most = forces[400..].iter().map(|f| (f.z / held - 1.0).abs()).fold(0.0, Real::max);
            let down = -0.002 + 0.005 * ease(first as Real * TICK, 0.0, 0.3);
            println!(
                "{name} {place_name}: felt from {:.2} mm on, {held:.3} N at 3 mm on {points} points, within {:.0} %",
                down * 1e3,
                most * 1e2
            );
            assert!(points > 0 && held > 0.1, "{name} {place_name}");
            assert!(down > -0.3e-3 && down < 0.3e-3, "{name} {place_name}: felt at {down} m");
        }
    }
}

/// What is sharp goes deeper into the displayed surface than a mesh can show: pressed in and held, it is felt the same on
/// elements of any size, and without jolts.
#[test]
fn a_rim_an_edge_and_a_corner_are_felt_alike_and_quietly_on_any_mesh() {
    let rounding = 0.0005;
    let shapes: [(&str, ToolShape, [Real; 4], Real); 3] = [
        (
            "rim",
            Part::cylinder(0.006, 0.02, rounding).into(),
            quaternion(Vec3::y(), 0.25 * std::f64::consts::PI),
            0.0039,
        ),
        (
            "edge",
            block(Vec3::new(-0.004, 0.0, 0.0), Vec3::new(0.008, 0.01, 0.01), rounding).into(),
            quaternion(Vec3::x(), 0.25 * std::f64::consts::PI),
            0.0,
        ),
        // A diagonal of the cube stands upright.
        (
            "corner",
            block(Vec3::zeros(), Vec3::repeat(0.01), rounding).into(),
            quaternion(Vec3::new(1.0, -1.0, 0.0), 0.9553),
            0.0,
        ),
    ];
    for (name, shape, turned, lift) in shapes {
        // The deeper, the less are strains under a coarse mesh those of a small one.
        for (depth, most) in [(0.003, 0.06), (0.006, 0.07), (0.01, 0.16)] {
            let mut felt = Vec::new();
            for cells in ["[[4,4,4],[7,7,7],[12,12,12]]", "[[5,5,5],[9,9,9],[17,17,17]]"] {
                let mut cube = scene(&["material.damping_time=0.01", &format!("body.cells={cells}")]);
                cube.settings.tools[0].shape = shape.clone();
                let place = TOP + Vec3::new(0.008, 0.016, lift + rounding);
                let (forces, _, points) = lowered(&cube, depth, |down| posed(place - Vec3::z() * down, turned));
                let held = forces[499].norm();
                let bends = forces[100..].windows(3).map(|f| (f[2] - 2.0 * f[1] + f[0]).norm());
                let kink = bends.fold(0.0, Real::max);
                println!(
                    "{name} {:.0} mm deep on {cells}: {held:.3} N on {points} points, sideways {:.3} N, kink {:.1} mN",
                    1e3 * depth,
                    forces[499].xy().norm(),
                    1e3 * kink
                );
                assert!(kink < 0.008, "{name} {depth} on {cells}: {kink} of {held} N");
                // Only the rim leans to one side.
                let sideways = match name {
                    "rim" => 0.2,
                    _ if depth < 0.01 => 0.05,
                    // So crushed, elements buckle to one side.
                    _ => 0.08,
                };
                assert!(forces[499].xy().norm() < sideways * held, "{name} {depth} on {cells}: {:?}", forces[499]);
                felt.push(held);
            }
            assert!((felt[0] / felt[1] - 1.0).abs() < most, "{name} {depth}: {felt:?}");
        }
    }
}

#[test]
fn two_jaws_squeeze_a_fold_with_opposite_forces() {
    // A fold 16 mm thick, held at its foot; forceps whose tips gape 24 mm come down over it.
    let fold = [
        "body.size=[0.016,0.06,0.05]",
        "body.cells=[[2,8,6],[4,16,12]]",
        "hold=[{min=[0,0,0],max=[1,1,0],exact=true}]",
    ];
    let cube = with_shape(forceps(0.024), &fold);
    let top = Vec3::new(0.008, 0.03, 0.05);
    let per_part = cube.body.points_of_a_part();
    let mut press = simulation(&cube);
    tick(&mut press, attach());
    let mut jaws = [Vec3::zeros(); 3];
    let mut total = Vec3::zeros();
    for i in 0..900 {
        let height = 0.002 - 0.024 * ease(Real::from(i) * TICK, 0.0, 0.6);
        let tool = tick(&mut press, at(top + Vec3::z() * height)).tools[0];
        assert!(is_finite(&tool.state.physical_force));
        total = tool.state.physical_force;
        jaws = [Vec3::zeros(); 3];
        for p in &press.snapshot().points[0] {
            jaws[(p.point / per_part) as usize] -= p.normal * p.multiplier;
        }
    }
    println!(
        "jaws {:.3?} and {:.3?} N, handle {:.3?}, in all {total:.3?}",
        jaws[0].as_slice(),
        jaws[1].as_slice(),
        jaws[2].as_slice()
    );
    assert!(jaws[0].x < -0.1 && jaws[1].x > 0.1, "both are pushed outward");
    assert!((jaws[0].x + jaws[1].x).abs() < 0.05 * jaws[1].x);
    assert!((jaws.iter().sum::<Vec3>() - total).norm() < 0.05 * jaws[1].x);
}

#[test]
fn what_tools_of_other_shapes_get_the_body_loses_tick_by_tick() {
    // Forceps with both tips on the free cube; a cylinder and a block in one body.
    let pinch = momentum_errors([forceps(0.03)], 0.3, |t| {
        let turned = quaternion(Vec3::new(0.2, 1.0, 0.0), 0.1 + 0.2 * t);
        [posed(TOP + Vec3::new(-0.02 * t, 0.0, 0.006 - 0.08 * t), turned)]
    });
    let cylinder = Part::cylinder(0.01, 0.04, 0.001).into();
    let block = block(Vec3::repeat(-0.01), Vec3::repeat(0.02), 0.001).into();
    let two = momentum_errors([cylinder, block], 0.3, |t| {
        let turned = quaternion(Vec3::new(1.0, 0.3, 0.0), 0.5 - t);
        [
            posed(TOP + Vec3::new(0.01, 0.0, 0.012 - 0.08 * t), turned),
            posed(Vec3::new(-0.02 + 0.08 * t, 0.05, 0.05), turned),
        ]
    });
    println!("linear {:.1e} and {:.1e} of the momentum, angular {:.1e} and {:.1e}", pinch.0, two.0, pinch.1, two.1);
    for (linear, angular) in [pinch, two] {
        assert!(linear <= 1e-12 && angular <= 0.5);
    }
}

/// How far the force of a ball of `radius` that slides `depth` deep [m] over 30 mm of the top, `beside` its middle [m], gets
/// from its mean, over the mean, and that mean [N].
fn sliding(cube: &Setup, radius: Real, depth: Real, beside: Real) -> (Real, Real) {
    let mut slide = simulation(cube);
    tick(&mut slide, attach());
    let mut forces = Vec::new();
    for i in 0..2100 {
        let t = Real::from(i) * TICK;
        let way = 0.03 * ((t - 0.6) / 1.5).clamp(0.0, 1.0) - 0.015;
        let height = radius + 5e-4 - (depth + 5e-4) * ease(t, 0.0, 0.3);
        let force = tick(&mut slide, at(TOP + Vec3::new(way, beside, height))).tools[0].state.physical_force;
        if i > 600 {
            forces.push(force.z);
        }
    }
    let mean = forces.iter().sum::<Real>() / forces.len() as Real;
    // From one tick to the next it is smooth, too.
    let kinks = forces.windows(3).map(|f| (f[2] - 2.0 * f[1] + f[0]).abs()).fold(0.0, Real::max);
    assert!(kinks < 0.01 * mean, "{kinks} N of {mean}");
    (forces.iter().map(|f| (f / mean - 1.0).abs()).fold(0.0, Real::max), mean)
}

/// The cube, displayed by `cells` squares along each edge, covered by lattices that its faces cut anywhere, of constants
/// `spacings` [m]: the second moves as a whole, of more than two it adapts between them.
fn covered(spacings: &[Real], cells: u32, radius: Real) -> Setup {
    let elastic = Material::from_young(1e4, 0.35, 1000.0);
    let bounds = Bounds::new(Vec3::zeros(), Vec3::new(SIDE, SIDE, 1e-3));
    let recipe = Recipe {
        name: "covered".into(),
        shape: Shape::closed(box_surface(Vec3::repeat(SIDE), [cells; 3]), spacings.to_vec()),
        material: Material { phi: elastic.lambda * 0.01, psi: elastic.mu * 0.01, ..elastic },
        inclusions: vec![],
        holds: vec![Region { bounds, stiffness: None, exact: false }],
        elements: Default::default(),
        damping_ratio: 0.0,
    };
    let adapts = spacings.len() > 2;
    let settings = Settings {
        tools: vec![Tool { name: "ball".into(), shape: ToolShape::ball(radius), friction: 0.0, pivot: None }],
        adaptivity: adapts.then(Adaptivity::default),
        most_elements: 100_000,
        ..scene(&["tool.radius=0.01"]).settings
    };
    let body = Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap());
    Setup { rest: Snapshot::at_rest(&body, usize::from(!adapts), 1), body, settings }
}

/// Two lines along the slide beside the middle [m].
const TRACKS: [Real; 2] = [0.003, -0.0011];

/// Slides a ball of 10 mm along both tracks, 1 mm deep, then 2 and 3; its force stays within a part of its mean, by depth in `all`.
/// Unless all is tried: the deepest along one of them.
fn slides(name: &str, cube: &Setup, all: &[Real]) {
    for (i, (depth, most)) in [0.001, 0.002, 0.003].into_iter().zip(all.iter().copied()).enumerate() {
        for (k, beside) in TRACKS.into_iter().enumerate() {
            if !whole() && (i + 1 < all.len() || k == 0) {
                continue;
            }
            let (away, mean) = sliding(cube, 0.01, depth, beside);
            let name = format!("{name}, {:.0} mm deep, {:+.1} mm", 1e3 * depth, 1e3 * beside);
            println!("{name}: within {:.2} % of {mean:.4} N", 1e2 * away);
            assert!(away < most, "{name}: {away}");
        }
    }
}

#[test]
fn a_ball_that_slides_at_constant_depth_keeps_its_force() {
    let with = |cells: &[&str]| scene(&[&["tool.radius=0.01", "material.damping_time=0.01"], cells].concat());
    let uniform = with(&["body.cells=[[4,4,4],[8,8,8]]", "body.active_level=1"]);
    slides("uniform 12.5 mm", &uniform, &[0.025; 3]);
    slides("adaptive, 25 to 8.3 mm", &with(&["body.cells=[[4,4,4],[7,7,7],[12,12,12]]"]), &[0.03; 3]);
    slides("adaptive, 20 to 5.9 mm", &with(&["body.cells=[[5,5,5],[9,9,9],[17,17,17]]"]), &[0.03, 0.03, 0.025]);
}

#[test]
fn a_ball_that_slides_over_a_face_that_cuts_elements_keeps_its_force() {
    slides("cover of 12.5 mm", &covered(&[0.03, 0.0125], 40, 0.01), &[0.025, 0.025, 0.03]);
    if !whole() {
        return;
    }
    slides("cover of 8.5 mm", &covered(&[0.03, 0.0085], 40, 0.01), &[0.025; 3]);
    slides("cover of 8.5 mm, small triangles", &covered(&[0.03, 0.0085], 72, 0.01), &[0.025; 2]);
}

#[test]
fn a_ball_that_slides_over_an_adaptive_face_that_cuts_elements_keeps_its_force() {
    slides("adaptive cover, 30 to 6 mm", &covered(&[0.03, 0.018, 0.0105, 0.006], 40, 0.01), &[0.03, 0.025, 0.025]);
}

#[test]
fn a_wide_ball_that_slides_in_small_strain_keeps_its_force_whatever_the_size_of_elements() {
    let (radius, depth): (Real, Real) = (0.04, 0.75e-3);
    let hertz = 4.0 / 3.0 * 1e4 / (1.0 - 0.35 * 0.35) * radius.sqrt() * depth.powf(1.5);
    let continuum = hertz / (1.0 + Material::from_young(1e4, 0.35, 1.0).softening((depth / radius).sqrt()));
    for (i, spacing) in [0.0125, 0.0085].into_iter().enumerate() {
        let cover = covered(&[0.03, spacing], 40, radius);
        for (k, beside) in TRACKS.into_iter().enumerate() {
            if !whole() && i != k {
                continue;
            }
            let (away, mean) = sliding(&cover, radius, depth, beside);
            let name = format!("wide ball, cover of {:.1} mm, {:+.1} mm", 1e3 * spacing, 1e3 * beside);
            println!("{name}: within {:.2} % of {mean:.4} N, continuum {continuum:.4} N", 1e2 * away);
            assert!(away < 0.03 && (mean / continuum - 1.0).abs() < 0.05, "{name}: {away}, {mean} N");
        }
    }
}
