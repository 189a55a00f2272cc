//! Every key expression of the contract, and the topics of a recording. Nothing else spells them.
//!
//! `{session}` is the server's name (one zenoh key chunk: no `/ * $ ? #`), default [`DEFAULT_SESSION`].

use crate::control_request::Request;
use std::fmt::Display;

/// Session name of a server that was not given another.
pub const DEFAULT_SESSION: &str = "main";
/// Default endpoint of the force channel (poses in, wrenches out).
pub const DEFAULT_FORCE_ENDPOINT: &str = "tcp/127.0.0.1:7447";
/// Default endpoint of everything else (surface, session, control, status, presence).
pub const DEFAULT_SURFACE_ENDPOINT: &str = "tcp/127.0.0.1:7448";

/// True when `name` can be the name of a session or of a client: non-empty, letters, digits, `-` and `_`.
pub fn is_name(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
}

/// Poses of tool `tool`, on the force channel.
pub fn tool_pose(session: &str, tool: impl Display) -> String {
    format!("palpate/v1/{session}/tool/{tool}/pose")
}
/// Poses of every tool: what the server subscribes to.
pub fn all_tool_poses(session: &str) -> String {
    tool_pose(session, "*")
}
/// The tool id in a pose key, if `key` is one.
pub fn tool_of_pose_key(key: &str) -> Option<u32> {
    let mut chunks = key.rsplit('/');
    (chunks.next()? == "pose").then_some(())?;
    chunks.next()?.parse().ok()
}
/// Wrenches of tool `tool`, on the force channel.
pub fn tool_wrench(session: &str, tool: impl Display) -> String {
    format!("palpate/v1/{session}/tool/{tool}/wrench")
}
/// Wrenches of every tool.
pub fn all_tool_wrenches(session: &str) -> String {
    tool_wrench(session, "*")
}
/// Queryable: session description.
pub fn session(session: &str) -> String {
    format!("palpate/v1/{session}/session")
}
/// Where the session description is offered: clients of another major version ask under theirs, and are told this one.
pub fn session_of_any_version(session: &str) -> String {
    format!("palpate/*/{session}/session")
}
/// Queryable: the role of whoever asks. Each answer comes on a [`role`] of its own, and the server's router passes on those
/// of the asker alone.
pub fn all_roles(session: &str) -> String {
    role(session, "*")
}
/// What the client called `name` may do.
pub fn role(session: &str, name: &str) -> String {
    format!("palpate/v1/{session}/role/{name}")
}
/// Name of every client of a server that asks nobody for a certificate.
pub const ANYBODY: &str = "anybody";
/// Name that stands for clients without a role.
pub const NOBODY: &str = "nobody";
/// Requests of control, as they are called in keys.
pub const ACTIONS: [&str; 5] = ["attach", "detach", "reset", "record", "set"];
/// Which of [`ACTIONS`] a request is.
pub fn action(request: &Request) -> &'static str {
    match request {
        Request::Attach(_) => "attach",
        Request::Detach(_) => "detach",
        Request::Reset(_) => "reset",
        Request::Set(_) => "set",
        Request::StartRecording(_) | Request::StopRecording(_) => "record",
    }
}
/// Queryable: requests of the client called `name` (see [`role`]) for `action`, one of [`ACTIONS`].
pub fn control(session: &str, action: &str, name: &str) -> String {
    format!("palpate/v1/{session}/control/{action}/{name}")
}
/// Every request of everybody: what the server offers.
pub fn all_control(session: &str) -> String {
    control(session, "*", "*")
}
/// Action and name in a control key, if `key` is one.
pub fn asker_of_control_key(key: &str) -> Option<(&str, &str)> {
    let mut chunks = key.rsplit('/');
    let name = chunks.next()?;
    let action = chunks.next()?;
    (chunks.next()? == "control").then_some((action, name))
}
/// Queryable: every part of every picture on the surface.
pub fn surface_pictures(session: &str) -> String {
    format!("palpate/v1/{session}/surface/picture/*")
}
/// Queryable: every part of the surface topology.
pub fn surface_topology(session: &str) -> String {
    format!("palpate/v1/{session}/surface/topology/*")
}
/// Queryable: every part of the newest key frame, with levels.
pub fn surface_key(session: &str) -> String {
    format!("palpate/v1/{session}/surface/key/*")
}
/// Part `part` in an answer of [`surface_topology`] or [`surface_key`]: `key` with the part for `*`.
pub fn surface_part(key: &str, part: u32) -> String {
    key.replace('*', &part.to_string())
}
/// Every `every`-th surface frame (see [`EVERY`](crate::surface::EVERY)), with or without levels of detail.
pub fn surface_frames(session: &str, every: u32, levels: bool) -> String {
    format!("palpate/v1/{session}/surface/{}/{every}", if levels { "levels" } else { "frame" })
}
/// Every stream of surface frames.
pub fn all_surface_frames(session: &str) -> String {
    format!("palpate/v1/{session}/surface/*/*")
}
/// Status, once a second.
pub fn status(session: &str) -> String {
    format!("palpate/v1/{session}/status")
}
/// Liveliness token of the client that holds `tool` under `epoch`.
pub fn presence(session: &str, tool: impl Display, epoch: impl Display) -> String {
    format!("palpate/v1/{session}/presence/{tool}/{epoch}")
}
/// Liveliness of every client.
pub fn all_presence(session: &str) -> String {
    presence(session, "*", "*")
}
/// Tool and epoch in a presence key, if `key` is one.
pub fn holder_of_presence_key(key: &str) -> Option<(u32, u32)> {
    let mut chunks = key.rsplit('/');
    let epoch = chunks.next()?.parse().ok()?;
    let tool = chunks.next()?.parse().ok()?;
    (chunks.next()? == "presence").then_some((tool, epoch))
}
/// Bare round trip on the force channel, answered by the server with the same bytes: what the network alone costs.
pub fn echo_request(session: &str) -> String {
    format!("palpate/v1/{session}/echo/request")
}
/// Answers to [`echo_request`].
pub fn echo_reply(session: &str) -> String {
    format!("palpate/v1/{session}/echo/reply")
}

