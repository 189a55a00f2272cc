//! The surface as a tool sees it along the direction in which it pushes.

use super::touchable::{Touchable, area_vector};
use crate::ids::Triangle;
use crate::math::{Real, Vec3};
use std::f64::consts::PI;

/// Where the tool looks at the surface from, and how: along `ahead`, `across` being right-handed with it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub(super) ahead: Vec3,
    pub(super) across: [Vec3; 2],
    /// Cosine between what is ahead and a surface below which that is not seen.
    pub(super) least_facing: Real,
}

/// Where a walk over the surface ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct End {
    pub(super) triangle: Triangle,
    /// Barycentric weights of the place that was looked for, or of the nearest one of the edge at which the surface ends.
    pub(super) weights: [Real; 3],
    /// How far before the place that edge is, as it is seen [m]; zero where the place was found.
    pub(super) beyond: Real,
}

impl View {
    /// Along `ahead`; `near` says which way the first axis goes, as far as that is possible.
    pub(super) fn new(ahead: Vec3, near: Vec3) -> Self {
        let other = if ahead.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
        let flat = |v: Vec3| v - ahead * ahead.dot(&v);
        let first = flat(near).try_normalize(1e-6).unwrap_or_else(|| flat(other).normalize());
        Self { ahead, across: [first, ahead.cross(&first)], least_facing: 0.0 }
    }

    /// The same of a solid part: what is seen from the edge is beside it.
    pub(super) fn of_solid(ahead: Vec3, near: Vec3) -> Self {
        Self { least_facing: LEAST_FACING, ..Self::new(ahead, near) }
    }

    /// True for a triangle with this area vector, out of the body.
    fn sees(&self, outward: Vec3) -> bool {
        -outward.dot(&self.ahead) > self.least_facing * outward.norm()
    }

    /// Walks from a triangle over the surface as it is seen towards the place ahead of `place` [m], and ends where the surface goes
    /// around an edge behind which it is not seen.
    pub(super) fn walk(&self, on: &Touchable, from: Triangle, place: Vec3) -> End {
        let mut at = from;
        let [u, v] = self.across;
        for _ in 0..MOST_STEPS {
            let triangle = on.body.triangle(at);
            let corners = triangle.map(|c| {
                let away = on.vertex(c) - place;
                [away.dot(&u), away.dot(&v)]
            });
            // Twice the area that the place has with each side, above zero inside of what faces the tool.
            let side = |i: usize, j: usize| corners[i][1] * corners[j][0] - corners[i][0] * corners[j][1];
            let sides = [side(1, 2), side(2, 0), side(0, 1)];
            let area: Real = sides.iter().sum();
            if area <= 0.0 {
                break;
            }
            let weights = sides.map(|s| s / area);
            let out = weights.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
            if weights[out] >= -INSIDE {
                return End { triangle: at, weights, beyond: 0.0 };
            }
            let (i, j) = ((out + 1) % 3, (out + 2) % 3);
            let has = |t: &&Triangle| **t != at && on.body.triangle(**t).contains(&triangle[j]);
            let next = on.body.triangles_around(triangle[i]).iter().find(has);
            match next.filter(|t| self.sees(area_vector(on, **t))) {
                Some(next) => at = *next,
                None => return end(at, corners, [out, i, j]),
            }
        }
        End { triangle: at, weights: [1.0 / 3.0; 3], beyond: Real::INFINITY }
    }

    /// How far [m] the surface ends beyond what is ahead of `place`, on which the walk has found it, as far as that is within
    /// `reach` [m]; below zero.
    pub(super) fn margin(&self, on: &Touchable, from: Triangle, place: Vec3, reach: Real) -> Real {
        let [u, v] = self.across;
        let mut nearest = reach;
        for [x, y] in AROUND {
            let aside = (u * x + v * y) * reach;
            let end = self.walk(on, from, place + aside);
            if end.beyond > 0.0 && end.beyond.is_finite() {
                // The edge is that far before a place which lies `reach` away.
                let corners = on.body.triangle(end.triangle).map(|c| on.vertex(c));
                let border: Vec3 = corners.iter().zip(end.weights).map(|(c, w)| c * w).sum();
                let across = border - (place + aside);
                let flat = across - self.ahead * self.ahead.dot(&across);
                let straight = flat.try_normalize(1e-12).map_or(0.0, |n| -n.dot(&aside));
                nearest = nearest.min((straight - end.beyond).max(0.0));
            }
        }
        -nearest
    }
}

/// The end at the side between the corners `i` and `j` of a triangle, `out` being the third, as seen from a place at the origin.
fn end(triangle: Triangle, corners: [[Real; 2]; 3], [out, i, j]: [usize; 3]) -> End {
    let (a, b) = (corners[i], corners[j]);
    let along = [b[0] - a[0], b[1] - a[1]];
    let length = along[0] * along[0] + along[1] * along[1];
    let part = (-(a[0] * along[0] + a[1] * along[1]) / length.max(Real::MIN_POSITIVE)).clamp(0.0, 1.0);
    let nearest = [a[0] + part * along[0], a[1] + part * along[1]];
    let mut weights = [0.0; 3];
    (weights[out], weights[i], weights[j]) = (0.0, 1.0 - part, part);
    End { triangle, weights, beyond: (nearest[0] * nearest[0] + nearest[1] * nearest[1]).sqrt() }
}

/// Part of a disc of radius one that lies on the near side of a straight edge `beyond` its middle: 1 from -1 on, 0 from 1 on.
pub(super) fn part_before(beyond: Real) -> Real {
    let x = beyond.clamp(-1.0, 1.0);
    (libm::acos(x) - x * (1.0 - x * x).sqrt()) / PI
}

/// Cosine between a view and a normal below which what has it is seen from the edge: that of the outermost samples of a ball,
/// `√(1 − 0.95²)`.
pub(super) const LEAST_FACING: Real = 0.312;
/// Triangles that are walked over at most from one sample to the next.
const MOST_STEPS: usize = 64;
/// Barycentric weight below zero that counts as zero.
const INSIDE: Real = 1e-9;
/// Directions in which a sample looks for the end of the surface.
const AROUND: [[Real; 2]; 6] = {
    const HALF_ROOT: Real = 0.866_025_403_784_438_6;
    [[1.0, 0.0], [0.5, HALF_ROOT], [-0.5, HALF_ROOT], [-1.0, 0.0], [-0.5, -HALF_ROOT], [0.5, -HALF_ROOT]]
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_a_disc_is_before_an_edge_through_its_middle() {
        assert!((part_before(0.0) - 0.5).abs() < 1e-15);
        assert_eq!((part_before(-2.0), part_before(2.0)), (1.0, 0.0));
        // The segment of a third of the turn.
        assert!((part_before(0.5) - (PI / 3.0 - 0.75_f64.sqrt() / 2.0) / PI).abs() < 1e-12);
    }
}
