//! The surface for C: what came last, laid out as the header says and kept until the next call.

use std::{
    ffi::{c_char, c_int},
    sync::Arc,
};

use super::border::{Fallible, folder, guarded, text, write};
use crate::{Connection, Endpoints, Moment, Surface, SurfaceWatch, WatchOptions};

/// `palpate_watch`.
pub struct Watch {
    watch: SurfaceWatch,
    /// What C has pointers into.
    shown: Option<Shown>,
}

struct Shown {
    surface: Arc<Surface>,
    moment: Arc<Moment>,
    normals: Vec<[f32; 3]>,
    tools: Vec<CShownTool>,
}

/// `palpate_shown_tool`.
#[repr(C)]
pub struct CShownTool {
    tool: u32,
    phase: i32,
    position: [f32; 3],
    orientation: [f32; 4],
    force: [f32; 3],
}

/// `palpate_surface`.
#[repr(C)]
pub struct CSurface {
    topology: u32,
    tick: u64,
    sequence: u64,
    vertices: usize,
    triangles: usize,
    tools: usize,
    positions: *const f32,
    normals: *const f32,
    indices: *const u32,
    levels: *const u8,
    shown_tools: *const CShownTool,
}

/// `list` as an array; zeros where it has another length.
fn array<const N: usize>(list: &[f32]) -> [f32; N] {
    list.try_into().unwrap_or([0.0; N])
}

impl Shown {
    fn new(surface: Arc<Surface>, moment: Arc<Moment>) -> Self {
        let tools = moment.tools.iter().map(|tool| CShownTool {
            tool: tool.tool,
            phase: tool.phase,
            position: array(&tool.position),
            orientation: array(&tool.orientation),
            force: array(&tool.force),
        });
        Self { tools: tools.collect(), normals: surface.normals(&moment.positions), surface, moment }
    }

    fn laid_out(&self) -> CSurface {
        let Moment { topology, tick, sequence, positions, levels, .. } = &*self.moment;
        CSurface {
            topology: *topology,
            tick: *tick,
            sequence: *sequence,
            vertices: positions.len(),
            triangles: self.surface.triangles.len(),
            tools: self.tools.len(),
            positions: positions.as_ptr().cast(),
            normals: self.normals.as_ptr().cast(),
            indices: self.surface.triangles.as_ptr().cast(),
            levels: if levels.is_empty() { std::ptr::null() } else { levels.as_ptr() },
            shown_tools: self.tools.as_ptr(),
        }
    }
}

/// Where the surface is; NULL means that of a server on this machine, which asks for no certificate.
///
/// # Safety
/// Each is NULL or text.
pub(super) unsafe fn surface_endpoints(
    surface: *const c_char,
    session: *const c_char,
    identity: *const c_char,
) -> Fallible<Endpoints> {
    let local = Endpoints::default();
    // SAFETY: NULL or text by the caller's word.
    let (surface, session, identity) =
        unsafe { (text(surface, &local.surface)?, text(session, &local.session)?, folder(identity)?) };
    Ok(Endpoints { surface: surface.into(), session: session.into(), identity, ..local.clone() })
}

/// See `palpate.h`.
///
/// # Safety
/// The texts are NULL or text.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_watch_open(
    surface_endpoint: *const c_char,
    session: *const c_char,
    identity: *const c_char,
    every: u32,
    levels: c_int,
) -> *mut Watch {
    guarded(std::ptr::null_mut(), || {
        // SAFETY: NULL or text by the caller's word.
        let endpoints = unsafe { surface_endpoints(surface_endpoint, session, identity) }?;
        let options = WatchOptions { every, levels: levels != 0 };
        let watch = Connection::open_surface(&endpoints)?.watch_surface(options)?;
        Ok(Box::into_raw(Box::new(Watch { watch, shown: None })))
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `watch` comes from `palpate_watch_open` and is in use by nobody else; `surface` is valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_watch_latest(watch: *mut Watch, surface: *mut CSurface) -> c_int {
    guarded(-1, || {
        // SAFETY: the pointers are as above by the caller's word.
        let (watch, out) = unsafe { (write(watch, "watch")?, write(surface, "surface")?) };
        let (latest, surface) = (watch.watch.latest(), watch.watch.surface());
        // Between two surfaces the newest moment may be of the older one.
        let Some(moment) = latest.filter(|moment| moment.topology == surface.topology) else { return Ok(0) };
        if watch.shown.as_ref().is_some_and(|shown| Arc::ptr_eq(&shown.moment, &moment)) {
            return Ok(0);
        }
        *out = watch.shown.insert(Shown::new(surface, moment)).laid_out();
        Ok(1)
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `watch` is NULL or comes from `palpate_watch_open`, is in use by nobody else and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_watch_close(watch: *mut Watch) {
    guarded((), || {
        if !watch.is_null() {
            // SAFETY: it came from Box::into_raw in palpate_watch_open, and is not used again by the caller's word.
            drop(unsafe { Box::from_raw(watch) });
        }
        Ok(())
    });
}
