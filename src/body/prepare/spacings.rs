//! How fine to make the levels of a closed surface.

use palpate_core::math::Real;

/// Ratio of neighbouring lattice constants: with more, the jump between levels costs accuracy; with less, levels cost
/// memory and add little.
const RATIO: Real = 1.7;

/// Four lattice constants [m], coarse to fine, for a body of `volume` [m³].
pub fn automatic(volume: Real) -> [Real; 4] {
    let coarsest = coarsest(volume);
    [coarsest, coarsest / 1.7, coarsest / (1.7 * 1.7), coarsest / (1.7 * 1.7 * 1.7)]
}

/// Lattice constants [m], coarse to fine, the last of them `finest`, for a body of `volume` [m³].
pub fn down_to(finest: Real, volume: Real) -> Vec<Real> {
    let mut spacings = vec![finest];
    while spacings[spacings.len() - 1] * RATIO <= coarsest(volume) {
        spacings.push(spacings[spacings.len() - 1] * RATIO);
    }
    spacings.reverse();
    spacings
}

/// Lattice constant [m] of about 200 nodes (2 per a³): enough to bend, few enough for any machine.
fn coarsest(volume: Real) -> Real {
    (volume / 100.0).cbrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spacings_go_down_to_the_finest_by_one_ratio_from_a_few_hundred_nodes() {
        let spacings = down_to(0.004, 1.818e-3);
        assert_eq!(*spacings.last().unwrap(), 0.004);
        assert!(spacings.windows(2).all(|pair| (pair[0] / pair[1] - RATIO).abs() < 1e-12));
        let nodes = 2.0 * 1.818e-3 / spacings[0].powi(3);
        assert!((200.0..200.0 * RATIO.powi(3)).contains(&nodes), "{nodes}");
        // A body smaller than asked for has one level, as asked for.
        assert_eq!(down_to(0.02, 1e-6), [0.02]);
    }
}
