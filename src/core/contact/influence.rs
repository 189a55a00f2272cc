//! What a force on the surface of an elastic body does below the size of a mesh, in closed form.
//!
//! Under a load that is spread like a normal distribution of deviation `S` a half-space gives way by `k ψ(r; S)` at the distance
//! `r`, `k = (1−ν²)/(πE)` [Johnson 1985, 3.2; the convolution of Boussinesq's `1/r`]. A mesh shows the load of a sample as if it
//! were as wide as the rows by which it hangs on the nodes. So what the mesh leaves out of the sample's own, narrower load is the
//! difference of two such potentials, as in the splitting of long and short range by Hockney & Eastwood (1988): it is short-ranged, has no
//! singularity, and its matrix over any samples is positive semidefinite while the mesh's load is the wider one.

use crate::math::{Real, Vec3};
use std::f64::consts::PI;

/// A load that spreads over less than the mesh shows of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Narrow {
    /// Its middle [m].
    pub(super) place: Vec3,
    /// Which way it pushes.
    pub(super) normal: Vec3,
    /// Of where it spreads [m²]; zero for one that is none.
    pub(super) variance: Real,
    /// Of where the mesh shows it [m²].
    pub(super) shown: Real,
    /// What a half-space of the material gives way by, per newton and per distance [m²/N].
    pub(super) compliance: Real,
}

impl Narrow {
    /// The same where the mesh shows it with another variance [m²].
    pub(super) fn shown_as(&self, shown: Real) -> Self {
        Self { shown, ..*self }
    }

    /// What a newton on one adds at the other to the dent that the mesh leaves out [m/N].
    pub(super) fn between(&self, other: &Narrow) -> Real {
        let facing = self.normal.dot(&other.normal);
        if facing <= 0.0 || self.variance <= 0.0 || other.variance <= 0.0 {
            return 0.0;
        }
        // The mesh is not to show more than there is.
        let shown = self.shown.max(other.shown).max(self.variance).max(other.variance);
        let apart = (self.place - other.place).norm_squared();
        let left_out = potential(apart, self.variance + other.variance) - potential(apart, 2.0 * shown);
        0.5 * (self.compliance + other.compliance) * left_out * facing
    }

    /// What the mesh leaves out of a load of one newton, where it shows it as wide as that [1/m], at a squared distance [m²].
    pub(super) fn left_out(&self, distance_squared: Real) -> Real {
        potential(distance_squared, self.variance) - potential(distance_squared, self.shown.max(self.variance))
    }

    /// The same at a place `away` [m] where the surface faces along `normal`.
    pub(super) fn at(&self, away: Vec3, normal: Vec3) -> Real {
        if self.variance <= 0.0 {
            return 0.0;
        }
        let apart = (away - self.place).norm_squared();
        // There it is felt through as wide a row as the one by which it pushes.
        let left_out = self.shown_as(2.0 * self.shown.max(self.variance)).left_out(apart);
        self.compliance * left_out * normal.dot(&self.normal).max(0.0)
    }
}

/// `ψ(r; S) = √(π/2)/S · e^{−x} I₀(x)`, `x = r²/(4S²)` [1/m], for a squared distance [m²] and a variance `S²` [m²].
fn potential(distance_squared: Real, variance: Real) -> Real {
    (0.5 * PI / variance).sqrt() * scaled_bessel(distance_squared / (4.0 * variance))
}

/// The same of a load that is spread along and across by these `variances` [m²], at so many multiples of `sides` [m] from its middle, (rows,
/// columns): the integral over `u` of what each of the normal distributions `e^{−r²u²}` that make up `1/r` becomes, `u` going as a
/// tangent, which makes the integrand periodic. That is a product of one factor along and one across, whose values at the multiples of
/// a side are its powers.
fn stretched_potentials<const COLUMNS: usize, const ROWS: usize>(
    [columns, rows]: [usize; 2],
    sides: [Real; 2],
    variances: [Real; 2],
) -> [[Real; COLUMNS]; ROWS] {
    let between = 2.0 * (variances[0] * variances[1]).sqrt();
    let step = 0.5 * PI / STEPS as Real;
    let whole = 2.0 / (PI * between).sqrt() * step;
    let mut potentials = [[0.0; COLUMNS]; ROWS];
    for i in 0..STEPS {
        let (sin, cos) = libm::sincos((i as Real + 0.5) * step);
        let (up, down) = (sin * sin, cos * cos);
        let widened = variances.map(|v| down + up * 2.0 * v / between);
        let [along, across] = [0, 1].map(|k| libm::exp(-sides[k] * sides[k] * up / (between * widened[k])));
        let mut row = whole / (widened[0] * widened[1]).sqrt();
        let mut to_next_row = across;
        for line in potentials.iter_mut().take(rows) {
            let (mut here, mut to_next) = (row, along);
            for potential in line.iter_mut().take(columns) {
                *potential += here;
                here *= to_next;
                to_next *= along * along;
            }
            row *= to_next_row;
            to_next_row *= across * across;
        }
    }
    potentials
}

/// Places at which the integrand of [`stretched_potentials`] is taken: right to 1e-6 up to fifty times as long as wide.
const STEPS: usize = 32;

