//! The surface as a series of VTK files (VTU, text), and the one that lists them with their times (PVD): ParaView opens that.

use super::{moments, surface};
use crate::output::{self, Output};
use crate::recording::Recording;
use palpate_client::{Moment, Surface};
use palpate_core::simulation::TICK;
use std::fmt::Display;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Names of the files of a series.
pub struct Series {
    /// Ticks of the frames that are written.
    ticks: Vec<u64>,
}

/// The file that lists the others.
const LIST: &str = "surface.pvd";

impl Series {
    /// Every `every`-th frame of `recording`.
    pub fn of(recording: &Recording, every: usize) -> Self {
        Self { ticks: recording.frames.keys().copied().step_by(every.max(1)).collect() }
    }

    /// All of its files in `folder`; the list is the first.
    pub fn files(&self, folder: &Path) -> Vec<PathBuf> {
        std::iter::once(LIST.to_owned())
            .chain(self.ticks.iter().map(|tick| name(*tick)))
            .map(|n| folder.join(n))
            .collect()
    }
}

fn name(tick: u64) -> String {
    format!("surface_{tick:09}.vtu")
}

/// Writes `series` of `recording` into `folder`, the list at last; how many frames it has.
///
/// # Errors
/// Those of the file system, and when a frame is damaged.
pub fn write_series(recording: &Recording, series: &Series, folder: &Path) -> io::Result<usize> {
    let damaged = |e: palpate_client::ClientError| io::Error::new(io::ErrorKind::InvalidData, e.to_string());
    let surface = surface(recording).map_err(damaged)?;
    let mut list =
        String::from("<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n<Collection>\n");
    let mut written = 0;
    for moment in moments(recording, surface.clone()) {
        let moment = moment.map_err(damaged)?;
        // Both ascend.
        if series.ticks.binary_search(&moment.tick).is_err() {
            continue;
        }
        let file = name(moment.tick);
        let mut out = Output::create(&folder.join(&file))?;
        write_frame(&mut out, &surface, &moment)?;
        out.finish()?;
        list += &format!("<DataSet timestep=\"{:.3}\" file=\"{file}\"/>\n", moment.tick as f64 * TICK);
        written += 1;
    }
    list += "</Collection>\n</VTKFile>\n";
    output::write(&folder.join(LIST), list.as_bytes())?;
    Ok(written)
}

/// A cell of three corners in VTK.
const VTK_TRIANGLE: u8 = 5;

fn write_frame(out: &mut impl Write, surface: &Surface, moment: &Moment) -> io::Result<()> {
    let (vertices, triangles) = (moment.positions.len(), surface.triangles.len());
    let moved = moment.positions.iter().zip(&surface.rest_positions).map(|(x, rest)| [0, 1, 2].map(|i| x[i] - rest[i]));
    writeln!(
        out,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\">\n\
         <UnstructuredGrid>\n<FieldData>\n<DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" \
         format=\"ascii\">{}</DataArray>\n</FieldData>\n\
         <Piece NumberOfPoints=\"{vertices}\" NumberOfCells=\"{triangles}\">\n<Points>",
        moment.tick as f64 * TICK
    )?;
    array(out, "Float32", "position_m", 3, moment.positions.as_flattened())?;
    writeln!(out, "</Points>\n<PointData>")?;
    array(out, "Float32", "displacement_m", 3, moved.collect::<Vec<_>>().as_flattened())?;
    if !moment.levels.is_empty() {
        array(out, "UInt8", "level", 1, &moment.levels)?;
    }
    writeln!(out, "</PointData>\n<Cells>")?;
    array(out, "Int32", "connectivity", 1, surface.triangles.as_flattened())?;
    array(out, "Int32", "offsets", 1, &(1..=triangles).map(|t| 3 * t).collect::<Vec<_>>())?;
    array(out, "UInt8", "types", 1, &vec![VTK_TRIANGLE; triangles])?;
    writeln!(out, "</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

fn array<T: Display>(out: &mut impl Write, kind: &str, name: &str, components: usize, values: &[T]) -> io::Result<()> {
    let head =
        format!("<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\">");
    writeln!(out, "{head}")?;
    for row in values.chunks(components * 8) {
        row.iter().try_for_each(|value| write!(out, "{value} "))?;
        writeln!(out)?;
    }
    writeln!(out, "</DataArray>")
}
