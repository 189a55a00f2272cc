//! What every change of resolution must leave intact, over random sequences of changes.

use super::*;
use palpate_body::geometry::primitives::toy_surface;
use palpate_core::ids::{Slot, Vertex};
use palpate_core::model::active_mesh::{ChangeCost, Momenta};
use palpate_core::model::element_kernel::Simd;
use palpate_core::stepping::step::{self, Pushing, World};
use std::collections::BTreeSet;

/// Largest `Σ|w|` of a row: fits beyond it are refused, and barycentric rows of the covers here stay below it.
const MOST_AMPLIFICATION: Real = 6.0;
/// Sums of some thousand terms of alternating sign, each rounded to 1e-16.
const ROUNDING: Real = 1e-12;

/// Largest errors found.
#[derive(Debug, Default)]
struct Worst {
    row_sum: Real,
    row_place: Real,
    amplification: Real,
    mass: Real,
    centre: Real,
    linear: Real,
    angular: Real,
    lightest: Real,
    faster: Real,
    /// Of a display vertex [m].
    shown: Real,
    /// Elements and rows over what was foreseen.
    taken: [Real; 2],
}

fn toy() -> Arc<Body> {
    let recipe = Recipe {
        name: "toy".into(),
        shape: Shape::closed(toy_surface(0.005), vec![0.022, 0.014, 0.009]),
        material: Material::from_young(8e3, 0.4, 1000.0),
        inclusions: vec![],
        holds: vec![],
        elements: Default::default(),
        damping_ratio: 0.0,
    };
    Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap())
}

fn size(body: &Body) -> Real {
    body.surface().bounds().size().norm()
}

/// The active nodes cover the body once, and neighbouring regions are within one level.
fn check_set(body: &Body, set: &ActiveSet) {
    let mut level = vec![usize::MAX; body.node_count()];
    let mut count = vec![0; body.levels().len()];
    body.nodes().filter(|n| set.is_active(*n)).for_each(|n| count[body.level_of(n)] += 1);
    assert_eq!(set.count(), count);
    for n in body.nodes_of(body.finest()) {
        let mut stands = Vec::new();
        let mut above = n;
        loop {
            if set.is_active(above) {
                stands.push(above);
            }
            if body.level_of(above) == 0 {
                break;
            }
            above = body.parent(above);
        }
        assert_eq!(stands.len(), 1, "node {n} is stood for by {stands:?}");
        level[n.index()] = body.level_of(stands[0]);
    }
    for e in body.elements_of(body.finest()) {
        let levels = body.element(e).map(|n| level[n.index()]);
        let (low, high) = (levels.iter().min().unwrap(), levels.iter().max().unwrap());
        assert!(high - low <= 1, "regions of levels {levels:?} meet in element {e}");
    }
    for n in body.nodes() {
        if set.status(n) == Status::Refined {
            assert_eq!(set.first_needed(body, n), None, "node {n} is refined");
        }
    }
}

