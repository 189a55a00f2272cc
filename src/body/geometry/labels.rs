//! Labels of tetrahedra: which region of a body each belongs to, as volume files say.

use super::mesh_error::MeshError;
use palpate_core::geometry::tet_mesh::TetMesh;
use palpate_core::math::{Real, Vec3};
use std::collections::BTreeMap;

/// Most labels that are told apart: an array of more numbers the cells or measures something.
const MOST_LABELS: usize = 256;

/// What arrays of labels are called, the likeliest first: one whose name contains the word is taken.
const NAMES: [&str; 14] = [
    "physical",
    "material",
    "region",
    "label",
    "domain",
    "tissue",
    "segment",
    "section",
    "elset",
    "part",
    "attribute",
    "reference",
    "medit",
    "entity",
];

/// True for an array that is called as labels are.
pub(super) fn is_called_label(name: &str) -> bool {
    NAMES.iter().any(|word| name.to_lowercase().contains(word))
}

/// True for an array that is called as directions of fibres are.
pub(super) fn is_called_fibre(name: &str) -> bool {
    let name = name.to_lowercase();
    ["fibre", "fiber"].iter().any(|word| name.contains(word))
}

/// One whole number for each tetrahedron of a mesh, under a name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labels {
    /// What the file calls them.
    pub name: String,
    /// (n_elements); empty where there are none.
    pub of: Vec<i64>,
}

/// A mesh with its labels and the directions of its fibres, of which there may be none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabelledMesh {
    /// The tetrahedra.
    pub mesh: TetMesh,
    /// Their labels.
    pub labels: Labels,
    /// Unit direction of the fibres in each of them, zero where there are none; (n_elements), or empty.
    pub directions: Vec<Vec3>,
}

impl From<TetMesh> for LabelledMesh {
    fn from(mesh: TetMesh) -> Self {
        Self { mesh, ..Self::default() }
    }
}

impl LabelledMesh {
    /// Each label and the volume of its tetrahedra [m³].
    pub fn volumes(&self) -> BTreeMap<i64, Real> {
        let mut volumes = BTreeMap::new();
        self.labels
            .of
            .iter()
            .enumerate()
            .for_each(|(e, label)| *volumes.entry(*label).or_default() += self.mesh.volume(e));
        volumes
    }
}

impl Labels {
    /// The labels called `name`, a number for each tetrahedron.
    ///
    /// # Errors
    /// In words, when one is no whole number or too many differ.
    pub(super) fn from_numbers(name: &str, numbers: impl Iterator<Item = Real>) -> Result<Self, &'static str> {
        let whole = |x: Real| (x.fract() == 0.0 && x.abs() < 1e15).then_some(x as i64);
        let of = numbers.map(whole).collect::<Option<Vec<i64>>>().ok_or("not all its numbers are whole")?;
        let mut different = of.clone();
        different.sort_unstable();
        different.dedup();
        if different.len() > MOST_LABELS {
            return Err("more than 256 of its numbers differ");
        }
        Ok(Self { name: name.to_owned(), of })
    }

    /// Those of `all` that are called `wanted`; without a wish, those that are called as labels are, or the only ones.
    ///
    /// # Errors
    /// When none is called so.
    pub(super) fn choose(all: Vec<Labels>, wanted: Option<&str>) -> Result<Labels, MeshError> {
        if let Some(wanted) = wanted {
            let has = all.iter().map(|labels| labels.name.clone()).collect();
            let found = all.into_iter().find(|labels| labels.name == wanted);
            return found.ok_or(MeshError::NoLabels { wanted: wanted.to_owned(), has });
        }
        let called = |word: &&str| all.iter().position(|labels| labels.name.to_lowercase().contains(*word));
        let only = (all.len() == 1).then_some(0);
        Ok(NAMES.iter().find_map(called).or(only).map(|i| all[i].clone()).unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_found_by_their_name_or_because_there_are_no_others() {
        let named = |name: &str| Labels { name: name.into(), of: vec![1] };
        let chosen = |names: &[&str], wanted| {
            Labels::choose(names.iter().map(|name| named(name)).collect(), wanted).map(|labels| labels.name)
        };
        assert_eq!(chosen(&["strength", "MaterialIds"], None).unwrap(), "MaterialIds");
        assert_eq!(chosen(&["id"], None).unwrap(), "id");
        assert_eq!(chosen(&["id", "order"], None).unwrap(), "");
        assert_eq!(chosen(&["material", "order"], Some("order")).unwrap(), "order");
        let e = chosen(&["material", "order"], Some("organ")).unwrap_err().to_string();
        assert!(e.contains("'organ'") && e.contains("material, order"), "{e}");
        assert!(chosen(&[], Some("organ")).unwrap_err().to_string().contains("none"));
    }

    #[test]
    fn measurements_and_numbers_of_cells_are_no_labels() {
        assert_eq!(Labels::from_numbers("a", [1.0, -3.0].into_iter()).unwrap().of, [1, -3]);
        assert_eq!(Labels::from_numbers("a", [1.0, 0.5].into_iter()), Err("not all its numbers are whole"));
        assert!(Labels::from_numbers("a", [1.0, Real::NAN].into_iter()).is_err());
        assert!(Labels::from_numbers("a", (0..1000).map(Real::from)).unwrap_err().contains("256"));
    }
}
