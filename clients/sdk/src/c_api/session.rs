//! What the server has and how it is doing, for C: texts and lists laid out as the header says and kept until the next call.

use std::{
    ffi::{CString, c_char, c_int},
    sync::{Arc, Mutex, PoisonError},
};

use super::{
    border::{Fallible, guarded, status, write},
    client::Client,
};
use crate::{Connection, Session, Status, Subscription};

/// `palpate_tool`.
#[repr(C)]
pub struct CTool {
    tool: u32,
    taken: i32,
    name: *const c_char,
    shape: *const c_char,
    radius: f64,
    length: f64,
}

/// `palpate_session_info`.
#[repr(C)]
pub struct CSession {
    version_major: u32,
    version_minor: u32,
    name: *const c_char,
    body: *const c_char,
    tick: u64,
    mass: f64,
    bounds: [f64; 6],
    workspace: [f64; 6],
    force_limit: f64,
    torque_limit: f64,
    tools: usize,
    tool_list: *const CTool,
}

/// `palpate_server_status`.
#[repr(C)]
pub struct CStatus {
    tick: u64,
    tick_rate_hz: f64,
    age: f64,
    lateness: f64,
    compute: f64,
    missed_deadlines: u64,
    lapsed_ticks: u64,
    unmoved_ticks: u64,
    restored_states: u64,
    refused: u64,
    nodes: u64,
    elements: u64,
    clients: u64,
}

/// What C has pointers into.
pub(super) struct Described {
    /// Name and body, then name and shape of each tool.
    texts: Vec<CString>,
    tools: Vec<CTool>,
}

impl Described {
    fn new(session: &Session) -> Self {
        let body = session.body.as_ref().map_or("", |body| &body.name);
        let tools = session.tools.iter().flat_map(|tool| [&*tool.name, &*tool.shape]);
        let texts = [&*session.name, body].into_iter().chain(tools);
        let texts: Vec<CString> = texts.map(|text| CString::new(text.replace('\0', " ")).unwrap_or_default()).collect();
        let tools = session.tools.iter().zip(texts[2..].chunks_exact(2)).map(|(tool, texts)| CTool {
            tool: tool.tool,
            taken: tool.taken.into(),
            name: texts[0].as_ptr(),
            shape: texts[1].as_ptr(),
            radius: tool.radius,
            length: tool.length,
        });
        let tools = tools.collect();
        Self { texts, tools }
    }

    fn laid_out(&self, session: &Session) -> CSession {
        let (body, limits) = (session.body.as_ref(), session.limits.as_ref());
        let six = |numbers: Option<&Vec<f64>>| numbers.and_then(|n| (**n).try_into().ok()).unwrap_or_default();
        CSession {
            version_major: session.version_major,
            version_minor: session.version_minor,
            name: self.texts[0].as_ptr(),
            body: self.texts[1].as_ptr(),
            tick: session.tick,
            mass: body.map_or(0.0, |body| body.mass_kg),
            bounds: six(body.map(|body| &body.bounds)),
            workspace: six(limits.map(|limits| &limits.workspace)),
            force_limit: limits.map_or(0.0, |limits| limits.force),
            torque_limit: limits.map_or(0.0, |limits| limits.torque),
            tools: self.tools.len(),
            tool_list: self.tools.as_ptr(),
        }
    }
}

/// The newest status of the server.
pub(super) struct StatusFeed {
    /// With its arrival [ns].
    newest: Arc<Mutex<Option<(Status, u64)>>>,
    _subscription: Subscription,
}

impl StatusFeed {
    fn new(connection: &Connection) -> Fallible<Self> {
        let newest = Arc::<Mutex<Option<(Status, u64)>>>::default();
        let (to, opened) = (newest.clone(), connection.opened());
        let subscription = connection.subscribe_status(move |status| {
            let arrival = crate::connection::nanoseconds_since(opened);
            *to.lock().unwrap_or_else(PoisonError::into_inner) = Some((status, arrival));
        })?;
        Ok(Self { newest, _subscription: subscription })
    }

    fn laid_out(&self, now_ns: u64) -> Option<CStatus> {
        let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        let (status, arrival) = newest.as_ref()?;
        let p99 = |of: &Option<palpate_proto::Distribution>| of.as_ref().map_or(0.0, |of| 1e-6 * of.p99);
        Some(CStatus {
            tick: status.tick,
            tick_rate_hz: status.tick_rate_hz,
            age: now_ns.saturating_sub(*arrival) as f64 * 1e-9,
            lateness: p99(&status.lateness_us),
            compute: p99(&status.compute_us),
            missed_deadlines: status.missed_deadlines,
            lapsed_ticks: status.lapsed_ticks,
            unmoved_ticks: status.unmoved_ticks,
            restored_states: status.restored_states,
            refused: status.refused.iter().map(|refusal| refusal.count).sum(),
            nodes: status.nodes,
            elements: status.elements,
            clients: status.clients.len() as u64,
        })
    }
}

/// See `palpate.h`.
///
/// # Safety
/// `client` comes from `palpate_connect` and is in use by nobody else; `session` is valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session(client: *mut Client, session: *mut CSession) -> c_int {
    status(|| {
        // SAFETY: the pointers are as above by the caller's word.
        let (client, out) = unsafe { (write(client, "client")?, write(session, "session")?) };
        let session = client.connection.session()?;
        *out = client.described.insert(Described::new(&session)).laid_out(&session);
        Ok(())
    })
}

/// See `palpate.h`.
///
/// # Safety
/// `client` comes from `palpate_connect` and is in use by nobody else; `status` is valid for writes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_status(client: *mut Client, status: *mut CStatus) -> c_int {
    guarded(-1, || {
        // SAFETY: the pointers are as above by the caller's word.
        let (client, out) = unsafe { (write(client, "client")?, write(status, "status")?) };
        let feed = match &mut client.status {
            Some(feed) => feed,
            none => none.insert(StatusFeed::new(&client.connection)?),
        };
        let Some(newest) = feed.laid_out(client.connection.now_ns()) else { return Ok(0) };
        *out = newest;
        Ok(1)
    })
}
