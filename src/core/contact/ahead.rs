//! Where a part of a tool is about to touch the surface: of a face of the last tick, and of a new one.

use super::moving_part::{MovingPart, Silhouette};
use super::patch::{Patch, Pressed};
use super::touchable::{Touchable, area_vector};
use super::view::{LEAST_FACING, View};
use crate::ids::{Triangle, Vertex};
use crate::math::{Real, Vec3};
use crate::model::constraint::PointMemory;

/// Where the surface is about to be touched: a triangle, how it is looked at, and how it was pushed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ahead {
    pub(super) triangle: Triangle,
    pub(super) view: View,
    pub(super) pressed: Pressed,
    /// What is remembered of its first sample.
    pub(super) known: Option<u32>,
}

/// Where a face of the last tick is now, whose points are `known` and begin at number `first`: about the direction in which it was pushed.
pub(super) fn still_ahead(on: &Touchable, part: &MovingPart, known: &[PointMemory], first: u32) -> Option<Ahead> {
    let push: Vec3 = known.iter().map(|m| m.normal * m.multiplier).sum();
    let (middle, load) = (known.get(part.middle())?, push.norm());
    if part.is_solid() {
        return (load > 0.0).then(|| solid_ahead(on, part, known, first, push)).flatten();
    }
    let triangle = on.body.triangle_of_point(middle.point);
    let ahead = if load > 0.0 { half_way(push / load, middle.normal) } else { middle.normal };
    let ahead = seen_from_ahead(on, triangle, [ahead, middle.normal]);
    let view = View::new(ahead, first_axis(part, known, ahead));
    let along = view.across[0];
    // Where on the tool it was.
    let place = |m: &PointMemory| along.dot(&part.arm(m.core, m.normal));
    if load <= 0.0 {
        // It has let go, unless the mesh alone would swallow the tool.
        let foot = on.touched(middle);
        let shadow = along.dot(&part.axis());
        let share = if shadow > 0.0 { (place(middle) / shadow).clamp(0.0, 1.0) } else { 0.0 };
        if ahead.dot(&(foot - part.start() - part.axis() * share)) > 0.0 {
            return None;
        }
        let pressed = Pressed::not([if part.is_ball() { 0.0 } else { place(middle) }, 0.0]);
        return Some(Ahead { triangle, view, pressed, known: Some(first) });
    }
    let half_width = Patch::half_width_of(part, &view, |i| known.get(i).map_or(ahead, |m| m.normal));
    let edges = Some([[-half_width, half_width]; 2]);
    let Some([columns, _]) = part.cells() else {
        let pressed = Pressed { force: load, middle: [0.0; 2], spread: [[0.0; 2]; 2], edges };
        return Some(Ahead { triangle, view, pressed, known: Some(first) });
    };
    let (middle, spread) = spread(known, &place);
    // Each lies on a cell as long as the samples are apart.
    let cell = (place(known.get(columns - 1)?) - place(&known[0])) / (columns - 1) as Real;
    let spread = [spread.map(|side| side + cell * cell / 12.0), [0.0; 2]];
    let pressed = Pressed { force: load, middle: [middle, 0.0], spread, edges };
    Some(Ahead { triangle, view, pressed, known: Some(first) })
}

/// The same of a solid part, which got that `push` [N].
fn solid_ahead(on: &Touchable, part: &MovingPart, known: &[PointMemory], first: u32, push: Vec3) -> Option<Ahead> {
    let most = known.iter().max_by(|a, b| a.multiplier.total_cmp(&b.multiplier))?;
    let (triangle, load) = (on.body.triangle_of_point(most.point), push.norm());
    let ahead = which_way(on, known, push / load);
    let ahead = seen_from_ahead(on, triangle, [ahead, most.normal]);
    let view = View::of_solid(ahead, part.longest_across(ahead));
    let (mut middle, mut all, mut edges) = ([0.0; 2], [[0.0; 2]; 2], [[0.0; 2]; 2]);
    for (c, cells) in part.cells()?.into_iter().enumerate() {
        let place = |m: &PointMemory| view.across[c].dot(&part.arm(m.core, m.normal));
        let places = known.iter().map(place);
        let (low, high) = (places.clone().fold(Real::INFINITY, Real::min), places.fold(Real::NEG_INFINITY, Real::max));
        // Each lies on a cell as long as the samples are apart.
        let cell = (high - low) / (cells - 1) as Real;
        let (mean, spread) = spread(known, &place);
        (middle[c], all[c]) = (mean, spread.map(|side| side + cell * cell / 12.0));
        edges[c] = [low - 0.5 * cell, high + 0.5 * cell];
    }
    let pressed = Pressed { force: load, middle, spread: all, edges: Some(edges) };
    Some(Ahead { triangle, view, pressed, known: Some(first) })
}

