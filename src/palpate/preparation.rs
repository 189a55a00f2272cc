//! From mesh files to a body in a file: what `palpate prepare` and Python's `prepare` do.

use crate::scene::LoadedScene;
use crate::scene::prepared::body_keys;
use crate::writable;
use anyhow::{Context, bail};
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_body::prepare::bodies::one_body;
use palpate_body::prepare::body_check::check;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::input::{Fineness, Input, shape};
use palpate_body::prepare::region::{Reach, keep_finest_within};
use palpate_body::prepare::{self, Shape, prepare};
use palpate_core::math::{Bounds, Real, Vec3};
use std::path::{Path, PathBuf};

/// What a body is to be made of, and how.
pub struct Preparation {
    /// A closed surface, or tetrahedral meshes, coarse to fine.
    pub inputs: Vec<PathBuf>,
    /// Unit of length of the files.
    pub unit: LengthUnit,
    /// Further factor on their coordinates.
    pub scale: Real,
    /// How fine the levels are to be.
    pub fineness: Fineness,
    /// Where the finest level is to be, in the files' own coordinates: nothing, a box (6) or a ball (4).
    pub finest_in: Vec<f64>,
    /// The array of labels that regions of the material go by.
    pub labels: Option<String>,
    /// About how many vertices viewers get.
    pub display_vertices: usize,
    /// Scene whose material and holds the body is prepared for.
    pub scene: PathBuf,
    /// Keys of it that are others, as in `material.youngs_modulus=8000`.
    pub set: Vec<String>,
    /// Holes of a surface are closed up to this width [m].
    pub fill_holes: Real,
    /// Of several bodies in a file the largest is taken.
    pub largest: bool,
    /// A surface may cross itself.
    pub allow_crossings: bool,
    /// A body may have any size.
    pub any_size: bool,
}

/// A body that is made.
pub struct Prepared {
    /// The body and where it comes from.
    pub file: BodyFile,
    /// What it was made of, in metres.
    pub shape: Shape,
    /// What a report is to say of the inputs, a line each.
    pub said: Vec<String>,
}

impl Preparation {
    /// As the command line has it where no option is given.
    pub fn of(inputs: Vec<PathBuf>, unit: LengthUnit) -> Self {
        Self {
            inputs,
            unit,
            scale: 1.0,
            fineness: Fineness::Automatic,
            finest_in: Vec::new(),
            labels: None,
            display_vertices: prepare::DISPLAY_VERTICES,
            scene: "organ".into(),
            set: Vec::new(),
            fill_holes: 0.0,
            largest: false,
            allow_crossings: false,
            any_size: false,
        }
    }

    /// Makes the body; `progress` is told what is under way, and how much of it is done.
    ///
    /// # Errors
    /// An option makes no sense, an input is no body, or one of `outputs`, each with the option that names it, cannot be
    /// written or is a file that is read: by whatever name, and also where an input brings files along that were not named.
    pub fn run(
        &self,
        outputs: &[(&str, &Path)],
        progress: &mut dyn FnMut(&str, usize, usize),
    ) -> anyhow::Result<Prepared> {
        if !(1e-6..=1e6).contains(&self.scale) || !(50..=20_000).contains(&self.display_vertices) {
            bail!("--scale is from 1e-6 to 1e6, --display-vertices from 50 to 20000");
        }
        self.check_levels()?;
        let reach = self.reach()?;
        let Some(first) = self.inputs.first() else { bail!("no input: give a mesh file or several") };
        let writable_beside = |inputs: &[PathBuf]| {
            let inputs = || inputs.iter().map(PathBuf::as_path);
            outputs.iter().try_for_each(|(option, path)| writable::file(option, path, inputs()))
        };
        writable_beside(&self.inputs)?;
        writable_beside(std::slice::from_ref(&self.scene))?;
        let mut loaded = LoadedScene::load(&self.scene, &self.set)?;
        writable_beside(&loaded.files())?;
        let (mut files, mut solids, mut said) = (Vec::new(), Vec::new(), Vec::new());
        for (i, path) in self.inputs.iter().enumerate() {
            progress(&format!("reading {}", path.display()), i, self.inputs.len());
            let about = || path.display().to_string();
            let input = Input::read(path, self.unit, self.scale, self.fill_holes, self.labels.as_deref());
            let input = input.with_context(about)?;
            let folder = path.parent().unwrap_or(Path::new(""));
            writable_beside(&input.files.iter().map(|file| folder.join(&file.name)).collect::<Vec<_>>())?;
            let (name, lines) = (input.files[0].name.clone(), input.said());
            let element = self.fineness.finest_element(&input.solid);
            let (solid, dropped) = one_body(input.solid, element, self.largest).with_context(about)?;
            said.extend(lines.into_iter().chain(dropped).map(|line| format!("{name}: {line}")));
            files.extend(input.files);
            solids.push(solid);
        }
        progress("checking shapes", 1, 1);
        check(&solids, self.unit, self.scale, self.any_size, self.allow_crossings)?;
        let shape = shape(solids, &self.fineness, self.display_vertices).map_err(anyhow::Error::msg)?;
        loaded.scene.name = first.file_stem().unwrap_or_default().to_string_lossy().chars().take(64).collect();
        loaded.scene.body = body_keys();
        // The file is that of one body.
        loaded.scene.organ.clear();
        let recipe = loaded.recipe(shape);
        let mut body = prepare(&recipe, progress)?;
        if let Some(reach) = reach {
            progress("keeping the finest level in its region", 1, 1);
            body = keep_finest_within(body, &reach)?;
        }
        let provenance = Provenance {
            palpate: env!("CARGO_PKG_VERSION").into(),
            inputs: files,
            options: self.options(),
            scene: loaded.scene.to_toml(),
        };
        Ok(Prepared { file: BodyFile { provenance, body }, shape: recipe.shape, said })
    }

