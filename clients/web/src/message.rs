//! What goes over the WebSocket.
//!
//! | way | form | content |
//! |---|---|---|
//! | to the page | binary | a byte that tells the kind, then that message of the contract |
//! | to the page | text | JSON: [`Notice`] |
//! | to the gateway | binary | [`CONTROL`] and a `ControlRequest`; or [`POSE`], the tool's number (a byte) and a `ToolPose` |
//! | to the gateway | binary | [`SEEN`] and the sequence of the newest frame that the page has decoded (u64, little-endian) |
//! | to the gateway | text | JSON: [`Wish`] |
//!
//! Control requests are answered in their order.

use axum::body::Bytes;
use palpate_sdk::proto::{Message, ToolPose};
use palpate_sdk::{ControlRequest, PoseSample};
use serde::{Deserialize, Serialize};

use crate::Rights;

/// `Session`: at first, and again when a tool is taken or freed.
pub const SESSION: u8 = 1;
/// `SurfaceTopology`: all parts in their order, before the first frame of a surface.
pub const SURFACE_TOPOLOGY: u8 = 2;
/// `SurfaceFrame`: all parts of one frame after another, with levels. Frames may be left out; the key frame of a frame is not.
pub const SURFACE_FRAME: u8 = 3;
/// `Status`: once a second.
pub const STATUS: u8 = 4;
/// `ToolWrench` of a tool that this page holds: the newest, without its local model. Sequence and time of the pose are
/// those that the page gave.
pub const TOOL_WRENCH: u8 = 5;
/// `ControlReply`.
pub const CONTROL_REPLY: u8 = 6;

/// To the gateway: `ControlRequest`, of attach, detach and reset.
pub const CONTROL: u8 = 1;
/// To the gateway: `ToolPose` of a tool that this page holds.
pub const POSE: u8 = 2;

/// To the gateway: a frame was decoded. Frames, and wrenches with them, wait where four are on the way: what a slow page
/// gets is few and new.
pub const SEEN: u8 = 3;

/// Longest message that a page may send [bytes]: a pose takes 70.
pub(crate) const LONGEST: usize = 4096;

/// What a page is told beside the contract.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Notice {
    /// First of all: what the page may do.
    Welcome {
        /// Its rights.
        rights: Rights,
    },
    /// Whether the server is there.
    Link {
        /// Why not; `None`: it is.
        fault: Option<String>,
    },
    /// A tool that the page held is not its any more.
    Lost {
        /// The tool's number.
        tool: u32,
        /// Why.
        fault: String,
    },
    /// A message of the page that was refused.
    Refused {
        /// Why.
        fault: String,
    },
    /// An answer to [`Wish::Invite`].
    Invitation {
        /// What follows scheme, host and port in the address.
        path: String,
        /// What it gives a right to.
        rights: Rights,
    },
}

/// What a page may ask for beside the contract.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Wish {
    /// An address that lets one more browser in. Operators only.
    Invite {
        /// With these rights.
        rights: Rights,
    },
}

/// A message of the contract for a page.
pub(crate) fn to_page(kind: u8, message: &impl Message) -> Bytes {
    let mut bytes = Vec::with_capacity(1 + message.encoded_len());
    bytes.push(kind);
    message.encode_raw(&mut bytes);
    bytes.into()
}

/// A binary message of a page.
#[derive(Clone, Debug, PartialEq)]
pub enum FromPage {
    /// [`CONTROL`].
    Control(ControlRequest),
    /// [`POSE`].
    Pose {
        /// The tool's number.
        tool: u32,
        /// Its pose.
        pose: PagePose,
    },
    /// [`SEEN`]: the sequence of the newest frame that the page has decoded.
    Seen(u64),
}

/// A pose as the page gave it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PagePose {
    /// Of the holding of the tool.
    pub epoch: u32,
    /// +1 with every pose of the page.
    pub sequence: u32,
    /// On the page's clock [ns].
    pub time_ns: u64,
    /// Every number is finite.
    pub sample: PoseSample,
}

impl FromPage {
    /// `None` where the bytes are no such message.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [CONTROL, request @ ..] => Some(Self::Control(ControlRequest::decode(request).ok()?)),
            [POSE, tool, pose @ ..] => {
                let pose = ToolPose::decode(pose).ok()?;
                let sample = PoseSample {
                    position: finite(&pose.position)?,
                    orientation: finite(&pose.orientation)?,
                    linear_velocity: None,
                    buttons: pose.buttons,
                    opening: finite::<1>(&[pose.opening])?[0],
                };
                let ToolPose { epoch, sequence, time_ns, .. } = pose;
                Some(Self::Pose { tool: (*tool).into(), pose: PagePose { epoch, sequence, time_ns, sample } })
            }
            [SEEN, sequence @ ..] => Some(Self::Seen(u64::from_le_bytes(sequence.try_into().ok()?))),
            _ => None,
        }
    }
}

/// `values` as `N` finite numbers.
fn finite<const N: usize>(values: &[f32]) -> Option<[f64; N]> {
    let values: [f32; N] = values.try_into().ok()?;
    values.iter().all(|value| value.is_finite()).then(|| values.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_comes_with_its_tool_and_every_number() {
        let pose = ToolPose {
            epoch: 9,
            sequence: 3,
            time_ns: 5,
            position: vec![0.5, 0.25, -1.0],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            buttons: 2,
            ..Default::default()
        };
        let bytes = |pose: &ToolPose| [&[POSE, 4], &pose.encode_to_vec()[..]].concat();
        let Some(FromPage::Pose { tool, pose: read }) = FromPage::decode(&bytes(&pose)) else { panic!("a pose") };
        assert_eq!((tool, read.epoch, read.sequence, read.time_ns, read.sample.buttons), (4, 9, 3, 5, 2));
        assert_eq!(read.sample.position, [0.5, 0.25, -1.0]);
        for bad in [vec![], vec![0.0; 2], vec![f32::NAN, 0.0, 0.0]] {
            assert_eq!(FromPage::decode(&bytes(&ToolPose { position: bad, ..pose.clone() })), None);
        }
        assert_eq!(FromPage::decode(&[]), None);
        assert_eq!(FromPage::decode(&[POSE]), None);
        assert_eq!(FromPage::decode(&[77, 1, 2]), None);
        assert_eq!(FromPage::decode(&[SEEN, 1, 2]), None);
        assert_eq!(FromPage::decode(&[SEEN, 4, 1, 0, 0, 0, 0, 0, 0]), Some(FromPage::Seen(260)));
    }

    #[test]
    fn notices_read_as_the_page_expects_them() {
        let json = |notice: &Notice| serde_json::to_string(notice).unwrap();
        assert_eq!(json(&Notice::Welcome { rights: Rights::Viewer }), r#"{"welcome":{"rights":"viewer"}}"#);
        assert_eq!(json(&Notice::Link { fault: None }), r#"{"link":{"fault":null}}"#);
        let wish: Wish = serde_json::from_str(r#"{"invite":{"rights":"operator"}}"#).unwrap();
        assert_eq!(wish, Wish::Invite { rights: Rights::Operator });
    }
}
