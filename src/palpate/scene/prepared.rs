//! Scenes of prepared bodies: what they leave out of material and holds is as the body was prepared.

use super::body_keys::{BodyKeys, MaterialKeys, Source};
use super::keys::Scene;
use super::organ_keys::TissueKeys;
use super::{LoadedScene, SceneError, elastic_keys, parse};
use palpate_body::prepare::body_file::{BodyFile, BodyFileError, Provenance};
use palpate_body::prepare::{self, Region};
use palpate_core::model::Body;
use std::path::Path;

/// Keys of a body as it was prepared: none but its source.
pub fn body_keys() -> BodyKeys {
    // One key, which a test parses.
    toml::from_str("source = \"prepared\"").unwrap_or_else(|e| unreachable!("{e}"))
}

fn failed(origin: &str, path: &Path) -> impl Fn(BodyFileError) -> SceneError {
    move |source| SceneError::Prepared { origin: origin.to_owned(), path: path.to_owned(), source: Box::new(source) }
}

/// The text of the scene that the body in the file at `path` was prepared for, with that body.
pub(super) fn scene_of(path: &Path) -> Result<String, SceneError> {
    let origin = path.display().to_string();
    let provenance = Provenance::read(path).map_err(failed(&origin, path))?;
    let mut scene = parse(&provenance.scene, &format!("{origin}, the scene it was prepared for"))?;
    scene.body = BodyKeys { file: path.file_name().map(Into::into), ..body_keys() };
    Ok(scene.to_toml())
}

/// `text`, which is that of `scene`, with the keys of material and the holds that it leaves out of prepared bodies; `None`
/// where nothing is prepared.
pub(super) fn completed(text: &str, scene: &Scene, origin: &str, folder: &Path) -> Result<Option<String>, SceneError> {
    let is_prepared = |body: &BodyKeys| body.source == Source::Prepared;
    if !is_prepared(&scene.body) && !scene.organ.iter().any(|organ| is_prepared(&organ.body)) {
        return Ok(None);
    }
    let mut table = toml::from_str::<toml::Table>(text)
        .map_err(|e| SceneError::Syntax { origin: origin.to_owned(), message: e.to_string() })?;
    if is_prepared(&scene.body) {
        complete(&mut table, &scene.body, |_| true, origin, folder)?;
    }
    let organs = table.get_mut("organ").and_then(toml::Value::as_array_mut).into_iter().flatten();
    for (table, organ) in organs.zip(&scene.organ).filter(|(_, organ)| is_prepared(&organ.body)) {
        let origin = format!("{origin}: organ \"{}\"", organ.name);
        if let toml::Value::Table(table) = table {
            complete(table, &organ.body, |key| TissueKeys::KEYS.contains(&key), &origin, folder)?;
        }
    }
    Ok(Some(table.to_string()))
}

/// Puts into `table`, in which `keys` are those of a prepared body, what it leaves out: of the material what `takes` names.
fn complete(
    table: &mut toml::Table,
    keys: &BodyKeys,
    takes: impl Fn(&str) -> bool,
    origin: &str,
    folder: &Path,
) -> Result<(), SceneError> {
    let BodyKeys { file, active_level, display, display_unit, .. } = keys.clone();
    let kept = BodyKeys { file, active_level, display, display_unit, ..body_keys() };
    if *keys != kept {
        let fault = "body: a prepared body is as it was prepared: leave out all keys but source, file, \
                     active_level, display and display_unit";
        return Err(SceneError::Values(vec![format!("{origin}: {fault}")]));
    }
    let file = keys.file.as_ref().ok_or_else(|| SceneError::Missing {
        origin: origin.to_owned(),
        source_name: "prepared",
        needs: "body.file, a file that `palpate prepare` has made",
    })?;
    let path = folder.join(file);
    let provenance = Provenance::read(&path).map_err(failed(origin, &path))?;
    let mut prepared = toml::from_str::<toml::Table>(&provenance.scene)
        .map_err(|e| SceneError::Syntax { origin: origin.to_owned(), message: e.to_string() })?;
    if let Some(toml::Value::Table(material)) = prepared.get_mut("material") {
        material.retain(|key, _| takes(key));
        if let Some(toml::Value::Table(given)) = table.remove("material") {
            elastic_keys::as_given(material, &given);
            material.extend(given);
        }
    }
    for key in ["material", "hold"] {
        if !table.contains_key(key)
            && let Some(value) = prepared.remove(key)
        {
            table.insert(key.into(), value);
        }
    }
    Ok(())
}

impl LoadedScene {
    /// The prepared body, of the scene's material and held as the scene says.
    pub(super) fn prepared_body(&self, progress: &mut dyn FnMut(&str, usize, usize)) -> Result<Body, SceneError> {
        let path = self.folder.join(self.scene.body.file.as_deref().unwrap_or(Path::new("")));
        let file = BodyFile::read(&path).map_err(failed(&self.origin, &path))?;
        let bounds = prepare::bounds(&file.body);
        let holds: Vec<Region> = self.scene.hold.iter().map(|h| h.region(bounds)).collect();
        let (scene, material, inclusions) = (&self.scene, self.scene.material(), self.scene.inclusions());
        let MaterialKeys { elements, damping_ratio, .. } = scene.material;
        prepare::refit(file.body, &scene.name, material, &inclusions, &holds, elements, damping_ratio, progress)
            .map_err(|source| SceneError::Prepare { origin: self.origin.clone(), source: Box::new(source) })
    }
}