/// Elements, interface nodes, rows and masses are those of the active nodes.
fn check_mesh(body: &Body, mesh: &ActiveMesh, worst: &mut Worst) {
    let mut interface = BTreeSet::new();
    let mut in_use = 0;
    for e in body.elements() {
        let nodes = body.element(e);
        let active = nodes.iter().filter(|n| mesh.set().is_active(**n)).count();
        assert_eq!(usize::from(mesh.active_vertices(e)), active, "element {e}");
        assert_eq!(mesh.pool().contains(e), active > 0, "element {e}");
        if active > 0 {
            in_use += 1;
            interface.extend(nodes.iter().filter(|n| !mesh.set().is_active(**n)));
            let slots = nodes.map(|n| mesh.slot(n).unwrap());
            assert!(mesh.pool().nodes_of(e).is_some_and(|nodes| nodes.eq(slots)), "element {e}");
        }
    }
    assert_eq!(mesh.pool().len(), in_use);
    let listed: BTreeSet<Node> = mesh.interface().iter().map(|s| mesh.node(*s)).collect();
    assert_eq!((mesh.interface().len(), &listed), (interface.len(), &interface));
    assert_eq!(mesh.active().len() as u32, mesh.set().count().iter().sum::<u32>());
    for n in body.nodes() {
        assert_eq!(mesh.slot(n).is_some(), mesh.set().is_active(n) || interface.contains(&n), "node {n}");
    }

    let mut entries = 0;
    for &slot in mesh.interface() {
        let row = mesh.row(slot);
        let u = body.rest(mesh.node(slot));
        let (mut sum, mut place, mut masters) = (0.0, Vec3::zeros(), BTreeSet::new());
        for (master, w) in row.entries() {
            assert!(mesh.is_master(master) && masters.insert(master), "row of node {}", mesh.node(slot));
            sum += w;
            place += body.rest(mesh.node(master)) * w;
            entries += 1;
        }
        assert!(masters.len() >= 4, "a row of {} masters is not affine-exact", masters.len());
        worst.row_sum = worst.row_sum.max((sum - 1.0).abs());
        worst.row_place = worst.row_place.max((place - u).norm() / size(body));
        worst.amplification = worst.amplification.max(row.amplification());
    }
    assert_eq!(mesh.row_entries(), entries);

    let (mut mass, mut moment) = (0.0, Vec3::zeros());
    for &slot in mesh.active() {
        let m = mesh.motion.mass[slot.index()];
        mass += m;
        moment += body.rest(mesh.node(slot)) * m;
        worst.lightest = worst.lightest.min(m / body.mass() * mesh.active().len() as Real);
    }
    worst.mass = worst.mass.max((mass / body.mass() - 1.0).abs());
    worst.centre = worst.centre.max((moment / mass - body.centre_of_mass()).norm() / size(body));

    for v in body.vertices() {
        let a = mesh.embedding(v);
        assert!(mesh.pool().contains(a.element), "display vertex {v} hangs on element {}, not in use", a.element);
        assert!(mesh.pool().nodes_of(a.element).is_some_and(|nodes| nodes.eq(a.slots)), "display vertex {v}");
    }
}

/// What follows from the state of a mesh, bit for bit, with nodes instead of slots.
fn derived(body: &Body, mesh: &ActiveMesh) -> Vec<(u32, Vec<u64>)> {
    let mut all = Vec::new();
    for &slot in mesh.active() {
        let s = slot.index();
        let x = mesh.motion.position[s].map(Real::to_bits);
        let masses = [mesh.motion.mass[s], mesh.motion.inverse_mass[s]].map(Real::to_bits);
        all.push((mesh.node(slot).0, [&masses[..], &x[..]].concat()));
    }
    for &slot in mesh.interface() {
        let row = mesh.row(slot).entries().flat_map(|(m, w)| [u64::from(mesh.node(m).0), w.to_bits()]);
        let x = mesh.motion.position[slot.index()].map(Real::to_bits);
        all.push((mesh.node(slot).0, row.chain(x).collect()));
    }
    for v in body.vertices() {
        let a = mesh.embedding(v);
        let place = mesh.vertex(v);
        let bits = a.weights.into_iter().chain([a.spacing, place.x, place.y, place.z]).map(Real::to_bits);
        all.push((a.element.0, bits.collect()));
    }
    all
}

fn saved(body: &Body, mesh: &ActiveMesh) -> State {
    let mut state = State::with_room(body, body.element_count(), body.node_count());
    mesh.save_into(&mut state);
    state
}

/// How the path to a state must not show: a mesh made from it has the same bits, and does the same.
fn check_history(body: &Body, mesh: &ActiveMesh) {
    let state = saved(body, mesh);
    let again = ActiveMesh::new(body, &state, body.element_count()).unwrap();
    let (a, b) = (derived(body, mesh), derived(body, &again));
    assert_eq!(a.len(), b.len());
    for (i, (a, b)) in a.iter().zip(&b).enumerate() {
        assert_eq!(a, b, "entry {i} of {} active, {} interface", mesh.active().len(), mesh.interface().len());
    }
    assert_eq!(mesh.stiffest_spring().to_bits(), again.stiffest_spring().to_bits());
    assert_eq!(saved(body, &again), state);
}

/// Random velocities, and positions that no longer are at rest.
fn stir(body: &Body, mesh: &mut ActiveMesh, random: &mut Random) {
    let (shear, turn) = (random.vector(0.2), random.vector(3.0));
    mesh.change_motion(|n, x, v| {
        let u = body.rest(n);
        *x = u + Vec3::new(shear.x * u.y, shear.y * u.z, shear.z * u.x) + random.vector(1e-3);
        *v = turn.cross(&u) + random.vector(0.5);
    });
}

