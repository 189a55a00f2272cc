//! Poses from Python: anything that numpy makes an array of.

use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use palpate_core::contact::jaws::Stance;
use palpate_core::math::{Pose, Vec3, normalized_quaternion};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::bad_value;

/// Poses from rows of x, y, z [m], or of x, y, z and a quaternion x, y, z, w of any length but 0, or of these and how far the jaws are
/// open. One row may be the whole.
pub fn poses(given: &Bound<'_, PyAny>) -> PyResult<Vec<Stance>> {
    let array = given.py().import("numpy")?.call_method1("ascontiguousarray", (given, "float64"))?;
    let array = array.cast::<PyArrayDyn<f64>>()?.readonly();
    let shape = array.shape();
    let columns = match shape {
        [columns] | [_, columns] if [3, 7, 8].contains(columns) => *columns,
        _ => {
            let shape = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
            return Err(bad_value(format!(
                "poses of shape ({shape}): give rows of x, y, z, or of x, y, z, qx, qy, qz, qw, or of these and the opening of jaws"
            )));
        }
    };
    array.as_slice()?.chunks(columns).enumerate().map(|(row, numbers)| pose(row, numbers)).collect()
}

fn pose(row: usize, numbers: &[f64]) -> PyResult<Stance> {
    if !numbers.iter().all(|number| number.is_finite()) {
        return Err(bad_value(format!("pose {row} is not finite")));
    }
    let position = Vec3::from_column_slice(&numbers[..3]);
    let Some(quaternion) = numbers[3..].first_chunk::<4>() else {
        return Ok(Stance::at(Pose { position, ..Pose::default() }));
    };
    let orientation = normalized_quaternion(*quaternion)
        .ok_or_else(|| bad_value(format!("pose {row} has a quaternion of length 0")))?;
    let opening = numbers.get(7).copied().unwrap_or(0.0);
    if !(0.0..=1.0).contains(&opening) {
        return Err(bad_value(format!("pose {row} has jaws that are open by {opening}: 0, closed, to 1")));
    }
    Ok(Stance { pose: Pose { position, orientation }, opening })
}

/// The only pose in `given`.
pub fn one_pose(given: &Bound<'_, PyAny>) -> PyResult<Stance> {
    match poses(given)?[..] {
        [pose] => Ok(pose),
        ref several => Err(bad_value(format!("{} poses: one is expected", several.len()))),
    }
}

/// Names with their values, of which one alone need not be in a list.
pub fn named_values(given: &Bound<'_, PyDict>) -> PyResult<Vec<(String, Vec<f64>)>> {
    let values = |value: Bound<'_, PyAny>| value.extract::<f64>().map(|one| vec![one]).or_else(|_| value.extract());
    given.iter().map(|(name, value)| Ok((name.extract()?, values(value)?))).collect()
}
