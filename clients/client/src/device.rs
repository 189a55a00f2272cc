//! Haptic devices: what a client has to know of one, so that nobody tunes a gain.

use std::{borrow::Cow, path::Path};

use serde::Deserialize;

use crate::ClientError;

/// What a device can do.
///
/// Force, torque, stiffness, damping and workspace are the values the CHAI3D drivers use for it. Resolution, apparent
/// mass and friction are typical values in the manner of the vendors' data sheets, not measurements of one specimen.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Device {
    /// As the drivers call it.
    pub name: Cow<'static, str>,
    /// Greatest force [N]; more is cut to this length.
    pub max_force: f64,
    /// Greatest torque [N·m]; 0 for a device without torque feedback.
    #[serde(default)]
    pub max_torque: f64,
    /// Greatest angular stiffness it renders stably [N·m/rad]: what its virtual coupling gets. Of no use without torque.
    #[serde(default)]
    pub max_angular_stiffness: f64,
    /// Greatest stiffness it renders stably [N/m]: what its virtual coupling gets.
    pub max_stiffness: f64,
    /// Greatest damping it renders stably [N·s/m]: what the passivity controller may add.
    pub max_damping: f64,
    /// Radius of the ball in which its tip can move [m].
    pub workspace_radius: f64,
    /// Step of its encoders at the tip [m].
    pub resolution: f64,
    /// Apparent mass at the tip [kg]. Only the virtual Phantom uses it.
    #[serde(default = "typical_mass")]
    pub mass: f64,
    /// Backdrive friction at the tip [N], Coulomb. Only the virtual Phantom uses it.
    #[serde(default)]
    pub friction: f64,
}

/// Apparent mass of the small desktop devices [kg], for a file that leaves it out.
fn typical_mass() -> f64 {
    0.05
}

/// Every device that needs no file.
const DEVICES: [Device; 6] = [
    Device {
        name: Cow::Borrowed("Touch"),
        max_force: 3.3,
        max_torque: 0.0,
        max_angular_stiffness: 0.0,
        max_stiffness: 400.0,
        max_damping: 4.0,
        workspace_radius: 0.075,
        resolution: 55e-6,
        mass: 0.045,
        friction: 0.26,
    },
    Device {
        name: Cow::Borrowed("PHANTOM Omni"),
        max_force: 3.3,
        max_torque: 0.0,
        max_angular_stiffness: 0.0,
        max_stiffness: 700.0,
        max_damping: 5.0,
        workspace_radius: 0.10,
        resolution: 55e-6,
        mass: 0.045,
        friction: 0.26,
    },
    Device { name: Cow::Borrowed("PHANTOM Desktop"), ..TOUCH_X },
    TOUCH_X,
    Device {
        name: Cow::Borrowed("PHANTOM Premium 1.5 6DOF"),
        max_force: 8.5,
        max_torque: 0.188,
        max_angular_stiffness: 0.3,
        max_stiffness: 800.0,
        max_damping: 5.0,
        workspace_radius: 0.12,
        resolution: 30e-6,
        mass: 0.136,
        friction: 0.04,
    },
    Device {
        name: Cow::Borrowed("omega"),
        max_force: 12.0,
        max_torque: 0.0,
        max_angular_stiffness: 0.0,
        max_stiffness: 5000.0,
        max_damping: 30.0,
        workspace_radius: 0.08,
        resolution: 10e-6,
        mass: 0.2,
        friction: 0.05,
    },
];

/// The PHANTOM Desktop under its later name.
const TOUCH_X: Device = Device {
    name: Cow::Borrowed("Touch X"),
    max_force: 7.9,
    max_torque: 0.0,
    max_angular_stiffness: 0.0,
    max_stiffness: 1000.0,
    max_damping: 5.0,
    workspace_radius: 0.10,
    resolution: 23e-6,
    mass: 0.045,
    friction: 0.06,
};

impl Device {
    /// The device called `name`, in whatever case. Errors: no such device; the error lists those there are.
    pub fn by_name(name: &str) -> Result<Device, ClientError> {
        DEVICES.iter().find(|device| device.name.eq_ignore_ascii_case(name)).cloned().ok_or_else(|| {
            let known = DEVICES.each_ref().map(|device| format!("\"{}\"", device.name)).join(", ");
            ClientError::Unknown { what: "device", name: name.to_owned(), known }
        })
    }

