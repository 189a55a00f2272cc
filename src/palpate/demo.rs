//! `palpate demo`: server and virtual Phantom in one process, over loopback, watched in a browser, in a window where there
//! is a display, or in the terminal.
//!
//! Window and page belong to a process of their own, `palpate view` or `palpate web`: nothing of graphics shares the
//! simulation's process. The
//! only place of the program that uses the client libraries beside `record`: the Phantom is a client like any
//! other, with zenoh sessions of its own.

use crate::companion::Companion;
use crate::{SceneArgs, ServerArgs, build, describe, ending, log_to_stderr, metrics_page, runtime};
use anyhow::{Context, anyhow, bail};
use clap::Args;
use palpate::realtime::scheduling;
use palpate::scene::Scene;
use palpate::server::Server;
use palpate::{say, tell};
use palpate_phantom::{Device, Live, Network, Pattern, Report};
use palpate_proto as proto;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph, Row, Sparkline, Table};
use std::collections::VecDeque;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

#[derive(Args)]
pub struct DemoArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    server: ServerArgs,
    /// End with a summary after this long [s]; without it, at q or Ctrl-C
    #[arg(long)]
    seconds: Option<f64>,
    /// What the virtual hand does; left out: it palpates, or grasps where the first tool has jaws
    #[arg(long, value_enum, ignore_case = true)]
    pattern: Option<Pattern>,
    /// How far below the surface the hand wants to go [m]; left out: 12 mm, or 16 mm to grasp
    #[arg(long)]
    depth: Option<f64>,
    /// Device that the virtual hand holds
    #[arg(long, default_value = "PHANTOM Omni")]
    device: String,
    /// Device that the virtual hand holds, from a TOML file with its limits
    #[arg(long, conflicts_with = "device")]
    device_file: Option<PathBuf>,
    #[command(flatten)]
    network: Network,
    /// How often the device sends poses [Hz]; a headset's 72 to 90 also work
    #[arg(long, default_value_t = 1000.0)]
    rate_hz: f64,
    /// Stay in the terminal, where there is a display too
    #[arg(long)]
    terminal: bool,
    /// Serve a page, and open it where there is a display: see `palpate web`
    #[cfg(feature = "web")]
    #[arg(long, conflicts_with = "terminal")]
    web: bool,
    /// Print a line a second instead of the live view
    #[arg(long)]
    plain: bool,
}

impl DemoArgs {
    /// What the hand does with the first tool of `scene`.
    fn pattern(&self, scene: &Scene) -> Pattern {
        let has_jaws = scene.tool.first().is_some_and(|tool| tool.grip.is_some());
        self.pattern.unwrap_or(if has_jaws { Pattern::Grasp } else { Pattern::Palpate })
    }

    /// The command that shows the demo, in a process of its own; `None`: the terminal does.
    fn companion(&self) -> Option<&'static [&'static str]> {
        #[cfg(feature = "web")]
        if self.web {
            return Some(&["web", "--open"]);
        }
        #[cfg(feature = "viewer")]
        if !self.terminal && !self.plain && palpate_viewer::window::display_is_named() {
            return Some(&["view"]);
        }
        None
    }
}

/// Points of the force history: 100 ms each.
const HISTORY: usize = 240;

/// What the view shows.
#[derive(Default)]
struct View {
    title: String,
    status: proto::Status,
    phantom: Option<Live>,
    /// Rendered force [mN], newest last.
    force: VecDeque<u64>,
    limit: f64,
}

