//! The pool against lists of ids.

use super::*;
use proptest::prelude::*;

const TOTAL: usize = 60;
const CAPACITY: usize = 45;
const NODES: usize = 20;

#[derive(Clone, Debug)]
enum Op {
    Insert(Element, usize, [Slot; 4]),
    Remove(Element),
    SetClass(Element, usize),
    SetStiffness(Element, Real),
    Evaluate(usize, Real),
    Clear,
}

fn op() -> impl Strategy<Value = Op> {
    let id = || (0..TOTAL as u32).prop_map(Element);
    let class = || prop_oneof![8 => 0..3usize, 1 => 0..CLASSES];
    let nodes = || prop::array::uniform4((0..NODES).prop_map(Slot::at));
    prop_oneof![
        12 => (id(), class(), nodes()).prop_map(|(i, c, n)| Op::Insert(i, c, n)),
        4 => id().prop_map(Op::Remove),
        6 => (id(), class()).prop_map(|(i, c)| Op::SetClass(i, c)),
        1 => (id(), 0.1..2.0).prop_map(|(i, k)| Op::SetStiffness(i, k)),
        2 => (class(), 0.5..1.5).prop_map(|(c, x)| Op::Evaluate(c, x)),
        1 => Just(Op::Clear),
    ]
}

/// Some numbers that are different for every element.
fn constants(id: Element) -> ElementConstants {
    let number = |i: usize, c: usize| (2.0 + id.0 as Real + 3.0 * i as Real - c as Real).sqrt();
    let gradient = [0, 1, 2].map(|i| [0, 1, 2].map(|c| number(i, c)));
    ElementConstants {
        gradient,
        lambda: 1.0,
        mu: 0.1 * id.0 as Real,
        neo_hookean: 0.0,
        collapse: 1.0,
        fibres: [0.0; 6],
    }
}

fn history(x: Real) -> History {
    History { strain: [x, 2.0 * x, 3.0 * x, 4.0 * x, 5.0 * x, 6.0 * x], det: 1.0 + x, branch: [[x; 6], [-x; 6]] }
}

fn positions(x: Real) -> Vec<Padded> {
    (0..NODES).map(|n| [n as Real * x, (n * n % 7) as Real, (n * 5 % 11) as Real * x, 0.0]).collect()
}

const RATES: Rates = Rates { volume: 0.7, shear: 1.3, decay: [0.97, 0.6], share: [0.8, 0.4] };

/// What the pool must know of an element.
#[derive(Clone)]
struct Known {
    nodes: [Slot; 4],
    constants: ElementConstants,
}

