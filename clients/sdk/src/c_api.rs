//! The C interface: what `include/palpate.h` declares, which also documents it.
//!
//! Nothing here has a rule of its own: it checks pointers, turns text and numbers, and calls the crate. Panics end at
//! this border.

use std::{
    cell::RefCell,
    error::Error,
    ffi::{CStr, CString, c_char, c_int},
    panic::{AssertUnwindSafe, catch_unwind},
    slice,
};

use crate::{
    Attachment, Clutch, Connection, Device, Endpoints, Frame, PoseSample, Registration, RenderMode, Renderer, SdkError,
    Tool,
};

type Fallible<T> = Result<T, Box<dyn Error>>;

/// `palpate_registration`.
#[repr(C)]
pub struct CRegistration {
    scale: f64,
    rotation: [f64; 4],
    translation: [f64; 3],
}

impl CRegistration {
    fn checked(&self) -> Result<Registration, SdkError> {
        Registration::new(self.scale, self.rotation, self.translation)
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
    client: *const c_char,
    tool: *const c_char,
    rate_hz: f64,
    device: *const c_char,
    frame: *const c_char,
    render: *const c_char,
    registration: CRegistration,
}

/// `palpate_pose`.
#[repr(C)]
pub struct CPose {
    position: [f64; 3],
    orientation: [f64; 4],
    linear_velocity: [f64; 3],
    angular_velocity: [f64; 3],
    buttons: u32,
}

/// `palpate_client`.
pub struct Client {
    connection: Connection,
    held: Option<Held>,
}

/// A tool in the hand, and everything between the device's numbers and the server's.
struct Held {
    tool: Tool,
    renderer: Renderer,
    frame: Frame,
    clutch: Clutch,
    pressed: bool,
    /// The device's newest pose in Palpate's axes, for forces between poses.
    pose: PoseSample,
}

impl Held {
    fn send_pose(&mut self, pose: &CPose) -> Result<(), SdkError> {
        let frame = &self.frame;
        self.pose = PoseSample {
            position: frame.position_in(pose.position),
            orientation: frame.orientation_in(pose.orientation),
            linear_velocity: Some(frame.velocity_in(pose.linear_velocity)),
            angular_velocity: Some(frame.torque_in(pose.angular_velocity)),
            buttons: pose.buttons,
        };
        let in_body = self.clutch.follow(&self.pose, self.pressed, self.tool.now_ns());
        self.tool.send_pose(in_body).map(|_| ())
    }

    /// Force [N] and torque [N·m] in the device's axes.
    fn render(&mut self, position: [f64; 3], velocity: [f64; 3]) -> [[f64; 3]; 2] {
        if let Some(received) = self.tool.latest_wrench().filter(|received| received.fresh) {
            self.renderer.receive(&received.wrench, received.arrival_ns);
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
        [self.frame.force_out(force), self.frame.torque_out(torque)]
    }
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// What `work` returns, or `failed`, with the reason kept for `palpate_last_error`.
fn guarded<T>(failed: T, work: impl FnOnce() -> Fallible<T>) -> T {
    let reason = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => return value,
        Ok(Err(error)) => error.to_string(),
        Err(_) => "the library panicked; this is a fault of it".to_owned(),
    };
    let reason = CString::new(reason.replace('\0', " ")).unwrap_or_default();
    LAST_ERROR.with(|last| *last.borrow_mut() = reason);
    failed
}

fn status(work: impl FnOnce() -> Fallible<()>) -> c_int {
    guarded(-1, || work().map(|()| 0))
}

/// The text at `pointer`, or `default` for NULL.
///
/// # Safety
/// `pointer` is NULL or points to text that ends with 0 and outlives `'a`.
unsafe fn text<'a>(pointer: *const c_char, default: &'a str) -> Fallible<&'a str> {
    if pointer.is_null() {
        return Ok(default);
    }
    // SAFETY: not NULL, and text by the caller's word.
    Ok(unsafe { CStr::from_ptr(pointer) }.to_str()?)
}

