//! Whatever a tool does, the body stays whole and comes back to rest.
//!
//! Wild trajectories at random.

use super::*;
use palpate_core::math::{Bounds, normalized_quaternion};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Ticks of wild motion.
const WILD: u64 = 400;
/// Ticks in which the body has to come to rest.
const REST: u64 = 4_000;

/// What a wild client does for a while.
enum Way {
    /// Stays at a place, reached in one jump.
    Jump(Vec3),
    /// A straight way through the body, per tick.
    Stab(Vec3, Vec3),
    /// Along the surface, to and fro.
    Stroke(Vec3, Vec3),
    /// Anywhere, every tick.
    Shake,
    Silent,
}

fn body() -> Arc<Body> {
    let mut cube = elastic_cube(2e4, true);
    (cube.damping_ratio, cube.spacings) = (0.3, vec![0.060, 0.042, 0.030]);
    cube.body()
}

fn wild_settings() -> Settings {
    let tool = |name: &str, radius, length| Tool {
        name: name.into(),
        shape: ToolShape::capsule(radius, length),
        friction: 0.0,
        pivot: None,
    };
    Settings {
        tools: vec![tool("ball", 0.01, 0.0), tool("rod", 0.005, 0.08), tool("tip", 0.001, 0.0)],
        limits: ForceLimits { force: 3.3, torque: 0.2, slew: 1000.0 },
        // Faster than any scene allows.
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.5, engage_ticks: 20 },
        most_elements: 500,
        ..settings(Some(Adaptivity { split: 0.1, ..Adaptivity::default() }))
    }
}

fn posed(position: Vec3, orientation: [Real; 4]) -> ToolEvent {
    match ball_at(position) {
        ToolEvent::Pose(sample) => ToolEvent::Pose(PoseSample { pose: Pose { position, orientation }, ..sample }),
        other => other,
    }
}

/// How far from rest, and how fast.
fn unrest(body: &Body, simulation: &Simulation) -> (Real, Real) {
    let mesh = simulation.mesh();
    mesh.active().iter().fold((0.0, 0.0), |worst: (Real, Real), slot| {
        let v = mesh.motion.velocity[slot.index()];
        let away = (mesh.position(*slot) - body.rest(mesh.node(*slot))).norm();
        (worst.0.max(away), worst.1.max(Vec3::new(v[0], v[1], v[2]).norm()))
    })
}

/// What one seed did: largest displacement [m], most elements, changes, ticks until rest, whether it was entangled and put
/// back, what was left [m, m/s].
struct Ran {
    bend: Real,
    elements: u32,
    changes: u32,
    least_det: Real,
    until_rest: u64,
    entangled: bool,
    left: (Real, Real),
}