proptest! {
    #[test]
    fn the_pool_does_what_lists_of_ids_do(ops in prop::collection::vec(op(), 1..300)) {
        let mut pool = ElementPool::new(TOTAL, CAPACITY, NODES, 2);
        let mut classes = vec![Vec::<Element>::new(); CLASSES];
        let mut known = vec![None::<Known>; TOTAL];
        let spare = |pool: &ElementPool| {
            (pool.free.capacity(), pool.classes.iter().map(|c| c.blocks.capacity()).collect::<Vec<_>>())
        };
        let allocated = spare(&pool);
        let take = |classes: &mut Vec<Vec<Element>>, id: Element| {
            for class in classes {
                if let Some(at) = class.iter().position(|i| *i == id) {
                    class.swap_remove(at);
                }
            }
        };
        for op in ops {
            match op {
                Op::Insert(id, class, nodes) => {
                    let len: usize = classes.iter().map(Vec::len).sum();
                    let fits = known[id.index()].is_none() && len < CAPACITY;
                    prop_assert_eq!(pool.insert(id, class, &nodes, &constants(id), &history(0.01 * id.0 as Real)), fits);
                    if fits {
                        classes[class].push(id);
                        known[id.index()] = Some(Known { nodes, constants: constants(id) });
                        prop_assert_eq!(pool.history(id), Some(history(0.01 * id.0 as Real)));
                    }
                }
                Op::Remove(id) => {
                    let before = pool.history(id);
                    prop_assert_eq!(before.is_some(), known[id.index()].is_some());
                    prop_assert_eq!(pool.remove(id), before);
                    take(&mut classes, id);
                    known[id.index()] = None;
                }
                Op::SetClass(id, class) => {
                    let before = pool.history(id);
                    prop_assert_eq!(pool.set_class(id, class), known[id.index()].is_some());
                    prop_assert_eq!(pool.history(id), before);
                    if known[id.index()].is_some() && !classes[class].contains(&id) {
                        take(&mut classes, id);
                        classes[class].push(id);
                    }
                }
                Op::SetStiffness(id, k) => {
                    let stiffer = ElementConstants { lambda: k, mu: 0.5 * k, ..constants(id) };
                    prop_assert_eq!(pool.set_stiffness(id, &stiffer), known[id.index()].is_some());
                    if let Some(known) = &mut known[id.index()] {
                        known.constants = stiffer;
                    }
                }
                Op::Evaluate(class, x) => {
                    pool.add_forces(Simd::best(), class, &RATES, &positions(x), &mut [[0.0; 4]; NODES]);
                }
                Op::Clear => {
                    pool.clear();
                    classes.iter_mut().for_each(Vec::clear);
                    known.fill(None);
                }
            }
            prop_assert_eq!(pool.len(), classes.iter().map(Vec::len).sum::<usize>());
            for (class, ids) in classes.iter().enumerate() {
                prop_assert_eq!(pool.count(class), ids.len());
                prop_assert_eq!(&pool.ids(class).collect::<Vec<_>>(), ids);
                prop_assert!(ids.iter().all(|id| pool.class_of(*id) == Some(class)));
            }
            for id in (0..TOTAL).map(Element::at) {
                prop_assert_eq!(pool.contains(id), known[id.index()].is_some());
                let nodes = pool.nodes_of(id).map(Iterator::collect::<Vec<_>>);
                prop_assert_eq!(nodes, known[id.index()].as_ref().map(|k| k.nodes.to_vec()));
            }
        }
        prop_assert_eq!(spare(&pool), allocated);

        // The same ids in the same order make up the same pool, to the last bit of the forces.
        let mut again = ElementPool::new(TOTAL, CAPACITY, NODES, 2);
        for class in (0..CLASSES).rev() {
            for id in pool.ids(class) {
                let Known { nodes, constants } = known[id.index()].clone().expect("known");
                let history = pool.history(id).expect("there");
                prop_assert!(again.insert(id, class, &nodes, &constants, &history));
            }
        }
        for class in 0..CLASSES {
            let run = |pool: &mut ElementPool, path: Simd| {
                let mut force = [[0.0; 4]; NODES];
                let extremes = pool.add_forces(path, class, &RATES, &positions(0.9), &mut force);
                (force.map(|f| f.map(Real::to_bits)), extremes)
            };
            prop_assert_eq!(run(&mut pool, Simd::best()), run(&mut again, Simd::Portable));
            for id in pool.ids(class) {
                prop_assert_eq!(pool.history(id), again.history(id));
            }
        }
    }
}

#[test]
fn every_class_finds_room_however_the_elements_are_spread() {
    for capacity in [1, 7, 8, 9, 45, 60] {
        let mut pool = ElementPool::new(TOTAL, capacity, NODES, 1);
        for id in (0..capacity).map(Element::at) {
            assert!(pool.insert(id, id.index() % CLASSES, &[0, 1, 2, 3].map(Slot), &constants(id), &History::REST));
        }
        assert!(
            capacity == TOTAL || !pool.insert(Element(59), 0, &[Slot(0); 4], &constants(Element(0)), &History::REST)
        );
        for class in 0..CLASSES {
            (0..capacity).map(Element::at).for_each(|id| assert!(pool.set_class(id, class)));
            assert_eq!(pool.count(class), capacity);
        }
    }
}

#[test]
#[should_panic(expected = "lost node")]
fn a_node_beyond_the_field_is_refused() {
    ElementPool::new(TOTAL, CAPACITY, NODES, 0).insert(
        Element(0),
        0,
        &[0, 1, 2, NODES as u32].map(Slot),
        &constants(Element(0)),
        &History::REST,
    );
}
