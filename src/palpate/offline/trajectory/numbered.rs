//! Parameters by names that need no scene: tissues and tools by number.

use palpate_core::math::Real;
use palpate_core::simulation::{Parameter, Threshold};

/// The name of a quantity by number.
pub(super) fn numbered_name(parameter: &Parameter) -> String {
    match parameter {
        Parameter::Gravity(_) => "gravity".into(),
        Parameter::Damping(_) => "damping".into(),
        Parameter::Supports(_) => "supports".into(),
        Parameter::Stiffness { tissue, .. } => format!("stiffness.{tissue}"),
        Parameter::Friction { tool, .. } => format!("friction.{tool}"),
        Parameter::Shape { tool, .. } => format!("shape.{tool}"),
        Parameter::Resolution { threshold, .. } => format!("resolution.{}", threshold.name()),
    }
}

/// The quantity of a [`numbered_name`] with these values; `None` where there is none.
pub(super) fn numbered(name: &str, values: &[Real]) -> Option<Parameter> {
    let value = || <[Real; 1]>::try_from(values).ok().map(|[value]| value);
    Some(match name.split_once('.') {
        None if name == "gravity" => Parameter::Gravity(<[Real; 3]>::try_from(values).ok()?.into()),
        None if name == "damping" => Parameter::Damping(value()?),
        None if name == "supports" => Parameter::Supports(value()?),
        Some(("stiffness", tissue)) => Parameter::Stiffness { tissue: tissue.parse().ok()?, factor: value()? },
        Some(("friction", tool)) => Parameter::Friction { tool: tool.parse().ok()?, coefficient: value()? },
        Some(("shape", tool)) => Parameter::shape(tool.parse().ok()?, value()?)?,
        Some(("resolution", name)) => Parameter::Resolution {
            threshold: Threshold::ALL.into_iter().find(|threshold| threshold.name() == name)?,
            value: value()?,
        },
        _ => return None,
    })
}