fn run(body: &Arc<Body>, seed: u64) -> Ran {
    let mut random = Random(seed);
    let settings = wild_settings();
    let tools = settings.tools.len();
    let mut wild = simulation(body, &settings, uniform(body, 0));
    let mut ways = [const { Way::Silent }; 3];
    let mut until = [0; 3];
    let mut turned = [[0.0, 0.0, 0.0, 1.0]; 3];
    let mut touched = 0;
    let mut ran = Ran {
        bend: 0.0,
        elements: 0,
        changes: 0,
        least_det: 1.0,
        until_rest: REST,
        entangled: false,
        left: (Real::INFINITY, 0.0),
    };
    for i in 0..WILD {
        let mut inputs = Inputs::default();
        for tool in 0..tools {
            let turn = |random: &mut Random| {
                normalized_quaternion(std::array::from_fn(|_| random.between(-1.0, 1.0)))
                    .unwrap_or([0.0, 0.0, 0.0, 1.0])
            };
            let place = |random: &mut Random| Vec3::from_fn(|_, _| random.between(-0.05, 0.15));
            let event = if i >= until[tool] {
                until[tool] = i + 5 + random.below(100) as u64;
                turned[tool] = turn(&mut random);
                let anywhere = place(&mut random);
                let (way, event) = match random.below(10) {
                    0 => (Way::Silent, Some(ToolEvent::Detach)),
                    1 => (Way::Silent, None),
                    2 | 3 => (
                        Way::Shake,
                        Some(ToolEvent::Attach {
                            epoch: 1,
                            period_ticks: 1 + i as u32 % 20,
                            coupling: Coupling::RIGID,
                        }),
                    ),
                    4 => (Way::Jump(anywhere), None),
                    5 => (Way::Shake, None),
                    6 => {
                        let way = random.vector(1.0).normalize() * (1e-3 * random.between(0.2, 3.0));
                        (Way::Stroke(Vec3::new(0.02, 0.05, SIDE - 0.01), way), None)
                    }
                    _ => {
                        // From outside through the middle and out again, up to four times as fast as a tool may.
                        let way = random.vector(1.0).normalize();
                        (Way::Stab(Vec3::repeat(0.05) - way * 0.12, way * (1e-3 * random.between(0.3, 4.0))), None)
                    }
                };
                ways[tool] = way;
                event
            } else {
                match &mut ways[tool] {
                    Way::Jump(place) => Some(posed(*place, turned[tool])),
                    Way::Stab(place, way) => {
                        *place += *way;
                        Some(posed(*place, turned[tool]))
                    }
                    Way::Stroke(place, way) => {
                        *place += *way;
                        if (*place - Vec3::repeat(0.05)).amax() > 0.06 {
                            *way = -*way;
                        }
                        // The rod spins while it goes.
                        Some(posed(*place, turn(&mut random)))
                    }
                    Way::Shake => Some(posed(place(&mut random), turn(&mut random))),
                    Way::Silent => None,
                }
            };
            inputs.tools[tool] = event;
        }
        let outputs = wild.advance(&inputs);
        assert!(!outputs.restored, "seed {seed}, tick {i}");
        ran.elements = ran.elements.max(outputs.elements);
        ran.changes += outputs.adapted.splits + outputs.adapted.merges;
        ran.least_det = ran.least_det.min(outputs.extremes.det_f);
        if outputs.tools.iter().any(|tool| tool.contact_points > 0) {
            touched = i;
        }
        for tool in &outputs.tools {
            assert!(tool.state.force.norm() <= settings.limits.force * (1.0 + 1e-9), "seed {seed}, tick {i}");
            assert!(tool.state.physical_force.norm().is_finite(), "seed {seed}, tick {i}");
        }
        assert!(wild.mesh().is_finite(), "seed {seed}, tick {i}");
        ran.bend = ran.bend.max(unrest(body, &wild).0);
        if i % 20 == 19 {
            // A state that lost an element for want of room is refused.
            let sound = Simulation::new(body.clone(), settings.clone(), wild.snapshot());
            assert!(sound.is_ok(), "seed {seed}, tick {i}: {}", sound.err().unwrap_or_default());
        }
    }
    let mut leave = Inputs::default();
    leave.tools[..tools].fill(Some(ToolEvent::Detach));
    assert!(!wild.advance(&leave).restored);
    assert!(wild.snapshot().body.is_finite(), "seed {seed}");
    for i in 0..REST {
        let outputs = wild.advance(&Inputs::default());
        if outputs.restored {
            // Not before it is known to stay as it is.
            let untouched = WILD + i - touched;
            assert!(
                untouched >= 2_000 && !ran.entangled && outputs.extremes.det_f < 0.6,
                "seed {seed}, tick {i} of rest"
            );
            ran.entangled = true;
        }
        ran.changes += outputs.adapted.splits + outputs.adapted.merges;
        if i % 50 == 49 {
            ran.left = unrest(body, &wild);
            if is_at_rest(ran.left) {
                ran.until_rest = i;
                break;
            }
        }
    }
    ran
}

/// Within 1e-4 of its size, and so slow that it would take minutes to cross it. (The springs of the hold have no damping
/// of their own: nodes that dangle from them ring for a second or two, by less than a micrometre.)
fn is_at_rest(left: (Real, Real)) -> bool {
    left.0 < 1e-4 * SIDE && left.1 < 1e-2 * SIDE
}

/// Seeds that once broke the body, or left it tangled: far beyond the first.
const ONCE: [u64; 9] = [1198, 2426, 4806, 5293, 5799, 5980, 7002, 8698, 8941];

