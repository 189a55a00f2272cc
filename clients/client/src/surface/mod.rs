//! What there is to see: the surface of the body as it moves.
//!
//! Whoever has the messages, from a server or a recording, makes a [`Surface`] of those of its topology and gives the
//! frames to a [`SurfaceDecoder`].

mod appearance;
mod decoder;

pub use appearance::{Material, Picture};
pub use decoder::{Moment, SurfaceDecoder};

use nalgebra::Vector3;
use palpate_proto::surface::SurfaceCode;
use palpate_proto::{Organ, SurfaceTopology};
use std::ops::Range;

use crate::ClientError;

/// The triangulated surface of the body at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Frames of this surface carry the same number.
    pub topology: u32,
    /// (n) vertex numbers of each triangle, counter-clockwise seen from outside; all below `rest_positions.len()`.
    pub triangles: Vec<[u32; 3]>,
    /// (vertices) [m].
    pub rest_positions: Vec<[f32; 3]>,
    /// Step of the grid on which frames' vertices stand [m]: no coordinate is off by more than half of it.
    pub step: f64,
    /// The organs that it encloses, one at least: their vertices and triangles stand organ by organ.
    pub organs: Vec<Organ>,
    /// (vertices) unit normals at rest, zero for that of the triangles around; empty: so for all.
    pub normals: Vec<[f32; 3]>,
    /// (vertices) texture coordinates, (0, 0) the upper left corner of a picture; empty: none.
    pub uvs: Vec<[f32; 2]>,
    /// What the triangles look like, one material's after another's; empty: as the viewer likes.
    pub materials: Vec<Material>,
    code: SurfaceCode,
}

