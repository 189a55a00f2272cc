//! A stiff nodule below a soft surface, and what of it a stroke feels.

use super::*;
use palpate_body::prepare::inclusions::Inclusion;
use palpate_body::prepare::region::Reach;
use palpate_core::math::Bounds;
use palpate_core::model::Fibres;

/// A block of soft tissue [m], and its material.
const BLOCK: Vec3 = Vec3::new(0.08, 0.06, 0.04);
const SOFT: Real = 5e3;
/// The nodule: 8 mm across, its centre 10 mm below the middle of the top.
const DEPTH: Real = 0.01;
const RADIUS: Real = 0.004;
/// How much stiffer it is.
const CONTRAST: Real = 10.0;

fn block(nodule: bool) -> Arc<Body> {
    let place = Reach::Ball(Vec3::new(BLOCK.x / 2.0, BLOCK.y / 2.0, BLOCK.z - DEPTH), RADIUS);
    let inclusion = Inclusion {
        place: place.into(),
        youngs_modulus: CONTRAST * SOFT,
        poisson_ratio: 0.45,
        density: 1050.0,
        neo_hookean: 0.0,
        fibres: Fibres::NONE,
    };
    let recipe = Recipe {
        name: "block".into(),
        shape: Shape::closed(box_surface(BLOCK, [16, 12, 8]), vec![0.016, 0.009, 0.005]),
        material: Material::from_young(SOFT, 0.45, 1050.0),
        inclusions: if nodule { vec![inclusion] } else { vec![] },
        holds: vec![Region {
            bounds: Bounds::new(Vec3::zeros(), Vec3::new(BLOCK.x, BLOCK.y, 0.0)),
            stiffness: None,
            exact: false,
        }],
        elements: Default::default(),
        damping_ratio: 0.15,
    };
    let body = prepare(&recipe, &mut |_, _, _| {}).unwrap();
    report(&body);
    Arc::new(body)
}

/// The vertical force [N] of a stroke across the nodule, 4 mm deep, tick by tick from where it has begun, and the most
/// elements in use.
fn stroke(body: &Arc<Body>, adaptivity: Option<Adaptivity>) -> (Vec<Real>, usize) {
    let start = uniform(body, if adaptivity.is_some() { 0 } else { body.finest() });
    let mut stroke = simulation(body, &settings(adaptivity), start);
    stroke.advance(&inputs(ATTACH));
    let (mut forces, mut elements) = (Vec::new(), 0);
    for i in 1..1000 {
        let t = Real::from(i) * TICK;
        let depth = -0.002 + 0.006 * ease(t, 0.0, 0.25);
        let x = BLOCK.x / 2.0 + 0.04 * (ease(t, 0.4, 1.0) - 0.5);
        let outputs = stroke.advance(&inputs(ball_at(Vec3::new(x, BLOCK.y / 2.0, BLOCK.z + 0.01 - depth))));
        let force = outputs.tools[0].state.physical_force.z;
        elements = elements.max(stroke.mesh().pool().len());
        if t > 0.3 {
            forces.push(force);
        }
    }
    (forces, elements)
}

/// Means over frames: the force of single ticks shows each change of resolution.
fn frames(forces: &[Real]) -> Vec<Real> {
    let (all, _) = forces.as_chunks::<{ TICKS_PER_FRAME as usize }>();
    all.iter().map(|frame| frame.iter().sum::<Real>() / TICKS_PER_FRAME as Real).collect()
}

#[test]
fn a_stroke_feels_a_nodule_as_on_the_finest_level() {
    let (soft, with) = (block(false), block(true));
    let difference = |adaptivity: Option<Adaptivity>| {
        let ((plain, _), (felt, elements)) = (stroke(&soft, adaptivity.clone()), stroke(&with, adaptivity));
        let difference: Vec<Real> = frames(&felt).iter().zip(frames(&plain)).map(|(a, b)| a - b).collect();
        (difference, frames(&plain), elements)
    };
    let (expected, plain, all) = difference(None);
    let (found, _, used) = difference(Some(Adaptivity::default()));
    let most = |values: &[Real]| values.iter().copied().fold(0.0, Real::max);
    let apart: Vec<Real> = expected.iter().zip(&found).map(|(a, b)| (a - b).abs()).collect();
    let rms = (apart.iter().map(|d| d * d).sum::<Real>() / apart.len() as Real).sqrt();
    println!(
        "{:.3} N without it; the nodule adds up to {:.5} N on {all} elements, {:.5} N on at most {used}; apart by {:.4} N at \
         most, {rms:.4} N rms",
        most(&plain),
        most(&expected),
        most(&found),
        most(&apart)
    );
    assert!(most(&expected) > 0.03 * most(&plain), "it is felt");
    assert!(3 * used < all, "{used} of {all}");
    assert!((most(&found) / most(&expected) - 1.0).abs() < 0.1 && rms < 0.1 * most(&expected));
    assert!(most(&apart) < 0.15 * most(&expected));
    // Above it, in the middle of the stroke, more than before it.
    let (before, above) = (expected[0], expected[expected.len() / 2 + 1]);
    assert!(above > 2.0 * before.abs(), "{before} {above}");
}
