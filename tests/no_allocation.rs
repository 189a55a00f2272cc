//! What the allocator itself counts, thread by thread, and what the kernel lets through. The simulation thread allocates nothing
//! once it runs and asks the system for nothing but to wake others, while a tool attaches, presses, is lost, a recording starts
//! and stops, and the body is reset, and while all that refines and coarsens the body. And what a body and its simulation hold
//! grows no faster than the body has nodes.

use palpate::realtime::clock::Clock;
use palpate::realtime::mailbox::{Command, PoseSlot, RecordTap, mailboxes};
use palpate::realtime::sim_thread::SimThread;
use palpate::scene::LoadedScene;
use palpate_body::prepare::{Recipe, Region, Shape, prepare};
use palpate_core::contact::tool::{Coupling, PoseSample, ToolEvent};
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::body::{BodyParts, LabelParts, MixtureParts};
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Budget, Frame, Inputs, Parameter, Part, Settings, Simulation, Snapshot};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

struct Counting;
thread_local! {
    static COUNTED: Cell<bool> = const { Cell::new(false) };
    static CALLS: Cell<u64> = const { Cell::new(0) };
    static HELD: Cell<i64> = const { Cell::new(0) };
}

/// One call that takes `more` bytes, or gives some back.
fn count(more: i64) {
    if COUNTED.get() {
        CALLS.set(CALLS.get() + 1);
        HELD.set(HELD.get() + more);
    }
}

// SAFETY: every call is passed on to the system's allocator; counting touches only this thread's cells, which need no
// allocation and no drop.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        // SAFETY: passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as i64));
        // SAFETY: passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as i64 - layout.size() as i64);
        // SAFETY: passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Turns of the simulation thread and of the script on the other side of its mailboxes: ticks that have ended, and those after
/// which the script has run.
#[derive(Default)]
struct Turns {
    ended: AtomicU64,
    scripted: AtomicU64,
}

/// Lets the script run between ticks; time jumps to every deadline, and now and then far beyond it.
struct Scripted {
    now: u64,
    tick: u64,
    turns: Arc<Turns>,
}
impl Clock for Scripted {
    fn now(&mut self) -> u64 {
        self.now += 50_000;
        self.now
    }
    fn after(&mut self, _: Part, _: u32) -> u64 {
        self.now += 1_000;
        self.now
    }
    fn sleep_until(&mut self, deadline: u64) {
        self.tick += 1;
        let stall = if self.tick.is_multiple_of(500) { 200_000_000 } else { 0 };
        self.now = self.now.max(deadline) + stall;
        self.turns.ended.store(self.tick, Ordering::Release);
        // Whoever may not ask the system for anything waits awake.
        while self.turns.scripted.load(Ordering::Acquire) < self.tick {
            std::hint::spin_loop();
        }
    }
}

/// From here on the kernel ends this process with SIGSYS where this thread asks it for anything but to count an eventfd up,
/// which wakes other threads, and to end itself. A lock that somebody else holds would ask, too. The clock needs no call.
#[cfg(target_os = "linux")]
fn confine() {
    use seccompiler::{BpfProgram, SeccompAction, SeccompFilter, apply_filter};
    let end = [libc::SYS_exit, libc::SYS_madvise, libc::SYS_munmap, libc::SYS_rt_sigprocmask, libc::SYS_sigaltstack];
    let rules = end.into_iter().chain([libc::SYS_write]).map(|call| (call, vec![])).collect();
    let architecture = std::env::consts::ARCH.try_into().unwrap();
    let (others, these) = (SeccompAction::KillProcess, SeccompAction::Allow);
    let filter = SeccompFilter::new(rules, others, these, architecture).unwrap();
    apply_filter(&BpfProgram::try_from(filter).unwrap()).unwrap();
}

/// In another process, because it ends it.
#[cfg(target_os = "linux")]
#[test]
fn a_confined_thread_that_asks_the_system_ends_its_process() {
    use std::os::unix::process::ExitStatusExt;
    if std::env::var_os("PALPATE_TEST_CONFINED").is_some() {
        std::thread::spawn(|| {
            confine();
            std::thread::sleep(std::time::Duration::from_millis(1));
        })
        .join()
        .unwrap();
        return;
    }
    let mut again = std::process::Command::new(std::env::current_exe().unwrap());
    again.args(["a_confined_thread_that_asks_the_system_ends_its_process", "--exact"]);
    let status = again.env("PALPATE_TEST_CONFINED", "1").output().unwrap().status;
    assert_eq!(status.signal(), Some(libc::SIGSYS), "{status}");
}

