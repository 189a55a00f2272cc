//! Messages to core types and back; what is malformed, not finite, out of range or stale is refused, with its reason.

pub mod session;
pub mod surface;

use palpate_core::contact::safety::Limited;
use palpate_core::contact::tool::{Coupling, MOST_TOOLS, Phase, PoseSample, ToolEvent, ToolState};
use palpate_core::feedback::LocalModel;
use palpate_core::math::{Bounds, Pose, Real, Vec3, normalized_quaternion};
use palpate_core::simulation::{Budget, Inputs, ObstacleOutput, Parameter, Prices, Threshold, TickFlags, ToolOutput};
use palpate_proto as proto;
use palpate_proto::Message;

/// Why a pose is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refusal {
    /// The bytes are no pose, or a list has another length than documented.
    Malformed,
    /// The key names no tool of this session.
    UnknownTool,
    /// Nobody holds the tool under this epoch.
    WrongEpoch,
    /// A number is infinite or not a number.
    NotFinite,
    /// The orientation's length is not one within 1 %.
    BadOrientation,
    /// The position lies outside the workspace.
    OutOfRange,
    /// An older or repeated sequence number.
    Stale,
}

impl Refusal {
    /// Every reason, in the order in which they are counted.
    pub const ALL: [Refusal; 7] = [
        Refusal::Malformed,
        Refusal::UnknownTool,
        Refusal::WrongEpoch,
        Refusal::NotFinite,
        Refusal::BadOrientation,
        Refusal::OutOfRange,
        Refusal::Stale,
    ];

    /// As the status message names it.
    pub fn name(self) -> &'static str {
        match self {
            Refusal::Malformed => "malformed",
            Refusal::UnknownTool => "unknown tool",
            Refusal::WrongEpoch => "wrong epoch",
            Refusal::NotFinite => "not finite",
            Refusal::BadOrientation => "bad orientation",
            Refusal::OutOfRange => "out of range",
            Refusal::Stale => "stale",
        }
    }
}

/// What a pose has to pass: who holds the tool, and how far the client's numbers have come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Of the holder; 0 while nobody holds the tool.
    pub epoch: u32,
    /// What the holder alone was told.
    pub secret: u64,
    /// Last sequence number that passed, 0 before the first.
    pub sequence: u32,
    /// The newest stale sequence number, and how many have come in order.
    pub behind: (u32, u32),
    /// Times that the numbers of the holder have jumped back, and were followed.
    pub jumps: u32,
    /// Where a tool may be [m].
    pub workspace: Bounds,
}

/// Stale poses in order, none of them repeated, after which it was the number before them that was wrong: 20 ms of a haptic
/// device, in which its force does not fall yet. Fewer, and a network that sends a few poses twice is followed back in time.
const JUMPED: u32 = 20;

impl Gate {
    /// For whoever holds the tool under `epoch` with `secret`; with 0 nothing passes.
    pub fn new(epoch: u32, secret: u64, workspace: Bounds) -> Self {
        Self { epoch, secret, sequence: 0, behind: (0, 0), jumps: 0, workspace }
    }

    /// Whether the pose number `sequence` is in order, or the sender's numbers have turned out to go on from here.
    fn is_next(&mut self, sequence: u32) -> bool {
        // Wrapping difference: a device at 1 kHz takes 49 days to get round.
        let is_after = |last: u32| last == 0 || sequence.wrapping_sub(last) as i32 > 0;
        if sequence == 0 {
            return false;
        }
        if !is_after(self.sequence) {
            let in_order = self.behind.1 > 0 && is_after(self.behind.0);
            self.behind = (sequence, if in_order { self.behind.1 + 1 } else { 1 });
            if self.behind.1 < JUMPED {
                return false;
            }
            self.jumps = self.jumps.saturating_add(1);
        }
        (self.sequence, self.behind) = (sequence, (0, 0));
        true
    }

