//! The scheduling class of the device loop.

/// SCHED_FIFO priority of the device loop and of zenoh's threads in this process. Below the server's own threads, so
/// that a phantom on the server's machine never delays the simulation.
#[cfg(unix)]
const PRIORITY: u8 = 40;

/// Raises the calling thread as far as the system lets it and returns what was granted, for the report.
///
/// Threads started later by this one inherit it. A refusal is no error: the loop runs on, only less evenly.
pub(crate) fn raise_this_thread() -> String {
    match raise() {
        Ok(granted) => granted,
        Err(error) => format!("normal ({error})"),
    }
}

#[cfg(unix)]
fn raise() -> Result<String, String> {
    use thread_priority::{
        RealtimeThreadSchedulePolicy::Fifo, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
        thread_native_id,
    };
    let priority = ThreadPriority::Crossplatform(PRIORITY.try_into()?);
    set_thread_priority_and_policy(thread_native_id(), priority, ThreadSchedulePolicy::Realtime(Fifo))
        .map_err(|error| format!("SCHED_FIFO refused: {error}"))?;
    Ok(format!("SCHED_FIFO {PRIORITY}"))
}

#[cfg(not(unix))]
fn raise() -> Result<String, String> {
    thread_priority::ThreadPriority::Max.set_for_current().map_err(|error| format!("refused: {error}"))?;
    Ok("highest thread priority".to_owned())
}
