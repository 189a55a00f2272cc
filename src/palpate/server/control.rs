//! Who holds which tool, and the requests of clients.

use super::{ServerError, Shared, lock, network, recorder};
use crate::realtime::mailbox::Command;
use crate::wire;
use palpate_core::contact::tool::Coupling;
use palpate_core::simulation::TICK;
use palpate_proto::control_request::Request;
use palpate_proto::{self as proto, Message, keys};
use std::ops::RangeInclusive;
use std::path::{Component, Path};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use zenoh::query::Query;
use zenoh::sample::SampleKind;

/// A holder that sends nothing for this long loses its tool, whatever its connection says.
const SILENCE: Duration = Duration::from_secs(10);

/// A client with a tool.
#[derive(Clone, Debug)]
struct Holder {
    client: String,
    epoch: u32,
}

/// Who holds which tool.
pub(super) struct Holders {
    held: Mutex<Holding>,
}

struct Holding {
    tools: Vec<Option<Holder>>,
    next_epoch: u32,
}

impl Holders {
    pub(super) fn new(tools: usize) -> Self {
        // Epochs of an earlier run of the server must not come again: start at the seconds of this one.
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
        let next_epoch = (seconds as u32).wrapping_mul(16) | 1;
        Self { held: Mutex::new(Holding { tools: vec![None; tools], next_epoch }) }
    }

    /// Names of present clients with their tools.
    pub(super) fn clients(&self, names: impl Fn(usize) -> String) -> Vec<String> {
        let held = lock(&self.held);
        let named = held.tools.iter().enumerate();
        named.filter_map(|(i, h)| h.as_ref().map(|h| format!("{} ({})", h.client, names(i)))).collect()
    }

    fn taken(&self, tool: usize) -> bool {
        lock(&self.held).tools[tool].is_some()
    }

    /// Frees tools whose holders have gone silent.
    pub(super) fn free_silent(&self, shared: &Shared) {
        let silent: Vec<(usize, u32)> = lock(&self.held)
            .tools
            .iter()
            .enumerate()
            .filter_map(|(i, h)| h.as_ref().map(|h| (i, h.epoch)))
            .filter(|(i, _)| shared.input.silence(*i) > SILENCE)
            .collect();
        for (tool, epoch) in silent {
            if free(shared, tool, epoch).is_ok() {
                tracing::info!(tool, "freed: its client has been silent for {} s", SILENCE.as_secs());
            }
        }
    }
}

/// Answers the session description and control requests until it is aborted.
pub(super) async fn serve(
    shared: &Arc<Shared>,
    session: &zenoh::Session,
) -> Result<tokio::task::JoinHandle<()>, ServerError> {
    let name = &shared.options.session;
    let about = session.declare_queryable(keys::session_of_any_version(name)).await.map_err(network)?;
    let control = session.declare_queryable(keys::control(name)).await.map_err(network)?;
    let shared = shared.clone();
    Ok(tokio::spawn(async move {
        loop {
            tokio::select! {
                Ok(query) = about.recv_async() => answer(&query, describe(&shared).encode_to_vec()).await,
                Ok(query) = control.recv_async() => {
                    let bytes = query.payload().map(|p| p.to_bytes().into_owned()).unwrap_or_default();
                    let reply = match proto::ControlRequest::decode(&bytes[..]) {
                        Ok(request) => carry_out(&shared, request).await,
                        Err(e) => Err(format!("not a control request: {e}")),
                    };
                    let reply = reply.unwrap_or_else(|error| proto::ControlReply { error, ..Default::default() });
                    answer(&query, reply.encode_to_vec()).await;
                }
                else => return,
            }
        }
    }))
}

async fn answer(query: &Query, payload: Vec<u8>) {
    if let Err(e) = query.reply(query.key_expr().clone(), payload).await {
        tracing::debug!("a query went unanswered: {e}");
    }
}

/// Frees the tool of every client whose liveliness ends.
pub(super) async fn watch_presence(
    shared: &Arc<Shared>,
    session: &zenoh::Session,
) -> Result<tokio::task::JoinHandle<()>, ServerError> {
    let presence =
        session.liveliness().declare_subscriber(keys::all_presence(&shared.options.session)).await.map_err(network)?;
    let shared = shared.clone();
    Ok(tokio::spawn(async move {
        while let Ok(sample) = presence.recv_async().await {
            let holder = keys::holder_of_presence_key(sample.key_expr().as_str());
            if let (SampleKind::Delete, Some((tool, epoch))) = (sample.kind(), holder)
                && free(&shared, tool as usize, epoch).is_ok()
            {
                tracing::info!(tool, "freed: its client is gone");
            }
        }
    }))
}

