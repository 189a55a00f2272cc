//! Time steps: every element steps by a power of two [DDCB01 3.3], as long as its stability allows.
//!
//! Class `i` steps by `2^−i` ticks, from a whole tick down to 1/128 of one, so that all elements meet at every tick. Longer
//! steps would be stable on coarse levels, but what they save is little (coarse elements are few) and what they cost is
//! accuracy: energy errors grow with the square of the step, and a hand would feel elements that answer late.

use super::body::{Body, MaxwellBranch};
use super::element_kernel::StrainLimit;
use super::element_pool::CLASSES;
use super::material::{COLLAPSE_ONSET, Material};
use crate::ids::{Element, Node};
use crate::math::Real;

/// Length of a tick [s].
pub const TICK: Real = 1e-3;
/// And [ns].
pub const TICK_NS: u64 = (TICK * 1e9) as u64;

/// Part of the explicit limit that is used. Meshes of regular elements become unstable at 0.9 altitudes per wave
/// travel time; the factor below them is the margin for cut elements and for the step in which a strain grows.
const SAFETY: Real = 0.75;

/// Longest step [s] in `body`: a tick; without any damping half of one, because nothing takes away what the step's own
/// error, which goes with its square, adds to the energy.
pub fn longest(body: &Body) -> Real {
    let damped = body.damping_time() > 0.0 || !body.maxwell().is_empty();
    if damped { TICK } else { 0.5 * TICK }
}

/// Coefficient of the strain-difference term that goes with Maxwell branches: it takes the energy out of the fastest
/// modes, for which the branches are too slow.
pub const STEP_VISCOSITY: Real = 0.1;

/// Contact is held at least this often.
pub const LONGEST_CONTACT_CLASS: usize = 1;
/// And as often as the shortest-stepped element of the body moves, up to this class; beyond, only what carries the contact
/// counts. Tuned: on viscous elements more solves let a tool on soft springs shake within the tick (torque 1.5 % from that
/// of a rigid tool led along the same way, 0.4 % with this); fewer were not tried.
pub const SOFT_CONTACT_CLASS: usize = 2;
/// By class of step: forces that act with the elements, or the contact, that they stand for.
pub type Residual<T> = [T; CLASSES];

/// Step of class `class` [s].
pub fn step_of(class: usize) -> Real {
    TICK / Real::from(1u32 << class)
}

/// The class of the longest step that is not above `step` [s]; the last one where none is that short.
pub fn class_for(step: Real) -> usize {
    (0..CLASSES).find(|c| step_of(*c) <= step).unwrap_or(CLASSES - 1)
}

/// How far an element is from rest: what bounds its next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strained {
    /// Bound on the present elastic stiffness over that at rest.
    pub growth: Real,
    /// Bound on the present squared stretch: what viscosity grows by.
    pub stretch: Real,
}

impl Strained {
    /// Not at all.
    pub const REST: Strained = Strained { growth: 1.0, stretch: 1.0 };

    /// From the last strain `s` (xx, yy, zz, yz, xz, xy) and determinant of an element of `material`.
    ///
    /// The tangent along any pair of directions is at most `(λ+2μ) |F|² + λ tr E + 2μ e`, `e` the largest principal
    /// strain and `|F|² = 1 + 2e`; `e ≤ tr E/3 + √(2/3) |dev E|`. That of the neo-Hookean law is `μ + (λ+μ) |cof F n|²` [`J` is linear
    /// along any pair], at most `μ + (λ+μ) |F|⁴`; that of fibres `K (|F a|² + a·E a)` at most. The compression term adds `k |cof F|²`.
    pub fn of(material: &Material, s: &[Real; 6], det: Real) -> Self {
        let trace = s[0] + s[1] + s[2];
        let squared = s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + 2.0 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5]);
        let deviator = (squared - trace * trace / 3.0).max(0.0).sqrt();
        let largest = trace / 3.0 + SQRT_TWO_THIRDS * deviator;
        let stretch = (1.0 + 2.0 * largest).max(1.0);
        let stress = (material.lambda * trace + 2.0 * material.mu * largest) / material.pressure_modulus();
        let green = (1.0 + 2.0 * largest + stress).max(1.0);
        let swollen = (material.mu + (material.lambda + material.mu) * stretch * stretch) / material.pressure_modulus();
        let matrix = (1.0 - material.neo_hookean) * green + material.neo_hookean * swollen;
        let whole = material.largest_modulus();
        let part = material.fibres.modulus / whole;
        let mut growth = matrix * (material.pressure_modulus() / whole) + part * (1.0 + 3.0 * largest.max(0.0));
        if det < COLLAPSE_ONSET {
            // C = I + 2E; |cof F|² is its second invariant.
            let first = 3.0 + 2.0 * trace;
            let second = 3.0 + 4.0 * trace + 4.0 * squared;
            growth += material.collapse_stiffness() / whole * (0.5 * (first * first - second)).max(0.0);
        }
        Self { growth, stretch }
    }
}

