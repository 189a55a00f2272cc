//! How long it takes from a tick to the pixels that show it, and where the time goes, with a server on this machine:
//!
//!     palpate demo --terminal
//!     cargo run --release -p palpate-viewer --example latency
//!
//! A free tool is held far from the body: its wrenches, a thousand a second, tell when each tick was.

use anyhow::Context;
use hdrhistogram::Histogram;
use palpate_sdk::{Attachment, Connection, Endpoints, PoseSample};
use palpate_viewer::app::App;
use palpate_viewer::offscreen::Offscreen;
use palpate_viewer::painter::Painter;
use palpate_viewer::source::Live;
use palpate_viewer::three_d::{ClearState, HasContext, RenderTargetMultisample, Viewport};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// How long each part is measured.
const MEASURED: Duration = Duration::from_secs(10);
/// Size of the picture.
const SIZE: (u32, u32) = (1280, 800);

fn main() -> anyhow::Result<()> {
    let endpoints = Endpoints::default();
    let connection = Connection::open(&endpoints)?;
    let clock = TickClock::new(&connection)?;
    println!("{:<44}{:>9}{:>9}{:>9}", "[ms]", "p50", "p99", "max");

    let mut decoded = histogram();
    let (live, began, mut last) = (Live::watch(&endpoints), Instant::now(), None);
    while began.elapsed() < MEASURED {
        let newest = live.view().newest;
        if let Some(tick) = newest.filter(|_| newest != last) {
            last = newest;
            if began.elapsed() > Duration::from_secs(1) {
                record(&mut decoded, clock.since(&connection, tick));
            }
        }
        std::thread::sleep(Duration::from_micros(500));
    }
    row("tick to decoded frame", &decoded);
    drop(live);

    let offscreen = Offscreen::new()?;
    let mut painter = Painter::new(&offscreen.context);
    let mut app = App::live(&endpoints);
    while app.moment().tick == 0 {
        app.advance(0.0)?;
    }
    let viewport = Viewport::new_at_origo(SIZE.0, SIZE.1);
    let target = RenderTargetMultisample::<[u8; 4], f32>::new(&offscreen.context, SIZE.0, SIZE.1, 4);
    let mut parts =
        ["moment between two frames", "panels", "normals, colours, upload", "drawing"].map(|name| (name, histogram()));
    let (mut whole, mut pixels) = (histogram(), histogram());
    let (began, before, mut pictures) = (Instant::now(), processor_time(), 0u32);
    while began.elapsed() < MEASURED {
        let start = Instant::now();
        app.advance(0.0)?;
        let moment = start.elapsed();
        let spent = painter.prepare(&mut app, &mut [], 1e3 * began.elapsed().as_secs_f64(), viewport, 1.0);
        let draw = Instant::now();
        target.clear(ClearState::color_and_depth(1.0, 1.0, 1.0, 1.0, 1.0)).write(|| painter.paint(&app))?;
        // SAFETY: the context is current on this thread; without this the renderer's own threads go on unseen.
        unsafe { offscreen.context.finish() };
        for ((_, part), took) in parts.iter_mut().zip([moment, spent.panels, spent.mesh, draw.elapsed()]) {
            record(part, took);
        }
        record(&mut whole, start.elapsed());
        record(&mut pixels, clock.since(&connection, app.moment().tick));
        pictures += 1;
    }
    parts.iter().for_each(|(name, part)| row(name, part));
    row("a picture, all of these", &whole);
    row("tick to pixels, 40 ms of delay in it", &pixels);
    let (seconds, worked) = (began.elapsed().as_secs_f64(), processor_time().zip(before));
    println!("{:.1} pictures a second of {} x {}", f64::from(pictures) / seconds, SIZE.0, SIZE.1);
    // What a machine that does nothing else has to do.
    if let Some((after, before)) = worked {
        println!("{:.1} ms of a processor for each", 1e3 * (after - before) / f64::from(pictures));
    }
    Ok(())
}

/// Processor time [s] of all threads so far, where the system says (Linux, which counts in hundredths).
fn processor_time() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let numbers: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    Some(numbers.get(11..13)?.iter().filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() * 0.01)
}

/// When ticks are, on the clock of a connection.
struct TickClock {
    /// Least that a wrench's arrival came after its tick number's milliseconds [ns].
    offset: Arc<AtomicI64>,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl TickClock {
    fn new(connection: &Connection) -> anyhow::Result<Self> {
        let limits = connection.session()?.limits.context("a server without limits")?;
        let corner: Vec<f64> = limits.workspace[3..6].iter().map(|coordinate| coordinate - 0.01).collect();
        let offset = Arc::new(AtomicI64::new(i64::MAX));
        let least = offset.clone();
        let attachment = Attachment { client: "latency".into(), ..Attachment::default() };
        let mut tool = connection.attach_observed(&attachment, move |wrench, arrival_ns| {
            least.fetch_min(arrival_ns as i64 - 1_000_000 * wrench.tick as i64, Relaxed);
        })?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            let pose = PoseSample {
                position: [corner[0], corner[1], corner[2]],
                orientation: [0.0, 0.0, 0.0, 1.0],
                linear_velocity: None,
                buttons: 0,
                opening: 0.0,
            };
            while !stopped.load(Relaxed) && tool.send_pose(pose).is_ok() {
                std::thread::sleep(Duration::from_millis(1));
            }
            let _ = tool.detach();
        });
        std::thread::sleep(Duration::from_secs(1));
        Ok(Self { offset, stop, thread: Some(thread) })
    }

    /// How long ago `tick` was.
    fn since(&self, connection: &Connection, tick: u64) -> Duration {
        let then = self.offset.load(Relaxed) + 1_000_000 * tick as i64;
        Duration::from_nanos((connection.now_ns() as i64 - then).max(0) as u64)
    }
}

impl Drop for TickClock {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn histogram() -> Histogram<u64> {
    // Microseconds up to a minute.
    Histogram::new_with_bounds(1, 60_000_000, 3).unwrap_or_else(|_| unreachable!("valid bounds"))
}

fn record(histogram: &mut Histogram<u64>, took: Duration) {
    histogram.saturating_record(took.as_micros().max(1) as u64);
}

fn row(name: &str, histogram: &Histogram<u64>) {
    let ms = |micros: u64| micros as f64 / 1e3;
    let (p50, p99) = (histogram.value_at_quantile(0.5), histogram.value_at_quantile(0.99));
    println!("{name:<44}{:>9.2}{:>9.2}{:>9.2}", ms(p50), ms(p99), ms(histogram.max()));
}
