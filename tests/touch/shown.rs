//! The surface that is shown is the one that is touched: it lies against the tool, which the mesh alone does not.

use super::shapes::block;
use super::*;
use palpate_core::contact::tool::Part;

/// A tool whose foremost place is its reference point, how far a place is above its surface, and within what distance from its middle it
/// touches when it is pressed so deep [m].
struct Presses<'a> {
    name: &'a str,
    part: Part,
    above: &'a dyn Fn(Vec3) -> Real,
    near: Real,
    depth: Real,
}

impl Presses<'_> {
    /// Presses it, moves it aside, and gives how far vertices within its middle are above it at least and at most: as the mesh shows them, and as
    /// they are shown.
    fn run(&self, setup: &Setup) -> [[Real; 2]; 2] {
        let mut settings = setup.settings.clone();
        settings.tools[0].shape = self.part.clone().into();
        let mut press = Simulation::new(setup.body.clone(), settings, setup.rest.clone()).unwrap();
        tick(&mut press, attach());
        let mut place = TOP;
        for i in 0..700 {
            let t = Real::from(i) * TICK;
            let down = 0.002 - (self.depth + 0.002) * ease(t, 0.0, 0.3);
            place = TOP + Vec3::new(0.004 * ease(t, 0.3, 0.6), 0.003, down);
            tick(&mut press, at(place));
        }
        let mut bare = vec![Vec3::zeros(); setup.body.surface().vertices.len()];
        press.mesh().skin(&mut bare);
        let within = |vertices: &[Vec3]| {
            let away = vertices.iter().map(|v| v - place);
            let touched = away.filter(|d| d.z.abs() < 0.01 && d.xy().norm() < self.near);
            let gaps: Vec<Real> = touched.map(|d| (self.above)(d)).collect();
            assert!(gaps.len() > 1);
            [
                gaps.iter().copied().fold(Real::INFINITY, Real::min),
                gaps.iter().copied().fold(-Real::INFINITY, Real::max),
            ]
        };
        [within(&bare), within(&press.touched_surface())]
    }
}

#[test]
fn the_surface_that_is_shown_lies_against_the_tool() {
    let ball = |radius: Real| {
        let at = Pose { position: Vec3::z() * radius, ..Pose::default() };
        (Part::capsule(radius, 0.0).at(at), move |d: Vec3| (d - Vec3::z() * radius).norm() - radius)
    };
    let ((small, on_small), (large, on_large)) = (ball(0.01), ball(0.03));
    let lying = Pose { position: Vec3::new(-0.02, 0.0, 0.004), orientation: ALONG_X };
    let on_capsule = |d: Vec3| Vec3::new((d.x.abs() - 0.02).max(0.0), d.y, d.z - 0.004).norm() - 0.004;
    let cylinder = Part::cylinder(0.01, 0.03, 0.001);
    let face = block(Vec3::new(-0.01, -0.01, 0.001), Vec3::new(0.02, 0.02, 0.03), 0.001);
    let all = [
        Presses { name: "ball", part: small.clone(), above: &on_small, near: 1.6e-3, depth: 0.001 },
        Presses { name: "ball", part: small, above: &on_small, near: 2.7e-3, depth: 0.003 },
        Presses { name: "large ball", part: large, above: &on_large, near: 4.7e-3, depth: 0.003 },
        Presses {
            name: "capsule",
            part: Part::capsule(0.004, 0.04).at(lying),
            above: &on_capsule,
            near: 2.5e-3,
            depth: 0.002,
        },
        Presses { name: "cylinder", part: cylinder, above: &|d| d.z, near: 5e-3, depth: 0.003 },
        Presses { name: "block", part: face, above: &|d| d.z, near: 5e-3, depth: 0.003 },
    ];
    let uniform = |cells: &str, elements: &str| {
        let (cells, elements) = (format!("body.cells={cells}"), format!("material.elements=\"{elements}\""));
        scene(&[&cells, "body.active_level=0", &elements, "body.display_vertices=20000"])
    };
    let soft = ["material.poisson_ratio=0.45", "material.youngs_modulus=2000", "material.damping_time=0.01"];
    let setups = [
        ("coarse, tetrahedra", uniform("[[8,8,8]]", "tetrahedra")),
        ("coarse", uniform("[[8,8,8]]", "smoothed")),
        ("fine, tetrahedra", uniform("[[12,12,12]]", "tetrahedra")),
        ("fine", uniform("[[12,12,12]]", "smoothed")),
        ("adaptive, soft", adaptive_cube(&[&soft[..], &["body.display_vertices=20000"]].concat())),
    ];
    for (name, setup) in &setups {
        for of in &all {
            let [bare, shown] = of.run(setup).map(|gaps| gaps.map(|gap| gap / of.depth));
            println!("{name}, {} {} mm deep: {bare:.2?} of that, as shown {shown:.2?}", of.name, of.depth * 1e3);
            assert!(shown.iter().all(|gap| gap.abs() < 0.15));
            let is_round = of.name != "cylinder" && of.name != "block";
            assert!(!is_round || bare[0] < -0.3);
        }
    }
}

/// A machine that is too slow for the body shows what it last was.
#[test]
fn a_dent_is_shown_while_the_body_stands_still() {
    let cube = cube(&["tool.radius=0.01"]);
    let mut press = simulation(&cube);
    tick(&mut press, attach());
    let mut place = TOP;
    for i in 0..400 {
        place = TOP + Vec3::z() * (0.012 - 0.006 * ease(Real::from(i) * TICK, 0.0, 0.3));
        tick(&mut press, at(place));
    }
    let moving = press.touched_surface();
    let outputs = press.advance(&Inputs { budget: Budget::of(1), ..inputs(&[Some(at(place))]) });
    assert!(outputs.plan.taken == 0);
    let apart = |other: &[Vec3]| moving.iter().zip(other).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max);
    let mut bare = moving.clone();
    press.mesh().skin(&mut bare);
    let (still, left_out) = (apart(&press.touched_surface()), apart(&bare));
    println!("{:.1} µm off, of {:.1} that the mesh leaves out", 1e6 * still, 1e6 * left_out);
    assert!(left_out > 1e-3 && still < 0.02 * left_out);
}
