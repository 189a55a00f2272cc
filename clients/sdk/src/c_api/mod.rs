//! The C interface: what `include/palpate.h` declares, which also documents it.
//!
//! Nothing here has a rule of its own: it checks pointers, turns text and numbers, and calls the crate. Panics end at
//! this border.

mod border;
mod client;
mod session;
mod watch;

use std::{
    ffi::{c_char, c_int},
    slice,
};

use border::{guarded, last_error, read, status, text, write};
use client::{CAttachment, CPose, CRegistration, CToolState, Client, Held};

use crate::{Attachment, Connection, Device, Endpoints, Frame, Registration, RenderMode};

/// See `palpate.h`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// See `palpate.h`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_last_error() -> *const c_char {
    last_error()
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
    identity: *const c_char,
) -> *mut Client {
    guarded(std::ptr::null_mut(), || {
        // SAFETY: NULL or text by the caller's word.
        let (force, others) = unsafe {
            (
                text(force_endpoint, &Endpoints::default().force)?.to_owned(),
                watch::surface_endpoints(surface_endpoint, session, identity)?,
            )
        };
        let endpoints = Endpoints { force, ..others };
        Ok(Client::boxed(Connection::open(&endpoints)?))
    })
}

/// See `palpate.h`.
///
/// # Safety
/// Each argument is NULL or text.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_connect_surface(
    surface_endpoint: *const c_char,
    session: *const c_char,
    identity: *const c_char,
) -> *mut Client {
    guarded(std::ptr::null_mut(), || {
        // SAFETY: NULL or text by the caller's word.
        let endpoints = unsafe { watch::surface_endpoints(surface_endpoint, session, identity) }?;
        Ok(Client::boxed(Connection::open_surface(&endpoints)?))
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
            tool: tool.to_owned(),
            rate_hz: attachment.rate_hz,
            ..Attachment::of(name, &device, &registration)
        })?;
        client.held = Some(Held::new(tool, &device, frame, mode, registration));
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
        Ok(client.held()?.send_pose(pose)?)
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
        let rendered = client.held()?.render(*position, *velocity)?;
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
/// `client` comes from `palpate_connect` and is in use by nobody else; `state` is valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_state(client: *mut Client, state: *mut CToolState) -> c_int {
    status(|| {
        // SAFETY: the pointers are as above by the caller's word.
        let (client, state) = unsafe { (write(client, "client")?, write(state, "state")?) };
        *state = client.held()?.state();
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
        let held = unsafe { write(client, "client") }?.held()?;
        held.pressed = pressed != 0;
        Ok(held.tool.check(held.tool.now_ns())?)
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
        unsafe { write(client, "client") }?.detach()
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

#[cfg(test)]
mod tests {
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    use super::*;

    fn said() -> String {
        // SAFETY: palpate_last_error returns text that lasts until the next call.
        unsafe { CStr::from_ptr(palpate_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn null_is_answered_with_an_error_that_names_it() {
        let mut force = [1.0; 3];
        // SAFETY: NULL is allowed everywhere, which is what this tests.
        unsafe {
            assert_eq!(palpate_attach(null_mut(), null()), -1);
            assert_eq!(said(), "client is NULL");
            assert_eq!(palpate_send_pose(null_mut(), null()), -1);
            assert_eq!(palpate_force(null_mut(), null(), null(), &mut force, null_mut()), -1);
            assert_eq!(force, [0.0; 3], "where it fails the force is zero");
            assert_eq!(palpate_clutch(null_mut(), 1), -1);
            assert_eq!(palpate_state(null_mut(), null_mut()), -1);
            assert_eq!(session::palpate_session(null_mut(), null_mut()), -1);
            assert_eq!(session::palpate_status(null_mut(), null_mut()), -1);
            assert_eq!(watch::palpate_watch_latest(null_mut(), null_mut()), -1);
            assert_eq!(said(), "watch is NULL");
            watch::palpate_watch_close(null_mut());
            assert_eq!(palpate_detach(null_mut()), -1);
            assert_eq!(palpate_registration_fit(null(), null(), 3, 1.0, null_mut(), null_mut()), -1);
            assert_eq!(said(), "the points are NULL");
            assert_eq!(palpate_registration_place(null_mut(), null(), null()), -1);
            assert_eq!(palpate_frame_position(null(), null(), null_mut()), -1);
            palpate_attachment_defaults(null_mut());
            palpate_close(null_mut());
        }
    }

    #[test]
    fn a_panic_ends_at_the_border_and_is_told() {
        assert_eq!(status(|| panic!("on purpose")), -1);
        assert!(said().contains("panicked"));
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
        assert!(said().contains("\"blender\""));
    }
}
