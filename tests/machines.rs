//! Machines that are made up: what the parts of a tick cost is told, and when the machine is away. On each of them the clock
//! is kept, whatever it costs in accuracy.

use palpate::realtime::clock::Clock;
use palpate::realtime::mailbox::{Command, PoseSlot, ServerEnds, mailboxes};
use palpate::realtime::sim_thread::{Measured, SimThread};
use palpate::scene::LoadedScene;
use palpate_core::contact::tool::{Coupling, PoseSample};
use palpate_core::math::{Pose, Real, Vec3};
use palpate_core::simulation::{Part, Prices, Simulation};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Of the ball that presses [m].
const RADIUS: Real = 0.02;
/// Ticks in which it is learnt what things cost, and how that spreads.
const LEARNS: u64 = 2200;
/// Ticks of a hand's press and release.
const PRESS_TICKS: u64 = 1000;

/// A machine on which time passes as its parts are said to cost.
struct Machine<'a> {
    now: u64,
    tick: u64,
    /// How many times slower than a common one, by tick.
    slowness: &'a dyn Fn(u64) -> Real,
    /// Noise of costs: its state.
    noise: u64,
    ticks: u64,
    stop: Arc<AtomicBool>,
    server: ServerEnds,
    /// Where the hand presses.
    top: Vec3,
    found: Found,
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    missed: u64,
    still: u64,
    /// Most ticks in a row in which the body stood still.
    still_in_a_row: u64,
    in_a_row: u64,
    /// Sum of the elements in use while the hand presses, and of these ticks.
    elements: u64,
    pressed: u64,
    /// Greatest force [N].
    force: Real,
}

impl Machine<'_> {
    /// Costs are what they are said to be within a tenth, as on a quiet machine.
    fn cost(&mut self, part: Part, count: u32) -> u64 {
        self.noise = self.noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let uniform = (self.noise >> 40) as Real / (1 << 24) as Real;
        let slow = (self.slowness)(self.tick) * (0.95 + 0.1 * uniform);
        (Real::from(Prices::COMMON.of(part, count)) * slow) as u64
    }

    /// A ball that is pressed in by 12 mm and taken away again.
    fn pose(&self) -> PoseSample {
        let phase = (self.tick % PRESS_TICKS) as Real / PRESS_TICKS as Real;
        let height = 0.012 - 0.024 * (std::f64::consts::PI * phase).sin();
        let pose = Pose { position: self.top + Vec3::z() * (RADIUS + height), ..Pose::default() };
        PoseSample { sequence: self.tick as u32 + 1, time_ns: 0, pose, buttons: 0, opening: 0.0 }
    }
}

impl Clock for Machine<'_> {
    fn now(&mut self) -> u64 {
        self.now
    }
    fn after(&mut self, part: Part, count: u32) -> u64 {
        let cost = self.cost(part, count);
        self.now += cost;
        self.now
    }
    fn sleep_until(&mut self, deadline: u64) {
        self.now = self.now.max(deadline);
        self.tick += 1;
        let slot = PoseSlot { epoch: 1, sample: self.pose() };
        self.server.poses[0].write(Some(slot));
        while let Ok(t) = self.server.timings.pop() {
            let still = t.plan.taken < t.plan.needed;
            let found = &mut self.found;
            if t.tick > LEARNS {
                found.missed += u64::from(t.missed);
                found.still += u64::from(still);
                found.in_a_row = if still { found.in_a_row + 1 } else { 0 };
                found.still_in_a_row = found.still_in_a_row.max(found.in_a_row);
            }
            if t.tick % PRESS_TICKS == PRESS_TICKS / 2 {
                found.elements += u64::from(t.elements);
                found.pressed += 1;
            }
        }
        while let Ok(report) = self.server.reports.pop() {
            self.found.force = self.found.force.max(report.tools[0].state.force.norm());
        }
        if self.tick >= self.ticks {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Name, and slowness by tick.
type Kind<'a> = (&'a str, &'a dyn Fn(u64) -> Real);

/// A cube on a machine of `slowness`: what it measures at its start, and what comes of `ticks` ticks there.
fn run(slowness: &dyn Fn(u64) -> Real, ticks: u64) -> (Measured, Found) {
    let given = [String::from("body.cells=[[3,3,3],[6,6,6],[12,12,12]]")];
    let loaded = LoadedScene::load(Path::new("cube"), &given).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let (settings, start) = (loaded.scene.settings(), loaded.scene.at_rest(&body));
    let simulation = Simulation::new(body.clone(), settings.clone(), start).unwrap();
    let (ends, mut server) = mailboxes(&body, &settings).unwrap();
    let attach = Command::Attach { tool: 0, epoch: 1, period_ticks: 1, coupling: Coupling::RIGID };
    server.commands.push(attach).ok().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let mut machine = Machine {
        now: 1,
        tick: 0,
        slowness,
        noise: 1,
        ticks,
        stop: stop.clone(),
        server,
        top: Vec3::new(0.05, 0.05, 0.1),
        found: Found::default(),
    };
    let mut thread = SimThread::new(simulation, ends);
    let measured = thread.measure(&mut machine);
    if measured.fits() {
        thread.run(&mut machine, &stop);
    }
    (measured, machine.found)
}

#[test]
fn on_a_slower_machine_and_on_one_whose_clock_changes_the_rate_holds_and_accuracy_gives_way() {
    let machines: [Kind; 4] = [
        ("common", &|_| 1.0),
        ("half as fast", &|_| 2.0),
        ("clock changes by a third each second", &|tick| if tick % 2000 < 1000 { 1.0 } else { 4.0 / 3.0 }),
        ("others come and go each second", &|tick| if tick % 2000 < 1000 { 1.0 } else { 2.0 }),
    ];
    let ticks = 8000;
    let found = machines.map(|(name, slowness)| {
        let (measured, found) = run(slowness, ticks);
        println!("{name}: floor {} us; {found:?}", measured.floor / 1000);
        assert!(measured.fits());
        let judged = ticks - LEARNS;
        assert!(found.missed * 1000 <= judged, "{name}: {} of {judged} ticks were late", found.missed);
        assert!(found.still * 100 <= judged && found.still_in_a_row <= 5, "{name}: it stood still for {found:?}");
        found
    });
    let [common, slow, ..] = found;
    assert!(common.elements > slow.elements, "{} elements, {} on half the machine", common.elements, slow.elements);
    let worst = found.map(|f| (f.force - common.force).abs() / common.force).into_iter().fold(0.0, Real::max);
    println!("peak forces differ by {:.1} % at most", 100.0 * worst);
}

#[test]
fn a_machine_that_the_coarsest_body_is_too_much_for_is_told_before_it_serves() {
    let (measured, found) = run(&|_| 12.0, 100);
    println!("{}", measured.describe());
    assert!(!measured.fits() && measured.floor > measured.planned);
    assert_eq!(found.pressed, 0, "it serves nothing");
    assert!(run(&|_| 1.0, 10).0.fits());
}