    /// Reads a device from a TOML file: the fields of this struct as keys, in the units given there. `mass` and
    /// `friction` may be left out, and `max_torque` with `max_angular_stiffness` where there is no torque feedback.
    ///
    /// Errors: [`ClientError::DeviceFile`], which names the file, and the line or the key.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Device, ClientError> {
        let file = path.as_ref().display().to_string();
        let unreadable =
            |error: std::io::Error| ClientError::DeviceFile { file: file.clone(), reason: error.to_string() };
        Self::from_text(&std::fs::read_to_string(&path).map_err(unreadable)?, &file)
    }

    /// Reads a device from the `text` of such a file, which errors call `file`.
    ///
    /// Errors: as [`from_file`](Self::from_file).
    pub fn from_text(text: &str, file: &str) -> Result<Device, ClientError> {
        let fault = |reason: String| ClientError::DeviceFile { file: file.to_owned(), reason };
        let device: Device = toml::from_str(text).map_err(|error| fault(error.to_string().trim_end().to_owned()))?;
        device.check().map_err(fault)?;
        Ok(device)
    }

    /// Errors: the first number that no device can have, by its key.
    fn check(&self) -> Result<(), String> {
        let positive = [
            ("max_force", self.max_force),
            ("max_stiffness", self.max_stiffness),
            ("workspace_radius", self.workspace_radius),
            ("resolution", self.resolution),
            ("mass", self.mass),
        ];
        let not_negative = [
            ("max_torque", self.max_torque),
            ("max_angular_stiffness", self.max_angular_stiffness),
            ("max_damping", self.max_damping),
            ("friction", self.friction),
        ];
        if self.name.is_empty() {
            return Err("name is empty".to_owned());
        }
        if let Some((key, value)) = positive.iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
            return Err(format!("{key} is {value}: it must be above 0"));
        }
        if let Some((key, value)) = not_negative.iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
            return Err(format!("{key} is {value}: it must be 0 or more"));
        }
        if self.max_torque > 0.0 && self.max_angular_stiffness == 0.0 {
            return Err("max_angular_stiffness is 0: a device with torque feedback has one".to_owned());
        }
        Ok(())
    }

    /// The most energy that a rendered environment may give out to the hand beyond what it has taken in [J]:
    /// `max_force² / (2 max_stiffness)`, 7.8 mJ for an Omni.
    ///
    /// This is what the stiffest spring that the device renders gives back when it is pressed with the greatest force
    /// and let go: the hand meets as much in everyday use, so that it is never surprised by more.
    pub fn passivity_budget(&self) -> f64 {
        self.max_force * self.max_force / (2.0 * self.max_stiffness)
    }
}

impl Default for Device {
    /// The PHANTOM Omni, the device most papers used.
    fn default() -> Self {
        let [_, omni, ..] = DEVICES;
        omni
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"
        name = "six bar"
        max_force = 5         # N
        max_stiffness = 800.0 # N/m
        max_damping = 2.0
        workspace_radius = 0.09
        resolution = 20e-6
    "#;

    fn read(text: &str) -> Result<Device, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("device.toml");
        std::fs::write(&file, text).unwrap();
        Device::from_file(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn a_device_is_found_in_any_case() {
        assert_eq!(Device::by_name("phantom omni").unwrap(), Device::default());
        assert_eq!(Device::by_name("OMEGA").unwrap().max_force, 12.0);
        let (desktop, touch_x) = (Device::by_name("PHANTOM Desktop").unwrap(), Device::by_name("Touch X").unwrap());
        assert_eq!((desktop.max_force, desktop.max_stiffness), (touch_x.max_force, touch_x.max_stiffness));
    }

    #[test]
    fn an_unknown_device_is_answered_with_the_known_ones() {
        let error = Device::by_name("mouse").unwrap_err().to_string();
        assert!(error.contains("\"mouse\"") && error.contains("\"Touch\"") && error.contains("\"omega\""), "{error}");
    }

    #[test]
    fn every_preset_passes_the_check_of_files() {
        for device in DEVICES {
            device.check().unwrap();
        }
        assert!((Device::default().passivity_budget() - 7.8e-3).abs() < 1e-4);
    }

    #[test]
    fn a_file_needs_only_what_a_data_sheet_says() {
        let device = read(FILE).unwrap();
        assert_eq!((device.name.as_ref(), device.max_force, device.max_torque), ("six bar", 5.0, 0.0));
        assert_eq!((device.mass, device.friction), (typical_mass(), 0.0));
    }

    #[test]
    fn every_bad_value_is_named_by_file_and_key() {
        for (from, to, named) in [
            ("5  ", "-5 ", "max_force is -5"),
            ("5  ", "nan", "max_force is NaN"),
            ("800.0", "inf", "max_stiffness is inf"),
            ("2.0", "-1e-3", "max_damping is -0.001"),
            ("0.09", "0", "workspace_radius is 0"),
            ("20e-6", "\"fine\"", "resolution"),
            ("max_damping", "max_dampnig", "max_dampnig"),
            ("max_damping", "max_torque = 0.2\nmax_damping", "max_angular_stiffness is 0"),
            ("max_force = 5", "", "max_force"),
            ("six bar", "", "name is empty"),
        ] {
            let error = read(&FILE.replace(from, to)).unwrap_err();
            assert!(error.contains(named) && error.contains("device.toml"), "{named}: {error}");
        }
        let missing = Device::from_file("no/such/device.toml").unwrap_err().to_string();
        assert!(missing.contains("no/such/device.toml"), "{missing}");
    }
}
