//! A row for each tick of each tool that somebody holds.

use crate::output::Output;
use crate::recording::Recording;
use palpate_client::{PoseSample, Wrench};
use palpate_core::contact::tool::ToolEvent;
use palpate_core::simulation::TICK;
use std::io;
use std::path::Path;

/// What a row says, in its order: the newest pose that the client sent (`handle`, empty before the first), then the wrench
/// after the tick, with the pose of the simulated tool.
const COLUMNS: &str = "time_s,tool,handle_x_m,handle_y_m,handle_z_m,handle_qx,handle_qy,handle_qz,handle_qw,buttons,handle_opening,\
    x_m,y_m,z_m,qx,qy,qz,qw,force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm,\
    physical_force_x_N,physical_force_y_N,physical_force_z_N,physical_torque_x_Nm,physical_torque_y_Nm,physical_torque_z_Nm,opening,grip_torque_Nm,\
    contact_points,phase,flags";

/// Writes the table of `recording` as CSV to `path`; how many rows it has.
///
/// # Errors
/// Those of the file system, and when a wrench is damaged.
pub fn write_table(recording: &Recording, path: &Path) -> io::Result<usize> {
    let mut out = csv::Writer::from_writer(Output::create(path)?);
    out.write_record(COLUMNS.split(','))?;
    let mut handles = vec![None::<PoseSample>; recording.scene.tool.len()];
    let mut rows = 0;
    for (tick, inputs) in &recording.inputs {
        for (handle, event) in handles.iter_mut().zip(&inputs.tools) {
            match event {
                Some(ToolEvent::Pose(sample)) => {
                    *handle = Some(PoseSample {
                        position: sample.pose.position.into(),
                        orientation: sample.pose.orientation,
                        linear_velocity: None,
                        buttons: sample.buttons,
                        opening: sample.opening,
                    });
                }
                Some(_) => *handle = None,
                None => {}
            }
        }
        for ((_, tool), message) in recording.wrenches.range((*tick, 0)..=(*tick, u32::MAX)) {
            let damaged = |what: String| io::Error::new(io::ErrorKind::InvalidData, format!("tick {tick}: {what}"));
            let wrench = Wrench::try_from(message).map_err(|e| damaged(e.to_string()))?;
            let named = recording.scene.tool.get(*tool as usize).zip(handles.get(*tool as usize));
            let (keys, handle) = named.ok_or_else(|| damaged(format!("there is no tool {tool}")))?;
            out.write_field(format!("{:.3}", *tick as f64 * TICK))?;
            out.write_field(&keys.name)?;
            match handle {
                Some(handle) => {
                    numbers(&mut out, &[&handle.position, &handle.orientation])?;
                    out.write_field(handle.buttons.to_string())?;
                    out.write_field(handle.opening.to_string())?;
                }
                None => (0..9).try_for_each(|_| out.write_field(""))?,
            }
            numbers(&mut out, &[&wrench.position, &wrench.orientation, &wrench.force, &wrench.torque])?;
            numbers(&mut out, &[&wrench.physical_force, &wrench.physical_torque])?;
            numbers(&mut out, &[&[wrench.opening, wrench.grip_torque]])?;
            out.write_field(wrench.contact_points.to_string())?;
            out.write_field(format!("{:?}", wrench.phase).to_lowercase())?;
            out.write_field(wrench.flags.to_string())?;
            out.write_record(None::<&[u8]>)?;
            rows += 1;
        }
    }
    out.into_inner().map_err(|e| e.into_error())?.finish()?;
    Ok(rows)
}

/// Adds fields to the row that is being written.
fn numbers(out: &mut csv::Writer<Output>, values: &[&[f64]]) -> csv::Result<()> {
    values.iter().copied().flatten().try_for_each(|x| out.write_field(x.to_string()))
}
