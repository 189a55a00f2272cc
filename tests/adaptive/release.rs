//! What all of this is for: let go by a tool, a body whose resolution followed the tool swings like one that is fine
//! everywhere.

use super::*;
use palpate_core::ids::Vertex;

/// Ticks until the ball is all the way down, until it is gone, and after that.
const DOWN: u64 = 500;
const GONE: u64 = 800;
const SWING: u64 = 2000;

/// What a body did once it was let go.
struct Swing {
    /// Displacement along z [m] of the mass on the mean and of the middle of the free face, (n_ticks).
    mean: Vec<Real>,
    tip: Vec<Real>,
    /// Active nodes on the mean while pressed at full depth and while swinging, and at the end.
    nodes: [Real; 3],
    /// Nodes split and families merged after the ball is gone, and ticks from then on with several levels in use.
    changes: [u32; 2],
    mixed: u32,
}

/// The ball bends the cube down near its free edge by `depth` [m] and is gone from one tick to the next.
fn let_go(body: &Arc<Body>, adaptivity: Option<Adaptivity>, depth: Real) -> Swing {
    let level = if adaptivity.is_some() { 0 } else { body.finest() };
    let mut run = simulation(body, &settings(adaptivity), uniform(body, level));
    let middle = Vec3::new(SIDE, SIDE / 2.0, SIDE / 2.0);
    let to_middle = |v: &Vertex| (body.surface().vertices[v.index()] - middle).norm();
    let tip = body.vertices().min_by(|a, b| to_middle(a).total_cmp(&to_middle(b))).unwrap();
    let mut swing = Swing { mean: vec![], tip: vec![], nodes: [0.0; 3], changes: [0; 2], mixed: 0 };
    for i in 0..GONE + SWING {
        let down = -0.001 + (depth + 0.001) * ease(i as Real, 0.0, DOWN as Real);
        let given = match i {
            0 => inputs(ATTACH),
            GONE => inputs(ToolEvent::Detach),
            i if i > GONE => Inputs::default(),
            _ => inputs(ball_at(Vec3::new(0.085, SIDE / 2.0, SIDE + 0.01 - down))),
        };
        let outputs = run.advance(&given);
        assert!(!outputs.restored, "tick {i}");
        let nodes = Real::from(outputs.active.iter().sum::<u32>());
        if i < GONE {
            swing.nodes[0] += if i >= DOWN { nodes / (GONE - DOWN) as Real } else { 0.0 };
            continue;
        }
        swing.nodes[1] += nodes / SWING as Real;
        swing.nodes[2] = nodes;
        swing.changes[0] += outputs.adapted.splits;
        swing.changes[1] += outputs.adapted.merges;
        swing.mixed += u32::from(outputs.active.iter().filter(|n| **n > 0).count() > 1);
        swing.mean.push(mean_displacement(body, run.mesh()).z);
        swing.tip.push((run.mesh().vertex(tip) - body.surface().vertices[tip.index()]).z);
    }
    swing
}

/// Root mean square of a signal: what it swings by, without hanging on a single sample.
fn rms(signal: &[Real]) -> Real {
    (signal.iter().map(|x| x * x).sum::<Real>() / signal.len() as Real).sqrt()
}

#[test]
fn let_go_by_a_tool_an_adaptive_body_swings_like_a_fine_one() {
    let default = Adaptivity::default().split;
    // Refined for the ball and merged behind it; stirred up, without damping, until the strain of the swing itself asks
    // for resolution; and damped a little.
    for (damping_ratio, depth, split) in [(0.0, 0.005, default), (0.0, 0.012, default / 4.0), (0.02, 0.012, default)] {
        let mut cube = elastic_cube(2e4, true);
        (cube.spacings, cube.damping_ratio) = (vec![0.032, 0.018, 0.0105], damping_ratio);
        let body = cube.body();
        report(&body);
        let finest = body.nodes_of(body.finest()).len() as Real;
        let fine = let_go(&body, None, depth);
        let swing = let_go(&body, Some(Adaptivity { split, ..Adaptivity::default() }), depth);
        let nodes = swing.nodes.map(|n| n / finest);
        println!(
            "ζ {damping_ratio}, {:.0} mm, split at {split}: {:.2?} of {finest} nodes while pressed, while swinging and at the \
             end; {} splits and {} merges after the release, {} ticks on more than one level; the finest's period is {:.1} ms",
            depth * 1e3,
            nodes,
            swing.changes[0],
            swing.changes[1],
            swing.mixed,
            period(&fine.mean) * 1e3
        );
        assert!(nodes[0] < 0.3 && nodes[1] < 0.3, "little is saved");
        assert!(swing.changes[0] + swing.changes[1] > 20 && swing.mixed > 50, "resolution stays as it is");
        for (what, adaptive, fine) in [("mass", &swing.mean, &fine.mean), ("tip", &swing.tip, &fine.tip)] {
            let off = period(adaptive) / period(fine) - 1.0;
            // Over whole periods, each of its own: parts of one would tell of the phase.
            let ends = |signal: &[Real]| {
                let two = (2.0 * period(signal) / TICK).round() as usize;
                (rms(&signal[..two]), rms(&signal[signal.len() - two..]))
            };
            let (adaptive, fine_ends) = (ends(adaptive), ends(fine));
            let (first, last) = (adaptive.0 / fine_ends.0 - 1.0, adaptive.1 / fine_ends.1 - 1.0);
            println!(
                "  {what}, swings by {:.2} mm rms: period {:+.2} %, amplitude {:+.2} % in the first two periods and \
                 {:+.2} % in the last",
                rms(fine) * 1e3,
                off * 100.0,
                first * 100.0,
                last * 100.0
            );
            assert!(off.abs() < 0.02, "the period is off by {:.2} %", off * 100.0);
            // Every merge may take or give a little.
            let kept = (1.0 + last) / (1.0 + first) - 1.0;
            assert!(kept.abs() < 0.025, "of its amplitude it keeps {kept:+.3} more");
            // The ball goes to the same depth, but how much of that is dent and how much bends the body is as uncertain as
            // its force, by 1 to 3 %.
            assert!(first.abs() < 0.035 && last.abs() < 0.035, "amplitudes are off by {first:.3} and {last:.3}");
        }
    }
}