/// Topics of a recording.
pub mod topics {
    /// One `RecordingStart`.
    pub const START: &str = "palpate/start";
    /// `TickInputs`, one per tick.
    pub const INPUTS: &str = "palpate/inputs";
    /// `ToolWrench`, one per attached tool and tick.
    pub const WRENCH: &str = "palpate/wrench";
    /// `StateHash`, one per frame.
    pub const HASH: &str = "palpate/hash";
    /// `SurfaceTopology`, one per part.
    pub const TOPOLOGY: &str = "palpate/surface/topology";
    /// `SurfacePicture`, one per part.
    pub const PICTURE: &str = "palpate/surface/picture";
    /// `SurfaceFrame` with levels, one per part and frame.
    pub const SURFACE: &str = "palpate/surface/frame";
    /// One `RecordingEnd`, in a recording that ends early.
    pub const END: &str = "palpate/end";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_read_back_what_they_were_made_from() {
        assert_eq!(tool_of_pose_key(&tool_pose("main", 7)), Some(7));
        assert_eq!(tool_of_pose_key(&tool_wrench("main", 7)), None);
        assert_eq!(tool_of_pose_key("palpate/v1/main/tool/x/pose"), None);
        assert_eq!(holder_of_presence_key(&presence("main", 2, 99)), Some((2, 99)));
        assert_eq!(holder_of_presence_key("a/b"), None);
        assert_eq!(asker_of_control_key(&control("main", "reset", "anna")), Some(("reset", "anna")));
        assert_eq!(asker_of_control_key(&role("main", "anna")), None);
        assert!(is_name("lab-2_a") && !is_name("a/b") && !is_name("*") && !is_name(""));
    }
}
