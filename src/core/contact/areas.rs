//! How much of the surface each point of a tool stands for, where there are fewer points than vertices and triangles that touch.

use super::candidate::{Candidate, Sheet};
use super::posed::Posed;
use super::touchable::Touchable;
use crate::math::Real;
use crate::model::constraint::PointMemory;

/// Vertices have all the area when `candidates` come, ascending by point; a triangle's point takes its own from the corners,
/// the less the nearer it is to one of them: on a corner it is none, and nothing is to be felt of how it gets there. What
/// has next to none left is no candidate, unless it tells that something has sunk below it.
pub(super) fn share_areas(on: &Touchable, parts: &[Posed], candidates: &mut Vec<Candidate>) {
    let (vertices, per_part) = (on.vertices.len() as u32, on.body.points_of_a_part());
    let is_vertex = |c: &Candidate| c.point % per_part < vertices;
    for i in 0..candidates.len() {
        let c = candidates[i];
        if is_vertex(&c) {
            continue;
        }
        let near = GIVEN_ON * parts[c.part as usize].part.half_thickness();
        let nearest = c.stencil.iter().map(|(v, _)| (on.vertices[v.index()] - c.place).norm()).fold(near, Real::min);
        let x = nearest / near;
        candidates[i].share = x * x * (3.0 - 2.0 * x);
        candidates[i].area = candidates[i].share * c.area;
        for (v, _) in c.stencil {
            let corner = v.0 + c.part * per_part;
            if let Ok(k) = candidates.binary_search_by_key(&corner, |c| c.point) {
                candidates[k].area = (candidates[k].area - candidates[i].area / 3.0).max(0.0);
            }
        }
    }
    candidates.retain(|c| c.share > LEAST_SHARE || c.sheet != Sheet::Front);
}

/// Of the points of the last tick, those up to this far apart [m] count as touching where not all can be kept.
const LET_GO: Real = 2e-4;

/// Leaves no more points than `most`, in the order of their numbers: of those that touch some that are spread
/// over all that is touched, then the nearest of the others. Those of the last tick come first, so that a wide tool's points
/// do not take turns, then vertices before triangles and the deepest first, ties to the smaller number. What is left out
/// leaves its area to the nearest that is kept, so that the surface is as stiff as before; that one has the
/// mean normal of all that it stands for, or a rim would push to the side where more of its points are left.
pub(super) fn thin_out(on: &Touchable, candidates: &mut Vec<Candidate>, memory: &[PointMemory], most: usize) {
    if candidates.len() <= most {
        return;
    }
    let (vertices, per_part) = (on.vertices.len() as u32, on.body.points_of_a_part());
    for c in candidates.iter_mut() {
        let known = memory.binary_search_by_key(&c.point, |m| m.point).is_ok();
        let apart = c.gap > if known { LET_GO } else { 0.0 };
        c.last = (apart, !known, c.point % per_part >= vertices);
    }
    candidates.sort_unstable_by(|a, b| a.last.cmp(&b.last).then(a.gap.total_cmp(&b.gap)).then(a.point.cmp(&b.point)));
    let touching = candidates.partition_point(|c| !c.last.0);
    if touching > most {
        spread_out(&mut candidates[..touching], most);
        let (kept, others) = candidates[..touching].split_at_mut(most);
        for other in others {
            let nearest = kept.iter_mut().min_by(|a, b| a.away(other).total_cmp(&b.away(other)));
            if let Some(nearest) = nearest.filter(|c| c.away(other) < Real::INFINITY) {
                nearest.stand_for(other);
            }
        }
    }
    candidates.truncate(most);
    candidates.sort_unstable_by_key(|c| c.point);
}

/// Brings to the front of the `candidates` at most that `most`, none near another.
fn spread_out(candidates: &mut [Candidate], most: usize) {
    let touched: Real = candidates.iter().map(|c| c.area).sum();
    let mut spread = SPREAD * touched / most.max(1) as Real;
    for _ in 0..MOST_TURNS {
        let (mut kept, mut i) = (0, 0);
        while i < candidates.len() && kept <= most {
            let (before, rest) = candidates.split_at(i);
            let near = if rest[0].last.1 { spread } else { STAYS * spread };
            if !before[..kept].iter().any(|c| c.away(&rest[0]) < near) {
                candidates[kept..=i].rotate_right(1);
                kept += 1;
            }
            i += 1;
        }
        if kept <= most {
            return;
        }
        spread *= WIDER;
    }
}

/// Part of the squared distance at which those of the last tick stay.
const STAYS: Real = 0.5;

/// By how much the squared distance grows while too many are kept, ...
const WIDER: Real = 1.3;
/// ... and how often.
const MOST_TURNS: usize = 8;

/// Squared distance of points that are kept, at first, over the area that each has to stand for.
const SPREAD: Real = 0.8;

/// Part of half of a part's thickness within which a triangle's point leaves its area to the corners.
const GIVEN_ON: Real = 0.3;
/// Of a triangle's own area that its point is a candidate for.
const LEAST_SHARE: Real = 1e-3;
