//! What the real-time threads ask of the system, and what it granted.

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

/// Priority of the simulation thread.
pub const SIMULATION: u8 = 80;
/// Priority of the force output thread.
pub const FORCE_OUTPUT: u8 = 60;
/// Priority of the force session's network threads: zenoh's threads inherit it from the thread that opens it.
pub const FORCE_NETWORK: u8 = 50;

/// Asks for SCHED_FIFO at `priority` for the calling thread.
///
/// # Errors
/// The system's reason.
pub fn fifo(priority: u8) -> Result<(), String> {
    let value = priority.try_into()?;
    set_thread_priority_and_policy(
        thread_native_id(),
        ThreadPriority::Crossplatform(value),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(|e| format!("{e:?}"))
}

/// Has all threads of this process, also those to come, allocate from two arenas. glibc makes up to eight for each processor: what
/// a thread gives back to one, threads of the others do not take, and all of them stay locked. With two the server takes 20 MB less,
/// and does not grow from fault to fault (`tests/matrix`); with one, threads that allocate at once wait for each other.
pub fn share_arenas() {
    #[cfg(target_env = "gnu")]
    // SAFETY: it changes how memory is found from now on, and nothing about what was found before.
    unsafe {
        libc::mallopt(libc::M_ARENA_MAX, 2);
    }
}

/// Has all memory that there is now in RAM, and keeps there what is used of all that comes later. The simulation thread allocates
/// nothing: to what it is given later its giver does this again, so that no tick waits for a page. The others' stacks of 2 MB,
/// of which they touch little, come and go with them. False where the system refuses.
pub fn lock_memory() -> bool {
    use rustix::mm::{MlockAllFlags, mlockall};
    mlockall(MlockAllFlags::CURRENT).is_ok() && mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT).is_ok()
}

/// The machine in words: processor, how many of them, and kernel.
pub fn machine() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let info = read("/proc/cpuinfo");
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split(':').nth(1));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let kernel = read("/proc/sys/kernel/osrelease");
    let system = read("/proc/sys/kernel/ostype");
    let model = model.unwrap_or("unknown processor").trim();
    format!("{model}, {cores} processors, {} {}", system.trim(), kernel.trim())
}

/// What the simulation thread got.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Granted {
    /// SCHED_FIFO.
    pub fifo: bool,
    /// All memory that has been used stays in RAM.
    pub locked: bool,
    /// CPU that the thread is bound to.
    pub cpu: Option<usize>,
}

impl Granted {
    /// Asks for all of it on behalf of the calling thread; `cpu` binds it to that CPU.
    pub fn ask(cpu: Option<usize>) -> Self {
        let fifo = fifo(SIMULATION).is_ok();
        let locked = lock_memory();
        let cpu = cpu.filter(|id| core_affinity::set_for_current(core_affinity::CoreId { id: *id }));
        Self { fifo, locked, cpu }
    }

    /// For the status message.
    pub fn describe(&self) -> String {
        let fifo = if self.fifo { format!("SCHED_FIFO {SIMULATION}") } else { "normal scheduling".into() };
        let locked = if self.locked { ", memory locked" } else { ", memory not locked" };
        let cpu = self.cpu.map(|c| format!(", on CPU {c}")).unwrap_or_default();
        format!("{fifo}{locked}{cpu}")
    }

    /// One warning with its remedy when something was refused.
    pub fn warning(&self) -> Option<String> {
        let refused = match (self.fifo, self.locked) {
            (true, true) => return None,
            (false, true) => "real-time scheduling",
            (true, false) => "locked memory",
            (false, false) => "real-time scheduling and locked memory",
        };
        Some(format!(
            "the system refused {refused}: on a busy machine ticks will be late. Remedy: run as root, or add to \
             /etc/security/limits.d/palpate.conf the lines '@realtime - rtprio 90' and '@realtime - memlock unlimited', \
             put the user into the group realtime, and log in again"
        ))
    }
}

/// Name of the simulation thread, by which its time is told from the others'.
pub const SIMULATION_THREAD: &str = "simulation";

/// Processor time that this process's real-time threads have taken since they began [ns]: the simulation thread, and all
/// others together. `None` where the system does not tell.
pub fn real_time_use() -> Option<(u64, u64)> {
    let (mut simulation, mut others) = (0, 0);
    for thread in std::fs::read_dir("/proc/self/task").ok()? {
        let folder = thread.ok()?.path();
        // A thread may end while it is looked at.
        let read = |name: &str| std::fs::read_to_string(folder.join(name)).ok();
        let (Some(stat), Some(times)) = (read("stat"), read("schedstat")) else { continue };
        // The name stands in brackets, and may have spaces and brackets itself; the policy is the 39th field after it.
        let (Some(begin), Some(end)) = (stat.find('('), stat.rfind(')')) else { continue };
        let policy = stat[end + 1..].split_whitespace().nth(38);
        let time = times.split_whitespace().next().and_then(|ns| ns.parse::<u64>().ok()).unwrap_or(0);
        match policy {
            // SCHED_FIFO and SCHED_RR.
            Some("1" | "2") if &stat[begin + 1..end] == SIMULATION_THREAD => simulation += time,
            Some("1" | "2") => others += time,
            _ => {}
        }
    }
    Some((simulation, others))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_of_real_time_threads_is_told_by_thread_where_they_are_granted() {
        let busy = |name: &str| {
            let thread = std::thread::Builder::new().name(name.into());
            let (told, tell) = std::sync::mpsc::channel();
            let (end, ended) = std::sync::mpsc::channel::<()>();
            let thread = thread
                .spawn(move || {
                    let granted = fifo(1).is_ok();
                    let began = std::time::Instant::now();
                    while began.elapsed() < std::time::Duration::from_millis(20) {}
                    let _ = told.send(granted);
                    let _ = ended.recv();
                })
                .unwrap();
            (tell.recv().unwrap(), end, thread)
        };
        let (before, others_before) = real_time_use().unwrap();
        let (granted, end, thread) = busy(SIMULATION_THREAD);
        let (after, others) = real_time_use().unwrap();
        assert!(!granted || after >= before + 10_000_000, "{before}, then {after}");
        drop(end);
        thread.join().unwrap();
        let (granted, end, thread) = busy("another (one)");
        let (_, others_after) = real_time_use().unwrap();
        assert!(!granted || others_after >= others.max(others_before) + 10_000_000, "{others}, then {others_after}");
        drop(end);
        thread.join().unwrap();
    }

    #[test]
    fn a_refusal_names_what_and_the_remedy() {
        let all = Granted { fifo: true, locked: true, cpu: None };
        assert_eq!(all.warning(), None);
        let none = Granted::default();
        let warning = none.warning().unwrap();
        assert!(warning.contains("rtprio") && warning.contains("memlock"));
        assert_eq!(none.describe(), "normal scheduling, memory not locked");
    }
}