pub fn run(args: DemoArgs) -> anyhow::Result<ExitCode> {
    let companion = args.companion();
    let live = !args.plain && std::io::stdout().is_terminal();
    // A log line would tear the live view; what matters is in the view itself.
    if companion.is_some() || !live {
        log_to_stderr(args.server.log);
    }
    scheduling::share_arenas();
    args.server.check_writable(&args.scene)?;
    let options = args.server.options(args.server.trust());
    let where_it_listens = describe(&options)?;
    let (loaded, body, start) = build(&args.scene)?;
    let device = match &args.device_file {
        Some(file) => Device::from_file(file)?,
        None => Device::by_name(&args.device)?,
    };
    let scene: Scene = loaded.scene.clone();
    let runtime = runtime()?;
    let ended = runtime.block_on(async {
        let signals = ending::listen()?;
        args.server.metrics.map(metrics_page::serve).transpose()?;
        let server = Server::start(loaded.scene, body, start, options).await?;
        tell!("{where_it_listens}; {}", server.measured().describe());
        if let Some(warning) = server.warning() {
            tell!("warning: {warning}");
        }
        let (stop, newest) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(None)));
        let phantom = start_phantom(&args, &scene, device.clone(), stop.clone(), newest.clone())?;
        let mut view = View {
            title: format!(
                "palpate demo: {}, {} held by a virtual hand, {}",
                scene.name,
                device.name,
                args.pattern(&scene).name()
            ),
            limit: scene.safety.force_limit,
            ..View::default()
        };
        let watched = tokio::task::block_in_place(|| {
            let status = server.live();
            let mut refresh = |view: &mut View| {
                view.status = status.borrow().clone();
                let now = *newest.lock().unwrap_or_else(PoisonError::into_inner);
                view.phantom = now;
                let force = now.map_or(0.0, |n: Live| norm(n.sample.force));
                view.force.push_back((force * 1e3) as u64);
                if view.force.len() > HISTORY {
                    view.force.pop_front();
                }
            };
            let over = || phantom.is_finished() || signals.borrow().is_some();
            if let Some(command) = companion {
                let companion = Companion::start(command, &args.server)?;
                watch_plain(&mut view, &mut refresh, || over() || companion.has_ended())?;
                if over() || !companion.has_failed() {
                    return Ok(());
                }
                tell!("palpate {} failed: watching in the terminal", command[0]);
            }
            if live { watch_live(&mut view, &mut refresh, over) } else { watch_plain(&mut view, &mut refresh, over) }
        });
        stop.store(true, Ordering::Relaxed);
        let report = tokio::task::spawn_blocking(move || phantom.join())
            .await?
            .map_err(|_| anyhow!("the virtual Phantom panicked"))?;
        let status = server.stop().await;
        watched?;
        say!("{}\n", summary(&status))?;
        let report = report.context("the virtual Phantom")?;
        say!("{report}")?;
        if report.should_have_touched() && report.contact_wrenches == 0 {
            bail!(
                "the virtual hand touched nothing in {:.1} s: the body is not where its surface was, or nothing of it \
                 faces up. Remedy: see how it starts with `palpate view`; `palpate-phantom --site` takes another place",
                report.seconds
            );
        }
        Ok(ending::exit_code(&status, *signals.borrow()))
    });
    runtime.shutdown_background();
    ended
}

fn start_phantom(
    args: &DemoArgs,
    scene: &Scene,
    device: Device,
    stop: Arc<AtomicBool>,
    newest: Arc<Mutex<Option<Live>>>,
) -> anyhow::Result<std::thread::JoinHandle<anyhow::Result<Report>>> {
    let options = palpate_phantom::Options {
        endpoints: palpate_sdk::Endpoints {
            force: args.server.force_endpoint.clone(),
            surface: args.server.surface_endpoint.clone(),
            session: args.server.session.clone(),
            ..Default::default()
        },
        device,
        pattern: args.pattern(scene),
        depth: args.depth.unwrap_or_else(|| args.pattern(scene).depth()),
        rate_hz: args.rate_hz,
        render: args.network.render,
        link: args.network.conditions()?,
        seed: args.network.seed,
        seconds: args.seconds,
        ..palpate_phantom::Options::default()
    };
    std::thread::Builder::new()
        .name("virtual Phantom".into())
        .spawn(move || {
            palpate_phantom::run(&options, &stop, &mut |live| {
                *newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(*live);
            })
        })
        .context("starting the virtual Phantom")
}

fn watch_plain(view: &mut View, refresh: &mut dyn FnMut(&mut View), over: impl Fn() -> bool) -> anyhow::Result<()> {
    let mut last = Instant::now();
    while !over() {
        std::thread::sleep(Duration::from_millis(100));
        refresh(view);
        if last.elapsed() >= Duration::from_secs(1) {
            last = Instant::now();
            tell!("{}", one_line(view));
        }
    }
    Ok(())
}