/// # Safety
/// `pointer` is NULL or valid for reads while `'a` lasts.
unsafe fn read<'a, T>(pointer: *const T, name: &str) -> Fallible<&'a T> {
    // SAFETY: valid by the caller's word; NULL becomes None.
    unsafe { pointer.as_ref() }.ok_or_else(|| format!("{name} is NULL").into())
}

/// # Safety
/// `pointer` is NULL or valid for reads and writes, and nobody else uses it while `'a` lasts.
unsafe fn write<'a, T>(pointer: *mut T, name: &str) -> Fallible<&'a mut T> {
    // SAFETY: valid and not shared by the caller's word; NULL becomes None.
    unsafe { pointer.as_mut() }.ok_or_else(|| format!("{name} is NULL").into())
}

/// See `palpate.h`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// See `palpate.h`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_last_error() -> *const c_char {
    LAST_ERROR.with(|last| last.borrow().as_ptr())
}

/// See `palpate.h`.
///
/// # Safety
/// The points hold 3 · `pairs` numbers each, `registration` is valid for writes, `residual` too or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_registration_fit(
    device_points: *const f64,
    body_points: *const f64,
    pairs: usize,
    scale: f64,
    registration: *mut CRegistration,
    residual: *mut f64,
) -> c_int {
    status(|| {
        if device_points.is_null() || body_points.is_null() {
            return Err("the points are NULL".into());
        }
        // SAFETY: not NULL, and 3 · pairs numbers by the caller's word; [f64; 3] is three of them without padding.
        let [device, body] =
            [device_points, body_points].map(|points| unsafe { slice::from_raw_parts(points.cast(), pairs) });
        let pairs: Vec<([f64; 3], [f64; 3])> = device.iter().copied().zip(body.iter().copied()).collect();
        // SAFETY: valid for writes by the caller's word.
        let registration = unsafe { write(registration, "registration") }?;
        let fit = Registration::fit(&pairs, (scale != 0.0).then_some(scale))?;
        *registration = (&fit.registration).into();
        // SAFETY: NULL or valid for writes by the caller's word.
        if let Some(residual) = unsafe { residual.as_mut() } {
            *residual = fit.residual;
        }
        Ok(())
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `registration` is valid for reads and writes, `device` and `body` point to three numbers each.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_registration_place(
    registration: *mut CRegistration,
    device: *const [f64; 3],
    body: *const [f64; 3],
) -> c_int {
    status(|| {
        // SAFETY: the pointers are as above by the caller's word.
        let (registration, device, body) =
            unsafe { (write(registration, "registration")?, read(device, "device")?, read(body, "body")?) };
        *registration = (&registration.checked()?.place(*device, *body)).into();
        Ok(())
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `frame` is text, `position` points to three numbers, `palpate_position` to room for as many.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_frame_position(
    frame: *const c_char,
    position: *const [f64; 3],
    palpate_position: *mut [f64; 3],
) -> c_int {
    status(|| {
        // SAFETY: the pointers are as above by the caller's word.
        let (frame, position, out) = unsafe {
            (
                text(frame, Frame::default().name)?,
                read(position, "position")?,
                write(palpate_position, "palpate_position")?,
            )
        };
        *out = Frame::by_name(frame)?.position_in(*position);
        Ok(())
    })
}

/// See `palpate.h`.
///
/// # Safety
/// Each argument is NULL or text.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_connect(
    force_endpoint: *const c_char,
    surface_endpoint: *const c_char,
    session: *const c_char,
) -> *mut Client {
    guarded(std::ptr::null_mut(), || {
        let local = Endpoints::default();
        // SAFETY: NULL or text by the caller's word.
        let (force, surface, session) = unsafe {
            (
                text(force_endpoint, &local.force)?,
                text(surface_endpoint, &local.surface)?,
                text(session, &local.session)?,
            )
        };
        let endpoints = Endpoints { force: force.into(), surface: surface.into(), session: session.into() };
        let connection = Connection::open(&endpoints)?;
        Ok(Box::into_raw(Box::new(Client { connection, held: None })))
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `attachment` is NULL or valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_attachment_defaults(attachment: *mut CAttachment) {
    let defaults = CAttachment {
        client: std::ptr::null(),
        tool: std::ptr::null(),
        rate_hz: Attachment::default().rate_hz,
        device: std::ptr::null(),
        frame: std::ptr::null(),
        render: std::ptr::null(),
        registration: (&Registration::default()).into(),
    };
    if !attachment.is_null() {
        // SAFETY: not NULL, and valid for writes by the caller's word; what was there needs no drop.
        unsafe { attachment.write(defaults) };
    }
}

/// See `palpate.h`.
///
/// # Safety
/// `client` comes from `palpate_connect` and is in use by nobody else; `attachment` is valid, its texts NULL or text.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_attach(client: *mut Client, attachment: *const CAttachment) -> c_int {
    status(|| {
        // SAFETY: the pointers are as above by the caller's word.
        let (client, attachment) = unsafe { (write(client, "client")?, read(attachment, "attachment")?) };
        // SAFETY: NULL or text by the caller's word.
        let (name, tool, device, frame, render) = unsafe {
            (
                text(attachment.client, "C client")?,
                text(attachment.tool, "")?,
                text(attachment.device, "PHANTOM Omni")?,
                text(attachment.frame, Frame::default().name)?,
                text(attachment.render, RenderMode::default().name())?,
            )
        };
        if client.held.is_some() {
            return Err("this client holds a tool already".into());
        }
        let device = if device.ends_with(".toml") { Device::from_file(device)? } else { Device::by_name(device)? };
        let (frame, mode): (_, RenderMode) = (Frame::by_name(frame)?, render.parse()?);
        let registration = attachment.registration.checked()?;
        let tool = client.connection.attach(&Attachment {
            client: name.to_owned(),
            tool: tool.to_owned(),
            rate_hz: attachment.rate_hz,
            coupling_stiffness: registration.coupling_stiffness(&device),
        })?;
        let pose = PoseSample {
            position: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: None,
            angular_velocity: None,
            buttons: 0,
        };
        let (renderer, clutch) = (Renderer::new(&registration.in_body(&device), mode), Clutch::new(registration));
        client.held = Some(Held { tool, renderer, frame, clutch, pressed: false, pose });
        Ok(())
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `client` comes from `palpate_connect` and is in use by nobody else; `pose` is valid for reads.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_send_pose(client: *mut Client, pose: *const CPose) -> c_int {
    status(|| {
        // SAFETY: the pointers are as above by the caller's word.
        let (client, pose) = unsafe { (write(client, "client")?, read(pose, "pose")?) };
        Ok(held(client)?.send_pose(pose)?)
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `client` comes from `palpate_connect` and is in use by nobody else; the others point to three numbers each; `torque`
/// may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_force(
    client: *mut Client,
    position: *const [f64; 3],
    velocity: *const [f64; 3],
    force: *mut [f64; 3],
    torque: *mut [f64; 3],
) -> c_int {
    // SAFETY: NULL or valid for writes by the caller's word.
    let (mut force, mut torque) = unsafe { (force.as_mut(), torque.as_mut()) };
    for out in [&mut force, &mut torque].into_iter().flatten() {
        **out = [0.0; 3];
    }
    status(|| {
        // SAFETY: the pointers are as above by the caller's word.
        let (client, position, velocity) =
            unsafe { (write(client, "client")?, read(position, "position")?, read(velocity, "velocity")?) };
        let rendered = held(client)?.render(*position, *velocity);
        *force.ok_or("force is NULL")? = rendered[0];
        if let Some(torque) = torque {
            *torque = rendered[1];
        }
        Ok(())
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `client` comes from `palpate_connect` and is in use by nobody else.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_clutch(client: *mut Client, pressed: c_int) -> c_int {
    status(|| {
        // SAFETY: as above by the caller's word.
        held(unsafe { write(client, "client") }?)?.pressed = pressed != 0;
        Ok(())
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `client` comes from `palpate_connect` and is in use by nobody else.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_detach(client: *mut Client) -> c_int {
    status(|| {
        // SAFETY: as above by the caller's word.
        let client = unsafe { write(client, "client") }?;
        Ok(client.held.take().ok_or(NO_TOOL)?.tool.detach()?)
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `client` is NULL or comes from `palpate_connect`, is in use by nobody else and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_close(client: *mut Client) {
    guarded((), || {
        if !client.is_null() {
            // SAFETY: it came from Box::into_raw in palpate_connect, and is not used again by the caller's word.
            drop(unsafe { Box::from_raw(client) });
        }
        Ok(())
    });
}

const NO_TOOL: &str = "this client holds no tool: call palpate_attach first";

fn held(client: &mut Client) -> Fallible<&mut Held> {
    client.held.as_mut().ok_or_else(|| NO_TOOL.into())
}

#[cfg(test)]
mod tests {
    use std::ptr::{null, null_mut};

    use super::*;

    fn last_error() -> String {
        // SAFETY: palpate_last_error returns text that lasts until the next call.
        unsafe { CStr::from_ptr(palpate_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn null_is_answered_with_an_error_that_names_it() {
        let mut force = [1.0; 3];
        // SAFETY: NULL is allowed everywhere, which is what this tests.
        unsafe {
            assert_eq!(palpate_attach(null_mut(), null()), -1);
            assert_eq!(last_error(), "client is NULL");
            assert_eq!(palpate_send_pose(null_mut(), null()), -1);
            assert_eq!(palpate_force(null_mut(), null(), null(), &mut force, null_mut()), -1);
            assert_eq!(force, [0.0; 3], "where it fails the force is zero");
            assert_eq!(palpate_clutch(null_mut(), 1), -1);
            assert_eq!(palpate_detach(null_mut()), -1);
            assert_eq!(palpate_registration_fit(null(), null(), 3, 1.0, null_mut(), null_mut()), -1);
            assert_eq!(last_error(), "the points are NULL");
            assert_eq!(palpate_registration_place(null_mut(), null(), null()), -1);
            assert_eq!(palpate_frame_position(null(), null(), null_mut()), -1);
            palpate_attachment_defaults(null_mut());
            palpate_close(null_mut());
        }
    }

    #[test]
    fn a_panic_ends_at_the_border_and_is_told() {
        assert_eq!(status(|| panic!("on purpose")), -1);
        assert!(last_error().contains("panicked"));
        assert_eq!(status(|| Ok(())), 0);
    }

    #[test]
    fn points_are_fitted_and_placed_and_frames_converted() {
        let device = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
        let body = device.map(|[x, y, z]| [0.5 * x + 1.0, 0.5 * y, 0.5 * z]);
        let mut registration = CRegistration { scale: 0.0, rotation: [0.0; 4], translation: [0.0; 3] };
        let (mut residual, mut position) = (1.0, [0.0; 3]);
        // SAFETY: every pointer is to a local of the right size.
        unsafe {
            let (device, body) = (device.as_ptr().cast(), body.as_ptr().cast());
            assert_eq!(palpate_registration_fit(device, body, 3, 0.0, &mut registration, &mut residual), 0);
            assert_eq!(palpate_registration_place(&mut registration, &[0.0; 3], &[0.0, 0.0, 0.2]), 0);
            assert_eq!(palpate_frame_position(c"unreal".as_ptr(), &[100.0, 0.0, 0.0], &mut position), 0);
            assert_eq!(palpate_frame_position(c"blender".as_ptr(), &[0.0; 3], &mut position), -1);
        }
        assert!((registration.scale - 0.5).abs() < 1e-9 && residual < 1e-9);
        assert!((registration.translation[2] - 0.2).abs() < 1e-9);
        assert_eq!(position, [0.0, 1.0, 0.0]);
        assert!(last_error().contains("\"blender\""));
    }
}
