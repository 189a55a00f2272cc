//! A plane cut through a body: what each level looks like inside.

use palpate_core::geometry::{Surface, TetMesh};
use palpate_core::math::{Real, Vec3};

/// A plane, and the axes along which it is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point of it [m].
    pub origin: Vec3,
    /// Unit vector that is drawn to the right.
    pub right: Vec3,
    /// Unit vector that is drawn upward.
    pub up: Vec3,
}

/// A point of a plane: how far to the right of its origin, and how far up [m].
pub type Point = (Real, Real);

impl Plane {
    /// Through the middle of a box from `low` to `high` [m], across its shortest side; z goes up where it can.
    pub fn through(low: Vec3, high: Vec3) -> Self {
        let across = (high - low).imin();
        let [right, up] = [[1, 2], [0, 2], [0, 1]][across];
        let axis = |i: usize| Vec3::from_fn(|row, _| if row == i { 1.0 } else { 0.0 });
        Self { origin: (low + high) / 2.0, right: axis(right), up: axis(up) }
    }

    /// How far `p` lies from the plane [m].
    fn height(&self, p: Vec3) -> Real {
        (p - self.origin).dot(&self.right.cross(&self.up))
    }

    fn point(&self, p: Vec3) -> Point {
        ((p - self.origin).dot(&self.right), (p - self.origin).dot(&self.up))
    }

    /// Where the line between `a` and `b`, on different sides, goes through.
    fn between(&self, a: Vec3, b: Vec3) -> Point {
        let (at_a, at_b) = (self.height(a), self.height(b));
        self.point(a + (b - a) * (at_a / (at_a - at_b)))
    }

    /// Each element of `mesh` that is cut, and its cut: a triangle or a quadrangle.
    pub fn cut(&self, mesh: &TetMesh) -> Vec<(usize, Vec<Point>)> {
        let of_element = |e: usize| {
            let corners = mesh.corners(e);
            let (above, below): (Vec<Vec3>, Vec<Vec3>) = corners.iter().partition(|p| self.height(**p) >= 0.0);
            let polygon = match (&above[..], &below[..]) {
                ([a], rest @ [_, _, _]) | (rest @ [_, _, _], [a]) => {
                    rest.iter().map(|b| self.between(*a, *b)).collect()
                }
                // Around the quadrangle, each corner on an edge that shares an end with the next.
                ([a, b], [c, d]) => {
                    vec![self.between(*a, *c), self.between(*a, *d), self.between(*b, *d), self.between(*b, *c)]
                }
                _ => return None,
            };
            Some((e, polygon))
        };
        (0..mesh.elements.len()).filter_map(of_element).collect()
    }

    /// The lines in which `surface` is cut.
    pub fn outline(&self, surface: &Surface) -> Vec<[Point; 2]> {
        let of_triangle = |t: usize| {
            let (above, below): (Vec<Vec3>, Vec<Vec3>) =
                surface.corners(t).into_iter().partition(|p| self.height(*p) >= 0.0);
            match (&above[..], &below[..]) {
                ([a], [b, c]) | ([b, c], [a]) => Some([self.between(*a, *b), self.between(*a, *c)]),
                _ => None,
            }
        };
        (0..surface.triangles.len()).filter_map(of_triangle).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::geometry::primitives::{box_mesh, box_surface};

    fn area(polygon: &[Point]) -> Real {
        let next = polygon.iter().cycle().skip(1);
        polygon.iter().zip(next).map(|(a, b)| 0.5 * (a.0 * b.1 - a.1 * b.0)).sum::<Real>().abs()
    }

    #[test]
    fn a_cut_through_a_box_covers_its_rectangle_once() {
        let size = Vec3::new(0.2, 0.05, 0.1);
        let plane = Plane::through(Vec3::zeros(), size);
        assert_eq!((plane.right, plane.up), (Vec3::x(), Vec3::z()));
        let cut = plane.cut(&box_mesh(size, [4, 3, 2]));
        let total: Real = cut.iter().map(|(_, polygon)| area(polygon)).sum();
        assert!((total - 0.2 * 0.1).abs() < 1e-12, "{total}");
        assert!(cut.iter().flat_map(|(_, p)| p).all(|(x, y)| x.abs() < 0.1 + 1e-12 && y.abs() < 0.05 + 1e-12));
        let outline = plane.outline(&box_surface(size, [4, 3, 2]));
        let length: Real = outline.iter().map(|[a, b]| ((a.0 - b.0).powi(2) + (a.1 - b.1).powi(2)).sqrt()).sum();
        assert!((length - 0.6).abs() < 1e-12, "{length}");
    }
}
