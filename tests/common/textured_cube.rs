//! The clamped cube with a surface of its own to look at: files made here.

use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::Vec3;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// How far the surface to look at stands off the touched one [m].
pub const STANDS_OFF: f64 = 0.5e-3;

/// Writes a scene of the weightless clamped cube of 0.1 m into `folder`, shown by `cells`² squares a side, in millimetres: its
/// top has a picture, green on the left and yellow on the right, the rest is white. Gives the path of the scene.
pub fn textured_cube(folder: &Path, cells: u32) -> PathBuf {
    let edge = 100.0;
    let surface = box_surface(Vec3::repeat(edge), [cells; 3]);
    let mut obj = String::from("mtllib cube.mtl\n");
    let middle = Vec3::repeat(0.5 * edge);
    for v in &surface.vertices {
        let shown = middle + (v - middle) * (1.0 + 2e3 * STANDS_OFF / edge);
        let out = (v - middle).normalize();
        writeln!(obj, "v {} {} {}\nvt {} {}", shown.x, shown.y, shown.z, v.x / edge, v.y / edge).unwrap();
        writeln!(obj, "vn {} {} {}", out.x, out.y, out.z).unwrap();
    }
    let is_top = |t: &&[u32; 3]| t.iter().all(|v| surface.vertices[*v as usize].z == edge);
    for (material, top) in [("top", true), ("sides", false)] {
        writeln!(obj, "usemtl {material}").unwrap();
        for t in surface.triangles.iter().filter(|t| is_top(t) == top) {
            let [a, b, c] = t.map(|v| v + 1);
            writeln!(obj, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}").unwrap();
        }
    }
    std::fs::write(folder.join("cube.obj"), obj).unwrap();
    std::fs::write(folder.join("cube.mtl"), "newmtl top\nmap_Kd top.png\nnewmtl sides\nKd 1 1 1\n").unwrap();
    let mut encoder = png::Encoder::new(std::fs::File::create(folder.join("top.png")).unwrap(), 2, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&[20, 220, 20, 240, 220, 20]).unwrap();
    let scene = folder.join("cube.toml");
    let cube = include_str!("../../config/scenes/cube.toml");
    let shown = "[body]\ndisplay = \"cube.obj\"\ndisplay_unit = \"mm\"";
    let text = cube.replace("[body]", shown) + "\n[world]\ngravity = [0.0, 0.0, 0.0]\n";
    std::fs::write(&scene, text).unwrap();
    scene
}