    fn check_levels(&self) -> anyhow::Result<()> {
        let Fineness::Levels(levels) = &self.fineness else { return Ok(()) };
        if levels.windows(2).any(|pair| pair[1] > 0.8 * pair[0]) || levels.len() > 8 {
            bail!("--levels: at most 8, coarse to fine, each at most 0.8 of the one before it");
        }
        Ok(())
    }

    /// Where the finest level is to be [m].
    fn reach(&self) -> anyhow::Result<Option<Reach>> {
        let numbers: Vec<f64> = self.finest_in.iter().map(|x| x * self.unit.metres() * self.scale).collect();
        let point = |at: usize| Vec3::from_row_slice(&numbers[at..at + 3]);
        Ok(match numbers.len() {
            0 => None,
            4 => Some(Reach::Ball(point(0), numbers[3])),
            6 => Some(Reach::Box(Bounds::of([point(0), point(3)]))),
            n => bail!("--finest-in: {n} numbers; a box has 6 (x0,y0,z0,x1,y1,z1), a ball 4 (x,y,z,radius)"),
        })
    }

    /// What decides the body beside files and scene, as on the command line.
    fn options(&self) -> String {
        // To a nanometre, so that 0.0033 m is 3.3 mm again.
        let length = |metres: &Real| format!("{}mm", (1e6 * metres).round() / 1e3);
        let mut options = format!("--unit {} --display-vertices {}", self.unit, self.display_vertices);
        if self.scale != 1.0 {
            options += &format!(" --scale {}", self.scale);
        }
        match &self.fineness {
            Fineness::Automatic => {}
            Fineness::Finest(finest) => options += &format!(" --finest {}", length(finest)),
            Fineness::Levels(levels) => {
                let levels: Vec<String> = levels.iter().map(length).collect();
                options += &format!(" --levels {}", levels.join(","));
            }
        }
        if let Some(name) = &self.labels {
            options += &format!(" --labels {name}");
        }
        if self.largest {
            options += " --largest";
        }
        if self.fill_holes > 0.0 {
            options += &format!(" --fill-holes {}", length(&self.fill_holes));
        }
        if !self.finest_in.is_empty() {
            let numbers: Vec<String> = self.finest_in.iter().map(f64::to_string).collect();
            options += &format!(" --finest-in {}", numbers.join(","));
        }
        options
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_options_are_those_of_the_command_line() {
        let mut preparation = Preparation::of(vec!["liver.stl".into()], "mm".parse().unwrap());
        assert_eq!(
            preparation.options(),
            "--unit mm --display-vertices 2000".replace("2000", &prepare::DISPLAY_VERTICES.to_string())
        );
        preparation.fineness = Fineness::Levels(vec![0.022, 0.0033]);
        preparation.fill_holes = 0.0254;
        preparation.finest_in = vec![1.0, 2.0, 3.0, 4.5];
        let options = preparation.options();
        assert!(options.ends_with(" --levels 22mm,3.3mm --fill-holes 25.4mm --finest-in 1,2,3,4.5"), "{options}");
    }
}
