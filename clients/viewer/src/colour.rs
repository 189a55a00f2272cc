//! What a colour on the organ means.

use crate::deformation::Deformation;
use crate::source::Moment;
use three_d::Srgba;

/// What the organ's colour shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Colouring {
    /// The tissue itself.
    #[default]
    Material,
    /// The level of resolution in use, as in figure 8 of the paper.
    Level,
    /// The largest stretch or squeeze along the surface.
    Strain,
    /// The distance from rest.
    Displacement,
}

/// What stands beside the organ to read its colours by.
#[derive(Clone, Debug, PartialEq)]
pub enum Legend {
    /// Nothing to read.
    None,
    /// The source does not say what is asked for.
    Unknown(&'static str),
    /// A colour for each level that the body has.
    Levels(Vec<Srgba>),
    /// A scale from 0 to `end`, in `unit`.
    Scale {
        /// What is shown.
        title: &'static str,
        /// Value of the last colour, in `unit`.
        end: f32,
        /// Unit of the numbers.
        unit: &'static str,
    },
}

/// Soft tissue, organ by organ: reds and browns, then what lies between them.
const TISSUES: [Srgba; 8] = [
    Srgba::new_opaque(176, 84, 76),
    Srgba::new_opaque(138, 92, 128),
    Srgba::new_opaque(214, 160, 104),
    Srgba::new_opaque(132, 144, 92),
    Srgba::new_opaque(226, 190, 178),
    Srgba::new_opaque(112, 76, 60),
    Srgba::new_opaque(104, 124, 150),
    Srgba::new_opaque(206, 120, 130),
];
/// Where the source does not say what is asked for.
const UNKNOWN: Srgba = Srgba::new_opaque(150, 152, 156);
/// Strain at the end of its scale.
const LARGEST_STRAIN: f32 = 0.2;
/// Colours of the levels, coarsest first: the paper's blue, green and yellow, then finer ones.
const LEVELS: [Srgba; 6] = [
    Srgba::new_opaque(70, 110, 210),
    Srgba::new_opaque(70, 170, 90),
    Srgba::new_opaque(240, 208, 60),
    Srgba::new_opaque(235, 130, 50),
    Srgba::new_opaque(205, 60, 70),
    Srgba::new_opaque(150, 70, 160),
];

impl Colouring {
    /// All of them, in the order of the keys 1 to 4.
    pub const ALL: [Colouring; 4] = [Self::Material, Self::Level, Self::Strain, Self::Displacement];

    /// For a button.
    pub fn short(self) -> &'static str {
        match self {
            Self::Material => "material",
            Self::Level => "level",
            Self::Strain => "strain",
            Self::Displacement => "shift",
        }
    }

    /// (vertices) the colours of `moment`; `size` is the body's diagonal at rest [m].
    pub fn colours(self, deformation: &Deformation, moment: &Moment, size: f32) -> Vec<Srgba> {
        let vertices = moment.positions.len();
        let scaled = |values: Vec<f32>, end: f32| values.iter().map(|value| scale(value / end)).collect();
        match self {
            Self::Material => {
                let organs = deformation.surface().organs.iter().enumerate();
                organs.flat_map(|(i, organ)| vec![tissue(i); organ.vertices as usize]).collect()
            }
            Self::Level if moment.levels.len() == vertices => moment.levels.iter().map(|&l| level(l.into())).collect(),
            Self::Level => vec![UNKNOWN; vertices],
            Self::Strain => scaled(deformation.strain(&moment.positions), LARGEST_STRAIN),
            Self::Displacement => scaled(deformation.displacement(&moment.positions), largest_displacement(size)),
        }
    }

    /// How to read them, for a body of `levels` levels.
    pub fn legend(self, moment: &Moment, levels: usize, size: f32) -> Legend {
        match self {
            Self::Material => Legend::None,
            Self::Level if moment.levels.is_empty() => Legend::Unknown("the source does not say the level of detail"),
            Self::Level => Legend::Levels((0..levels).map(level).collect()),
            Self::Strain => Legend::Scale { title: "strain", end: 100.0 * LARGEST_STRAIN, unit: "%" },
            Self::Displacement => {
                Legend::Scale { title: "displacement", end: 1e3 * largest_displacement(size), unit: "mm" }
            }
        }
    }
}

/// The colour of an organ's tissue.
pub fn tissue(organ: usize) -> Srgba {
    TISSUES[organ % TISSUES.len()]
}

/// The colour of a level of resolution.
pub fn level(level: usize) -> Srgba {
    LEVELS[level.min(LEVELS.len() - 1)]
}

/// The colour of `value` on the scale from 0 to 1; the ends go on beyond it.
pub fn scale(value: f32) -> Srgba {
    let colorous::Color { r, g, b } = colorous::YELLOW_ORANGE_RED.eval_continuous(f64::from(value.clamp(0.0, 1.0)));
    Srgba::new_opaque(r, g, b)
}

/// Displacement at the end of its scale [m] for a body with diagonal `size` [m]: a round number below a tenth.
fn largest_displacement(size: f32) -> f32 {
    round_number(size / 10.0)
}

/// The largest of 1, 2 and 5 times a power of ten that is not above `value`.
pub fn round_number(value: f32) -> f32 {
    let power = 10f32.powf(value.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|step| step * power).find(|round| *round <= value * 1.000_01).unwrap_or(power)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_sdk::Surface;
    use std::sync::Arc;

    #[test]
    fn colours_say_what_the_moment_says() {
        let rest = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let surface = Surface::new(0, vec![[0, 1, 2]], rest, 1e-4).unwrap();
        let deformation = Deformation::new(&Arc::new(surface.clone()));
        let moved = Moment {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.1], [0.0, 1.0, 0.0]],
            levels: vec![0, 2, 9],
            ..Default::default()
        };
        let colours = |colouring: Colouring, moment: &Moment| colouring.colours(&deformation, moment, 1.0);
        assert_eq!(colours(Colouring::Level, &moved), [LEVELS[0], LEVELS[2], LEVELS[5]]);
        assert_eq!(colours(Colouring::Displacement, &moved), [scale(0.0), scale(1.0), scale(0.0)]);
        let rest = Moment::at_rest(&surface);
        assert_eq!(colours(Colouring::Strain, &rest), [scale(0.0); 3]);
        assert_eq!(colours(Colouring::Level, &rest), [UNKNOWN; 3]);
        assert!(matches!(Colouring::Level.legend(&rest, 3, 1.0), Legend::Unknown(_)));
        assert_eq!(Colouring::Level.legend(&moved, 3, 1.0), Legend::Levels(LEVELS[..3].to_vec()));
    }

    #[test]
    fn round_numbers_are_round_and_not_above() {
        for (value, round) in [(0.0123, 0.01), (0.05, 0.05), (0.049, 0.02), (7.3, 5.0), (1.0, 1.0)] {
            assert!((round_number(value) / round - 1.0).abs() < 1e-5, "{value}: {}", round_number(value));
        }
    }
}
