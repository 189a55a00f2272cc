//! What a level that is not used costs: nothing.

use super::*;
use palpate_core::model::body::{BodyParts, LabelParts, MixtureParts};
use palpate_core::stepping::work::{self, Prices};

/// `body` without its finest level.
fn without_finest(body: &Body) -> Arc<Body> {
    let mut levels = body.levels()[..body.finest()].to_vec();
    levels.last_mut().unwrap().finer_host.clear();
    let parts = BodyParts {
        name: body.name().into(),
        surface: body.surface().clone(),
        shape: body.parts().shape,
        material_of: vec![Vec::new(); levels.len()],
        levels,
        materials: vec![*body.material()],
        mixtures: MixtureParts::default(),
        labels: LabelParts::default(),
        supports: body.supports().to_vec(),
        maxwell: body.maxwell().to_vec(),
        slowest_mode: body.slowest_mode(),
        organs: vec![],
    };
    Arc::new(Body::new(parts).unwrap())
}

#[test]
fn a_level_ten_times_as_large_costs_nothing_until_it_is_used() {
    let mut cube = elastic_cube(1e4, true);
    (cube.damping_ratio, cube.spacings) = (0.15, vec![0.034, 0.021, 0.0135, 0.0062]);
    let large = cube.body();
    let small = without_finest(&large);
    report(&large);
    report(&small);
    let elements = |body: &Body| body.elements_of(body.finest()).len();
    assert!(elements(&large) > 9 * elements(&small));

    for seed in 0..10 {
        let nodes = random_set(&small, &mut Random(seed));
        let count = |body: &Body| {
            let mesh = mesh_on(body, nodes.clone());
            (
                work::evaluations(&mesh),
                work::of_motion(body, &mesh, &Prices::COMMON, 0),
                mesh.pool().len(),
                mesh.row_entries(),
            )
        };
        let (a, b) = (count(&small), count(&large));
        println!("set {seed}, {} active: {} evaluations, {} ns, {} elements", nodes.len(), a.0, a.1, a.2);
        assert_eq!(a, b);
    }

    // And while resolution follows a tool. The bodies' masses differ in the last bit, decisions by no more than that.
    let adaptivity = Adaptivity { finest: small.finest(), ..Adaptivity::default() };
    let run = |body: &Arc<Body>| {
        let mut press = simulation(body, &settings(Some(adaptivity.clone())), uniform(body, 0));
        let (mut evaluations, mut units, mut cost) = (0u64, 0u64, 0u64);
        for i in 0..800 {
            let o = press.advance(&press_and_stroke(i));
            evaluations += u64::from(o.element_evaluations);
            units += u64::from(o.plan.taken);
            cost += u64::from(o.adapted.work);
        }
        [evaluations, units, cost].map(|x| x as Real)
    };
    let (a, b) = (run(&small), run(&large));
    println!("a press: evaluations, units and cost {a:?} without the level, {b:?} with it");
    for (a, b) in a.iter().zip(&b) {
        assert!((a / b - 1.0).abs() < 0.01);
    }
    assert!(a[2] > 0.0);
}
