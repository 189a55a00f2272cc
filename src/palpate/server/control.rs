//! Who holds which tool, and the requests of clients.

use super::health::Weight;
use super::queries::Desk;
use super::roles::Client;
use super::{ServerError, Shared, lock, network, recorder};
use crate::realtime::mailbox::Command;
use palpate_core::contact::tool::Coupling;
use palpate_core::simulation::{Parameter, TICK};
use palpate_proto::control_request::Request;
use palpate_proto::{self as proto, Message, keys};
use std::ops::RangeInclusive;
use std::path::{Component, Path};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::mpsc;
use zenoh::sample::{Sample, SampleKind};

/// A holder that sends nothing for this long loses its tool, whatever its connection says.
const SILENCE: Duration = Duration::from_secs(10);
/// One that has given no sign yet, neither its liveliness nor a pose, loses it after this long: it had stopped to wait for
/// the answer when it got the tool, as clients do after two seconds, and asks again.
const UNCLAIMED: Duration = Duration::from_secs(2);

/// How long a request waits for the disk: less than the two seconds for which clients wait for its answer.
const LONGEST_DISK: Duration = Duration::from_millis(1500);

/// Clients that may come or go at once.
const MOST_PRESENCES: usize = 1024;

/// Bytes of a name that somebody gives.
const MOST_NAME: usize = 64;

/// A client with a tool.
#[derive(Clone, Debug)]
struct Holder {
    client: String,
    /// What others see of this holding of the tool, in wrenches and in the key of its liveliness.
    epoch: u32,
    /// What nobody else does.
    secret: u64,
    /// Its pose numbers have jumped so often.
    jumps: u32,
    /// Its liveliness has been heard of.
    is_present: bool,
}

/// Who holds which tool.
pub(super) struct Holders {
    held: Mutex<Holding>,
}

struct Holding {
    tools: Vec<Option<Holder>>,
}

impl Holders {
    pub(super) fn new(tools: usize) -> Self {
        Self { held: Mutex::new(Holding { tools: vec![None; tools] }) }
    }

    /// Names of present clients with their tools.
    pub(super) fn clients(&self, names: impl Fn(usize) -> String) -> Vec<String> {
        let held = lock(&self.held);
        let named = held.tools.iter().enumerate();
        named.filter_map(|(i, h)| h.as_ref().map(|h| format!("{} ({})", h.client, names(i)))).collect()
    }

    /// Time since the last pose of each held tool [s], with the tool's name.
    pub(super) fn pose_ages(&self, shared: &Shared) -> Vec<(String, f64)> {
        let held: Vec<usize> = {
            let held = lock(&self.held);
            (0..held.tools.len()).filter(|tool| held.tools[*tool].is_some()).collect()
        };
        let age = |tool: usize| (shared.scene.tool[tool].name.clone(), shared.input.silence(tool).0.as_secs_f64());
        held.into_iter().map(age).collect()
    }

    fn taken(&self, tool: usize) -> bool {
        lock(&self.held).tools[tool].is_some()
    }

    /// The liveliness of the holder of `tool` under `epoch` has begun.
    fn show(&self, tool: usize, epoch: u32) {
        let mut held = lock(&self.held);
        if let Some(holder) = held.tools.get_mut(tool).and_then(Option::as_mut).filter(|h| h.epoch == epoch) {
            holder.is_present = true;
        }
    }

    /// Says which holders' pose numbers have jumped since this was asked last: such a client is damaged, or somebody sends in its
    /// name.
    pub(super) fn tell_jumps(&self, shared: &Shared) {
        for (tool, holder) in lock(&self.held).tools.iter_mut().enumerate() {
            let Some(holder) = holder else { continue };
            let jumps = shared.input.jumps(tool);
            if jumps != holder.jumps {
                tracing::warn!(
                    tool,
                    client = holder.client,
                    jumps,
                    "its pose numbers jumped back, and are followed again"
                );
                holder.jumps = jumps;
            }
        }
    }

    /// Frees tools whose holders have gone silent.
    pub(super) fn free_silent(&self, shared: &Shared) {
        let held = lock(&self.held).tools.clone();
        let silent = held.into_iter().enumerate().filter_map(|(tool, holder)| {
            let holder = holder?;
            let (silence, has_posed) = shared.input.silence(tool);
            let limit = if holder.is_present || has_posed { SILENCE } else { UNCLAIMED };
            (silence > limit).then_some((tool, holder.epoch, limit))
        });
        for (tool, epoch, limit) in silent {
            if free(shared, tool, epoch, None).is_ok() {
                tracing::info!(tool, "freed: its client has been silent for {} s", limit.as_secs());
            }
        }
    }

    /// Frees tools whose holders flood the server with poses: it takes one a tick, and the others cost it time.
    pub(super) fn free_flooded(&self, shared: &Shared) {
        let held = lock(&self.held).tools.clone();
        for (tool, holder) in held.into_iter().enumerate() {
            let Some(holder) = holder.filter(|_| shared.input.is_flooded(tool)) else { continue };
            if free(shared, tool, holder.epoch, None).is_ok() {
                tracing::warn!(tool, client = holder.client, "freed: its client sends more poses than any device has");
            }
        }
    }
}