/// What a solid part of this `outline` overlaps of the surface around the triangle `under` it, or would a little farther on: of all that
/// is seen of it, ever less around what is deepest.
pub(super) fn overlapped(
    on: &Touchable,
    part: &MovingPart,
    view: &View,
    outline: &Silhouette,
    under: Triangle,
) -> Patch {
    let (mut patch, mut triangle) = (Patch::rectangle(outline.bounds), under);
    for round in 0..NEARER {
        let mut gaps = [[Real::INFINITY; LOOKS]; LOOKS];
        let sides = patch.sides([LOOKS; 2]);
        let at = |i: usize, j: usize| {
            [patch.line[0] + sides[0] * (i as Real + 0.5), patch.across[0] + sides[1] * (j as Real + 0.5)]
        };
        for (j, row) in gaps.iter_mut().enumerate() {
            for (i, gap) in row.iter_mut().enumerate() {
                let foot = if outline.outside(at(i, j)).0 > 0.0 { None } else { part.front(view, at(i, j)) };
                let Some(foot) = foot else { continue };
                let front = part.start() + foot.arm;
                let end = view.walk(on, triangle, front);
                if end.beyond == 0.0 {
                    triangle = end.triangle;
                    *gap = view.ahead.dot(&(on.displayed(triangle, end.weights) - front));
                }
            }
        }
        let least = gaps.iter().flatten().copied().fold(Real::INFINITY, Real::min);
        if least == Real::INFINITY {
            break;
        }
        let near = least + (-least).max(LEAST_DEPTH * part.radius());
        // Between two places it may be nearer than at either.
        let around = if round + 1 < NEARER { 1.0 } else { 0.5 };
        let mut edges = [[Real::INFINITY, Real::NEG_INFINITY]; 2];
        for (j, row) in gaps.iter().enumerate() {
            for (i, _) in row.iter().enumerate().filter(|(_, gap)| **gap <= near) {
                for (c, [low, high]) in edges.iter_mut().enumerate() {
                    let (at, half) = (at(i, j)[c], around * sides[c]);
                    (*low, *high) = (low.min(at - half), high.max(at + half));
                }
            }
        }
        let [line, across] = [(edges[0], patch.line), (edges[1], patch.across)]
            .map(|(edge, whole)| [edge[0].max(whole[0]), edge[1].min(whole[1])]);
        patch = Patch::rectangle([line, across]);
    }
    patch
}

/// Mean place of the forces on samples, and the mean squares of the distances from it before and behind, as if each had half of the force.
fn spread(known: &[PointMemory], place: &dyn Fn(&PointMemory) -> Real) -> (Real, [Real; 2]) {
    let all: Real = known.iter().map(|m| m.multiplier).sum();
    let mean = |of: &dyn Fn(&PointMemory) -> Real| known.iter().map(|m| m.multiplier * of(m)).sum::<Real>() / all;
    let middle = mean(place);
    let [before, behind] = [-1.0, 1.0].map(|side| mean(&|m| 2.0 * (side * (place(m) - middle)).max(0.0).powi(2)));
    (middle, [before, behind])
}

/// Which way a solid part that was pushed along `push` and whose samples of the last tick are `known` meets the surface: the mean of the
/// directions in which both face, weighted by the inverse of their circular variances [Mardia 1972], as an edge of the one tells nothing while
/// the other is flat.
fn which_way(on: &Touchable, known: &[PointMemory], push: Vec3) -> Vec3 {
    let pushing = || known.iter().filter(|m| m.multiplier > 0.0);
    let load: Real = pushing().map(|m| m.multiplier).sum();
    // Between those of the vertices, so that it makes no step where a sample gets into another triangle.
    let inward = |m: &PointMemory| {
        let of_vertex = |v: Vertex| on.body.triangles_around(v).iter().map(|t| area_vector(on, *t)).sum::<Vec3>();
        let corners = on.body.corners_of_point(m.point).into_iter().zip(m.weights);
        let outward: Vec3 = corners.map(|(v, w)| of_vertex(v).try_normalize(0.0).unwrap_or_default() * w).sum();
        -outward.try_normalize(0.0).unwrap_or_default()
    };
    let mean = |of: &dyn Fn(&PointMemory) -> Vec3| pushing().map(|m| of(m) * (m.multiplier / load)).sum::<Vec3>();
    let (tool, surface) = (mean(&|m| m.normal), mean(&inward));
    let variance = |v: Vec3| 1.0 - v.norm() + 1e-6;
    let between = tool.normalize() * variance(surface) + surface.try_normalize(1e-6).unwrap_or(push) * variance(tool);
    between.try_normalize(1e-12).unwrap_or(push)
}

/// The direction between that of the `push` and that of what is in the `middle`. Half of the way, as the patch's width goes: the direction and
/// the force are each the other's answer, too.
fn half_way(push: Vec3, middle: Vec3) -> Vec3 {
    (push + middle).try_normalize(1e-6).unwrap_or(push)
}

/// The first of these directions along which a triangle is not seen from the edge, which tells nothing of where it is touched; or straight at
/// it.
fn seen_from_ahead(on: &Touchable, triangle: Triangle, directions: [Vec3; 2]) -> Vec3 {
    let inward = (-area_vector(on, triangle)).try_normalize(0.0).unwrap_or(directions[0]);
    directions.into_iter().find(|d| d.dot(&inward) > LEAST_FACING).unwrap_or(inward)
}

/// Which way the first axis of a view along `ahead` goes whose samples of the last tick are `known`: a rod's own, as far as that is seen from
/// aside. From ahead it could be any: it stays as it was.
fn first_axis(part: &MovingPart, known: &[PointMemory], ahead: Vec3) -> Vec3 {
    if part.is_ball() {
        return known.get(1).map_or(ahead, |m| m.normal);
    }
    let axis = part.axis().normalize();
    let aside = axis - ahead * ahead.dot(&axis);
    let share = (aside.norm_squared() / (LEAST_FACING * LEAST_FACING)).min(1.0);
    let line = part.on_line();
    let turns = known[line.end - 1].normal - known[line.start].normal;
    match (turns.try_normalize(1e-6), aside.try_normalize(1e-6)) {
        (Some(before), Some(now)) if share < 1.0 => before + (now - before) * share,
        (Some(before), None) => before,
        _ => axis,
    }
}

/// Times that what a solid part overlaps is looked at more closely, ...
const NEARER: usize = 6;
/// ... in so many places along and across: each time it may be two fifths as wide, in all a two-hundredth.
const LOOKS: usize = 5;
/// Over the rounding of a solid part, how much farther on it is taken to be, as a ball before there is a load: with none a patch may have no
/// width, with more an edge begins on wide cells and is felt late.
const LEAST_DEPTH: Real = 0.002;