/// Strain up to which an element of `material` that is not crushed may step in `class`: [`stable_step`] with the bounds
/// of [`Strained::of`] on growth, `1 + (2 + 2μ/M) e + (λ/M) tr E` (of fibres `1 + 3e`), and on the squared stretch, `1 + 2e`, solved for
/// `|dev E|`, `M = λ + 2μ`, `e = tr E/3 + √(2/3) |dev E|`. Where some of it is neo-Hookean, growth is bounded by `e` alone: that part's by
/// `1 + (λ+μ)/M (4e + 4e²)`, and with `tr E ≤ 3e` the other's. Arguments as in [`stable_step`].
pub fn strain_limit(
    class: usize,
    material: &Material,
    omega_squared: Real,
    damping_time: Real,
    springs: Real,
) -> StrainLimit {
    let (h, tau, modulus) = (step_of(class), damping_time, material.pressure_modulus());
    let left = (4.0 - springs * h * h) / omega_squared - h * (h + 2.0 * tau);
    // `e · stretched + tr E · swollen ≤ left`.
    let whole = material.largest_modulus();
    let (matrix, fibres) = (modulus / whole, 3.0 * material.fibres.modulus / whole);
    let stretched = h * (h * (matrix * (2.0 + 2.0 * material.mu / modulus) + fibres) + 4.0 * tau);
    let swollen = matrix * (h * h * material.lambda / modulus);
    let w = material.neo_hookean;
    if w > 0.0 {
        // `square · e² + linear · e ≤ left`.
        let square = matrix * (4.0 * h * h * w * (material.lambda + material.mu) / modulus);
        let linear = square
            + 4.0 * h * tau
            + h * h * ((1.0 - w) * matrix * (2.0 + 2.0 * material.mu / modulus) + fibres)
            + (1.0 - w) * 3.0 * swollen;
        let most = ((linear * linear + 4.0 * square * left).max(0.0).sqrt() - linear) / (2.0 * square);
        return StrainLimit { deviator: 2.0 * most / SQRT_TWO_THIRDS, slope: 1.0 / (3.0 * SQRT_TWO_THIRDS) };
    }
    let per_deviator = SQRT_TWO_THIRDS * stretched;
    StrainLimit { deviator: 2.0 * left / per_deviator, slope: (stretched / 3.0 + swollen) / per_deviator }
}

const SQRT_TWO_THIRDS: Real = 0.816_496_580_927_726;

/// The class in `body` of what may step by `stable` [s]. Only stability shortens a step as strain grows: each change of an
/// element's step changes the energy a little, and changes that keep time with the strain add up.
pub fn class_in(body: &Body, stable: Real) -> usize {
    class_for(stable.min(longest(body)))
}

/// `ω²` [1/s²] of element `e` of `material` at rest, its Maxwell branches at their stiffest: `2/ω` is its longest stable step,
/// with the safety factor.
pub fn omega_squared(body: &Body, material: &Material, e: Element) -> Real {
    let jumps = body.of_jumps(material, e, 4);
    plain_omega_squared(body, material, e) * instantaneous(&jumps, body.maxwell())
}

/// The same without Maxwell branches: a pressure wave crosses the element's smallest altitude. Where stars have a part of the
/// stiffness, they have the same part of the masses.
fn plain_omega_squared(body: &Body, material: &Material, e: Element) -> Real {
    let altitude = smallest_altitude(body, e);
    let wave_speed_squared = material.largest_modulus() / body.density(e);
    4.0 * wave_speed_squared / (SAFETY * SAFETY * altitude * altitude)
}

/// `ω²` [1/s²] up to which an element at rest may step in `class`, in a body of viscous relaxation time `damping_time` [s]:
/// [`stable_step`] solved for it.
pub fn largest_omega_squared(class: usize, damping_time: Real) -> Real {
    let h = step_of(class);
    4.0 / (h * (h + 2.0 * damping_time))
}

/// [`omega_squared`] of the star of node `n`. With the mean of the deformation gradients around it is no stiffer than the
/// stiffest element there, where those are the `materials` of the body and the star has `means` of them.
pub fn omega_squared_of_star(body: &Body, n: Node, materials: &[Material], means: &Material) -> Real {
    let stiffness = |e: &Element| plain_omega_squared(body, &materials[body.material_number(*e)], *e);
    let stiffest = body.elements_around(n).iter().map(stiffness).fold(0.0, Real::max);
    stiffest * instantaneous(means, body.maxwell())
}

/// Class of the longest stable step at rest of what has this `omega_squared` [1/s²].
pub fn class_of_rest(body: &Body, omega_squared: Real) -> usize {
    class_in(body, stable_step(omega_squared, Strained::REST, body.damping_time(), 0.0))
}

/// Class of the longest stable step of element `e` at rest.
pub fn class_at_rest(body: &Body, e: Element) -> usize {
    class_of_rest(body, omega_squared(body, body.material_of(e), e))
}

fn smallest_altitude(body: &Body, e: Element) -> Real {
    let (r, place) = body.place_of_element(e);
    body.level(r).mesh.smallest_altitude(place)
}

/// Stiffness at once over that after relaxation, with the strain-difference term, of `material` with the branches `maxwell`.
fn instantaneous(material: &Material, maxwell: &[MaxwellBranch]) -> Real {
    if maxwell.is_empty() {
        return 1.0;
    }
    let branches = maxwell.iter().map(|b| b.modulus).sum::<Real>();
    (1.0 + 4.0 / 3.0 * material.mu * branches / material.largest_modulus()) * (1.0 + 2.0 * STEP_VISCOSITY)
}

/// Longest stable step [s] of an element of `omega_squared` (the branches' share included) that is strained as given,
/// in a body of viscous relaxation time `damping_time` [s], whose nodes also hang on springs of `springs` [1/s²].
///
/// The explicit limit of a mode of frequency ω whose viscosity is read from the last step is
/// `Δt²ω²/2 + Δt·c ≤ 2`; at rest, with `c = τω²`, that is `Δt ≤ (2/ω)(√(1+ξ²) − ξ)`, `ξ = τω/2`. Strain stiffens the
/// elastic part; the viscous part, which knows nothing of the compression term, grows only with the stretch.
pub fn stable_step(omega_squared: Real, strained: Strained, damping_time: Real, springs: Real) -> Real {
    let elastic = strained.growth * omega_squared + springs;
    let viscous = strained.stretch * damping_time * omega_squared;
    ((viscous * viscous + 4.0 * elastic).sqrt() - viscous) / elastic
}