#[test]
fn the_simulation_thread_allocates_nothing_and_asks_the_system_for_nothing() {
    let changes = run_and_press(&[]);
    assert!(changes.iter().all(|count| *count > 20), "splits and merges: {changes:?}");
}

/// Its points take of the time that changes would have.
#[test]
fn so_it_does_where_the_body_lies_on_a_floor_that_breathes_and_against_a_bone() {
    let changes = run_and_press(&["obstacle=[{name='floor', motion={displacement=[0,0,-0.002], period=0.5}}, \
          {name='bone', shape='cylinder', radius=0.02, length=0.1, position=[-0.0201,0.05,0]}]"]);
    assert!(changes.iter().all(|count| *count > 0), "splits and merges: {changes:?}");
}

#[test]
fn so_it_does_where_organs_meet() {
    let changes = run_and_press(&[
        "organ=[{name='beside', position=[0.0999,0.01,0.0], body={source='box', size=[0.08,0.08,0.09], \
          cells=[[2,2,2],[4,4,4],[8,8,8]]}, hold=[{min=[0,0,0], max=[0.08,0.08,0]}]}]",
        "contact=[{between=['cube','beside'], friction=0.3}]",
    ]);
    assert!(changes.iter().all(|count| *count > 0), "splits and merges: {changes:?}");
}

#[test]
fn so_it_does_with_tetrahedra_alone() {
    let changes = run_and_press(&["material.elements='tetrahedra'"]);
    assert!(changes.iter().all(|count| *count > 0), "splits and merges: {changes:?}");
}

