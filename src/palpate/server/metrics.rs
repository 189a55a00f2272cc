//! What is counted, for whoever installs a recorder of the `metrics` crate; without one nothing is. Seconds and bytes, and no
//! client's name.

use crate::realtime::mailbox::TickTiming;
use metrics::{Unit, counter, describe_counter, describe_gauge, describe_histogram, gauge, histogram};
use palpate_proto as proto;

/// Metrics that are times, of which Prometheus needs to be told buckets.
pub const TIMES: [&str; 2] = ["palpate_tick_lateness_seconds", "palpate_tick_compute_seconds"];

/// Says what each metric means.
pub(super) fn describe() {
    describe_histogram!(TIMES[0], Unit::Seconds, "Start of a tick after its deadline");
    describe_histogram!(TIMES[1], Unit::Seconds, "Time inside a tick");
    for (name, meaning) in [
        ("palpate_ticks_total", "Ticks run"),
        ("palpate_late_ticks_total", "Ticks that began more than a tick late"),
        ("palpate_missed_ticks_total", "Ticks that ended after the next deadline"),
        ("palpate_skipped_ticks_total", "Ticks that the machine lost: time passed, the body stood still"),
        ("palpate_stalls_total", "Times that the machine lost ticks"),
        ("palpate_frozen_ticks_total", "Ticks whose work did not fit: the body stood still"),
        ("palpate_restored_states_total", "States that were not finite, or entangled, and were replaced"),
        ("palpate_refused_poses_total", "Poses refused, by reason"),
        ("palpate_wrenches_sent_total", "Wrenches sent"),
        ("palpate_wrenches_skipped_total", "Wrenches superseded before they could be sent"),
        ("palpate_surface_frames_total", "Frames of the surface sent"),
    ] {
        describe_counter!(name, meaning);
    }
    for (name, meaning) in [
        ("palpate_active_nodes", "Active nodes, by level"),
        ("palpate_elements", "Active elements"),
        ("palpate_tick_planned_seconds", "Time that the last tick was planned to take"),
        ("palpate_tools_held", "Tools that somebody holds"),
        ("palpate_pose_age_seconds", "Time since the last pose of a held tool"),
        ("palpate_recording_bytes", "Size of the recording that runs"),
        ("palpate_health", "1 in the state that the server is in: serving, degraded or failed"),
        ("palpate_build_info", "1, with the version as label"),
    ] {
        describe_gauge!(name, meaning);
    }
    gauge!("palpate_build_info", "version" => env!("CARGO_PKG_VERSION")).set(1.0);
}

/// Takes in a tick.
pub(super) fn tick(timing: &TickTiming) {
    histogram!(TIMES[0]).record(timing.lateness as f64 * 1e-9);
    histogram!(TIMES[1]).record(timing.compute as f64 * 1e-9);
}

/// Takes in what the status says; `ticks` and `frames` are totals, `pose_ages` [s] those of held tools, by their names.
pub(super) fn status(status: &proto::Status, ticks: u64, frames: u64, pose_ages: &[(String, f64)]) {
    for (name, total) in [
        ("palpate_ticks_total", ticks),
        ("palpate_late_ticks_total", status.late_ticks),
        ("palpate_missed_ticks_total", status.missed_deadlines),
        ("palpate_skipped_ticks_total", status.lapsed_ticks),
        ("palpate_stalls_total", status.stalls),
        ("palpate_frozen_ticks_total", status.unmoved_ticks),
        ("palpate_restored_states_total", status.restored_states),
        ("palpate_wrenches_sent_total", status.wrenches_sent),
        ("palpate_wrenches_skipped_total", status.wrenches_skipped),
        ("palpate_surface_frames_total", frames),
    ] {
        counter!(name).absolute(total);
    }
    for refused in &status.refused {
        counter!("palpate_refused_poses_total", "reason" => refused.reason.clone()).absolute(refused.count);
    }
    for (level, nodes) in status.active_nodes.iter().enumerate() {
        gauge!("palpate_active_nodes", "level" => level.to_string()).set(*nodes as f64);
    }
    gauge!("palpate_elements").set(status.elements as f64);
    gauge!("palpate_tick_planned_seconds").set(status.work as f64 * 1e-9);
    gauge!("palpate_tools_held").set(pose_ages.len() as f64);
    for (tool, age) in pose_ages {
        gauge!("palpate_pose_age_seconds", "tool" => tool.clone()).set(*age);
    }
    gauge!("palpate_recording_bytes").set(status.recording.as_ref().map_or(0.0, |recording| recording.bytes as f64));
    for (state, name) in
        [(proto::Health::Serving, "serving"), (proto::Health::Degraded, "degraded"), (proto::Health::Failed, "failed")]
    {
        gauge!("palpate_health", "state" => name).set(f64::from(u8::from(status.health() == state)));
    }
}
