//! The ways to make a force from wrenches, by name.

use std::str::FromStr;

use crate::ClientError;

/// How the force is made from the wrenches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RenderMode {
    /// The newest force, held until the next comes. For comparison: a delayed force makes a stiff contact shake.
    Raw,
    /// The newest force, guarded by the passivity controller.
    Passive,
    /// The local model of the newest wrench, evaluated where the device is now. Holds the force where there is none.
    LocalModel,
    /// The local model, guarded by the passivity controller.
    #[default]
    LocalModelPassive,
}

/// Every mode with the name it is chosen by.
const MODES: [(&str, RenderMode); 4] = [
    ("raw", RenderMode::Raw),
    ("passive", RenderMode::Passive),
    ("local", RenderMode::LocalModel),
    ("local-passive", RenderMode::LocalModelPassive),
];

impl RenderMode {
    /// Every mode, in the order of their names.
    #[cfg(test)]
    pub(super) const ALL: [Self; 4] = [Self::Raw, Self::Passive, Self::LocalModel, Self::LocalModelPassive];

    /// The names of all modes.
    pub fn names() -> [&'static str; 4] {
        MODES.map(|(name, _)| name)
    }

    /// The name it is chosen by.
    pub fn name(self) -> &'static str {
        MODES[self as usize].0
    }

    /// True where the force is that of the local model at the place of the device.
    pub(super) fn uses_model(self) -> bool {
        matches!(self, Self::LocalModel | Self::LocalModelPassive)
    }

    /// True where the passivity controller limits the force.
    pub(super) fn is_guarded(self) -> bool {
        matches!(self, Self::Passive | Self::LocalModelPassive)
    }
}

impl FromStr for RenderMode {
    type Err = ClientError;

    /// The mode of that name, in whatever case. Errors: no such mode; the error lists those there are.
    fn from_str(name: &str) -> Result<Self, ClientError> {
        MODES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|&(_, mode)| mode).ok_or_else(|| {
            ClientError::Unknown { what: "render mode", name: name.to_owned(), known: Self::names().join(", ") }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_go_by_their_names() {
        for (name, mode) in MODES {
            assert_eq!((name.parse::<RenderMode>().unwrap(), mode.name()), (mode, name));
        }
        assert!("fast".parse::<RenderMode>().unwrap_err().to_string().contains("raw, passive, local, local-passive"));
    }
}
