//! What can be wrong with names, files, numbers and messages.

/// Every failure of this crate, worded for the person in front of the client.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ClientError {
    /// A message came that is not what the contract says.
    #[error("undecodable {message}: {reason}")]
    Undecodable {
        /// Name of the message.
        message: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// Nothing here has this name.
    #[error("there is no {what} \"{name}\", only {known}")]
    Unknown {
        /// What was looked for: a device, a frame, a mode.
        what: &'static str,
        /// The name, as given.
        name: String,
        /// The names there are.
        known: String,
    },
    /// A device file cannot be read, or says what no device can do.
    #[error("{file}: {reason}")]
    DeviceFile {
        /// The file, as given.
        file: String,
        /// The line or the key, and what is wrong with it.
        reason: String,
    },
    /// Points or numbers that give no registration.
    #[error("no registration: {0}")]
    Registration(String),
    /// A link cannot lose this share of what is sent.
    #[error("the loss is {loss}: it is a share, 0 to 1")]
    Link {
        /// The loss, as given.
        loss: f64,
    },
    /// A pose holds a number that is not finite as f32: it is not to be sent.
    #[error("the pose is not finite")]
    PoseNotFinite,
}