    /// Decodes a pose and lets it pass, or says why not.
    ///
    /// # Errors
    /// The reason of the refusal.
    pub fn pass(&mut self, bytes: &[u8]) -> Result<PoseSample, Refusal> {
        let message = proto::ToolPose::decode(bytes).map_err(|_| Refusal::Malformed)?;
        if self.epoch == 0 || (message.epoch, message.secret) != (self.epoch, self.secret) {
            return Err(Refusal::WrongEpoch);
        }
        let position = vec3(&message.position)?;
        let orientation: [f32; 4] = message.orientation.as_slice().try_into().map_err(|_| Refusal::Malformed)?;
        let orientation = orientation.map(Real::from);
        let opening = Real::from(message.opening);
        if !position.iter().chain(&orientation).chain([&opening]).all(|c| c.is_finite()) {
            return Err(Refusal::NotFinite);
        }
        let length_squared: Real = orientation.iter().map(|c| c * c).sum();
        let orientation = normalized_quaternion(orientation)
            .filter(|_| (length_squared - 1.0).abs() < 0.02)
            .ok_or(Refusal::BadOrientation)?;
        if !self.workspace.contains(&position) {
            return Err(Refusal::OutOfRange);
        }
        if !self.is_next(message.sequence) {
            return Err(Refusal::Stale);
        }
        Ok(PoseSample {
            sequence: message.sequence,
            time_ns: message.time_ns,
            pose: Pose { position, orientation },
            buttons: message.buttons,
            opening: opening.clamp(0.0, 1.0),
        })
    }
}

fn vec3(values: &[f32]) -> Result<Vec3, Refusal> {
    let v: [f32; 3] = values.try_into().map_err(|_| Refusal::Malformed)?;
    Ok(Vec3::from(v.map(Real::from)))
}

fn f32s(v: &Vec3) -> Vec<f32> {
    v.iter().map(|c| *c as f32).collect()
}

fn f32s4(q: &[Real; 4]) -> Vec<f32> {
    q.iter().map(|c| *c as f32).collect()
}

fn phase(phase: Phase) -> i32 {
    let phase = match phase {
        Phase::Detached => proto::ToolPhase::Detached,
        Phase::Waiting => proto::ToolPhase::Waiting,
        Phase::Engaged => proto::ToolPhase::Engaged,
        Phase::Holding => proto::ToolPhase::Holding,
    };
    phase.into()
}

/// The wrench of tool `tool` after `tick`; `sequence` counts this tool's wrenches.
pub fn wrench(tool: u32, tick: u64, sequence: u64, output: &ToolOutput, flags: TickFlags) -> proto::ToolWrench {
    let t = &output.state;
    let Limited { clamped, slew, ramping } = output.limited;
    let bits = [
        (clamped, proto::WrenchFlag::Clamped),
        (slew, proto::WrenchFlag::SlewLimited),
        (ramping, proto::WrenchFlag::Ramping),
        (t.speed_limited, proto::WrenchFlag::SpeedLimited),
        (flags.restored, proto::WrenchFlag::StateRestored),
        (flags.substeps_dropped, proto::WrenchFlag::SubstepsDropped),
    ];
    proto::ToolWrench {
        tool,
        epoch: t.epoch,
        sequence,
        tick,
        pose_sequence: t.sequence,
        pose_time_ns: t.time_ns,
        pose_age_ticks: t.age_ticks,
        position: f32s(&t.pose.position),
        orientation: f32s4(&t.pose.orientation),
        physical_force: f32s(&t.physical_force),
        physical_torque: f32s(&t.physical_torque),
        force: f32s(&t.force),
        torque: f32s(&t.torque),
        contact_points: output.contact_points,
        phase: phase(t.phase),
        flags: bits.iter().filter(|b| b.0).map(|b| b.1 as u32).sum(),
        opening: t.jaws.opening as f32,
        grip_torque: t.jaws.torque as f32,
        ..Default::default()
    }
}

/// Puts a local model into a wrench, if there is one.
pub fn add_model(wrench: &mut proto::ToolWrench, model: &LocalModel) {
    if model.range == 0.0 {
        return;
    }
    wrench.model_position = f32s(&model.position);
    wrench.model_force = f32s(&model.force);
    wrench.model_normal = f32s(&model.normal);
    wrench.model_stiffness = model.stiffness.iter().map(|k| *k as f32).collect();
    wrench.model_range = model.range as f32;
}

