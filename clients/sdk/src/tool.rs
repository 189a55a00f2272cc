//! A tool in the hand: poses out, wrenches in.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
};

use palpate_client::{
    ClientError, Device, Grip, Hold, Order, PoseSample, Registration, Verdict, Wrench, watchdog_scale,
};
use palpate_proto::{Attach, Detach, Message, ToolPhase, ToolWrench, VERSION_MINOR, control_request::Request, keys};
use triple_buffer::triple_buffer;
use zenoh::{
    Wait,
    liveliness::LivelinessToken,
    pubsub::{Publisher, Subscriber},
};

use crate::{
    Connection, SdkError,
    connection::{nanoseconds_since, realtime_publisher},
    error::reason,
};

/// How to take a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Attachment {
    /// A name for people.
    pub client: String,
    /// Name of the tool to take; empty for any free one.
    pub tool: String,
    /// How often poses will come [Hz]: 1000 for a haptic device, 72 to 90 for a headset.
    pub rate_hz: f64,
    /// Stiffness of the virtual coupling [N/m] between the device and the simulated tool: the stiffest that the device
    /// renders, in body space. 0 holds the tool rigidly, for those who only move it.
    pub coupling_stiffness: f64,
    /// Its angular stiffness [N·m/rad] about the tool's reference point; 0 leaves the tool the orientation of the device.
    pub coupling_angular_stiffness: f64,
}

impl Attachment {
    /// Any free tool for `client`, 1000 poses a second, as stiff as `device` can render it where it is registered.
    pub fn of(client: &str, device: &Device, registration: &Registration) -> Self {
        Self {
            client: client.to_owned(),
            coupling_stiffness: registration.coupling_stiffness(device),
            coupling_angular_stiffness: device.max_angular_stiffness,
            ..Self::default()
        }
    }
}

impl Default for Attachment {
    /// Any free tool, held rigidly, 1000 poses a second, by nobody in particular.
    fn default() -> Self {
        Self {
            client: "client".to_owned(),
            tool: String::new(),
            rate_hz: 1000.0,
            coupling_stiffness: 0.0,
            coupling_angular_stiffness: 0.0,
        }
    }
}

/// The newest wrench that has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received {
    /// What it says.
    pub wrench: Wrench,
    /// When it came [ns], on the clock of [`Connection::now_ns`].
    pub arrival_ns: u64,
    /// True when [`Tool::latest_wrench`] had not returned it before.
    pub fresh: bool,
}

/// What became of the wrenches of a tool, since it was attached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Wrenches received.
    pub received: u64,
    /// Sequence numbers that never came.
    pub missed: u64,
    /// Messages that are no wrench.
    pub undecodable: u64,
    /// Wrenches of another epoch, ignored.
    pub foreign: u64,
    /// Wrenches that no server sends, ignored: see [`Verdict::Implausible`].
    pub implausible: u64,
}

/// How a tool is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToolStatus {
    /// Whether it is still in the hand.
    pub hold: Hold,
    /// Phase of the newest wrench; detached before the first.
    pub phase: ToolPhase,
    /// Bits of `WrenchFlag` of the newest wrench.
    pub flags: u32,
    /// Age of the newest wrench since its arrival, or of the attachment before the first [ns].
    pub age_ns: u64,
    /// Contacts that carry force in the newest wrench.
    pub contact_points: u32,
}

#[derive(Default)]
struct AtomicCounters {
    received: AtomicU64,
    missed: AtomicU64,
    undecodable: AtomicU64,
    foreign: AtomicU64,
    implausible: AtomicU64,
    /// A foreign wrench has come after one of the own epoch: the tool has another holder.
    taken: AtomicBool,
}

/// What the receiving callback writes: the newest wrench with its arrival [ns].
struct Inbox {
    newest: triple_buffer::Input<Option<(Wrench, u64)>>,
    order: Order,
}

/// A tool held by this client. Freed by [`detach`](Tool::detach), or by dropping it.
pub struct Tool {
    id: u32,
    epoch: u32,
    /// Came with the epoch, and stands in poses and in nothing that others see.
    secret: u64,
    sequence: u32,
    newest: Option<(Wrench, u64)>,
    seen: bool,
    grip: Grip,
    wrenches: triple_buffer::Output<Option<(Wrench, u64)>>,
    counters: Arc<AtomicCounters>,
    poses: Publisher<'static>,
    _subscriber: Subscriber<()>,
    _presence: LivelinessToken,
    // Last, so that what is declared on the sessions goes before they close.
    connection: Connection,
}

impl Connection {
    /// Takes a tool. Errors: [`SdkError::Refused`] when it does not exist or is taken, or a number is out of bounds;
    /// [`SdkError::NoForceChannel`], [`SdkError::NoAnswer`].
    pub fn attach(&self, attachment: &Attachment) -> Result<Tool, SdkError> {
        self.attach_observed(attachment, |_, _| ())
    }