async fn carry_out(shared: &Arc<Shared>, request: proto::ControlRequest) -> Result<proto::ControlReply, String> {
    let mut reply = proto::ControlReply::default();
    match request.request.ok_or("an empty control request: it is of a later version, or damaged")? {
        Request::Attach(attach) => reply.attached = Some(take(shared, &attach)?),
        Request::Detach(d) => free(shared, d.tool as usize, d.epoch)?,
        Request::Reset(_) => shared.command(Command::Reset)?,
        Request::StartRecording(start) => {
            let path = Path::new(&start.path);
            let plain = !start.path.is_empty() && path.components().all(|c| matches!(c, Component::Normal(_)));
            if !plain {
                return Err(format!("{:?}: give a file name below the server's recordings folder", start.path));
            }
            let path = shared.options.recordings.join(path);
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
            }
            recorder::start(shared, path).await?;
            reply.recording = shared.recorder.status();
        }
        Request::StopRecording(_) => {
            recorder::expect_end(shared);
            shared.command(Command::StopRecording)?;
            reply.recording = Some(recorder::finish(shared).await.ok_or("no recording is running")?);
        }
    }
    Ok(reply)
}

/// Stiffnesses of virtual couplings [N/m], [N·m/rad]: softer ones let go of the tool, stiffer ones are rigid.
const COUPLINGS: RangeInclusive<f64> = 10.0..=1e6;
const ANGULAR_COUPLINGS: RangeInclusive<f64> = 0.01..=1e3;

/// The compliance of a spring of `stiffness` [`unit`]; 0 for one of 0, which is none.
fn compliance(name: &str, stiffness: f64, unit: &str, allowed: RangeInclusive<f64>) -> Result<f64, String> {
    if stiffness == 0.0 {
        return Ok(0.0);
    }
    if !allowed.contains(&stiffness) {
        let (least, most) = (allowed.start(), allowed.end());
        return Err(format!("{name} is {stiffness} {unit}: 0 holds the tool rigidly, else {least} to {most}"));
    }
    Ok(1.0 / stiffness)
}

fn take(shared: &Shared, attach: &proto::Attach) -> Result<proto::Attached, String> {
    if !(10.0..=2000.0).contains(&attach.rate_hz) {
        return Err(format!("rate_hz is {}: declare how often poses come, 10 to 2000", attach.rate_hz));
    }
    if attach.client.len() > 64 {
        return Err("client names have at most 64 bytes".into());
    }
    let (stiffness, angular) = (attach.coupling_stiffness, attach.coupling_angular_stiffness);
    let coupling = Coupling {
        compliance: compliance("coupling_stiffness", stiffness, "N/m", COUPLINGS)?,
        angular_compliance: compliance("coupling_angular_stiffness", angular, "N·m/rad", ANGULAR_COUPLINGS)?,
    };
    let mut held = lock(&shared.holders.held);
    let names = || shared.scene.tool.iter().map(|t| t.name.as_str()).collect::<Vec<_>>().join(", ");
    let tool = if attach.tool.is_empty() {
        held.tools.iter().position(Option::is_none).ok_or("every tool is taken")?
    } else {
        let tool = shared.scene.tool.iter().position(|t| t.name == attach.tool);
        let tool = tool.ok_or_else(|| format!("no tool {:?}: this session has {}", attach.tool, names()))?;
        if let Some(holder) = &held.tools[tool] {
            return Err(format!("tool {:?} is held by {}", attach.tool, holder.client));
        }
        tool
    };
    let epoch = held.next_epoch;
    held.next_epoch = held.next_epoch.wrapping_add(1).max(1);
    let period_ticks = ((1.0 / (attach.rate_hz * TICK)).round() as u32).max(1);
    shared.command(Command::Attach { tool, epoch, period_ticks, coupling })?;
    shared.input.admit(tool, epoch);
    held.tools[tool] = Some(Holder { client: attach.client.clone(), epoch });
    tracing::info!(tool, client = attach.client, rate_hz = attach.rate_hz, "taken");
    Ok(proto::Attached { tool: tool as u32, epoch })
}

fn free(shared: &Shared, tool: usize, epoch: u32) -> Result<(), String> {
    let mut held = lock(&shared.holders.held);
    let holds = held.tools.get(tool).and_then(Option::as_ref).is_some_and(|h| h.epoch == epoch);
    if !holds {
        return Err(format!("tool {tool} is not held under epoch {epoch}"));
    }
    shared.command(Command::Detach { tool })?;
    shared.input.admit(tool, 0);
    held.tools[tool] = None;
    Ok(())
}

fn describe(shared: &Shared) -> proto::Session {
    let mut session = wire::session::describe(&shared.scene, &shared.body);
    for tool in &mut session.tools {
        tool.taken = shared.holders.taken(tool.tool as usize);
    }
    proto::Session {
        name: shared.options.session.clone(),
        tick: shared.counters.tick.load(Ordering::Relaxed),
        surface_endpoint: shared.options.surface_endpoint.clone(),
        ..session
    }
}