/// A tool as viewers see it.
pub fn tool_state(tool: u32, t: &ToolState) -> proto::ToolState {
    proto::ToolState {
        tool,
        position: f32s(&t.pose.position),
        orientation: f32s4(&t.pose.orientation),
        force: f32s(&t.force),
        phase: phase(t.phase),
        opening: t.jaws.opening as f32,
        shape: t.shape.map_or(0, |of| u32::from(of) + 1),
    }
}

/// An obstacle as viewers see it.
pub fn obstacle_state(obstacle: &ObstacleOutput) -> proto::ObstacleState {
    proto::ObstacleState { position: f32s(&obstacle.position), force: f32s(&obstacle.wrench.force) }
}

/// What tick `tick` consumed, as a recording keeps it.
pub fn inputs_to_message(tick: u64, inputs: &Inputs) -> proto::TickInputs {
    use proto::tool_input::Event;
    let event = |event: &ToolEvent| match event {
        ToolEvent::Attach { epoch, period_ticks, coupling } => Event::Attach(proto::RecordedAttach {
            epoch: *epoch,
            period_ticks: *period_ticks,
            coupling: coupling.compliance,
            angular_coupling: coupling.angular_compliance,
        }),
        ToolEvent::Detach => Event::Detach(true),
        ToolEvent::Pose(p) => Event::Pose(proto::RecordedPose {
            sequence: p.sequence,
            time_ns: p.time_ns,
            position: p.pose.position.iter().copied().collect(),
            orientation: p.pose.orientation.to_vec(),
            buttons: p.buttons,
            opening: p.opening,
        }),
    };
    let tools = inputs.tools.iter().enumerate();
    proto::TickInputs {
        tick,
        lapsed: inputs.lapsed,
        budget: inputs.budget.limit,
        planned: inputs.budget.planned,
        frame: inputs.budget.frame,
        change: inputs.budget.change,
        prices: inputs.prices.map_or(vec![], |prices| prices.0.to_vec()),
        commands: u32::from(inputs.reset),
        parameter: inputs.parameter.as_ref().map(recorded_parameter),
        tools: tools
            .filter_map(|(i, e)| e.as_ref().map(|e| proto::ToolInput { tool: i as u32, event: Some(event(e)) }))
            .collect(),
    }
}

fn recorded_parameter(parameter: &Parameter) -> proto::RecordedParameter {
    use proto::recorded_parameter::Quantity;
    let quantity = match *parameter {
        Parameter::Gravity(_) => Quantity::Gravity(true),
        Parameter::Damping(_) => Quantity::Damping(true),
        Parameter::Supports(_) => Quantity::Supports(true),
        Parameter::Stiffness { tissue, .. } => Quantity::Stiffness(tissue.into()),
        Parameter::Friction { tool, .. } => Quantity::Friction(tool.into()),
        Parameter::Shape { tool, .. } => Quantity::Shape(tool.into()),
        Parameter::Resolution { threshold, .. } => Quantity::Resolution(threshold as u32),
    };
    proto::RecordedParameter { quantity: Some(quantity), values: parameter.values() }
}

fn parameter_from_message(message: &proto::RecordedParameter) -> Option<Parameter> {
    use proto::recorded_parameter::Quantity;
    let values = message.values.as_slice();
    if !values.iter().all(|value| value.is_finite()) {
        return None;
    }
    let value = || <[Real; 1]>::try_from(values).ok().map(|[value]| value);
    Some(match message.quantity? {
        Quantity::Gravity(_) => Parameter::Gravity(<[Real; 3]>::try_from(values).ok()?.into()),
        Quantity::Damping(_) => Parameter::Damping(value()?),
        Quantity::Supports(_) => Parameter::Supports(value()?),
        Quantity::Stiffness(tissue) => Parameter::Stiffness { tissue: tissue.try_into().ok()?, factor: value()? },
        Quantity::Friction(tool) => Parameter::Friction { tool: tool.try_into().ok()?, coefficient: value()? },
        Quantity::Shape(tool) => Parameter::shape(tool.try_into().ok()?, value()?)?,
        Quantity::Resolution(number) => {
            Parameter::Resolution { threshold: *Threshold::ALL.get(number as usize)?, value: value()? }
        }
    })
}

