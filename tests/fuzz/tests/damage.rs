//! Files and messages that someone else wrote, damaged: the short form of `tests/fuzz/run`, with any compiler.

use palpate_body::prepare::body_file::BodyFile;
use palpate_core::math::Real;
use palpate_fuzz::cost::bounded;
use palpate_fuzz::seeds::{PARTS, PREPARED, resealed};
use palpate_fuzz::{TARGETS, Target};
use proptest::prelude::*;
use std::sync::LazyLock;

/// Every target with its seeds.
static SEEDED: LazyLock<Vec<(Target, Vec<Vec<u8>>)>> =
    LazyLock::new(|| TARGETS.iter().map(|target| (*target, (target.seeds)())).collect());

/// Changes of bytes: where, as a part of the whole, and what is written there.
fn damage() -> impl Strategy<Value = Vec<(Real, Vec<u8>)>> {
    let piece = prop_oneof![
        any::<u8>().prop_map(|b| vec![b]),
        Just(vec![0xff; 8]),
        Just(vec![0xff, 0xff, 0xff, 0xff, 0x0f]),
        Just(vec![0; 8]),
        Just(f64::NAN.to_le_bytes().to_vec()),
        Just(1e300f64.to_le_bytes().to_vec()),
        Just(b"9223372036854775807 ".to_vec()),
        Just(b" -1 nan 1e999 ".to_vec()),
    ];
    prop::collection::vec((0.0..1.0f64, piece), 1..4)
}

fn damaged(bytes: &[u8], from: usize, damage: &[(Real, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for (place, piece) in damage {
        let at = from + (place * (bytes.len() - from) as Real) as usize;
        let end = (at + piece.len()).min(bytes.len());
        bytes[at..end].copy_from_slice(&piece[..end - at]);
    }
    bytes
}

#[test]
fn every_reader_takes_what_it_is_for_within_its_bounds() {
    for (target, seeds) in &*SEEDED {
        assert!(!seeds.is_empty());
        for (number, seed) in seeds.iter().enumerate() {
            assert!(target.take(seed), "{} {number} of {} bytes", target.name, seed.len());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_prepared_file_of_which_any_byte_changed_is_refused(at in 0.0..1.0f64, to in 1..=255u8) {
        let mut bytes = PREPARED.clone();
        let at = (at * bytes.len() as Real) as usize;
        bytes[at] ^= to;
        prop_assert!(bounded(bytes.len(), || BodyFile::from_bytes(&bytes).is_err()));
    }

    #[test]
    fn a_prepared_file_cut_anywhere_is_refused(part in 0.0..1.0f64) {
        let bytes = &PREPARED[..(part * PREPARED.len() as Real) as usize];
        prop_assert!(bounded(bytes.len(), || BodyFile::from_bytes(bytes).is_err()));
        if bytes.len() > *PARTS {
            let sealed = resealed(bytes.to_vec());
            prop_assert!(bounded(sealed.len(), || BodyFile::from_bytes(&sealed).is_err()));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 4096, ..ProptestConfig::default() })]

    /// One in four is of another kind, as under a wrong name.
    #[test]
    fn damaged_bytes_are_refused_or_something_that_holds_together(
        target in 0..TARGETS.len(),
        other in prop::option::weighted(0.25, 0..TARGETS.len()),
        seed in any::<prop::sample::Index>(),
        cut in prop::option::of(0.0..1.0f64),
        damage in damage(),
    ) {
        let seeds = &SEEDED[other.unwrap_or(target)].1;
        let mut bytes = damaged(seed.get::<Vec<u8>>(seeds), 0, &damage);
        bytes.truncate((cut.unwrap_or(1.0) * bytes.len() as Real) as usize);
        SEEDED[target].0.take(&bytes);
    }
}