/// Answers the session description, what clients may do and their requests until `session` closes.
pub(super) async fn serve(shared: &Arc<Shared>, session: &zenoh::Session, desk: &Desk) -> Result<(), ServerError> {
    let name = &shared.options.session;
    let about = shared.clone();
    desk.offer(session, keys::session_of_any_version(name), move |key, _| {
        let answer = describe(&about).encode_to_vec();
        std::future::ready(vec![(key, answer.into())])
    })
    .await?;
    // The asker's own is the only one that the router passes on to it, beside that of nobody.
    let roles = shared.clients.describe().into_iter().map(|role| (keys::role(name, &role.name), role.encode_to_vec()));
    let roles: Vec<_> = roles.collect();
    desk.offer(session, keys::all_roles(name), move |_, _| {
        std::future::ready(roles.iter().map(|(key, role)| (key.clone(), role.clone().into())).collect())
    })
    .await?;
    let shared = shared.clone();
    desk.offer(session, keys::all_control(name), move |key, bytes| {
        let shared = shared.clone();
        async move {
            let reply = match proto::ControlRequest::decode(&bytes[..]) {
                Ok(request) => carry_out(&shared, &key, request).await,
                Err(e) => Err(format!("not a control request: {e}")),
            };
            let reply = reply.unwrap_or_else(|error| proto::ControlReply { error, ..Default::default() });
            vec![(key, reply.encode_to_vec().into())]
        }
    })
    .await
}

/// Frees the tool of every client whose liveliness ends.
pub(super) async fn watch_presence(
    shared: &Arc<Shared>,
    session: &zenoh::Session,
) -> Result<tokio::task::JoinHandle<()>, ServerError> {
    let key = keys::all_presence(&shared.options.session);
    // Where more come than can be looked at, the silence of a client frees its tool.
    let (seen, mut presence) = mpsc::channel(MOST_PRESENCES);
    let callback = move |sample: Sample| drop(seen.try_send(sample));
    session.liveliness().declare_subscriber(key).callback(callback).background().await.map_err(network)?;
    let shared = shared.clone();
    Ok(shared.clone().health.spawn("the task of presence", Weight::Fails, async move {
        while let Some(sample) = presence.recv().await {
            let holder = keys::holder_of_presence_key(sample.key_expr().as_str());
            let Some((tool, epoch)) = holder else { continue };
            match sample.kind() {
                SampleKind::Put => shared.holders.show(tool as usize, epoch),
                SampleKind::Delete if free(&shared, tool as usize, epoch, None).is_ok() => {
                    tracing::info!(tool, "freed: its client is gone");
                }
                SampleKind::Delete => {}
            }
        }
    }))
}

/// Carries out a request that came on `key`. The router has let it pass, so the client whose name the key has made it.
async fn carry_out(
    shared: &Arc<Shared>,
    key: &str,
    request: proto::ControlRequest,
) -> Result<proto::ControlReply, String> {
    let request = request.request.ok_or("an empty control request: it is of a later version, or damaged")?;
    let asked = keys::action(&request);
    let asker = keys::asker_of_control_key(key).filter(|(action, _)| *action == asked);
    let (action, who) = asker.ok_or_else(|| format!("a request to {asked} on {key}"))?;
    let client = shared.clients.who_may(action, who).ok_or_else(|| format!("{who} may not {action}"))?;
    let mut reply = proto::ControlReply::default();
    match request {
        Request::Attach(attach) => reply.attached = Some(take(shared, who, client, &attach)?),
        Request::Detach(d) => {
            free(shared, d.tool as usize, d.epoch, Some(d.secret))?;
            tracing::info!(tool = d.tool, who, "given back");
        }
        Request::Reset(_) => {
            shared.command(Command::Reset)?;
            tracing::info!(who, "body reset");
        }
        Request::Set(set) => {
            let named = |p: &proto::Parameter| shared.scene.parameters_named(&p.name, &p.values);
            let parameters = set.parameters.iter().map(named).collect::<Result<Vec<_>, _>>()?.concat();
            shared.set(&parameters)?;
            tracing::info!(who, ?parameters, "parameters set");
        }
        Request::StartRecording(start) => {
            let path = shared.options.recordings.join(plain_name(&start.path)?);
            tracing::info!(who, "asks for a recording");
            recorder::start(shared, path, LONGEST_DISK).await?;
            reply.recording = shared.recorder.status();
        }
        Request::StopRecording(_) => {
            tracing::info!(who, "ends the recording");
            recorder::expect_end(shared);
            shared.command(Command::StopRecording)?;
            reply.recording = Some(recorder::finish(shared, LONGEST_DISK).await.ok_or("no recording is running")?);
        }
    }
    Ok(reply)
}