#[test]
fn a_body_in_a_knot_is_put_back() {
    // Wound by a full turn while both its ends are held, a slender bar cannot come home by itself.
    let width = 0.03;
    let end = |x| Region {
        bounds: Bounds::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x, width, width)),
        stiffness: None,
        exact: false,
    };
    let recipe = Recipe {
        name: "bar".into(),
        shape: Shape::closed(box_surface(Vec3::new(SIDE, width, width), [12, 4, 4]), vec![0.018, 0.013]),
        material: Material::from_young(2e4, 0.35, 1000.0),
        inclusions: vec![],
        holds: vec![end(0.0), end(SIDE)],
        elements: Default::default(),
        damping_ratio: 0.3,
    };
    let body = Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap());
    report(&body);
    let mut bar = simulation(&body, &wild_settings(), uniform(&body, 0));
    let mut wound = bar.snapshot();
    for x in &mut wound.body.position {
        let (sin, cos) = (std::f64::consts::TAU * x.x / SIDE).sin_cos();
        let (y, z) = (x.y - width / 2.0, x.z - width / 2.0);
        *x = Vec3::new(x.x, width / 2.0 + cos * y - sin * z, width / 2.0 + sin * y + cos * z);
    }
    bar.load(&wound);
    let mut put_back = vec![];
    for i in 0..REST {
        let outputs = bar.advance(&Inputs::default());
        let crushed = outputs.extremes.det_f;
        if outputs.restored {
            put_back.push(i);
        }
        if i == 1_500 {
            let (far, fast) = unrest(&body, &bar);
            println!("after 1.5 s {:.1} mm from rest, {:.1} mm/s, det F {crushed:.2}", far * 1e3, fast * 1e3);
            assert!(far > 0.01, "it came home by itself: that was no knot");
        }
    }
    println!("put back after {put_back:?} ms");
    // Not before it is known to stay as it is.
    assert!(matches!(put_back[..], [2_000..2_100]));
    assert!(is_at_rest(unrest(&body, &bar)));
}

#[test]
fn no_wild_tool_breaks_the_body_and_it_comes_back_to_rest() {
    let body = body();
    report(&body);
    let first = cases(50, 10_000);
    let all: Vec<u64> = (0..first).chain(ONCE.into_iter().filter(|seed| *seed >= first)).collect();
    let count = all.len() as u64;
    let next = AtomicUsize::new(0);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let ran = std::sync::Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(|| {
                while let Some(&seed) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let result = run(&body, seed);
                    ran.lock().unwrap().push((seed, result));
                }
            });
        }
    });
    let mut ran = ran.into_inner().unwrap();
    ran.sort_by_key(|r| r.0);
    assert_eq!(ran.len() as u64, count);
    let most = |f: &dyn Fn(&Ran) -> Real| ran.iter().map(|r| f(&r.1)).fold(0.0, Real::max);
    let changes: u64 = ran.iter().map(|r| u64::from(r.1.changes)).sum();
    let knots = ran.iter().filter(|r| r.1.entangled).count() as u64;
    println!(
        "{count} seeds: up to {:.0} mm from rest, least det F {:.2}, up to {} elements, {changes} changes; at rest \
         after {:.2} s at most, {knots} of them put back out of a knot",
        most(&|r| r.bend) * 1e3,
        ran.iter().map(|r| r.1.least_det).fold(1.0, Real::min),
        ran.iter().map(|r| r.1.elements).max().unwrap(),
        most(&|r| r.until_rest as Real) * TICK
    );
    let seeds: Vec<u64> = ran.iter().filter(|r| r.1.entangled).map(|r| r.0).collect();
    println!("put back: {seeds:?}");
    let unsettled: Vec<String> = ran
        .iter()
        .filter(|r| !is_at_rest(r.1.left))
        .map(|r| format!("seed {}: {:.3} mm, {:.2} mm/s", r.0, r.1.left.0 * 1e3, r.1.left.1 * 1e3))
        .collect();
    assert!(ran.iter().all(|r| r.1.elements <= 500));
    assert!(most(&|r| r.bend) > 0.02 && changes > 20 * count, "wild enough to mean something");
    assert!(knots <= count.div_ceil(100), "{knots} of {count} ended in a knot: {seeds:?}");
    assert!(unsettled.is_empty(), "{} of {count} do not come to rest: {unsettled:#?}", unsettled.len());
}
