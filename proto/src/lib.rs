//! The wire contract of Palpate: generated messages, key expressions and the version.
//!
//! `palpate.proto` beside this crate's manifest is the documentation of every message, `contract.md` that of who sends what,
//! when and how; [`keys`] is the only place where key expressions are written down, [`surface`] how the vertices of a frame
//! are coded, [`identity`] what certificates are called.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod identity;
pub mod keys;
pub mod surface;

/// Messages of `palpate.proto`, package `palpate.v1`.
#[allow(missing_docs, clippy::all)]
mod messages {
    include!(concat!(env!("OUT_DIR"), "/palpate.v1.rs"));
}
pub use messages::*;
/// Messages of `foxglove.proto`, what Foxglove draws.
#[cfg(feature = "foxglove")]
#[allow(missing_docs, clippy::all)]
pub mod foxglove {
    include!(concat!(env!("OUT_DIR"), "/foxglove.rs"));
    /// The serialised `FileDescriptorSet` of these messages.
    pub const DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/foxglove.bin"));
}
pub use prost::Message;

/// Major version of the contract: peers with another one cannot talk to each other.
pub const VERSION_MAJOR: u32 = 1;
/// Minor version: grows when something is added.
pub const VERSION_MINOR: u32 = 10;
/// Minor version since which control has a key for each request and asker: what whoever touches needs at least.
pub const CONTROL_MINOR: u32 = 6;
/// Minor version since which the surface stream is as it is now: what a viewer needs at least.
pub const SURFACE_MINOR: u32 = 1;

/// The serialised `FileDescriptorSet` of the contract, also in `palpate.desc`: the schema that recordings embed.
pub const DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/palpate.bin"));

/// Full protobuf name of a message of this contract, as recordings name their schemas.
pub fn schema_name(message: &str) -> String {
    format!("palpate.v1.{message}")
}

impl ToolState {
    /// Number of the tool whose shape it has.
    pub fn shape_of(&self) -> u32 {
        self.shape.checked_sub(1).unwrap_or(self.tool)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_descriptor_set_beside_the_contract_is_that_of_the_contract() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/palpate.desc");
        if std::env::var_os("PALPATE_WRITE_VECTORS").is_some() {
            std::fs::write(file, DESCRIPTOR_SET).unwrap();
        }
        let same = std::fs::read(file).unwrap() == DESCRIPTOR_SET;
        assert!(same, "PALPATE_WRITE_VECTORS=1 cargo test -p palpate-proto writes it anew");
    }
}
