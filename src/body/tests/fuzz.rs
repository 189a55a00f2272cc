//! Files that someone else wrote: whatever their bytes, the answer is a shape or a body that holds together, or an error,
//! in memory proportional to the bytes there are.

use palpate_body::geometry::LabelledMesh;
use palpate_body::geometry::mesh_io::{LengthUnit, Solid};
use palpate_body::geometry::primitives::toy_surface;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::input::Input;
use palpate_body::prepare::{Recipe, Region, Shape, prepare};
use palpate_core::geometry::primitives::box_surface;
use palpate_core::geometry::{Surface, TetMesh};
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::{Body, Material};
use palpate_core::simulation::Snapshot;
use proptest::prelude::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::sync::LazyLock;
use xxhash_rust::xxh3::xxh3_64;

struct Peak;
thread_local! {
    static HELD: Cell<i64> = const { Cell::new(0) };
    static MOST: Cell<i64> = const { Cell::new(0) };
}

fn count(more: i64) {
    HELD.set(HELD.get() + more);
    MOST.set(MOST.get().max(HELD.get()));
}

// SAFETY: every call is passed on to the system's allocator; counting touches only this thread's cells, which need no
// allocation and no drop.
unsafe impl GlobalAlloc for Peak {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        // SAFETY: passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as i64));
        // SAFETY: passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Peak = Peak;

/// What `read` gives, having held no more than a hundred times `bytes` and a megabyte at once.
fn within_memory<T>(bytes: usize, read: impl FnOnce() -> T) -> T {
    let before = HELD.get();
    MOST.set(before);
    let result = read();
    let most = MOST.get() - before;
    assert!(most < 100 * bytes as i64 + (1 << 20), "{most} bytes held for a file of {bytes}");
    result
}

/// A small body with all that a body can have: two levels, springs, Maxwell branches.
static PREPARED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let recipe = Recipe {
        name: "toy".into(),
        shape: Shape::closed(toy_surface(0.006), vec![0.025, 0.016]),
        material: Material::from_young(5e3, 0.45, 1050.0),
        inclusions: vec![],
        holds: vec![Region {
            bounds: Bounds::new(Vec3::repeat(-1.0), Vec3::new(1.0, 1.0, 0.03)),
            stiffness: None,
            exact: false,
        }],
        damping_ratio: 0.15,
    };
    let body = prepare(&recipe, &mut |_, _, _| {}).unwrap();
    let scene = "name = \"toy\"\n[body]\nsource = \"prepared\"\n".into();
    BodyFile { provenance: Provenance { scene, ..Provenance::default() }, body }.bytes()
});

/// Where the body's own bytes begin in a prepared file: after them its checksum, then its parts.
fn start_of_body(bytes: &[u8]) -> usize {
    bytes.windows(11).position(|w| w == b"palpate-bdy").unwrap()
}

/// Both checksums put right, as someone would who means harm.
fn resealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let body = start_of_body(&PREPARED);
    let inner = xxh3_64(&bytes[body + 20..]);
    bytes[body + 12..body + 20].copy_from_slice(&inner.to_le_bytes());
    let length = bytes.len() as u64 - 28;
    bytes[12..20].copy_from_slice(&length.to_le_bytes());
    let outer = xxh3_64(&bytes[28..]);
    bytes[20..28].copy_from_slice(&outer.to_le_bytes());
    bytes
}

/// A body from a file can be put to work.
fn holds_together(body: &Body) {
    for level in 0..body.levels().len() {
        let start = Snapshot::at_rest(body, level, 1);
        palpate_core::model::ActiveMesh::new(body, &start.body, usize::MAX).unwrap();
    }
    assert_eq!(Body::from_bytes(body.bytes()).unwrap().checksum(), body.checksum());
}

/// Changes of bytes: where, as a part of the whole, and what is written there.
fn damage() -> impl Strategy<Value = Vec<(Real, Vec<u8>)>> {
    let piece = prop_oneof![
        any::<u8>().prop_map(|b| vec![b]),
        Just(vec![0xff; 8]),
        Just(vec![0xff, 0xff, 0xff, 0xff, 0x0f]),
        Just(vec![0; 8]),
        Just(f64::NAN.to_le_bytes().to_vec()),
        Just(1e300f64.to_le_bytes().to_vec()),
        Just(b"9223372036854775807 ".to_vec()),
        Just(b" -1 nan 1e999 ".to_vec()),
    ];
    prop::collection::vec((0.0..1.0f64, piece), 1..4)
}

