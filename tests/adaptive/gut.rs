//! A loop of gut that is pushed together from both sides, wildly and for long: its legs never go through each other, and it comes home.

use super::*;
use palpate_core::contact::meeting::Between;
use palpate_core::contact::tool::Part;
use palpate_core::ids::Vertex;
use std::f64::consts::PI;

/// A tube along a U: two legs along x, held at their ends at x = 0, and a bend.
#[derive(Clone, Copy)]
struct Loop {
    /// Of the tube [m].
    radius: Real,
    /// Of the bend, to the middle of the tube [m].
    bend: Real,
    /// [m].
    legs: Real,
    youngs_modulus: Real,
    poisson_ratio: Real,
    friction: Real,
}

const GUT: Loop =
    Loop { radius: 0.012, bend: 0.02, legs: 0.06, youngs_modulus: 5e3, poisson_ratio: 0.45, friction: 0.0 };

impl Loop {
    /// Where the middle of the tube is `along` it [m], and its direction there.
    fn middle(&self, along: Real) -> (Vec3, Vec3) {
        let (bent, whole) = (PI * self.bend, 2.0 * self.legs + PI * self.bend);
        if along < self.legs {
            (Vec3::new(along, -self.bend, 0.0), Vec3::x())
        } else if along > self.legs + bent {
            (Vec3::new(whole - along, self.bend, 0.0), -Vec3::x())
        } else {
            let (sin, cos) = ((along - self.legs) / self.bend).sin_cos();
            (Vec3::new(self.legs + self.bend * sin, -self.bend * cos, 0.0), Vec3::new(cos, sin, 0.0))
        }
    }

    fn surface(&self) -> Surface {
        let around = 20;
        let whole = 2.0 * self.legs + PI * self.bend;
        let rings = (whole / (0.3 * self.radius)).ceil() as u32;
        let mut surface = Surface { vertices: vec![], triangles: vec![] };
        for ring in 0..=rings {
            let (middle, along) = self.middle(whole * Real::from(ring) / Real::from(rings));
            let out = Vec3::new(along.y, -along.x, 0.0);
            for i in 0..around {
                let (sin, cos) = (2.0 * PI * Real::from(i) / Real::from(around)).sin_cos();
                surface.vertices.push(middle + (out * cos + Vec3::z() * sin) * self.radius);
            }
        }
        for ring in 0..rings {
            for i in 0..around {
                let [a, b] = [i, (i + 1) % around].map(|i| ring * around + i);
                surface.triangles.extend([[b, a, a + around], [b + around, b, a + around]]);
            }
        }
        for (ring, is_last) in [(0, false), (rings, true)] {
            let middle = surface.vertices.len() as u32;
            surface.vertices.push(self.middle(if is_last { whole } else { 0.0 }).0);
            for i in 0..around {
                let [a, b] = [i, (i + 1) % around].map(|i| ring * around + i);
                surface.triangles.push(if is_last { [b, a, middle] } else { [a, b, middle] });
            }
        }
        surface
    }

    fn body(&self) -> Arc<Body> {
        let surface = self.surface();
        assert!(surface.volume() > 0.0);
        let Bounds { low, high } = surface.bounds();
        let ends = Bounds::new(low, Vec3::new(0.0, high.y, high.z));
        let recipe = Recipe {
            name: "gut".into(),
            shape: Shape::closed(surface, [1.2, 0.8, 0.55].map(|a| a * self.radius).to_vec()),
            material: Material::from_young(self.youngs_modulus, self.poisson_ratio, 1000.0),
            inclusions: vec![],
            holds: vec![Region { bounds: ends, stiffness: None, exact: false }],
            elements: Default::default(),
            damping_ratio: 0.3,
        };
        Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap())
    }
}

/// Vertices of the displayed surface that are deeper than `tolerance` [m] in another place of it: where that much below one, the surface
/// winds around twice.
fn through(gut: &Simulation, tolerance: Real) -> usize {
    let surface = gut.body().surface();
    let moved: Vec<Vec3> = (0..surface.vertices.len()).map(|v| gut.mesh().vertex(Vertex::at(v))).collect();
    let mut normals = vec![Vec3::zeros(); moved.len()];
    for t in &surface.triangles {
        let [a, b, c] = t.map(|v| moved[v as usize]);
        t.iter().for_each(|v| normals[*v as usize] += (b - a).cross(&(c - a)));
    }
    // Van Oosterom and Strackee 1983.
    let angle = |p: Vec3, t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| moved[v as usize] - p);
        let [k, l, m] = [a.norm(), b.norm(), c.norm()];
        2.0 * a.dot(&b.cross(&c)).atan2(k * l * m + a.dot(&b) * m + b.dot(&c) * k + c.dot(&a) * l)
    };
    let winds = |p: Vec3| surface.triangles.iter().map(|t| angle(p, t)).sum::<Real>() / (4.0 * PI);
    (0..moved.len()).filter(|v| winds(moved[*v] - normals[*v].normalize() * tolerance) > 1.5).count()
}