/// `name`, where it is that of a file and of nothing else: in no folder, not hidden, and fit for a log.
fn plain_name(name: &str) -> Result<&str, String> {
    let mut parts = Path::new(name).components();
    let is_one = matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None));
    if is_one && name.len() <= MOST_NAME && !name.starts_with('.') && !name.chars().any(char::is_control) {
        return Ok(name);
    }
    Err(format!(
        "give the name of a new file below the server's recordings folder: {MOST_NAME} bytes at most, no folder in it, no \
         control characters"
    ))
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

fn take(shared: &Shared, who: &str, client: &Client, attach: &proto::Attach) -> Result<proto::Attached, String> {
    if !(10.0..=2000.0).contains(&attach.rate_hz) {
        return Err(format!("rate_hz is {}: declare how often poses come, 10 to 2000", attach.rate_hz));
    }
    // An error repeats the names that it is about, and the log has them, too.
    let is_plain = |name: &str| name.len() <= MOST_NAME && !name.chars().any(char::is_control);
    if !is_plain(&attach.client) || !is_plain(&attach.tool) {
        return Err(format!("names of clients and tools have at most {MOST_NAME} bytes, and no control characters"));
    }
    let (stiffness, angular) = (attach.coupling_stiffness, attach.coupling_angular_stiffness);
    let coupling = Coupling {
        compliance: compliance("coupling_stiffness", stiffness, "N/m", COUPLINGS)?,
        angular_compliance: compliance("coupling_angular_stiffness", angular, "N·m/rad", ANGULAR_COUPLINGS)?,
    };
    let mut held = lock(&shared.holders.held);
    let name = |tool: usize| shared.scene.tool[tool].name.as_str();
    let mut own = client.tools.iter().map(|tool| *tool as usize);
    let tool = if attach.tool.is_empty() {
        own.find(|tool| held.tools[*tool].is_none()).ok_or("every tool is taken")?
    } else {
        let names = own.clone().map(name).collect::<Vec<_>>().join(", ");
        let tool = own.find(|tool| name(*tool) == attach.tool);
        let tool = tool.ok_or_else(|| format!("no tool {:?}: there is {names} for you", attach.tool))?;
        if let Some(holder) = &held.tools[tool] {
            return Err(format!("tool {:?} is held by {}", attach.tool, holder.client));
        }
        tool
    };
    // Random, so that neither can be guessed, and an epoch of an earlier run of the server does not come again.
    let random = || getrandom::u64().map_err(|e| format!("the system has no random numbers: {e}"));
    let epoch = (random()? as u32).max(1);
    let secret = random()?.max(1);
    let period_ticks = ((1.0 / (attach.rate_hz * TICK)).round() as u32).max(1);
    shared.command(Command::Attach { tool, epoch, period_ticks, coupling })?;
    shared.input.admit(tool, epoch, secret);
    held.tools[tool] = Some(Holder { client: attach.client.clone(), epoch, secret, jumps: 0, is_present: false });
    tracing::info!(tool, who, client = attach.client, rate_hz = attach.rate_hz, "taken");
    Ok(proto::Attached { tool: tool as u32, epoch, secret })
}

/// Frees `tool`, which is held under `epoch`; whoever asks for it has to know its `secret`.
fn free(shared: &Shared, tool: usize, epoch: u32, secret: Option<u64>) -> Result<(), String> {
    let mut held = lock(&shared.holders.held);
    let is_it = |holder: &Holder| holder.epoch == epoch && secret.is_none_or(|secret| secret == holder.secret);
    let holds = held.tools.get(tool).and_then(Option::as_ref).is_some_and(is_it);
    if !holds {
        return Err(format!("tool {tool} is not held under epoch {epoch}"));
    }
    shared.command(Command::Detach { tool })?;
    shared.input.admit(tool, 0, 0);
    held.tools[tool] = None;
    Ok(())
}

fn describe(shared: &Shared) -> proto::Session {
    let mut session = shared.session.clone();
    for tool in &mut session.tools {
        tool.taken = shared.holders.taken(tool.tool as usize);
    }
    proto::Session {
        name: shared.options.session.clone(),
        tick: shared.counters.tick.load(Ordering::Relaxed),
        surface_endpoint: shared.options.surface_endpoint.clone(),
        parameters: describe_parameters(shared),
        ..session
    }
}

fn describe_parameters(shared: &Shared) -> Vec<proto::ParameterDescription> {
    let set = lock(&shared.parameters);
    let describe = |parameter: Parameter| {
        let now = set.iter().find(|set| set.is_same_quantity(&parameter)).unwrap_or(&parameter);
        let range = shared.ranges.of(&shared.body, now, &set)?;
        let (least, most) = (*range.start(), *range.end());
        let name = shared.scene.parameter_name(now);
        Some(proto::ParameterDescription { name, values: now.values(), least, most })
    };
    shared.scene.parameters().into_iter().filter_map(describe).collect()
}