/// Σ m|v| and Σ m|x||v|: what momenta are relative to.
fn scale(mesh: &ActiveMesh) -> (Real, Real) {
    let vec3 = |p: &[Real; 4]| Vec3::new(p[0], p[1], p[2]);
    mesh.active().iter().fold((0.0, 0.0), |sum, s| {
        let s = s.index();
        let p = vec3(&mesh.motion.velocity[s]).norm() * mesh.motion.mass[s];
        (sum.0 + p, sum.1 + p * vec3(&mesh.motion.position[s]).norm())
    })
}

fn fastest(mesh: &ActiveMesh) -> Real {
    let speed = |s: &Slot| Vec3::from_iterator(mesh.motion.velocity[s.index()][..3].iter().copied()).norm();
    mesh.active().iter().map(speed).fold(0.0, Real::max)
}

/// Makes `changes` in a stirred body: momenta stay, and it takes no more than foreseen.
fn change(body: &Body, mesh: &mut ActiveMesh, changes: &[Change], random: &mut Random, worst: &mut Worst) {
    stir(body, mesh, random);
    let (before, speed): (Momenta, Real) = (mesh.momenta(), fastest(mesh));
    let (linear, angular) = scale(mesh);
    let shown: Vec<Vec3> = body.vertices().map(|v| mesh.vertex(v)).collect();
    let parts = |u: ChangeCost| [u.elements, u.rows];
    let foreseen = parts(mesh.estimate(body, changes, false));
    let took = parts(mesh.apply(body, changes));
    (0..2).for_each(|i| worst.taken[i] = worst.taken[i].max(Real::from(took[i]) / Real::from(foreseen[i].max(1))));
    assert!((0..2).all(|i| took[i] <= foreseen[i]), "{took:?} elements and rows, {foreseen:?} foreseen");
    let after = mesh.momenta();
    worst.shown = body.vertices().map(|v| (mesh.vertex(v) - shown[v.index()]).norm()).fold(worst.shown, Real::max);
    let faded = body.vertices().filter(|v| mesh.geomorph[v.index()] != [0.0; 4]);
    assert!(faded.eq({
        let mut fading = mesh.morphing().to_vec();
        fading.sort_unstable();
        fading
    }));
    mesh.decay_geomorph();
    worst.linear = worst.linear.max((after.linear - before.linear).norm() / linear);
    worst.angular = worst.angular.max((after.angular - before.angular).norm() / angular);
    worst.faster = worst.faster.max(fastest(mesh) / speed);
}

fn judge(worst: &Worst) {
    println!("  {worst:?}");
    assert!(worst.row_sum < ROUNDING && worst.row_place < ROUNDING, "{worst:?}");
    assert!(worst.amplification < MOST_AMPLIFICATION && worst.amplification >= 1.0, "{worst:?}");
    assert!(worst.mass < ROUNDING && worst.centre < ROUNDING, "{worst:?}");
    assert!(worst.shown < 2e-12, "the displayed surface jumps: {worst:?}");
    assert!(worst.linear < ROUNDING && worst.angular < ROUNDING, "{worst:?}");
    // Corners of nearly empty elements weigh a thousandth of the mean; without any mass they could not be moved.
    assert!(worst.lightest > 0.0, "{worst:?}");
}

