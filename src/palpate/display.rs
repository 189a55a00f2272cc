//! What viewers are shown of a body: the surface that is touched, or one that looks better and moves with it.

use palpate_body::geometry::embedded::Embedding;
use palpate_body::geometry::textured::{Material, Picture, TexturedMesh};
use palpate_core::geometry::Surface;
use palpate_core::math::{Pose, Real, Vec3};
use palpate_core::model::Body;
use std::borrow::Cow;
use std::sync::Arc;

/// The surface that viewers get, at rest, and how it follows the touched one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Display {
    /// (n_vertices) [m].
    pub rest: Vec<[f32; 3]>,
    /// Vertex numbers, (n_triangles), organ by organ, and of each organ material by material.
    pub triangles: Vec<[u32; 3]>,
    /// Unit normals, (n_vertices); empty: those of the triangles.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, (n_vertices), (0, 0) the upper left corner of a picture; empty: none.
    pub uvs: Vec<[f32; 2]>,
    /// What the triangles look like, in their order; empty: as the viewer likes.
    pub looks: Vec<Look>,
    /// Pictures that looks refer to.
    pub pictures: Vec<Picture>,
    /// (organs) vertices and triangles of each.
    pub organs: Vec<[usize; 2]>,
    /// (n_vertices) places on the touched surface; empty: it is that surface.
    embedded: Vec<Embedding>,
}

/// What triangles look like.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// A name for people.
    pub name: String,
    /// How many triangles are of it.
    pub triangles: usize,
    /// Red, green and blue, linear, 0 to 1: a factor on the picture where there is one; `None`: as the viewer likes.
    pub colour: Option<[f32; 3]>,
    /// Place of its picture among [`Display::pictures`].
    pub picture: Option<usize>,
}

/// A surface to look at that does not lie on the body.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "vertex {} of the surface to look at is {:.1} mm from the one that is touched, which is {:.0} mm wide: check \
     display_unit, and that both files have the same origin",
    vertex + 1, 1e3 * distance, 1e3 * width
)]
pub struct FarOff {
    /// The farthest vertex, from 0.
    pub vertex: usize,
    /// Its distance [m].
    pub distance: Real,
    /// Diagonal of the touched surface [m].
    pub width: Real,
}

/// Farther from the touched surface than this part of its diagonal, a vertex does not belong to it; tuned. With less, a mesh that
/// was smoothed otherwise is refused; with more, one in another unit or frame hangs somewhere.
const FAR_OFF: Real = 0.1;

impl Display {
    /// The touched surface of `body` itself.
    pub fn touched(body: &Body) -> Self {
        let counts = body.organs().iter().map(|organ| [organ.vertices.len(), organ.triangles.len()]);
        Self {
            rest: body.surface().vertices.iter().map(single).collect(),
            triangles: body.surface().triangles.clone(),
            organs: counts.collect(),
            ..Self::default()
        }
    }

    /// Of `body`, of whose organs some have a surface `own` to look at [m], each in its organ's own frame.
    ///
    /// # Errors
    /// When one is not where its organ is, with the organ's number.
    pub fn new(body: &Body, own: &[Option<(Arc<TexturedMesh>, Pose)>]) -> Result<Self, (usize, FarOff)> {
        if own.iter().all(Option::is_none) {
            return Ok(Self::touched(body));
        }
        let mut display = Self::default();
        for (number, organ) in body.organs().iter().enumerate() {
            let first = organ.vertices.start as u32;
            let part = Surface {
                vertices: body.surface().vertices[organ.vertices.clone()].to_vec(),
                triangles: body.surface().triangles[organ.triangles.clone()]
                    .iter()
                    .map(|t| t.map(|v| v - first))
                    .collect(),
            };
            let (mesh, embedded) = match own.get(number).and_then(Option::as_ref) {
                Some((mesh, pose)) => {
                    let mut mesh = TexturedMesh::clone(mesh);
                    mesh.surface.vertices.iter_mut().for_each(|v| *v = pose.to_world(*v));
                    mesh.normals.iter_mut().for_each(|n| *n = single(&pose.rotate(Vec3::from(n.map(Real::from)))));
                    let embedded = embed(&mesh.surface.vertices, &part).map_err(|far| (number, far))?;
                    (mesh, embedded)
                }
                None => {
                    let on = (0..part.vertices.len() as u32).map(Embedding::on_vertex).collect();
                    (TexturedMesh { surface: part, ..TexturedMesh::default() }, on)
                }
            };
            display.add(&organ.name, mesh, embedded, first);
        }
        Ok(display)
    }