fn damaged(bytes: &[u8], from: usize, damage: &[(Real, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for (place, piece) in damage {
        let at = from + (place * (bytes.len() - from) as Real) as usize;
        let end = (at + piece.len()).min(bytes.len());
        bytes[at..end].copy_from_slice(&piece[..end - at]);
    }
    bytes
}

/// Files of every kind that is read, each with its extension.
static FILES: LazyLock<Vec<(&str, Vec<u8>)>> = LazyLock::new(|| {
    let surface = box_surface(Vec3::repeat(0.1), [2; 3]);
    let mesh = palpate_core::geometry::primitives::box_mesh(Vec3::repeat(0.1), [2; 3]);
    vec![
        ("obj", obj(&surface)),
        ("stl", stl(&surface)),
        ("stl", text_stl(&surface)),
        ("ply", ply(&surface)),
        ("ply", binary_ply(&surface)),
        ("glb", glb(&surface)),
        ("vtk", vtk(&mesh)),
        ("vtk", binary_vtk(&mesh)),
        ("vtu", vtu(&mesh, false)),
        ("vtu", vtu(&mesh, true)),
        ("mesh", medit(&mesh)),
        ("msh", msh(&mesh)),
        ("node", tetgen(&mesh).0),
        ("ele", tetgen(&mesh).1),
    ]
});

fn obj(surface: &Surface) -> Vec<u8> {
    let mut text = String::new();
    surface.vertices.iter().for_each(|v| writeln!(text, "v {} {} {}", v.x, v.y, v.z).unwrap());
    surface.triangles.iter().for_each(|t| writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
    text.into()
}

fn stl(surface: &Surface) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((surface.triangles.len() as u32).to_le_bytes());
    for t in 0..surface.triangles.len() {
        let numbers = [Vec3::zeros()].into_iter().chain(surface.corners(t)).flat_map(|p| [p.x, p.y, p.z]);
        bytes.extend(numbers.flat_map(|x| (x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn text_stl(surface: &Surface) -> Vec<u8> {
    let mut text = "solid a\n".to_owned();
    for t in 0..surface.triangles.len() {
        text += "facet normal 0 0 0\nouter loop\n";
        surface.corners(t).iter().for_each(|v| writeln!(text, "vertex {} {} {}", v.x, v.y, v.z).unwrap());
        text += "endloop\nendfacet\n";
    }
    (text + "endsolid a\n").into()
}

fn ply_header(encoding: &str, surface: &Surface) -> String {
    format!(
        "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        surface.vertices.len(),
        surface.triangles.len()
    )
}

fn ply(surface: &Surface) -> Vec<u8> {
    let mut text = ply_header("ascii", surface);
    surface.vertices.iter().for_each(|v| writeln!(text, "{} {} {}", v.x, v.y, v.z).unwrap());
    surface.triangles.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
    text.into()
}

fn binary_ply(surface: &Surface) -> Vec<u8> {
    let mut bytes = ply_header("binary_little_endian", surface).into_bytes();
    bytes.extend(surface.vertices.iter().flatten().flat_map(|c| c.to_le_bytes()));
    for t in &surface.triangles {
        bytes.push(3);
        bytes.extend(t.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

fn glb(surface: &Surface) -> Vec<u8> {
    let (points, corners) = (surface.vertices.len(), 3 * surface.triangles.len());
    let mut json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
"meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
"accessors": [{{"bufferView": 0, "componentType": 5126, "count": {points}, "type": "VEC3"}},
{{"bufferView": 1, "componentType": 5125, "count": {corners}, "type": "SCALAR"}}],
"bufferViews": [{{"buffer": 0, "byteLength": {at}}}, {{"buffer": 0, "byteOffset": {at}, "byteLength": {}}}],
"buffers": [{{"byteLength": {}}}]}}"#,
        4 * corners,
        12 * points + 4 * corners,
        at = 12 * points
    );
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let positions = surface.vertices.iter().flatten().flat_map(|c| (*c as f32).to_le_bytes());
    let binary: Vec<u8> = positions.chain(surface.triangles.iter().flatten().flat_map(|v| v.to_le_bytes())).collect();
    let number = |n: usize| (n as u32).to_le_bytes();
    let parts: [&[u8]; 7] = [
        &[b"glTF".as_slice(), &number(2), &number(28 + json.len() + binary.len())].concat(),
        &number(json.len()),
        b"JSON",
        json.as_bytes(),
        &number(binary.len()),
        b"BIN\0",
        &binary,
    ];
    parts.concat()
}

fn vtk(mesh: &TetMesh) -> Vec<u8> {
    let mut text = "# vtk DataFile Version 3.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\n".to_owned();
    writeln!(text, "POINTS {} float", mesh.nodes.len()).unwrap();
    mesh.nodes.iter().for_each(|u| writeln!(text, "{} {} {}", u.x, u.y, u.z).unwrap());
    writeln!(text, "CELLS {} {}", mesh.elements.len(), 5 * mesh.elements.len()).unwrap();
    mesh.elements.iter().for_each(|[a, b, c, d]| writeln!(text, "4 {a} {b} {c} {d}").unwrap());
    writeln!(text, "CELL_TYPES {}", mesh.elements.len()).unwrap();
    mesh.elements.iter().for_each(|_| writeln!(text, "10").unwrap());
    text.into()
}

fn binary_vtk(mesh: &TetMesh) -> Vec<u8> {
    let mut bytes = b"# vtk DataFile Version 5.1\na\nBINARY\nDATASET UNSTRUCTURED_GRID\n".to_vec();
    let line = |bytes: &mut Vec<u8>, text: String| bytes.extend((text + "\n").bytes());
    line(&mut bytes, format!("POINTS {} double", mesh.nodes.len()));
    bytes.extend(mesh.nodes.iter().flatten().flat_map(|c| c.to_be_bytes()));
    line(&mut bytes, format!("\nCELLS {} {}\nOFFSETS vtktypeint64", mesh.elements.len() + 1, 4 * mesh.elements.len()));
    bytes.extend((0..=mesh.elements.len()).flat_map(|e| (4 * e as i64).to_be_bytes()));
    line(&mut bytes, "\nCONNECTIVITY vtktypeint64".into());
    bytes.extend(mesh.elements.iter().flatten().flat_map(|n| i64::from(*n).to_be_bytes()));
    line(&mut bytes, format!("\nCELL_TYPES {}", mesh.elements.len()));
    bytes.extend(mesh.elements.iter().flat_map(|_| 10i32.to_be_bytes()));
    bytes
}

/// With arrays in base64, compressed and behind the text, or as text.
fn vtu(mesh: &TetMesh, packed: bool) -> Vec<u8> {
    let mut appended = Vec::new();
    let mut array = |name: &str, numbers: Vec<Real>| {
        let tag = format!("<DataArray type=\"Float64\" Name=\"{name}\"");
        if !packed {
            let text: Vec<String> = numbers.iter().map(Real::to_string).collect();
            return format!("{tag} format=\"ascii\">{}</DataArray>\n", text.join(" "));
        }
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(&bytes).unwrap();
        let block = encoder.finish().unwrap();
        let offset = appended.len();
        appended.extend([1, bytes.len(), 0, block.len()].iter().flat_map(|n| (*n as u32).to_le_bytes()));
        appended.extend(block);
        format!("{tag} format=\"appended\" offset=\"{offset}\"/>\n")
    };
    let points = array("Points", mesh.nodes.iter().flatten().copied().collect());
    let connectivity = array("connectivity", mesh.elements.iter().flatten().map(|n| (*n).into()).collect());
    let offsets = array("offsets", (1..=mesh.elements.len()).map(|e| 4.0 * e as Real).collect());
    let types = array("types", vec![10.0; mesh.elements.len()]);
    let text = format!(
        "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"{}>\n<UnstructuredGrid>\n<Piece>\n<Points>{points}\
         </Points>\n<Cells>{connectivity}{offsets}{types}</Cells>\n</Piece>\n</UnstructuredGrid>\n",
        if packed { " compressor=\"vtkZLibDataCompressor\"" } else { "" }
    );
    match packed {
        false => (text + "</VTKFile>\n").into(),
        true => {
            [text.as_bytes(), b"<AppendedData encoding=\"raw\">_", &appended, b"</AppendedData></VTKFile>"].concat()
        }
    }
}

fn medit(mesh: &TetMesh) -> Vec<u8> {
    let mut text = format!("MeshVersionFormatted 2\nDimension 3\nVertices {}\n", mesh.nodes.len());
    mesh.nodes.iter().for_each(|u| writeln!(text, "{} {} {} 0", u.x, u.y, u.z).unwrap());
    writeln!(text, "Edges 1\n1 2 0\nTetrahedra {}", mesh.elements.len()).unwrap();
    for e in &mesh.elements {
        let [a, b, c, d] = e.map(|n| n + 1);
        writeln!(text, "{a} {b} {c} {d} 7").unwrap();
    }
    (text + "End\n").into()
}

fn tetgen(mesh: &TetMesh) -> (Vec<u8>, Vec<u8>) {
    let mut node = format!("{} 3 1 0 # nodes\n", mesh.nodes.len());
    mesh.nodes.iter().enumerate().for_each(|(i, u)| writeln!(node, "{i} {} {} {} 0", u.x, u.y, u.z).unwrap());
    let mut ele = format!("{} 4 0\n", mesh.elements.len());
    mesh.elements.iter().enumerate().for_each(|(i, [a, b, c, d])| writeln!(ele, "{i} {a} {b} {c} {d}").unwrap());
    (node.into(), ele.into())
}

fn msh(mesh: &TetMesh) -> Vec<u8> {
    let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", mesh.nodes.len());
    mesh.nodes.iter().enumerate().for_each(|(i, u)| writeln!(text, "{} {} {} {}", i + 1, u.x, u.y, u.z).unwrap());
    writeln!(text, "$EndNodes\n$Elements\n{}", mesh.elements.len()).unwrap();
    for (i, e) in mesh.elements.iter().enumerate() {
        let [a, b, c, d] = e.map(|n| n + 1);
        writeln!(text, "{} 4 2 0 1 {a} {b} {c} {d}", i + 1).unwrap();
    }
    (text + "$EndElements\n").into()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_prepared_file_of_which_any_byte_changed_is_refused(at in 0.0..1.0f64, to in 1..=255u8) {
        let mut bytes = PREPARED.clone();
        let at = (at * bytes.len() as Real) as usize;
        bytes[at] ^= to;
        prop_assert!(within_memory(bytes.len(), || BodyFile::from_bytes(&bytes).is_err()));
    }

    #[test]
    fn a_prepared_file_cut_anywhere_is_refused(part in 0.0..1.0f64) {
        let bytes = &PREPARED[..(part * PREPARED.len() as Real) as usize];
        prop_assert!(within_memory(bytes.len(), || BodyFile::from_bytes(bytes).is_err()));
        let mut sealed = bytes.to_vec();
        if sealed.len() > start_of_body(&PREPARED) + 20 {
            sealed = resealed(sealed);
            prop_assert!(within_memory(sealed.len(), || BodyFile::from_bytes(&sealed).is_err()));
        }
    }

    #[test]
    fn a_forged_prepared_file_is_refused_or_a_body_that_holds_together(damage in damage()) {
        let bytes = resealed(damaged(&PREPARED, start_of_body(&PREPARED) + 20, &damage));
        if let Ok(file) = within_memory(bytes.len(), || BodyFile::from_bytes(&bytes)) {
            holds_together(&file.body);
        }
    }

    #[test]
    fn a_damaged_mesh_under_any_name_is_refused_or_a_shape_that_holds_together(
        file in 0..FILES.len(),
        name in prop::sample::select(vec!["obj", "stl", "ply", "glb", "gltf", "vtk", "vtu", "vtp", "mesh", "msh", "node", "palpate", ""]),
        own_name in any::<bool>(),
        cut in prop::option::of(0.0..1.0f64),
        damage in damage(),
        holes in prop::sample::select(vec![0.0, 0.2]),
    ) {
        let (own, bytes) = &FILES[file];
        let mut bytes = damaged(bytes, 0, &damage);
        bytes.truncate((cut.unwrap_or(1.0) * bytes.len() as Real) as usize);
        let name = format!("a.{}", if own_name { *own } else { name });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(&name);
        std::fs::write(&path, &bytes).unwrap();
        // Of TetGen's two files the other one is as it should be.
        for (kind, other) in [("ele", "node"), ("node", "ele")] {
            if name.ends_with(kind) {
                let (_, bytes) = FILES.iter().find(|(own, _)| *own == other).unwrap();
                std::fs::write(path.with_extension(other), bytes).unwrap();
            }
        }
        match within_memory(bytes.len() + 10_000, || Input::read(Path::new(&path), LengthUnit::Metre, 1.0, holes, None)) {
            Err(e) => prop_assert!(!e.to_string().is_empty()),
            Ok(Input { solid: Solid::Surface(surface), .. }) => prop_assert!(surface.volume() > 0.0),
            Ok(Input { solid: Solid::Volume(LabelledMesh { mesh, .. }), .. }) => {
                prop_assert!((0..mesh.elements.len()).all(|e| mesh.volume(e) > 0.0));
            }
        }
    }
}