impl Surface {
    /// The surface of `triangles` (n, 3) with vertices `rest_positions` [m]; vertices of its frames stand on a grid of `step`
    /// [m]. Errors: [`ClientError::Undecodable`] when a triangle names a vertex that does not exist, or the step is not positive.
    pub fn new(
        topology: u32,
        triangles: Vec<[u32; 3]>,
        rest_positions: Vec<[f32; 3]>,
        step: f64,
    ) -> Result<Self, ClientError> {
        let code = SurfaceCode::new(&triangles, &rest_positions, step).ok_or_else(|| {
            undecodable(format!("a triangle names a vertex that does not exist, or a grid of {step} m is none"))
        })?;
        let organ =
            Organ { vertices: rest_positions.len() as u32, triangles: triangles.len() as u32, ..Organ::default() };
        let organs = vec![organ];
        let (normals, uvs, materials) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { topology, triangles, rest_positions, step, organs, normals, uvs, materials, code })
    }

    /// The surface whose topology came in `parts`, in any order. Errors: [`ClientError::Undecodable`] when some are missing
    /// or do not fit together, or when a triangle names a vertex that does not exist.
    pub fn from_parts(mut parts: Vec<SurfaceTopology>) -> Result<Self, ClientError> {
        parts.sort_by_key(|part| part.part);
        let Some(first) = parts.first() else { return Err(undecodable("no parts of it came".into())) };
        let (topology, vertices, step) = (first.topology, first.vertices, first.step);
        if first.parts == 0 {
            return Err(undecodable("it is of version 1.0 of the contract, before frames were quantised".into()));
        }
        let whole = parts.len() == first.parts as usize
            && (0..).zip(&parts).all(|(at, part)| (part.part, part.topology) == (at, topology));
        if !whole {
            let came: Vec<u32> = parts.iter().map(|part| part.part).collect();
            return Err(undecodable(format!("parts {came:?} of {} came", first.parts)));
        }
        let mut triangles = Vec::new();
        let mut rest_positions = Vec::new();
        let (mut normals, mut uvs) = (Vec::new(), Vec::new());
        for part in &parts {
            let not_whole = |what: &str| undecodable(format!("the {what} of part {} are not whole", part.part));
            triangles.extend(triples(&part.triangles, u32::from_le_bytes).ok_or_else(|| not_whole("triangles"))?);
            let positions = triples(&part.rest_positions, f32::from_le_bytes).ok_or_else(|| not_whole("positions"))?;
            rest_positions.extend(positions);
            let own = triples(&part.normals, f32::from_le_bytes).ok_or_else(|| not_whole("normals"))?;
            normals.extend(own);
            let (own, rest) = part.uvs.as_chunks::<8>();
            let single = |bytes: &[u8]| f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[byte]));
            uvs.extend(own.iter().map(|uv| [single(&uv[..4]), single(&uv[4..])]));
            rest.is_empty().then_some(()).ok_or_else(|| not_whole("texture coordinates"))?;
        }
        if rest_positions.len() != vertices as usize {
            return Err(undecodable(format!("{} positions for {vertices} vertices", rest_positions.len())));
        }
        let mut surface = Self::new(topology, triangles, rest_positions, step)?;
        // A server of 1.1 says nothing of organs: all is one.
        let organs = std::mem::take(&mut parts[0].organs);
        if !organs.is_empty() {
            let sum =
                |count: fn(&Organ) -> u32| organs.iter().map(|organ| u64::from(count(organ))).sum::<u64>() as usize;
            if (sum(|o| o.vertices), sum(|o| o.triangles)) != (surface.rest_positions.len(), surface.triangles.len()) {
                return Err(undecodable("the organs are not those of the surface".into()));
            }
            surface.organs = organs;
        }
        let fits = |count: usize| count == 0 || count == surface.rest_positions.len();
        if !fits(normals.len()) || !fits(uvs.len()) {
            return Err(undecodable("normals or texture coordinates are not those of the surface".into()));
        }
        (surface.normals, surface.uvs) = (normals, uvs);
        surface.materials = Material::all(std::mem::take(&mut parts[0].materials), surface.triangles.len())
            .ok_or_else(|| undecodable("the materials are not those of the surface".into()))?;
        Ok(surface)
    }

    /// Vertices and triangles of each organ.
    pub fn ranges(&self) -> impl Iterator<Item = [Range<usize>; 2]> + '_ {
        let next = |from: &mut usize, count: u32| {
            *from += count as usize;
            *from - count as usize..*from
        };
        self.organs.iter().scan([0, 0], move |[vertex, triangle], organ| {
            Some([next(vertex, organ.vertices), next(triangle, organ.triangles)])
        })
    }

    /// Normals of the vertices at `positions` (vertices) [m]: unit, out of the body, the mean of those of the triangles around
    /// by their areas; zero where these cancel.
    pub fn normals(&self, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut normals = vec![Vector3::zeros(); positions.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|v| Vector3::from(positions[v as usize]));
            let normal = (b - a).cross(&(c - a));
            triangle.iter().for_each(|v| normals[*v as usize] += normal);
        }
        normals.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_default().into()).collect()
    }

    /// Messages that each of its frames comes in.
    pub fn parts(&self) -> usize {
        self.code.parts()
    }
}

fn undecodable(reason: String) -> ClientError {
    ClientError::Undecodable { message: "SurfaceTopology", reason }
}