/// Runs a cube with what else `more` says through all that a client may do; nothing is allocated, and the system not asked.
/// Splits and merges.
fn run_and_press(more: &[&str]) -> [u32; 2] {
    // On springs, with memory: everything that a body may have.
    let given = [
        "body.cells=[[3,3,3],[5,5,5],[9,9,9]]",
        "hold=[{min=[0,0,0], max=[0.1,0.1,0]}]",
        "material.damping_ratio=0.1",
        "world.gravity=[0,0,0]",
        // A ball, and solid cores beside it that touch, too, one of them a jaw.
        "tool=[{name='all', shape='compound', grip=0.1, part=[{radius=0.02}, \
            {shape='cylinder', radius=0.005, length=0.03, position=[0.0,0.0,-0.02]}, \
            {shape='convex', points=[[0.01,0,-0.02],[0.03,0,-0.02],[0.01,0.01,-0.02],[0.01,0,0.01]], \
             hinge={axis=[0,1,0], point=[0.01,0,0.02], closed=0.0, open=0.2}}]}, \
          {name='post', shape='cylinder', length=0.05}]",
    ];
    let given: Vec<String> = given.iter().chain(more).map(|key| key.to_string()).collect();
    let loaded = LoadedScene::load(Path::new("cube"), &given).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let (settings, start) = (loaded.scene.settings(), loaded.scene.at_rest(&body));
    let simulation = Simulation::new(body.clone(), settings.clone(), start).unwrap();
    let (sim_ends, mut ends) = mailboxes(&body, &settings).unwrap();
    let mut thread = SimThread::new(simulation, sim_ends);
    let stop = Arc::new(AtomicBool::new(false));

    let (mut contacts, mut recorded, mut frames, mut taps) = (0u64, 0u64, 0u64, 0u64);
    let (mut splits, mut merges) = (0, 0);
    let mut consumers = None;
    let (stopped, surface_area) = (stop.clone(), 0.1);
    let mut script = |tick: u64| {
        match tick {
            100 => ends
                .commands
                .push(Command::Attach { tool: 0, epoch: 9, period_ticks: 1, coupling: Coupling::RIGID })
                .ok()
                .unwrap(),
            600 => {
                let (start_in, start_out) = rtrb::RingBuffer::new(1);
                let (ticks_in, ticks_out) = rtrb::RingBuffer::new(4096);
                let (frames_in, frames_out) = rtrb::RingBuffer::new(128);
                let (mut empty_in, empty_out) = rtrb::RingBuffer::new(128);
                while empty_in.push(Box::new(Frame::with_room(&body, &settings))).is_ok() {}
                let tap = RecordTap {
                    start: start_in,
                    room: Some(Box::new(Snapshot::with_room(&body, &settings))),
                    ticks: ticks_in,
                    frames: frames_in,
                    empty_frames: empty_out,
                };
                consumers = Some((start_out, ticks_out, frames_out, empty_in));
                ends.commands.push(Command::StartRecording(Box::new(tap))).ok().unwrap();
            }
            // Pressed in, and back again: it has to come from outside.
            950 => [1, 0]
                .into_iter()
                .map(|of| Parameter::Shape { tool: 0, of })
                .for_each(|parameter| ends.commands.push(Command::Set(parameter)).ok().unwrap()),
            1400 => ends.commands.push(Command::StopRecording).ok().unwrap(),
            700 => [
                Parameter::Stiffness { tissue: 0, factor: 2.0 },
                Parameter::Damping(0.5),
                Parameter::Supports(0.5),
                Parameter::Gravity(Vec3::x()),
            ]
            .into_iter()
            .for_each(|parameter| ends.commands.push(Command::Set(parameter)).ok().unwrap()),
            1500 => ends.commands.push(Command::Reset).ok().unwrap(),
            1900 => ends.commands.push(Command::Detach { tool: 0 }).ok().unwrap(),
            2500 => stopped.store(true, Ordering::Relaxed),
            _ => {}
        }
        // Presses from above, twice, as it has to come from outside after a stall; then falls silent until the watchdog
        // lets go, then comes back.
        if (101..1000).contains(&tick) || (1600..1900).contains(&tick) {
            let down = 0.035 * (((tick % 500) as f64 - 100.0) / 250.0).clamp(0.0, 1.0);
            let position = Vec3::new(surface_area / 2.0, 0.05, 0.1 + 0.02 + 0.02 - down);
            let sample = PoseSample {
                sequence: tick as u32,
                time_ns: tick,
                pose: Pose { position, ..Pose::default() },
                buttons: 0,
                opening: (tick % 200) as f64 / 200.0,
            };
            ends.poses[0].write(Some(PoseSlot { epoch: 9, sample }));
        }
        while let Ok(report) = ends.reports.pop() {
            contacts += u64::from(report.tools[0].contact_points > 0);
        }
        while let Ok(timing) = ends.timings.pop() {
            splits += timing.adapted.splits;
            merges += timing.adapted.merges;
        }
        frames += u64::from(ends.frames.update());
        if let Some((_, ticks, _, _)) = &mut consumers {
            while ticks.pop().is_ok() {
                recorded += 1;
            }
        }
        while ends.retired.pop().is_ok() {
            taps += 1;
        }
    };
    let turns = Arc::new(Turns::default());
    let clock = Scripted { now: 1, tick: 0, turns: turns.clone() };
    let running = stop.clone();
    let simulation = std::thread::spawn(move || {
        #[cfg(target_os = "linux")]
        confine();
        COUNTED.set(true);
        thread.run(clock, &running);
        COUNTED.set(false);
        // What it owns is dropped elsewhere.
        (thread, CALLS.get())
    });
    while !simulation.is_finished() {
        let ended = turns.ended.load(Ordering::Acquire);
        if ended > turns.scripted.load(Ordering::Acquire) {
            script(ended);
            turns.scripted.store(ended, Ordering::Release);
        }
        std::thread::yield_now();
    }
    let (thread, calls) = simulation.join().unwrap();

    println!(
        "{calls} calls; {contacts} ticks in contact, {recorded} recorded, {frames} frames, {taps} taps, {splits} splits, \
         {merges} merges"
    );
    assert_eq!(calls, 0, "calls to the allocator on the simulation thread");
    // The script did happen.
    assert!(contacts > 300 && recorded > 700 && frames > 60 && taps == 1);
    let tick = thread.simulation().tick();
    assert!(tick > 2500 + 3 * 75, "time passed during the stalls: {tick}");
    [splits, merges]
}