/// What the mesh leaves out of the dents of equal loads on the cells of a grid, in each other [1/m].
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid<const COLUMNS: usize, const ROWS: usize> {
    /// How many there are in a row.
    columns: usize,
    /// Variance of a load on one of them, were it a disc [m²].
    variance: Real,
    /// By how many rows and columns they are apart.
    left_out: [[Real; COLUMNS]; ROWS],
}

impl<const COLUMNS: usize, const ROWS: usize> Grid<COLUMNS, ROWS> {
    /// Of so many `columns` and `rows` of cells with these `sides` [m], whose loads the mesh shows with the variance `shown` [m²].
    pub(super) fn new([columns, rows]: [usize; 2], sides: [Real; 2], shown: Real) -> Self {
        let variances = sides.map(|side| variance_of_disc(PI * side * side) / PI);
        let shown = shown.max(variances[0]).max(variances[1]);
        let mut left_out = stretched_potentials([columns, rows], sides, variances.map(|v| 2.0 * v));
        for (row, line) in left_out.iter_mut().take(rows).enumerate() {
            for (column, left_out) in line.iter_mut().take(columns).enumerate() {
                let place = [column as Real * sides[0], row as Real * sides[1]];
                *left_out -= potential(place[0] * place[0] + place[1] * place[1], 2.0 * shown);
            }
        }
        Self { columns, variance: variance_of_disc(sides[0] * sides[1]), left_out }
    }

    /// How much more a load gives way under itself than a whole cell's, of which a part alone is loaded, with that variance [m²].
    pub(super) fn more_of_its_own(&self, variance: Real) -> Real {
        (potential(0.0, 2.0 * variance) - potential(0.0, 2.0 * self.variance)).max(0.0)
    }

    /// Of the cells with these numbers, row by row.
    pub(super) fn between(&self, i: usize, j: usize) -> Real {
        let columns = self.columns;
        self.left_out[(i / columns).abs_diff(j / columns)][(i % columns).abs_diff(j % columns)]
    }
}

/// `e^{−x} I₀(x)` for `x ≥ 0`, within 2e-7 [Abramowitz & Stegun 1964, 9.8.1 and 9.8.2].
fn scaled_bessel(x: Real) -> Real {
    let sum = |c: &[Real], t: Real| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    if x < LARGE {
        let t = x / LARGE;
        libm::exp(-x) * sum(&NEAR, t * t)
    } else {
        sum(&FAR, LARGE / x) / x.sqrt()
    }
}

const LARGE: Real = 3.75;
const NEAR: [Real; 7] = [1.0, 3.5156229, 3.0899424, 1.2067492, 0.2659732, 0.0360768, 0.0045813];
const FAR: [Real; 9] =
    [0.39894228, 0.01328592, 0.00225319, -0.00157565, 0.00916281, -0.02057706, 0.02635537, -0.01647633, 0.00392377];

/// Variance [m²] of the normal distribution that gives way under itself as much as a uniform load on a disc of this `area` [m²] does
/// on the average: the disc's `16/(3πs)` for its radius `s` [Johnson 1985, 3.4] and `ψ(0; √2 σ) = √π/(2σ)` for two equal ones.
pub(super) fn variance_of_disc(area: Real) -> Real {
    let deviation = 3.0 * PI * PI.sqrt() / 32.0;
    deviation * deviation * area / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the integral `e^{−x} I₀(x) = 1/π ∫ e^{x (cos θ − 1)} dθ`.
    #[test]
    fn the_potential_is_that_of_a_normal_distribution() {
        for x in [0.0, 0.1, 1.0, 3.7, 3.8, 10.0, 200.0] {
            let steps = 20_000;
            let at = |i: u32| x * ((PI * (Real::from(i) + 0.5) / Real::from(steps)).cos() - 1.0);
            let exact = (0..steps).map(|i| at(i).exp()).sum::<Real>() / Real::from(steps);
            assert!((scaled_bessel(x) / exact - 1.0).abs() < 1e-6, "{x}");
        }
        // Far away it is Boussinesq's.
        assert!((potential(1.0, 1e-4) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_load_that_is_not_stretched_is_round_and_one_that_is_gives_way_by_the_mean_of_gauss() {
        for away in [0.0, 1e-3, 7e-3] {
            let potentials = stretched_potentials::<3, 3>([3; 2], [away; 2], [4e-6; 2]);
            for (row, line) in potentials.iter().enumerate() {
                for (column, potential_there) in line.iter().enumerate() {
                    let squares = away * away * (row * row + column * column) as Real;
                    assert!((potential_there / potential(squares, 4e-6) - 1.0).abs() < 1e-6);
                }
            }
        }
        for times in [3.0, 10.0, 50.0] {
            let (mut a, mut b) = (times, 1.0);
            for _ in 0..10 {
                (a, b) = (0.5 * (a + b), Real::sqrt(a * b));
            }
            let [[own]] = stretched_potentials::<1, 1>([1; 2], [0.0; 2], [1e-6 * times * times, 1e-6]);
            assert!((own * 1e-3 * a / (0.5 * PI).sqrt() - 1.0).abs() < 1e-6, "{times}");
        }
    }

    #[test]
    fn a_disc_gives_way_under_itself_by_its_mean() {
        let radius = 2e-3;
        let own = potential(0.0, 2.0 * variance_of_disc(PI * radius * radius));
        assert!((own * radius / (16.0 / (3.0 * PI)) - 1.0).abs() < 1e-12);
    }
}