    /// What a recording of `body` shows, whose surface at rest has the vertices `rest` [m].
    pub fn recorded(body: &Body, rest: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        let touched = Self::touched(body);
        if touched.rest == rest && touched.triangles == triangles {
            return touched;
        }
        let places: Vec<Vec3> = rest.iter().map(|v| Vec3::from(v.map(Real::from))).collect();
        Self { embedded: Embedding::of(&places, body.surface()), rest, triangles, ..Self::default() }
    }

    /// Adds the next organ, whose vertices hang on touched ones counted from `first`.
    fn add(&mut self, organ: &str, mesh: TexturedMesh, embedded: Vec<Embedding>, first: u32) {
        let TexturedMesh { surface, normals, uvs, materials, pictures } = mesh;
        let (before, picture) = (self.rest.len(), self.pictures.len());
        let after = before + surface.vertices.len();
        self.organs.push([surface.vertices.len(), surface.triangles.len()]);
        self.rest.extend(surface.vertices.iter().map(single));
        extend(&mut self.normals, normals, before, after);
        extend(&mut self.uvs, uvs, before, after);
        if materials.is_empty() {
            let triangles = surface.triangles.len();
            self.looks.push(Look { name: organ.to_owned(), triangles, colour: None, picture: None });
        }
        self.looks.extend(materials.into_iter().map(|Material { name, triangles, colour, picture: own }| Look {
            name,
            triangles,
            colour,
            picture: own.map(|own| own + picture),
        }));
        self.pictures.extend(pictures);
        self.triangles.extend(surface.triangles.into_iter().map(|t| t.map(|v| v + before as u32)));
        let placed = |e: Embedding| Embedding { corners: e.corners.map(|v| v + first), ..e };
        self.embedded.extend(embedded.into_iter().map(placed));
    }

    /// Places of all vertices [m] with the touched ones at `touched` [m].
    pub fn positions<'a>(&self, touched: &'a [Vec3]) -> Cow<'a, [Vec3]> {
        match self.embedded.as_slice() {
            [] => Cow::Borrowed(touched),
            embedded => Cow::Owned(embedded.iter().map(|e| e.position(touched)).collect()),
        }
    }

    /// Levels of detail of all vertices where `touched` are those of the touched ones.
    pub fn levels<'a>(&self, touched: &'a [u8]) -> Cow<'a, [u8]> {
        match self.embedded.as_slice() {
            [] => Cow::Borrowed(touched),
            embedded => Cow::Owned(embedded.iter().map(|e| touched[e.nearest() as usize]).collect()),
        }
    }
}

/// `vertices` [m] on the touched surface of their organ; an error where one is far from it.
fn embed(vertices: &[Vec3], touched: &Surface) -> Result<Vec<Embedding>, FarOff> {
    let embedded = Embedding::of(vertices, touched);
    let distances = embedded.iter().map(|e| e.distance(&touched.vertices)).enumerate();
    let farthest = distances.max_by(|a, b| a.1.total_cmp(&b.1));
    let width = touched.bounds().size().norm();
    match farthest {
        Some((vertex, distance)) if distance > FAR_OFF * width => Err(FarOff { vertex, distance, width }),
        _ => Ok(embedded),
    }
}

/// Appends `of`, which is empty or of `after - before` vertices, to those of `before`, of which some may have none.
fn extend<const N: usize>(all: &mut Vec<[f32; N]>, of: Vec<[f32; N]>, before: usize, after: usize) {
    if !of.is_empty() || !all.is_empty() {
        all.resize(before, [0.0; N]);
        all.extend(of);
        all.resize(after, [0.0; N]);
    }
}

fn single(v: &Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}
