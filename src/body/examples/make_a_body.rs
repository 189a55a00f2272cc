//! Makes a soft body from a closed surface and saves it, for a scene with `source = "prepared"`:
//! `cargo run -p palpate-body --example make_a_body`.

use palpate_body::geometry::primitives::sphere_surface;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::{Recipe, Shape, prepare};
use palpate_core::model::Material;
use std::error::Error;
use std::path::Path;

/// Saves a ball of 10 cm and half a kilogram into `file`.
pub fn make_a_body(file: &Path) -> Result<(), Box<dyn Error>> {
    let recipe = Recipe {
        name: "ball".into(),
        // In place of the sphere: geometry::mesh_io::read_surface("organ.stl".as_ref(), LengthUnit::Millimetre)?
        shape: Shape::closed(sphere_surface(0.05, 0.01), vec![0.03, 0.018]),
        material: Material::from_young(1e4, 0.35, 1000.0),
        inclusions: vec![],
        holds: vec![],
        elements: Default::default(),
        damping_ratio: 0.1,
    };
    let body = prepare(&recipe, &mut |what, step, of| println!("{what} ({step} of {of})"))?;
    let nodes: Vec<usize> = body.levels().iter().map(|level| level.mesh.nodes.len()).collect();
    println!("{:.2} kg, levels of {nodes:?} nodes: {}", body.mass(), file.display());
    std::fs::write(file, BodyFile { provenance: Provenance::default(), body }.bytes())?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    make_a_body("ball.palpate".as_ref())
}