    /// As [`attach`](Self::attach); `observer` is called with every wrench of this tool that is taken and its arrival time [ns].
    ///
    /// It runs on zenoh's receiving thread: for measuring, not for working. A control loop needs only the newest wrench
    /// and finds it with [`Tool::latest_wrench`].
    pub fn attach_observed(
        &self,
        attachment: &Attachment,
        observer: impl Fn(&Wrench, u64) + Send + Sync + 'static,
    ) -> Result<Tool, SdkError> {
        let force = self.force_session()?;
        let Attachment { client, tool, rate_hz, coupling_stiffness, coupling_angular_stiffness } = attachment.clone();
        let version_minor = VERSION_MINOR;
        let attach = Attach { client, tool, rate_hz, coupling_stiffness, coupling_angular_stiffness, version_minor };
        let attached = self.control(Request::Attach(attach))?.attached.ok_or(ClientError::Undecodable {
            message: "ControlReply",
            reason: "attach was not answered".to_owned(),
        })?;
        let (id, epoch, secret) = (attached.tool, attached.epoch, attached.secret);
        let session = &self.endpoints().session;

        let (newest, wrenches) = triple_buffer(&None);
        let inbox = Mutex::new(Inbox { newest, order: Order::default() });
        let counters = Arc::new(AtomicCounters::default());
        let (opened, counted) = (self.opened(), counters.clone());
        let key = keys::tool_wrench(session, id);
        let subscriber = force
            .declare_subscriber(&key)
            .callback(move |sample| {
                let arrival_ns = nanoseconds_since(opened);
                let Ok(message) = ToolWrench::decode(&*sample.payload().to_bytes()) else {
                    counted.undecodable.fetch_add(1, Relaxed);
                    return;
                };
                if message.epoch != epoch {
                    counted.foreign.fetch_add(1, Relaxed);
                    let inbox = inbox.lock().unwrap_or_else(PoisonError::into_inner);
                    counted.taken.fetch_or(inbox.order.has_begun(), Relaxed);
                    return;
                }
                let Ok(wrench) = Wrench::try_from(&message) else {
                    counted.undecodable.fetch_add(1, Relaxed);
                    return;
                };
                counted.received.fetch_add(1, Relaxed);
                // Uncontended: one thread receives for one session. The lock is here because callbacks are `Fn`.
                let mut inbox = inbox.lock().unwrap_or_else(PoisonError::into_inner);
                match inbox.order.judge(&wrench, arrival_ns) {
                    Verdict::Taken { missed } => {
                        counted.missed.fetch_add(missed, Relaxed);
                        inbox.newest.write(Some((wrench, arrival_ns)));
                        drop(inbox);
                        observer(&wrench, arrival_ns);
                    }
                    Verdict::Old => {}
                    Verdict::Implausible => {
                        counted.implausible.fetch_add(1, Relaxed);
                    }
                }
            })
            .wait()
            .map_err(|error| SdkError::Zenoh { operation: "subscribe to", key, reason: reason(error) })?;

        let key = keys::presence(session, id, epoch);
        let presence = self
            .surface_session()
            .liveliness()
            .declare_token(&key)
            .wait()
            .map_err(|error| SdkError::Zenoh { operation: "declare presence on", key, reason: reason(error) })?;

        let key = keys::tool_pose(session, id);
        let poses = realtime_publisher(force, key)?;

        Ok(Tool {
            id,
            epoch,
            secret,
            sequence: 0,
            newest: None,
            seen: false,
            grip: Grip::new(self.now_ns()),
            wrenches,
            counters,
            poses,
            _subscriber: subscriber,
            _presence: presence,
            connection: self.clone(),
        })
    }
}

impl Tool {
    /// The tool's number in the session.
    pub fn id(&self) -> u32 {
        self.id
    }

    /// The epoch under which it is held: nobody else's poses move it, nobody else's wrenches are felt.
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    /// The clock of this connection, see [`Connection::now_ns`].
    pub fn now_ns(&self) -> u64 {
        self.connection.now_ns()
    }

    /// Sends a pose with the current time and returns its sequence number, which counts from 1.
    ///
    /// Does not wait for the network: a pose that cannot leave now is dropped. Errors: [`ClientError::PoseNotFinite`],
    /// [`SdkError::Zenoh`] when the connection is closed.
    pub fn send_pose(&mut self, pose: PoseSample) -> Result<u32, SdkError> {
        let sequence = self.sequence.wrapping_add(1);
        let now_ns = self.now_ns();
        let message = pose.message(self.epoch, self.secret, sequence, now_ns)?;
        self.sequence = sequence;
        self.refresh();
        self.grip.sent(sequence, now_ns);
        self.poses.put(message.encode_to_vec()).wait().map_err(|error| SdkError::Zenoh {
            operation: "publish on",
            key: self.poses.key_expr().to_string(),
            reason: reason(error),
        })?;
        Ok(sequence)
    }

