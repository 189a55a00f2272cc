//! Numbers that things go by.

/// Stands for "no node", "no element" and the like in lists where an `Option` would take twice the room.
pub const NONE: u32 = u32::MAX;
