//! What the C interface hands around: structs as the header lays them out, and the client behind its pointer.

use std::ffi::c_char;

use super::{
    border::Fallible,
    session::{Described, StatusFeed},
};
use crate::{
    Clutch, Connection, Device, Frame, PoseSample, Registration, RenderMode, Renderer, SdkError, Tool, ToolStatus,
};

/// `palpate_registration`.
#[repr(C)]
pub struct CRegistration {
    pub(super) scale: f64,
    pub(super) rotation: [f64; 4],
    pub(super) translation: [f64; 3],
}

impl CRegistration {
    /// The registration that a C program has filled in. Errors: it is none.
    pub(super) fn checked(&self) -> Result<Registration, SdkError> {
        Ok(Registration::new(self.scale, self.rotation, self.translation)?)
    }
}

impl From<&Registration> for CRegistration {
    fn from(registration: &Registration) -> Self {
        Self { scale: registration.scale(), rotation: registration.rotation(), translation: registration.translation() }
    }
}

/// `palpate_attachment`.
#[repr(C)]
pub struct CAttachment {
    pub(super) client: *const c_char,
    pub(super) tool: *const c_char,
    pub(super) rate_hz: f64,
    pub(super) device: *const c_char,
    pub(super) frame: *const c_char,
    pub(super) render: *const c_char,
    pub(super) registration: CRegistration,
}

/// `palpate_pose`.
#[repr(C)]
pub struct CPose {
    pub(super) position: [f64; 3],
    pub(super) orientation: [f64; 4],
    pub(super) buttons: u32,
    pub(super) opening: f32,
}

/// `palpate_tool_state`.
#[repr(C)]
pub struct CToolState {
    hold: i32,
    phase: i32,
    flags: u32,
    contact_points: u32,
    age: f64,
    opening: f64,
    grip_torque: f64,
}

/// `palpate_client`.
pub struct Client {
    pub(super) connection: Connection,
    pub(super) held: Option<Held>,
    /// Of the last `palpate_session`.
    pub(super) described: Option<Described>,
    /// From the first `palpate_status` on.
    pub(super) status: Option<StatusFeed>,
}

/// A tool in the hand, and everything between the device's numbers and the server's.
pub(super) struct Held {
    pub(super) tool: Tool,
    pub(super) renderer: Renderer,
    pub(super) frame: Frame,
    pub(super) clutch: Clutch,
    pub(super) pressed: bool,
    /// The device's newest pose in Palpate's axes, for forces between poses.
    pub(super) pose: PoseSample,
    /// Of the jaws of the simulated tool, by the newest wrench.
    opening: f64,
}

impl Held {
    /// A tool just taken, before its first pose.
    pub(super) fn new(tool: Tool, device: &Device, frame: Frame, mode: RenderMode, registration: Registration) -> Self {
        let pose = PoseSample {
            position: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: None,
            buttons: 0,
            opening: 0.0,
        };
        let renderer = Renderer::new(&registration.in_body(device), mode);
        Self { tool, renderer, frame, clutch: Clutch::new(registration), pressed: false, pose, opening: 0.0 }
    }

    /// Errors: those of [`Tool::send_pose`], the pose is forgotten then; or the tool is gone, and the pose was sent.
    pub(super) fn send_pose(&mut self, pose: &CPose) -> Result<(), SdkError> {
        let frame = &self.frame;
        let pose = PoseSample {
            position: frame.position_in(pose.position),
            orientation: frame.orientation_in(pose.orientation),
            linear_velocity: None,
            buttons: pose.buttons,
            opening: pose.opening.into(),
        };
        let in_body = self.clutch.follow(&pose, self.pressed, self.tool.now_ns());
        self.tool.send_pose(in_body)?;
        self.pose = pose;
        self.tool.check(self.tool.now_ns())
    }

    /// How the tool is doing.
    pub(super) fn state(&mut self) -> CToolState {
        let now_ns = self.tool.now_ns();
        let ToolStatus { hold, phase, flags, age_ns, contact_points } = self.tool.status(now_ns);
        CToolState {
            hold: hold as i32,
            phase: phase as i32,
            flags,
            contact_points,
            age: age_ns as f64 * 1e-9,
            opening: self.opening,
            grip_torque: self.clutch.force_scale() * self.renderer.grip_torque(now_ns),
        }
    }

    /// Errors: the tool is gone. Otherwise force [N] and torque [N·m] in the device's axes, for its position and velocity in its frame's unit.
    pub(super) fn render(&mut self, position: [f64; 3], velocity: [f64; 3]) -> Result<[[f64; 3]; 2], SdkError> {
        self.tool.check(self.tool.now_ns())?;
        if let Some(received) = self.tool.latest_wrench().filter(|received| received.fresh) {
            self.renderer.receive(&received.wrench, received.arrival_ns);
            self.opening = received.wrench.opening;
        }
        let now_ns = self.tool.now_ns();
        let device = PoseSample {
            position: self.frame.position_in(position),
            linear_velocity: Some(self.frame.velocity_in(velocity)),
            ..self.pose
        };
        let in_body = self.clutch.follow(&device, self.pressed, now_ns);
        let force = self.renderer.force(in_body.position, in_body.linear_velocity.unwrap_or_default(), now_ns);
        let (registration, scale) = (self.clutch.registration(), self.clutch.force_scale());
        let force = registration.force_to_device(force).map(|f| scale * f);
        let torque = registration.torque_to_device(self.renderer.torque(now_ns)).map(|t| scale * t);
        Ok([self.frame.force_out(force), self.frame.torque_out(torque)])
    }
}

impl Client {
    /// A client without a tool, to be freed by `palpate_close`.
    pub(super) fn boxed(connection: Connection) -> *mut Self {
        Box::into_raw(Box::new(Self { connection, held: None, described: None, status: None }))
    }

    /// The tool in the hand. Errors: there is none.
    pub(super) fn held(&mut self) -> Fallible<&mut Held> {
        self.held.as_mut().ok_or_else(|| NO_TOOL.into())
    }

    /// Gives the tool back. Errors: there is none, or those of [`Tool::detach`].
    pub(super) fn detach(&mut self) -> Fallible<()> {
        Ok(self.held.take().ok_or(NO_TOOL)?.tool.detach()?)
    }
}

/// What a call that needs a tool says without one.
const NO_TOOL: &str = "this client holds no tool: call palpate_attach first";