    /// The newest wrench so far, `None` before the first.
    pub fn latest_wrench(&mut self) -> Option<Received> {
        self.refresh();
        let fresh = !std::mem::replace(&mut self.seen, true);
        self.newest.map(|(wrench, arrival_ns)| Received { wrench, arrival_ns, fresh })
    }

    /// The force to feel at `now_ns` (3) [N]: that of the newest wrench, faded by [`watchdog_scale`] of its age since
    /// arrival. Zero before the first wrench and when a component is not finite.
    pub fn safe_force(&mut self, now_ns: u64) -> [f64; 3] {
        self.refresh();
        safe_force(self.newest.as_ref(), now_ns)
    }

    /// How the tool is doing at `now_ns`.
    pub fn status(&mut self, now_ns: u64) -> ToolStatus {
        self.refresh();
        let newest = self.newest.map(|(wrench, _)| wrench);
        ToolStatus {
            hold: self.grip.hold(now_ns),
            phase: newest.map_or(ToolPhase::Detached, |wrench| wrench.phase),
            flags: newest.map_or(0, |wrench| wrench.flags),
            age_ns: self.grip.age_ns(now_ns),
            contact_points: newest.map_or(0, |wrench| wrench.contact_points),
        }
    }

    /// Errors: [`SdkError::ToolGone`] when the tool is no longer in the hand at `now_ns`: for those who would otherwise
    /// take it for air.
    pub fn check(&mut self, now_ns: u64) -> Result<(), SdkError> {
        let status = self.status(now_ns);
        match status.hold {
            Hold::Gone => Err(SdkError::ToolGone { silence_s: status.age_ns as f64 * 1e-9 }),
            Hold::Held | Hold::Fading | Hold::Refused => Ok(()),
        }
    }

    /// What became of the wrenches so far.
    pub fn counters(&self) -> Counters {
        Counters {
            received: self.counters.received.load(Relaxed),
            missed: self.counters.missed.load(Relaxed),
            undecodable: self.counters.undecodable.load(Relaxed),
            foreign: self.counters.foreign.load(Relaxed),
            implausible: self.counters.implausible.load(Relaxed),
        }
    }

    /// Gives the tool back. Errors as [`Connection::control`]; the tool is let go in any case.
    pub fn detach(self) -> Result<(), SdkError> {
        let detach = Detach { tool: self.id, epoch: self.epoch, secret: self.secret };
        self.connection.control(Request::Detach(detach)).map(|_| ())
    }

    fn refresh(&mut self) {
        if self.wrenches.update() {
            self.newest = *self.wrenches.output_buffer();
            self.seen = false;
            if let Some((wrench, arrival_ns)) = &self.newest {
                self.grip.received(wrench, *arrival_ns);
            }
        }
        if self.counters.taken.load(Relaxed) {
            self.grip.taken();
        }
    }
}

fn safe_force(newest: Option<&(Wrench, u64)>, now_ns: u64) -> [f64; 3] {
    match newest {
        Some((wrench, arrival_ns)) if wrench.force.iter().all(|f| f.is_finite()) => {
            let scale = watchdog_scale(now_ns.saturating_sub(*arrival_ns));
            wrench.force.map(|f| scale * f)
        }
        _ => [0.0; 3],
    }
}

#[cfg(test)]
mod tests {
    use palpate_proto::ToolPhase;

    use super::*;

    fn wrench(force: [f64; 3]) -> Wrench {
        Wrench {
            sequence: 1,
            tick: 1,
            pose_sequence: 1,
            pose_time_ns: 0,
            pose_age_ticks: 0,
            position: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            physical_force: force,
            physical_torque: [0.0; 3],
            force,
            torque: [0.0; 3],
            contact_points: 1,
            phase: ToolPhase::Engaged,
            flags: 0,
            model: None,
            opening: 0.0,
            grip_torque: 0.0,
        }
    }

    #[test]
    fn force_fades_with_the_age_of_its_wrench() {
        let newest = (wrench([0.0, 0.0, 2.0]), 1_000_000_000);
        assert_eq!(safe_force(Some(&newest), 1_020_000_000), [0.0, 0.0, 2.0]);
        assert!((safe_force(Some(&newest), 1_045_000_000)[2] - 1.0).abs() < 1e-12);
        assert_eq!(safe_force(Some(&newest), 1_070_000_000), [0.0; 3]);
        // A wrench that came between reading the clock and reading the inbox is new, not ages old.
        assert_eq!(safe_force(Some(&newest), 999_999_999), [0.0, 0.0, 2.0]);
    }

    #[test]
    fn no_wrench_or_a_non_finite_one_gives_no_force() {
        assert_eq!(safe_force(None, 0), [0.0; 3]);
        assert_eq!(safe_force(Some(&(wrench([0.0, f64::NAN, 1.0]), 0)), 0), [0.0; 3]);
    }
}