fn watch_live(view: &mut View, refresh: &mut dyn FnMut(&mut View), over: impl Fn() -> bool) -> anyhow::Result<()> {
    let mut terminal = ratatui::try_init().context("the terminal")?;
    let outcome = (|| {
        while !over() {
            refresh(view);
            terminal.draw(|frame| draw(view, frame))?;
            // The wait for a key is the view's clock.
            if event::poll(Duration::from_millis(100))?
                && let Event::Key(key) = event::read()?
            {
                let interrupt = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
                if interrupt || key.code == KeyCode::Char('q') {
                    break;
                }
            }
        }
        Ok(())
    })();
    ratatui::restore();
    outcome
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

fn one_line(view: &View) -> String {
    let s = &view.status;
    let late = s.lateness_us.unwrap_or_default();
    let compute = s.compute_us.unwrap_or_default();
    let force = view.phantom.map_or(0.0, |p| norm(p.sample.force));
    format!(
        "tick {:>7}  {:6.1} Hz  late p50 {:.0} p99 {:.0} p99.9 {:.0} max {:.0} µs  compute p50 {:.0} p99 {:.0} µs  \
         force {force:.3} N  {} nodes {} elements  {:.1} frames/s  {} missed",
        s.tick,
        s.tick_rate_hz,
        late.p50,
        late.p99,
        late.p999,
        late.max,
        compute.p50,
        compute.p99,
        s.nodes,
        s.elements,
        s.surface_frames_hz,
        s.missed_deadlines
    )
}

/// What a run came to, in words and numbers.
pub fn summary(s: &proto::Status) -> String {
    let row = |name: &str, d: Option<proto::Distribution>| {
        let d = d.unwrap_or_default();
        format!("{name:<28}{:>10.1}{:>10.1}{:>10.1}{:>10.1}{:>10}", d.p50, d.p99, d.p999, d.max, d.count)
    };
    let mut lines = vec![
        format!("{:<28}{:>10}{:>10}{:>10}{:>10}{:>10}", "[µs]", "p50", "p99", "p99.9", "max", "count"),
        row("tick lateness", s.lateness_us),
        row("compute per tick", s.compute_us),
        String::new(),
        format!(
            "{} ticks at {:.1} Hz; {} late by a tick, {} missed deadlines, {} stalls lost {} ticks, the body stood still in {}",
            s.tick, s.tick_rate_hz, s.late_ticks, s.missed_deadlines, s.stalls, s.lapsed_ticks, s.unmoved_ticks
        ),
        format!(
            "{} active nodes ({} by level), {} elements, {} evaluations; planned {}; {} splits, {} merges",
            s.nodes,
            by_level(s),
            s.elements,
            s.element_evaluations,
            planned(s),
            s.splits,
            s.merges
        ),
        format!(
            "{} of the missed deadlines while the machine was away, {:.1} of the others a minute; the real-time threads take \
             {:.0} % of a processor; the coarsest body takes {:.0} µs of a tick",
            s.missed_away,
            s.missed_per_minute,
            100.0 * s.real_time_share,
            s.floor as f64 / 1e3
        ),
        format!(
            "{} wrenches sent, {} skipped; {:.1} surface frames/s; {}",
            s.wrenches_sent, s.wrenches_skipped, s.surface_frames_hz, s.scheduling
        ),
    ];
    if !s.refused.is_empty() {
        let refused: Vec<String> = s.refused.iter().map(|r| format!("{} {}", r.count, r.reason)).collect();
        lines.push(format!("refused: {}", refused.join(", ")));
    }
    if s.restored_states > 0 {
        lines.push(format!("{} states that were not finite, or entangled, were replaced", s.restored_states));
    }
    if let Some(r) = &s.recording {
        let fault = if r.fault.is_empty() { String::new() } else { format!("; ENDED EARLY: {}", r.fault) };
        lines.push(format!("recorded {} ticks into {} ({:.1} MB){fault}", r.ticks, r.path, r.bytes as f64 / 1e6));
    }
    lines.join("\n")
}

fn draw(view: &View, frame: &mut ratatui::Frame) {
    let s = &view.status;
    let [head, clock, load, force, foot] = Layout::vertical([
        Constraint::Length(2),
        Constraint::Length(6),
        Constraint::Length(7),
        Constraint::Min(6),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    let scheduling = if s.scheduling.starts_with("SCHED_FIFO") { Color::Green } else { Color::Yellow };
    frame.render_widget(
        Paragraph::new(vec![
            Line::from(view.title.as_str()).bold(),
            Line::from(format!("{}; clients: {}", s.scheduling, s.clients.join(", "))).style(scheduling),
        ]),
        head,
    );
    let cells = |name: &str, d: Option<proto::Distribution>| {
        let d = d.unwrap_or_default();
        Row::new([name.to_owned(), micros(d.p50), micros(d.p99), micros(d.p999), micros(d.max)])
    };
    let widths = [
        Constraint::Length(20),
        Constraint::Length(10),
        Constraint::Length(10),
        Constraint::Length(10),
        Constraint::Length(10),
    ];
    let round_trip = view.phantom.map_or([f64::NAN; 2], |p| [p.round_trip_p50, p.round_trip_p99]);
    let table = Table::new(
        [
            cells("tick lateness", s.lateness_us),
            cells("compute per tick", s.compute_us),
            Row::new([
                "pose to wrench".to_owned(),
                micros(round_trip[0]),
                micros(round_trip[1]),
                String::new(),
                String::new(),
            ]),
        ],
        widths,
    )
    .header(Row::new(["[µs]", "p50", "p99", "p99.9", "max"]).bold())
    .block(Block::bordered().title(format!(" clock: {:.1} Hz, tick {} ", s.tick_rate_hz, s.tick)));
    frame.render_widget(table, clock);

    let missed = format!(
        "deadlines missed {} ({} away, {:.1} a minute)   stalls {} ({} ticks lost)   stood still {}",
        s.missed_deadlines, s.missed_away, s.missed_per_minute, s.stalls, s.lapsed_ticks, s.unmoved_ticks
    );
    let touch = view.phantom.map_or("waiting for the Phantom".to_owned(), |p| {
        format!(
            "{:?}, {} contact points, {} wrenches received, {} missed",
            p.phase, p.contact_points, p.wrenches, p.missed_wrenches
        )
    });
    let lines = vec![
        Line::from(format!(
            "active nodes {} ({}), {} elements, planned {}",
            s.nodes,
            by_level(s),
            s.elements,
            planned(s)
        )),
        Line::from(format!(
            "surface {:.1} frames/s; wrenches sent {}, skipped {}",
            s.surface_frames_hz, s.wrenches_sent, s.wrenches_skipped
        )),
        Line::from(missed).style(if s.missed_deadlines + s.stalls > 0 { Color::Yellow } else { Color::Reset }),
        Line::from(format!("tool: {touch}")),
        Line::from(recording_line(s)),
    ];
    frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(" body and channel ")), load);

    let now = view.force.back().copied().unwrap_or(0) as f64 / 1e3;
    let peak = view.force.iter().copied().max().unwrap_or(0);
    let block = Block::bordered().title(format!(
        " force {now:.3} N (last {} s, peak {:.3} N, limit {} N) ",
        HISTORY / 10,
        peak as f64 / 1e3,
        view.limit
    ));
    let width = block.inner(force).width as usize;
    let shown: Vec<u64> = view.force.iter().copied().skip(view.force.len().saturating_sub(width)).collect();
    let bars = Sparkline::default().data(&shown).max(peak.max(100)).style(Style::new().fg(Color::Red));
    frame.render_widget(bars.block(block), force);
    frame.render_widget(Line::from(" q or Ctrl-C ends ").dim(), foot);
}

/// What the last tick was planned to take, of what a tick may.
fn planned(s: &proto::Status) -> String {
    let micros = |ns: u64| ns as f64 / 1e3;
    format!("{:.0} µs a tick, at most {:.0} of {:.0}", micros(s.work), micros(s.planned), micros(s.budget))
}

fn recording_line(s: &proto::Status) -> String {
    match &s.recording {
        Some(r) => format!("recording {} ticks, {:.1} MB into {}", r.ticks, r.bytes as f64 / 1e6, r.path),
        None => "not recording".into(),
    }
}

fn micros(value: f64) -> String {
    if value.is_finite() { format!("{value:.1}") } else { "–".into() }
}

/// Active nodes per level, coarsest first: "120+80+400".
fn by_level(s: &palpate_proto::Status) -> String {
    s.active_nodes.iter().map(u64::to_string).collect::<Vec<_>>().join("+")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_view_shows_rate_lateness_force_and_misses() {
        let distribution = |p50| Some(proto::Distribution { p50, p99: 51.0, p999: 99.0, max: 1234.5, count: 10 });
        let view = View {
            title: "palpate demo: liver".into(),
            status: proto::Status {
                tick: 4321,
                tick_rate_hz: 999.9,
                lateness_us: distribution(21.5),
                compute_us: distribution(205.0),
                nodes: 777,
                elements: 3456,
                surface_frames_hz: 31.2,
                missed_deadlines: 3,
                ..Default::default()
            },
            force: [100, 400, 900].into(),
            limit: 3.3,
            ..View::default()
        };
        let mut terminal = ratatui::Terminal::new(ratatui::backend::TestBackend::new(100, 30)).unwrap();
        terminal.draw(|frame| draw(&view, frame)).unwrap();
        let text: String = terminal.backend().buffer().content().iter().map(|c| c.symbol()).collect();
        for part in [
            "999.9 Hz",
            "tick 4321",
            "21.5",
            "51.0",
            "99.0",
            "1234.5",
            "205.0",
            "active nodes 777",
            "3456 elements",
            "31.2 frames/s",
            "deadlines missed 3",
            "force 0.900 N",
            "peak 0.900 N",
            "limit 3.3 N",
        ] {
            assert!(text.contains(part), "{part}");
        }
        assert!(one_line(&view).contains("999.9 Hz"));
    }
}
