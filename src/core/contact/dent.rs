//! What the mesh leaves out of the dents under tools, for those who look: the surface that is touched is the one that is shown.

use super::influence::Narrow;
use crate::math::{Bounds, Real, Vec3};
use crate::model::Constraint;

/// What a sample of a tool, or of an obstacle, adds to what the mesh shows of the surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dent {
    load: Narrow,
    /// Half of how much longer than wide the loaded cell is, the way that it lies [m].
    long: Vec3,
    /// Into how many round loads beside each other it is cut.
    cuts: u32,
    /// Where the mesh displays the place that it touches [m].
    displayed: Vec3,
    /// Number of the constraint, and of the first on the same face of the tool.
    constraint: u32,
    face: u32,
    /// [N].
    force: Real,
}

impl Dent {
    /// Of a `load` on a cell with these `sides` [m], which the mesh displays with the variance that the load has as `shown` [m²], at
    /// `displayed` [m]. Constraint number `constraint` will say how large it is; `face` is that of the first on the same face.
    pub(super) fn new(load: Narrow, sides: [Vec3; 2], displayed: Vec3, [constraint, face]: [usize; 2]) -> Self {
        let [long, wide] = if sides[0].norm() < sides[1].norm() { [sides[1], sides[0]] } else { sides };
        let cuts = (long.norm() / wide.norm().max(Real::MIN_POSITIVE)).min(MOST_CUTS).round().max(1.0);
        let load = Narrow { variance: load.variance / cuts, ..load };
        let long = long * (0.5 * (1.0 - 1.0 / cuts));
        let [constraint, face] = [constraint, face].map(|number| number as u32);
        Self { load, long, cuts: cuts as u32, displayed, constraint, face, force: 0.0 }
    }

    /// The same now that the `constraints` are solved; where the body stood still, with the last force.
    pub(super) fn solved(&self, constraints: &[Constraint]) -> Self {
        let force = constraints.get(self.constraint as usize).map_or(0.0, |c| c.multiplier);
        Self { force, ..*self }
    }

    /// What it adds at a `place` of the surface that faces `inward` [m].
    fn at(&self, place: Vec3, inward: Vec3) -> Vec3 {
        let Self { load, long, cuts, .. } = self;
        let normal = load.normal;
        let away = place - load.place;
        // The mesh shows the place above the tool's.
        let away = away - normal * normal.dot(&away);
        let facing = normal.dot(&inward);
        if facing <= 0.0 || away.norm() > self.reach() {
            return Vec3::zeros();
        }
        let part = |i: u32| if *cuts > 1 { 2.0 * Real::from(i) / Real::from(cuts - 1) - 1.0 } else { 0.0 };
        let left_out: Real = (0..*cuts).map(|i| load.left_out((away - long * part(i)).norm_squared())).sum();
        normal * (facing * load.compliance * self.force / Real::from(*cuts) * left_out)
    }

    /// Beyond it, what the mesh shows of the load is right to 1 % [m]: `e^{-x} I₀(x)` is `1/√(2πx)` to `1/(8x)`.
    fn reach(&self) -> Real {
        self.long.norm() + 7.0 * self.load.shown.sqrt()
    }
}

/// A cell is cut into so many loads at most: with fewer, those of a long one are seen one by one; with more, a frame takes longer.
const MOST_CUTS: Real = 12.0;

/// What all `dents` add at a `place` of the surface that faces `inward` [m].
fn added(dents: &[Dent], place: Vec3, inward: Vec3) -> Vec3 {
    dents.iter().map(|dent| dent.at(place, inward)).sum()
}

/// The `dents` that push, those of each face no deeper than to where it touches: where a tool is deep for its size, half-spaces and meshes
/// of small strain do not add up.
fn that_push(dents: &[Dent]) -> Vec<Dent> {
    let mut pushing: Vec<Dent> = dents.iter().filter(|dent| dent.force > 0.0).copied().collect();
    let kept = pushing.chunk_by(|a, b| a.face == b.face).map(|face| {
        let (wanted, had) = face.iter().fold((0.0, 0.0), |(wanted, had), dent| {
            let along = |v: Vec3| dent.force * dent.load.normal.dot(&v);
            let is = added(&pushing, dent.displayed, dent.load.normal);
            (wanted + along(dent.load.place - dent.displayed), had + along(is))
        });
        (face.len(), if wanted * had > 0.0 { (wanted / had).min(1.0) } else { 0.0 })
    });
    let kept: Vec<Real> = kept.flat_map(|(count, kept)| std::iter::repeat_n(kept, count)).collect();
    pushing.iter_mut().zip(kept).for_each(|(dent, kept)| dent.force *= kept);
    pushing
}

/// Adds the `dents` to a surface of these `vertices` [m], the corners of whose `triangles` are counter-clockwise seen from outside.
pub fn deepen(vertices: &mut [Vec3], triangles: &[[u32; 3]], dents: &[Dent]) {
    let dents = that_push(dents);
    let around = |dent: &Dent| {
        let reach = Vec3::repeat(dent.reach());
        Bounds::new(dent.load.place - reach, dent.load.place + reach)
    };
    let Some(around) = dents.iter().map(around).reduce(|a, b| a.joined(&b)) else { return };
    let near: Vec<bool> = vertices.iter().map(|v| around.contains(v)).collect();
    let mut inward = vec![Vec3::zeros(); vertices.len()];
    for t in triangles {
        let t = t.map(|v| v as usize);
        if t.iter().any(|v| near[*v]) {
            let [a, b, c] = t.map(|v| vertices[v]);
            let area = (c - a).cross(&(b - a));
            t.iter().for_each(|v| inward[*v] += area);
        }
    }
    for (v, place) in vertices.iter_mut().enumerate().filter(|(v, _)| near[*v]) {
        if let Some(inward) = inward[v].try_normalize(0.0) {
            *place += added(&dents, *place, inward);
        }
    }
}
