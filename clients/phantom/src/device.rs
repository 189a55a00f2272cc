//! Haptic devices, as far as a simulation can tell them apart.

use anyhow::{Context, Result};

/// What a device can do.
///
/// Force, stiffness, damping and workspace are the values the CHAI3D drivers use for it. Resolution, apparent mass and
/// friction are typical values in the manner of the vendors' data sheets, not measurements of one specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Device {
    /// As the drivers call it.
    pub name: &'static str,
    /// Greatest force [N]; more is cut to this length.
    pub max_force: f64,
    /// Greatest torque [N·m]; 0 for a device without torque feedback.
    pub max_torque: f64,
    /// Greatest stiffness it renders stably [N/m].
    pub max_stiffness: f64,
    /// Greatest damping it renders stably [N·s/m].
    pub max_damping: f64,
    /// Radius of the ball in which its tip can move [m].
    pub workspace_radius: f64,
    /// Step of its encoders at the tip [m].
    pub resolution: f64,
    /// Apparent mass at the tip [kg].
    pub mass: f64,
    /// Backdrive friction at the tip [N], Coulomb.
    pub friction: f64,
}

/// Every device of this crate.
const DEVICES: [Device; 5] = [
    Device {
        name: "Touch",
        max_force: 3.3,
        max_torque: 0.0,
        max_stiffness: 400.0,
        max_damping: 4.0,
        workspace_radius: 0.075,
        resolution: 55e-6,
        mass: 0.045,
        friction: 0.26,
    },
    Device {
        name: "PHANTOM Omni",
        max_force: 3.3,
        max_torque: 0.0,
        max_stiffness: 700.0,
        max_damping: 5.0,
        workspace_radius: 0.10,
        resolution: 55e-6,
        mass: 0.045,
        friction: 0.26,
    },
    Device {
        name: "PHANTOM Desktop",
        max_force: 7.9,
        max_torque: 0.0,
        max_stiffness: 1000.0,
        max_damping: 5.0,
        workspace_radius: 0.10,
        resolution: 23e-6,
        mass: 0.045,
        friction: 0.06,
    },
    Device {
        name: "PHANTOM Premium 1.5 6DOF",
        max_force: 8.5,
        max_torque: 0.188,
        max_stiffness: 800.0,
        max_damping: 5.0,
        workspace_radius: 0.12,
        resolution: 30e-6,
        mass: 0.136,
        friction: 0.04,
    },
    Device {
        name: "omega",
        max_force: 12.0,
        max_torque: 0.0,
        max_stiffness: 5000.0,
        max_damping: 30.0,
        workspace_radius: 0.08,
        resolution: 10e-6,
        mass: 0.2,
        friction: 0.05,
    },
];

impl Device {
    /// The device called `name`, in whatever case. Errors: no such device; the error lists those there are.
    pub fn by_name(name: &str) -> Result<Device> {
        DEVICES.iter().find(|device| device.name.eq_ignore_ascii_case(name)).copied().with_context(|| {
            let names = DEVICES.map(|device| format!("\"{}\"", device.name));
            format!("there is no device \"{name}\", only {}", names.join(", "))
        })
    }
}

impl Default for Device {
    /// The PHANTOM Omni, the device most papers used.
    fn default() -> Self {
        DEVICES[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_found_in_any_case() {
        assert_eq!(Device::by_name("phantom omni").unwrap(), Device::default());
        assert_eq!(Device::by_name("OMEGA").unwrap().max_force, 12.0);
    }

    #[test]
    fn an_unknown_device_is_answered_with_the_known_ones() {
        let error = Device::by_name("mouse").unwrap_err().to_string();
        assert!(error.contains("\"mouse\"") && error.contains("\"Touch\"") && error.contains("\"omega\""), "{error}");
    }
}