/// `bytes` as triples of four-byte numbers; `None` when they are not whole.
fn triples<T: Copy>(bytes: &[u8], number: impl Fn([u8; 4]) -> T) -> Option<Vec<[T; 3]>> {
    let (triples, rest) = bytes.as_chunks::<12>();
    rest.is_empty().then_some(())?;
    let number_at = |triple: &[u8; 12], at: usize| number([0, 1, 2, 3].map(|byte| triple[4 * at + byte]));
    Some(triples.iter().map(|triple| [0, 1, 2].map(|at| number_at(triple, at))).collect())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A triangle in two parts.
    pub(crate) fn one_triangle() -> Vec<SurfaceTopology> {
        let positions = [0.0f32, 0., 0., 1., 0., 0., 0., 1., 0.5];
        let bytes = |positions: &[f32]| positions.iter().flat_map(|x| x.to_le_bytes()).collect();
        let first = SurfaceTopology {
            topology: 4,
            vertices: 3,
            triangles: [0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()).collect(),
            rest_positions: bytes(&positions[..6]),
            part: 0,
            parts: 2,
            step: 1e-4,
            ..Default::default()
        };
        let second =
            SurfaceTopology { triangles: vec![], rest_positions: bytes(&positions[6..]), part: 1, ..first.clone() };
        vec![second, first]
    }

    #[test]
    fn a_surface_reads_back_what_was_written_in_whatever_order_its_parts_come() {
        let surface = Surface::from_parts(one_triangle()).unwrap();
        assert_eq!(surface.triangles, [[0, 1, 2]]);
        assert_eq!(surface.rest_positions[2], [0.0, 1.0, 0.5]);
        assert_eq!((surface.topology, surface.step), (4, 1e-4));
        assert_eq!(surface.organs.len(), 1, "what says nothing of organs is one");
    }

    #[test]
    fn normals_point_out_of_the_body() {
        let surface = Surface::from_parts(one_triangle()).unwrap();
        let length = (0.5f32 * 0.5 + 1.0).sqrt();
        for normal in surface.normals(&surface.rest_positions) {
            let expected = [0.0, -0.5 / length, 1.0 / length];
            assert!(normal.iter().zip(expected).all(|(n, e)| (n - e).abs() < 1e-6), "{normal:?}");
        }
        assert_eq!(surface.normals(&[[0.0; 3]; 3]), [[0.0; 3]; 3]);
    }

    #[test]
    fn a_surface_says_whose_its_vertices_and_triangles_are() {
        let organ =
            |name: &str, vertices, triangles| Organ { name: name.into(), vertices, triangles, ..Organ::default() };
        let of = |organs: Vec<Organ>| {
            let mut parts = one_triangle();
            parts[1].organs = organs;
            Surface::from_parts(parts)
        };
        let surface = of(vec![organ("liver", 1, 1), organ("kidney", 2, 0)]).unwrap();
        assert_eq!(surface.organs[1].name, "kidney");
        assert_eq!(surface.ranges().collect::<Vec<_>>(), [[0..1, 0..1], [1..3, 1..1]]);
        for organs in [vec![organ("liver", 2, 1)], vec![organ("liver", u32::MAX, 1), organ("kidney", 4, 0)]] {
            assert!(of(organs).unwrap_err().to_string().contains("not those of the surface"));
        }
    }

    #[test]
    fn a_surface_that_does_not_fit_together_is_refused() {
        let refused = |change: &dyn Fn(&mut Vec<SurfaceTopology>)| {
            let mut parts = one_triangle();
            change(&mut parts);
            Surface::from_parts(parts).unwrap_err().to_string()
        };
        assert!(refused(&|parts| parts.clear()).contains("no parts"));
        assert!(refused(&|parts| drop(parts.pop())).contains("parts [1] of 2 came"));
        assert!(refused(&|parts| parts.iter_mut().for_each(|p| p.parts = 0)).contains("of version 1.0"));
        assert!(refused(&|parts| parts[0].topology = 5).contains("parts [0, 1] of 2 came"));
        assert!(refused(&|parts| parts.iter_mut().for_each(|p| p.vertices = 2)).contains("3 positions for 2 vertices"));
        assert!(refused(&|parts| parts[1].triangles.truncate(11)).contains("triangles of part 0 are not whole"));
        assert!(refused(&|parts| parts[0].rest_positions.truncate(11)).contains("positions of part 1 are not whole"));
        assert!(refused(&|parts| parts[1].triangles[0] = 3).contains("does not exist"));
        assert!(refused(&|parts| parts[1].step = 0.0).contains("a grid of 0 m"));
    }
}