/// The inputs that a recording kept; `None` when the message contradicts the format.
pub fn inputs_from_message(message: &proto::TickInputs) -> Option<Inputs> {
    use proto::tool_input::Event;
    let list = |v: &[Real]| <[Real; 3]>::try_from(v).ok().map(Vec3::from);
    let mut inputs = Inputs {
        lapsed: message.lapsed,
        budget: Budget {
            limit: message.budget,
            planned: message.planned,
            frame: message.frame,
            change: message.change,
        },
        prices: match message.prices.as_slice() {
            [] => None,
            prices => Some(Prices(prices.try_into().ok()?)),
        },
        reset: message.commands & 1 == 1,
        parameter: match &message.parameter {
            None => None,
            Some(parameter) => Some(parameter_from_message(parameter)?),
        },
        tools: [None; MOST_TOOLS],
    };
    for tool in &message.tools {
        let event = match tool.event.as_ref()? {
            Event::Attach(a) => ToolEvent::Attach {
                epoch: a.epoch,
                period_ticks: a.period_ticks,
                coupling: Coupling { compliance: a.coupling, angular_compliance: a.angular_coupling },
            },
            Event::Detach(_) => ToolEvent::Detach,
            Event::Pose(p) => ToolEvent::Pose(PoseSample {
                sequence: p.sequence,
                time_ns: p.time_ns,
                pose: Pose { position: list(&p.position)?, orientation: p.orientation.as_slice().try_into().ok()? },
                buttons: p.buttons,
                opening: p.opening,
            }),
        };
        *inputs.tools.get_mut(tool.tool as usize)? = Some(event);
    }
    Some(inputs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gate() -> Gate {
        Gate::new(7, 8, Bounds::new(Vec3::repeat(-1.0), Vec3::repeat(1.0)))
    }

    fn pose(change: impl Fn(&mut proto::ToolPose)) -> Vec<u8> {
        let mut message = proto::ToolPose {
            epoch: 7,
            secret: 8,
            sequence: 1,
            time_ns: 5,
            position: vec![0.1, 0.2, 0.3],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            ..Default::default()
        };
        change(&mut message);
        message.encode_to_vec()
    }

    #[test]
    fn each_fault_is_refused_for_its_own_reason() {
        let refused = |bytes: &[u8]| gate().pass(bytes).unwrap_err();
        assert!(gate().pass(&pose(|_| {})).is_ok());
        assert_eq!(refused(b"\xff\xff\xff garbage"), Refusal::Malformed);
        assert_eq!(refused(&pose(|p| p.position.truncate(2))), Refusal::Malformed);
        assert_eq!(refused(&pose(|p| p.epoch = 8)), Refusal::WrongEpoch);
        assert_eq!(refused(&pose(|p| p.secret = 0)), Refusal::WrongEpoch);
        assert_eq!(refused(&pose(|p| p.position[1] = f32::NAN)), Refusal::NotFinite);
        assert_eq!(refused(&pose(|p| p.orientation[3] = f32::INFINITY)), Refusal::NotFinite);
        assert_eq!(refused(&pose(|p| p.orientation = vec![0.0; 4])), Refusal::BadOrientation);
        assert_eq!(refused(&pose(|p| p.orientation = vec![0.0, 0.0, 0.0, 2.0])), Refusal::BadOrientation);
        assert_eq!(refused(&pose(|p| p.position[0] = 1.5)), Refusal::OutOfRange);
        assert_eq!(refused(&pose(|p| p.sequence = 0)), Refusal::Stale);
    }

    #[test]
    fn velocities_that_earlier_clients_send_are_skipped() {
        let plain = pose(|_| {});
        // Fields 6 and 7, packed: three floats each.
        let velocity =
            |field: u8| [&[field << 3 | 2, 12][..], &[1.0f32, f32::NAN, 1e9].map(f32::to_le_bytes).concat()].concat();
        let with = [&plain[..], &velocity(6), &velocity(7)].concat();
        assert_eq!(gate().pass(&with), gate().pass(&plain));
        assert!(gate().pass(&with).is_ok());
    }

    #[test]
    fn repeated_and_older_poses_are_stale_and_the_counter_may_wrap() {
        let mut gate = gate();
        let numbered = |n: u32| pose(move |p| p.sequence = n);
        assert!(gate.pass(&numbered(5)).is_ok());
        assert_eq!(gate.pass(&numbered(5)), Err(Refusal::Stale));
        assert_eq!(gate.pass(&numbered(4)), Err(Refusal::Stale));
        gate.sequence = u32::MAX;
        assert!(gate.pass(&numbered(3)).is_ok());
    }

    #[test]
    fn one_wrong_number_far_ahead_costs_twenty_poses_and_a_network_that_repeats_itself_is_not_followed() {
        let mut gate = gate();
        let numbered = |n: u32| pose(move |p| p.sequence = n);
        (1..100).for_each(|n| assert!(gate.pass(&numbered(n)).is_ok()));
        assert!(gate.pass(&numbered(100 + (1 << 31) - 16)).is_ok());
        let back = (101..).find(|n| gate.pass(&numbered(*n)).is_ok());
        assert_eq!((back, gate.jumps), (Some(120), 1));
        (121..300).for_each(|n| assert!(gate.pass(&numbered(n)).is_ok()));
        // Some that had come already come again, over and over.
        for _ in 0..50 {
            (280..299).for_each(|n| assert_eq!(gate.pass(&numbered(n)), Err(Refusal::Stale)));
        }
        assert!(gate.pass(&numbered(300)).is_ok());
        assert_eq!(gate.jumps, 1);
    }

    proptest! {
        #[test]
        fn garbage_never_passes_and_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(sample) = gate().pass(&bytes) {
                prop_assert!(sample.pose.position.iter().all(|c| c.is_finite()));
            }
        }

        #[test]
        fn inputs_survive_the_way_into_a_recording_bit_for_bit(
            numbers in prop::array::uniform7(-1e3..1e3f64), epoch in 1u32.., lapsed in 0u32.., limit in 0u32.., planned in 0u32.., frame in 0u32.., change in 0u32..,
        ) {
            let budget = Budget { limit, planned, frame, change };
            let sample = PoseSample {
                sequence: 9,
                time_ns: 77,
                pose: Pose {
                    position: Vec3::new(numbers[0], numbers[1], numbers[2]),
                    orientation: [numbers[3], numbers[4], numbers[5], numbers[6]],
                },
                buttons: 3,
                opening: 0.25,
            };
            let parameters = [
                Parameter::Gravity(Vec3::new(numbers[0], numbers[1], numbers[2])),
                Parameter::Stiffness { tissue: 3, factor: numbers[3] },
                Parameter::Friction { tool: 7, coefficient: numbers[4] },
                Parameter::Shape { tool: 6, of: 2 },
                Parameter::Damping(numbers[5]),
                Parameter::Supports(numbers[5]),
                Parameter::Resolution { threshold: Threshold::Merge, value: numbers[6] },
            ];
            let parameter = Some(parameters[epoch as usize % parameters.len()]);
            let mut inputs = Inputs { lapsed, budget, prices: Some(Prices::COMMON), reset: true, parameter, ..Inputs::default() };
            inputs.tools[0] = Some(ToolEvent::Pose(sample));
            inputs.tools[3] = Some(ToolEvent::Attach { epoch, period_ticks: 14, coupling: Coupling { compliance: 2.5e-3, angular_compliance: 3.0 } });
            inputs.tools[7] = Some(ToolEvent::Detach);
            let bytes = inputs_to_message(12, &inputs).encode_to_vec();
            let back = inputs_from_message(&proto::TickInputs::decode(&bytes[..]).unwrap());
            prop_assert_eq!(back, Some(inputs));
        }
    }
}
