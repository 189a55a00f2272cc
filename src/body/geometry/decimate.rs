//! Fewer triangles for the same shape.

use super::soundness::check_closed;
use palpate_core::geometry::Surface;
use palpate_core::geometry::surface::keep_referenced;
use palpate_core::math::{Bounds, Real};

/// Share of the volume [1] that decimation may add or take away.
const VOLUME_TOLERANCE: Real = 0.02;
/// Distance decimation may move the surface, over the largest extent [1].
const DECIMATION_ERROR: f32 = 0.02;

/// `surface` with about `target_vertices` vertices, all of them among the old ones; its shape moves by about 2 % of
/// its extent at most, so the target may be missed.
///
/// Returned unchanged when it is small enough already, when it is not closed, and when decimation would open it or
/// change its volume by more than 2 %.
pub fn decimate(surface: &Surface, target_vertices: usize) -> Surface {
    if surface.vertices.len() <= target_vertices {
        return surface.clone();
    }
    simplified(surface, target_vertices).unwrap_or_else(|| surface.clone())
}

fn simplified(surface: &Surface, target_vertices: usize) -> Option<Surface> {
    // The simplifier trusts its indices.
    check_closed(&mut surface.clone()).ok()?;
    let Bounds { low, high } = surface.bounds();
    let centre = (low + high) / 2.0;
    let positions: Vec<[f32; 3]> = surface.vertices.iter().map(|p| (p - centre).map(|c| c as f32).into()).collect();
    let adapter =
        meshopt::VertexDataAdapter::new(meshopt::typed_to_bytes(&positions), size_of::<[f32; 3]>(), 0).ok()?;
    // A closed surface has about two triangles per vertex. Regular triangles cost a little accuracy and are worth it:
    // each vertex is a place to touch.
    let indices = meshopt::simplify(
        surface.triangles.as_flattened(),
        &adapter,
        target_vertices.saturating_mul(6),
        DECIMATION_ERROR,
        meshopt::SimplifyOptions::RegularizeLight,
        None,
    );
    let mut triangles = indices.as_chunks::<3>().0.to_vec();
    let vertices = keep_referenced(&surface.vertices, &mut triangles);
    let mut small = Surface { vertices, triangles };
    check_closed(&mut small).ok()?;
    let (before, after) = (surface.volume(), small.volume());
    ((after - before).abs() <= VOLUME_TOLERANCE * before.abs()).then_some(small)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, read_surface};
    use crate::geometry::primitives::liver_surface;
    use crate::geometry::shared::shared;

    #[test]
    fn decimation_keeps_the_liver_closed_and_its_volume() {
        let liver = liver_surface(0.004);
        let small = decimate(&liver, 1000);
        assert!((900..=1010).contains(&small.vertices.len()), "{}", small.vertices.len());
        assert!(check_closed(&mut small.clone()).is_ok());
        assert!((small.volume() / liver.volume() - 1.0).abs() < 0.01);
        assert!(small.vertices.iter().all(|p| liver.vertices.contains(p)));
        assert_eq!(decimate(&liver, liver.vertices.len()), liver);
    }

    #[test]
    fn decimation_returns_the_surface_unchanged_rather_than_ruin_it() {
        let liver = liver_surface(0.008);
        let tiny = decimate(&liver, 0);
        assert!((tiny.volume() / liver.volume() - 1.0).abs() <= VOLUME_TOLERANCE);
        let mut open = liver.clone();
        open.triangles.pop();
        assert_eq!(decimate(&open, 100), open);
        let mut broken = liver.clone();
        broken.triangles[3][1] = liver.vertices.len() as u32;
        assert_eq!(decimate(&broken, 100), broken);
    }

    #[test]
    fn a_real_liver_decimates_to_a_sixth_and_keeps_its_volume() {
        let Some(path) = shared("meshes/Liver.stl") else { return };
        let liver = read_surface(&path, LengthUnit::Millimetre).unwrap();
        let small = decimate(&liver, 2_500);
        assert!((2_450..=2_550).contains(&small.vertices.len()), "{}", small.vertices.len());
        assert!((small.volume() / liver.volume() - 1.0).abs() < 0.005);
    }
}
