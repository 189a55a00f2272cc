//! What a mesh file lists, before it is put together.

use super::labels::Labels;
use super::mesh_error::MeshError;
use crate::math::Real;

/// Most triangles read; only polygons can make so many from so few bytes.
const MAX_TRIANGLES: usize = 8_000_000;

/// Points and cells as a file lists them, not yet connected or checked.
#[derive(Debug, Default)]
pub(super) struct Cells {
    /// In the file's unit, (n_points).
    pub points: Vec<[Real; 3]>,
    /// Valid indices into `points`, (n_triangles).
    pub triangles: Vec<[u32; 3]>,
    /// Number in the file and valid indices into `points`, (n_tetrahedra).
    pub tetrahedra: Vec<(i64, [u32; 4])>,
    /// What the file calls them, one way or several.
    pub labels: Vec<Labels>,
    /// True where points are shared between cells, so that two at one place are more than the format needs.
    pub indexed: bool,
}

impl Cells {
    /// Adds a polygon of the listed points `corners` as a fan of triangles.
    ///
    /// # Errors
    /// When there are too many triangles; those of fewer than three corners are left out.
    pub(super) fn polygon(&mut self, corners: &[u32]) -> Result<(), MeshError> {
        let [first, rest @ ..] = corners else { return Ok(()) };
        if self.triangles.len() + rest.len() > MAX_TRIANGLES {
            return Err(MeshError::TooBig { limit: MAX_TRIANGLES, what: "triangles" });
        }
        self.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        Ok(())
    }

    /// Labels the tetrahedra from number `first` on by the array `name` of `numbers`, one for each cell of the file or of
    /// the piece of it that they are the last of; an array that does not label all of them is none.
    pub(super) fn label_by_cell(&mut self, name: &str, numbers: &[Real], first: usize) {
        let of = |(number, _): &(i64, [u32; 4])| numbers.get(usize::try_from(number - 1).ok()?).copied();
        let Some(new) = self.tetrahedra[first..].iter().map(of).collect::<Option<Vec<Real>>>() else { return };
        let Some(mut new) = Labels::from_numbers(name, new.into_iter()) else { return };
        match self.labels.iter_mut().find(|labels| labels.name == name) {
            Some(labels) if labels.of.len() == first => labels.of.append(&mut new.of),
            None if first == 0 => self.labels.push(new),
            _ => {}
        }
    }

    /// The point that bears `index`, counted from `first`, in `cell` number `number`.
    ///
    /// # Errors
    /// When there is none.
    pub(super) fn index(&self, cell: &'static str, number: i64, index: i64, first: i64) -> Result<u32, MeshError> {
        let place = index.checked_sub(first).and_then(|i| usize::try_from(i).ok()).filter(|i| *i < self.points.len());
        place.map(|i| i as u32).ok_or(MeshError::BadIndex { cell, number, index })
    }
}