/// Cut to a fifth of its budget in a press, a body stands still until it has shed enough; that allocates nothing either.
#[test]
fn shedding_under_a_tool_allocates_nothing() {
    let given = ["body.cells=[[3,3,3],[5,5,5],[9,9,9],[13,13,13]]", "resolution.split=0.02"].map(String::from);
    let loaded = LoadedScene::load(Path::new("cube"), &given).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let mut press = Simulation::new(body.clone(), loaded.scene.settings(), loaded.scene.at_rest(&body)).unwrap();
    let (mut held, mut fewest, mut most) = (0, u32::MAX, 0);
    for tick in 0..1500 {
        let down = 0.035 * (f64::from(tick) / 300.0).min(1.0);
        let sample = PoseSample {
            sequence: tick,
            time_ns: u64::from(tick),
            pose: Pose { position: Vec3::new(0.05, 0.05, 0.14 - down), ..Pose::default() },
            buttons: 0,
            opening: 0.0,
        };
        let attach = ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID };
        let budget = Budget::of(if (700..1100).contains(&tick) { 330_000 } else { 2_400_000 });
        let mut inputs = Inputs { budget, ..Inputs::default() };
        inputs.tools[0] = Some(if tick == 0 { attach } else { ToolEvent::Pose(sample) });
        COUNTED.set(true);
        let active = press.advance(&inputs).active.iter().sum::<u32>();
        COUNTED.set(false);
        held += u32::from(press.outputs().plan.taken == 0);
        (fewest, most) = if tick < 700 { (fewest, most.max(active)) } else { (fewest.min(active), most) };
    }
    println!("{} calls; {most} active, then {fewest}; held in {held} ticks", CALLS.get());
    assert_eq!(CALLS.get(), 0, "calls to the allocator");
    assert!(held > 0 && fewest < most / 2, "it did shed");
}

/// What `make` makes, and the bytes that it holds.
fn held<T>(make: impl FnOnce() -> T) -> (T, Real) {
    let before = HELD.get();
    COUNTED.set(true);
    let made = make();
    COUNTED.set(false);
    (made, (HELD.get() - before) as Real)
}

/// A held, damped cube of 0.1 m, its finest level of lattice constant `finest` [m] and two coarser ones.
fn cube(finest: Real) -> Body {
    let side = Vec3::repeat(0.1);
    let cells = (side.x / finest) as u32;
    let face =
        Region { bounds: Bounds::new(Vec3::zeros(), Vec3::new(0.0, side.y, side.z)), stiffness: None, exact: false };
    let recipe = Recipe {
        name: "cube".into(),
        shape: Shape::closed(box_surface(side, [cells; 3]), vec![3.24 * finest, 1.8 * finest, finest]),
        material: Material::from_young(1e4, 0.45, 1000.0),
        inclusions: vec![],
        holds: vec![face],
        elements: Default::default(),
        damping_ratio: 0.15,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap()
}

/// Of a body, of a simulation with room for all its elements at once, and of one with the room that scenes give by
/// default, which a large body does not fill.
#[test]
fn memory_grows_no_faster_than_nodes() {
    let settings = LoadedScene::load(Path::new("cube"), &[]).unwrap().scene.settings();
    let per_node = [0.0112, 0.0053, 0.0028].map(|finest| {
        // Covers are made on all cores; put together anew, the body is all made on this thread.
        let prepared = cube(finest);
        let parts = || BodyParts {
            name: prepared.name().into(),
            surface: prepared.surface().clone(),
            shape: prepared.parts().shape,
            levels: prepared.levels().to_vec(),
            materials: vec![*prepared.material()],
            mixtures: MixtureParts::default(),
            labels: LabelParts::default(),
            material_of: vec![Vec::new(); prepared.levels().len()],
            supports: prepared.supports().to_vec(),
            maxwell: prepared.maxwell().to_vec(),
            slowest_mode: prepared.slowest_mode(),
            organs: vec![],
        };
        let (body, of_body) = held(|| Arc::new(Body::new(parts()).unwrap()));
        let simulation = |most_elements: usize| {
            let settings = Settings { most_elements, ..settings.clone() };
            let tools = settings.tools.len();
            held(|| Simulation::new(body.clone(), settings, Snapshot::at_rest(&body, 0, tools)).unwrap()).1
        };
        let nodes = body.nodes_of(body.finest()).len();
        let bytes = [of_body, simulation(usize::MAX), simulation(settings.most_elements)].map(|b| b / nodes as Real);
        println!(
            "{nodes} finest nodes, {} elements in all: {:.0} bytes a node in the body, {:.0} in a simulation of all \
             elements, {:.0} in one of at most {}",
            body.element_count(),
            bytes[0],
            bytes[1],
            bytes[2],
            settings.most_elements
        );
        bytes
    });
    let whole = per_node.map(|b| b[0] + b[1]);
    println!("body and simulation: {:.3} and {:.3} times the bytes a node", whole[1] / whole[0], whole[2] / whole[1]);
    assert!(whole[0] > 1000.0, "{} bytes a node: the allocator misses some", whole[0]);
    // Large bodies have fewer nodes on their faces, so a little more elements to a node.
    assert!(whole[1] / whole[0] < 1.15 && whole[2] / whole[1] < 1.15);
}
