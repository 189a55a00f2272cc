//! What can be wrong with the shapes of a body.

use palpate_core::math::{Real, Vec3};

/// What is wrong with shapes, where, and what to do about it.
#[derive(Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of each variant names its fields")]
pub enum ShapeFault {
    #[error("{0}")]
    Size(String),
    #[error(
        "{count} bodies in one file: one {} across around {}, another {} across around {}{}; a body hangs together: save each to \
         a file of its own, or take the largest alone with --largest of `palpate prepare`",
        across(sizes[0]),
        place(first),
        across(sizes[1]),
        place(second),
        if *within { ", within the first (a cavity faces inward: turn its triangles if it is one)" } else { "" }
    )]
    SeveralBodies { count: usize, sizes: [Real; 2], first: Vec3, second: Vec3, within: bool },
    #[error(
        "{count} pieces of the mesh touch in a corner or an edge at most, where they would turn freely: one around {}, another \
         around {}; join them by faces, or leave all but one out",
        place(first),
        place(second)
    )]
    Hinged { count: usize, first: Vec3, second: Vec3 },
    #[error(
        "the surface crosses itself: {count} pairs of triangles meet, the first around {}; repair it, in Blender with \
         the Remesh modifier, or go on with --allow-crossings: what lies inside is then uncertain there",
        place(at)
    )]
    Crosses { count: usize, at: Vec3 },
    #[error(
        "mesh {mesh} is no level of the same body as mesh {of}: its volume differs by {:+.0} %, its centre lies {:.0} % of \
         the body's radius away; give meshes of one body, all in one frame and unit",
        100.0 * volume,
        100.0 * centre
    )]
    OtherBody { mesh: usize, of: usize, volume: Real, centre: Real },
}

/// A place as people read it.
fn place(p: &Vec3) -> String {
    format!("({:.4}, {:.4}, {:.4}) m", p.x, p.y, p.z)
}

/// A length as people say it.
pub(super) fn across(length: Real) -> String {
    if length >= 1.0 { format!("{length:.3} m") } else { format!("{:.3} mm", 1e3 * length) }
}