fn walk(body: &Body, seeds: std::ops::Range<u64>, batches: usize) {
    report(body);
    for seed in seeds {
        let mut random = Random(seed);
        let mut worst = Worst { lightest: 1.0, ..Worst::default() };
        let start = random_set(body, &mut random);
        let mut mesh = mesh_on(body, start.clone());
        let (mut made, mut largest) = (0, 0);
        for batch in 0..batches {
            let changes = random_changes(body, mesh.set(), &mut random);
            change(body, &mut mesh, &changes, &mut random, &mut worst);
            made += changes.len();
            largest = largest.max(mesh.active().len());
            check_set(body, mesh.set());
            check_mesh(body, &mesh, &mut worst);
            if batch % 5 == 4 {
                check_history(body, &mesh);
                let fresh = ActiveMesh::new(body, &saved(body, &mesh), body.element_count()).unwrap();
                let element = |mesh: &ActiveMesh, v: Vertex| mesh.embedding(v).element;
                let hung = body.vertices().filter(|v| element(&mesh, *v) != element(&fresh, *v));
                assert_eq!(
                    hung.collect::<Vec<Vertex>>(),
                    Vec::<Vertex>::new(),
                    "display vertices that hang elsewhere than in a fresh mesh"
                );
            }
        }
        println!(" seed {seed}: {made} changes in {batches} batches, up to {largest} active nodes");
        judge(&worst);
        assert!(made > 2 * batches, "a walk that goes somewhere");

        // Back to where it began. Rows are those of the set; masses, too, but for the order in which the body's mass
        // and centre are summed.
        let target = ActiveSet::from_nodes(body, &start).unwrap();
        go_to(body, &mut mesh, &target, |_, _| {});
        check_history(body, &mesh);
        let fresh = mesh_on(body, start);
        for &slot in fresh.active() {
            let n = fresh.node(slot);
            let walked = mesh.motion.mass[mesh.slot(n).unwrap().index()];
            let mass = fresh.motion.mass[slot.index()];
            assert!((walked / mass - 1.0).abs() < 1e-13, "mass of node {n}: {walked} kg, fresh {mass} kg");
        }
        for &slot in fresh.interface() {
            let n = fresh.node(slot);
            let row = |mesh: &ActiveMesh, slot: Slot| -> Vec<(Node, u64)> {
                mesh.row(slot).entries().map(|(m, w)| (mesh.node(m), w.to_bits())).collect()
            };
            assert_eq!(row(&mesh, mesh.slot(n).unwrap()), row(&fresh, slot), "row of node {n}");
        }
    }
}

#[test]
fn every_walk_on_a_box_keeps_partition_balance_rows_mass_and_momenta() {
    walk(&elastic_cube(1e4, false).body(), 0..6, 60);
}

#[test]
fn every_walk_on_a_held_box_keeps_them_too() {
    walk(&elastic_cube(1e4, true).body(), 10..13, 60);
}

#[test]
fn every_walk_on_the_toy_keeps_partition_balance_rows_mass_and_momenta() {
    walk(&toy(), 20..23, 60);
}

/// A mesh that came to its set by changes and one made from its state step alike while they are stretched to the point
/// where elements need other steps.
#[test]
fn a_mesh_that_was_changed_and_one_made_from_its_state_step_alike() {
    for held in [false, true] {
        let body = elastic_cube(1e5, held).body();
        for seed in 0..4 {
            let mut random = Random(100 + seed);
            let mut mesh = mesh_on(&body, random_set(&body, &mut random));
            for _ in 0..20 {
                let changes = random_changes(&body, mesh.set(), &mut random);
                mesh.apply(&body, &changes);
            }
            let mut again = ActiveMesh::new(&body, &saved(&body, &mesh), body.element_count()).unwrap();
            let mut work = [step::Workspace::new(&mesh, 0), step::Workspace::new(&again, 0)];
            let along = random.vector(1.0).normalize();
            let classes = |mesh: &ActiveMesh| (0..8).map(|c| mesh.pool().count(c)).collect::<Vec<usize>>();
            let before = classes(&mesh);
            for i in 0..100 {
                for (mesh, work) in [&mut mesh, &mut again].into_iter().zip(&mut work) {
                    let centre = body.centre_of_mass();
                    mesh.change_motion(|_, x, v| {
                        let arm = (*x - centre).dot(&along);
                        *v = along * (arm * 8.0);
                    });
                    step::tick(
                        &World { path: Simd::best(), body: &body, gravity: Vec3::zeros() },
                        mesh,
                        Pushing::default(),
                        work,
                        &mut (),
                    );
                    mesh.reclass_over_limit(&body);
                }
                let same = saved(&body, &mesh) == saved(&body, &again);
                assert!(
                    same,
                    "held {held}, seed {seed}: they differ after tick {i}: {:?} {:?}",
                    classes(&mesh),
                    classes(&again)
                );
            }
            println!("held {held}, seed {seed}: classes {before:?} to {:?}", classes(&mesh));
            assert_ne!(before, classes(&mesh), "a stretch that shortens no step shows nothing");
        }
    }
}
