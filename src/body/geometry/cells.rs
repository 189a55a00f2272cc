//! What a mesh file lists, before it is put together.

use super::labels::{Labels, is_called_fibre, is_called_label};
use super::mesh_error::{MeshError, shown};
use palpate_core::math::{Real, Vec3, is_finite};

/// Most triangles read; only polygons can make so many from so few bytes.
const MAX_TRIANGLES: usize = 8_000_000;

/// Most corners of a polygon whose ears are looked for: that takes their cube.
const MOST_CORNERS: usize = 256;

/// Why an array is no label.
const NOT_ALL: &str = "it has not one number for each tetrahedron";

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
    /// Directions of fibres, (n_tetrahedra), of any length, and what the file calls them.
    pub directions: Option<(String, Vec<Vec3>)>,
    /// Polygons of fewer than three corners, which are no surface.
    pub degenerate: usize,
    /// What the file holds and is not taken, in words.
    pub left_out: Vec<String>,
    /// What else a report is to say of the file.
    pub notes: Vec<String>,
    /// True where points are shared between cells, so that two at one place are more than the format needs.
    pub indexed: bool,
}

impl Cells {
    /// Adds a polygon of the listed points `corners` as a fan of triangles, or one that is not convex as what is left of it
    /// when its ears are cut off one after the other.
    ///
    /// # Errors
    /// When there are too many triangles; those of fewer than three corners are counted and left out.
    pub(super) fn polygon(&mut self, corners: &[u32]) -> Result<(), MeshError> {
        let Some((first, rest)) = corners.split_first().filter(|(_, rest)| rest.len() > 1) else {
            self.degenerate += 1;
            return Ok(());
        };
        if self.triangles.len() + rest.len() > MAX_TRIANGLES {
            return Err(MeshError::TooBig { limit: MAX_TRIANGLES, what: "triangles" });
        }
        match self.ears(corners) {
            Some(ears) => self.triangles.extend(ears),
            None => self.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]])),
        }
        Ok(())
    }

    /// Adds the triangles of a strip of the listed points `corners`: each corner from the third on makes one with the two
    /// before it, every other of them listed the other way round. Corners that are listed twice, to go on elsewhere, make
    /// none.
    ///
    /// # Errors
    /// When there are too many triangles.
    pub(super) fn strip(&mut self, corners: &[u32]) -> Result<(), MeshError> {
        for (i, corners) in corners.windows(3).enumerate() {
            let [a, b, c] = if i % 2 == 0 { [0, 1, 2] } else { [1, 0, 2] }.map(|corner| corners[corner]);
            if a != b && b != c && c != a {
                self.polygon(&[a, b, c])?;
            }
        }
        Ok(())
    }

    /// The triangles of a polygon that turns both ways; none for others, nor where points that are to come or a polygon that
    /// crosses itself leave no ear.
    fn ears(&self, corners: &[u32]) -> Option<Vec<[u32; 3]>> {
        if !(4..=MOST_CORNERS).contains(&corners.len()) {
            return None;
        }
        let places: Vec<Vec3> =
            corners.iter().map(|c| Some(Vec3::from(*self.points.get(*c as usize)?))).collect::<Option<_>>()?;
        // Twice the area as a vector [Newell].
        let next = |i: usize| (i + 1) % places.len();
        let normal: Vec3 =
            (0..places.len()).map(|i| (places[i] - places[0]).cross(&(places[next(i)] - places[0]))).sum();
        let turn = |a: usize, b: usize, c: usize| (places[b] - places[a]).cross(&(places[c] - places[b])).dot(&normal);
        let flat = 1e-9 * normal.norm_squared();
        let mut left: Vec<usize> = (0..places.len()).collect();
        let around = |left: &[usize], i: usize| {
            let n = left.len();
            [left[(i + n - 1) % n], left[i], left[(i + 1) % n]]
        };
        let turns_back = |i: usize| {
            let [a, b, c] = around(&left, i);
            turn(a, b, c) < -flat
        };
        if !(0..left.len()).any(turns_back) {
            return None;
        }
        let mut ears = Vec::with_capacity(corners.len() - 2);
        while left.len() > 3 {
            let is_ear = |i: usize| {
                let [a, b, c] = around(&left, i);
                let within = |p: usize| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
                turn(a, b, c) > flat && !left.iter().any(|p| ![a, b, c].contains(p) && within(*p))
            };
            let ear = (0..left.len()).find(|i| is_ear(*i))?;
            ears.push(around(&left, ear).map(|i| corners[i]));
            left.remove(ear);
        }
        ears.push([left[0], left[1], left[2]].map(|i| corners[i]));
        Some(ears)
    }

    /// Labels the tetrahedra from number `first` on by the array `name` of `numbers`, one for each cell of the file or of
    /// the piece of it that they are the last of; an array that does not label all of them is none.
    pub(super) fn label_by_cell(&mut self, name: &str, numbers: &[Real], first: usize) {
        if first == self.tetrahedra.len() {
            return;
        }
        let of = |(number, _): &(i64, [u32; 4])| numbers.get(usize::try_from(number - 1).ok()?).copied();
        let Some(new) = self.tetrahedra[first..].iter().map(of).collect::<Option<Vec<Real>>>() else {
            return self.unfit(name, NOT_ALL);
        };
        let mut new = match Labels::from_numbers(name, new.into_iter()) {
            Ok(new) => new,
            Err(why) => return self.unfit(name, why),
        };
        match self.labels.iter_mut().find(|labels| labels.name == name) {
            Some(labels) if labels.of.len() == first => labels.of.append(&mut new.of),
            None if first == 0 => self.labels.push(new),
            _ => self.unfit(name, NOT_ALL),
        }
    }

    /// Takes the vectors `numbers` of the array `name`, three for each cell of the file or of the piece of it that the tetrahedra from number
    /// `first` on are of, for directions of fibres where it is called so, the first that is.
    pub(super) fn lead_by_cell(&mut self, name: &str, numbers: &[Real], first: usize) {
        let of = |(number, _): &(i64, [u32; 4])| {
            numbers.as_chunks::<3>().0.get(usize::try_from(number - 1).ok()?).copied().map(Vec3::from)
        };
        if first == self.tetrahedra.len() || !is_called_fibre(name) {
            return;
        }
        let new = self.tetrahedra[first..].iter().map(of).collect::<Option<Vec<Vec3>>>();
        let Some(mut new) = new.filter(|new| new.iter().all(is_finite)) else {
            return self.leads_none(name);
        };
        match &mut self.directions {
            Some((called, directions)) if called == name && directions.len() == first => directions.append(&mut new),
            None if first == 0 => self.directions = Some((name.to_owned(), new)),
            Some((called, _)) if called != name => {}
            _ => self.leads_none(name),
        }
    }

    /// Labels all tetrahedra by the array `name` of `numbers`, where they are fit for labels.
    pub(super) fn label(&mut self, name: &str, numbers: impl Iterator<Item = Real>) {
        match Labels::from_numbers(name, numbers) {
            Ok(labels) => self.labels.push(labels),
            Err(why) => self.unfit(name, why),
        }
    }

    /// Drops the labels and directions of arrays that have none for some tetrahedra.
    pub(super) fn drop_partial_arrays(&mut self) {
        let count = self.tetrahedra.len();
        if let Some((name, _)) = self.directions.take_if(|(_, directions)| directions.len() != count) {
            self.leads_none(&name);
        }
        let partial = |labels: &Labels| labels.of.len() != count;
        let names: Vec<String> = self.labels.iter().filter(|l| partial(l)).map(|l| l.name.clone()).collect();
        self.labels.retain(|labels| !partial(labels));
        names.iter().for_each(|name| self.unfit(name, NOT_ALL));
    }

    /// Notes that the array `name` of directions is none for all tetrahedra.
    fn leads_none(&mut self, name: &str) {
        let name = shown(name.as_bytes());
        let what = "it has not three finite numbers for each tetrahedron";
        self.left_out.push(format!("the array '{name}', which leads no fibres: {what}"));
    }

    /// Notes `why` the array `name` does not label the tetrahedra; measurements do not, and are not worth a word.
    fn unfit(&mut self, name: &str, why: &str) {
        let note = format!("the array '{}', which is no label: {why}", shown(name.as_bytes()));
        if is_called_label(name) && !self.left_out.contains(&note) {
            self.left_out.push(note);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice the areas of the triangles of a polygon in the plane, less than zero for those that are turned over.
    fn areas(corners: &[[Real; 2]]) -> Vec<Real> {
        let points: Vec<[Real; 3]> = corners.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
        let mut cells = Cells { points, ..Cells::default() };
        let all: Vec<u32> = (0..corners.len() as u32).collect();
        cells.polygon(&all).unwrap();
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| Vec3::from(cells.points[v as usize]));
            (b - a).cross(&(c - a)).z
        };
        cells.triangles.iter().map(area).collect()
    }

    #[test]
    fn a_polygon_that_is_not_convex_is_cut_into_triangles_within_it() {
        let l = [[0.0, 0.0], [60.0, 0.0], [60.0, 20.0], [20.0, 20.0], [20.0, 60.0], [0.0, 60.0]];
        let dart = [[0.0, 0.0], [40.0, 10.0], [0.0, 20.0], [10.0, 10.0]];
        let u = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [6.0, 9.0], [6.0, 3.0], [3.0, 3.0], [3.0, 9.0], [0.0, 9.0]];
        for (polygon, area) in [(&l[..], 2_000.0), (&dart[..], 300.0), (&u[..], 63.0)] {
            for first in 0..polygon.len() {
                let mut turned = polygon.to_vec();
                turned.rotate_left(first);
                let areas = areas(&turned);
                assert_eq!(areas.len(), polygon.len() - 2);
                assert!(areas.iter().all(|a| *a > 0.0), "{first}: {areas:?}");
                assert!((areas.iter().sum::<Real>() / 2.0 - area).abs() < 1e-9, "{first}: {areas:?}");
            }
        }
    }
}