/// A rod that wanders on its side of the loop, and what it does.
struct Rod {
    /// -1 or 1.
    side: Real,
    from: Vec3,
    to: Vec3,
    /// Ticks that it has gone from the one to the other, ...
    gone: Real,
    /// ... and that it does.
    ticks: Real,
}

impl Rod {
    fn new(of: &Loop, side: Real) -> Self {
        let at = Vec3::new(0.5 * of.legs, side * (of.bend + 3.0 * of.radius), 0.0);
        Self { side, from: at, to: at, gone: 0.0, ticks: 0.0 }
    }

    /// Where it is in the next tick: at random from outside to so far in that it has pushed its leg all the way to the other's place,
    /// along that, and out again, by up to 1 m/s in a loop as large as [`GUT`].
    fn next(&mut self, of: &Loop, random: &mut Random) -> Vec3 {
        if self.gone >= self.ticks {
            let depth = [of.bend + 2.5 * of.radius, of.radius][random.below(2)] + random.between(0.0, 1.0) * of.radius;
            let [along, height] = [random.between(0.2, 0.9) * of.legs, random.between(-0.5, 0.5) * of.radius];
            self.from = std::mem::replace(&mut self.to, Vec3::new(along, self.side * depth, height));
            let speed = random.between(0.02, 1.0) * of.radius / GUT.radius;
            let stays = random.below(100) as Real;
            (self.gone, self.ticks) = (0.0, ((self.to - self.from).norm() / speed / TICK).ceil() + stays);
        }
        self.gone += 1.0;
        self.from + (self.to - self.from) * (self.gone / self.ticks)
    }
}

/// How far nodes are from rest at most [m].
fn away(gut: &Simulation) -> Real {
    let mesh = gut.mesh();
    let of = |s: &Slot| (mesh.position(*s) - gut.body().rest(mesh.node(*s))).norm();
    mesh.active().iter().map(of).fold(0.0, Real::max)
}

fn run(of: Loop, seed: u64) {
    let body = of.body();
    report(&body);
    // Across the loop's plane, so long that no leg slips off it.
    let rod = |name: &str| {
        let part = Part::capsule(of.radius, 6.0 * of.radius);
        let shape = part.at(Pose { position: -3.0 * of.radius * Vec3::z(), ..Pose::default() }).into();
        Tool { name: name.into(), shape, friction: of.friction, pivot: None }
    };
    let settings = Settings {
        tools: vec![rod("left"), rod("right")],
        organ_friction: Between::all(of.friction),
        adaptivity: Some(Adaptivity::default()),
        following: Following { speed: 1.0, engage_ticks: 20 },
        ..settings(None)
    };
    let mut gut = simulation(&body, &settings, uniform(&body, 0));
    let mut random = Random(seed);
    let mut rods = [-1.0, 1.0].map(|side| Rod::new(&of, side));
    let (mut least_det, mut changes, mut met, mut most, mut often, mut bent) = (1.0 as Real, 0, 0, 0, 0, 0.0 as Real);
    for tick in 0..10_000 {
        let mut inputs = Inputs::default();
        for (event, rod) in inputs.tools.iter_mut().zip(&mut rods) {
            *event = Some(if tick == 0 { ATTACH } else { ball_at(rod.next(&of, &mut random)) });
        }
        let outputs = gut.advance(&inputs);
        assert!(!outputs.restored, "seed {seed}, tick {tick}");
        changes += outputs.adapted.splits + outputs.adapted.merges;
        least_det = least_det.min(outputs.extremes.det_f);
        met += usize::from(gut.meetings().iter().any(|m| m.multiplier > 0.0));
        if tick % 100 == 0 {
            let deep = through(&gut, 0.1 * of.radius);
            (most, often, bent) = (most.max(deep), often + u32::from(deep > 0), away(&gut).max(bent));
        }
    }
    let mut leave = Inputs::default();
    leave.tools[..2].fill(Some(ToolEvent::Detach));
    assert!(!gut.advance(&leave).restored);
    (0..5_000).for_each(|i| assert!(!gut.advance(&Inputs::default()).restored, "tick {i} of rest"));
    let (left, inside) = (away(&gut), through(&gut, 0.0));
    println!(
        "seed {seed}: {:.0} mm from rest, least det F {least_det:.2}, {changes} changes, meets itself in {met} ticks, \
         in {often} of 100 looks up to {most} vertices deeper than a tenth of its radius; after it {left:.0e} m from rest, {inside} inside",
        bent * 1e3
    );
    assert!(met > 1_000 && bent > 3.0 * of.radius && changes > 1_000);
    // For a moment, where rods crush it or it is flung faster than what is near is looked for.
    assert!(20 * most <= body.surface().vertices.len());
    assert!(inside == 0 && left < 1e-2 * of.radius);
}

#[test]
fn legs_of_a_loop_that_is_pushed_together_from_both_sides_stay_on_their_sides() {
    let rough = Loop { friction: 0.3, youngs_modulus: 2e4, ..GUT };
    let small = Loop { radius: 0.006, bend: 0.01, legs: 0.04, poisson_ratio: 0.3, ..GUT };
    for of in [GUT, rough, small] {
        (0..cases(1, 8)).for_each(|seed| run(of, seed));
    }
}
