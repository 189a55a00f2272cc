//! Viewers of the surface: what each sees, whatever the others and its own network do.

use super::{Running, above, move_tool, rigid, serve, serve_with, stranger, wait_for};
use palpate_proto::surface::{KEY_INTERVAL, MOST_MESSAGE_BYTES, VERTICES_PER_PART};
use palpate_proto::{Message, Session, SurfaceFrame, keys};
use palpate_sdk::{Connection, Moment, SurfaceDecoder, SurfaceWatch, WatchCounters, WatchOptions};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use zenoh::Wait;

/// Watches, and keeps every moment that it is shown.
pub struct Viewer {
    seen: Arc<Mutex<Vec<Arc<Moment>>>>,
    done: Arc<AtomicBool>,
    thread: JoinHandle<WatchCounters>,
}

impl Viewer {
    pub fn watch(connection: &Connection, options: WatchOptions) -> Self {
        let watch = connection.watch_surface(options).unwrap();
        let (seen, done) = <(Arc<Mutex<Vec<Arc<Moment>>>>, Arc<AtomicBool>)>::default();
        let (into, stop) = (seen.clone(), done.clone());
        let thread = std::thread::spawn(move || {
            while !stop.load(Relaxed) {
                let mut seen = into.lock().unwrap();
                if let Some(moment) = watch.latest().filter(|now| seen.last().is_none_or(|last| last != now)) {
                    seen.push(moment);
                }
                drop(seen);
                std::thread::sleep(Duration::from_millis(2));
            }
            watch.counters()
        });
        Self { seen, done, thread }
    }

    /// What it has been shown so far.
    pub fn seen(&self) -> Vec<Arc<Moment>> {
        self.seen.lock().unwrap().clone()
    }

    pub fn stop(self) -> Vec<Arc<Moment>> {
        self.done.store(true, Relaxed);
        let counters = self.thread.join().unwrap();
        assert_eq!(counters.undecodable, 0, "{counters:?}");
        self.seen.lock().unwrap().clone()
    }
}

fn by_tick(moments: &[Arc<Moment>]) -> BTreeMap<u64, &Moment> {
    moments.iter().map(|moment| (moment.tick, &**moment)).collect()
}

/// Moments of ticks that both have seen; they must show the same.
fn alike(some: &[Arc<Moment>], others: &[Arc<Moment>]) -> usize {
    let others = by_tick(others);
    let both = some.iter().filter_map(|one| Some((one, others.get(&one.tick)?)));
    both.inspect(|(one, other)| assert!(one.positions == other.positions, "tick {}", one.tick)).count()
}

/// A viewer's connection of its own.
fn connect(running: &Running) -> Connection {
    Connection::open_surface(&running.endpoints).unwrap()
}

/// Presses and lets go, at least once and until `done`.
fn palpate_until(connection: &Connection, what: &str, mut done: impl FnMut() -> bool) {
    let mut tool = connection.attach(&rigid("hand", "left", 1000.0)).unwrap();
    let mut strokes = 0;
    wait_for(what, || {
        move_tool(&mut tool, 0.02, -0.01, 450);
        move_tool(&mut tool, -0.01, 0.02, 450);
        strokes += 1;
        done()
    });
    println!("{strokes} strokes until {what}");
    tool.detach().unwrap();
}

#[test]
fn viewers_of_fewer_frames_and_of_levels_see_the_same_body() {
    let running = serve();
    let hand = Connection::open(&running.endpoints).unwrap();
    let all = Viewer::watch(&connect(&running), WatchOptions::default());
    let options = [(2, false), (4, true), (8, false)].map(|(every, levels)| WatchOptions { every, levels });
    let viewers = options.map(|options| (options, Viewer::watch(&connect(&running), options)));
    let fine = |moment: &Arc<Moment>| moment.levels.contains(&1);
    palpate_until(&hand, "all have seen ten moments in common", || {
        let seen = all.seen();
        viewers.iter().all(|(options, viewer)| {
            let some = viewer.seen();
            alike(&some, &seen) > 10 && (!options.levels || some.iter().any(fine))
        })
    });
    for (options, viewer) in viewers {
        let moments = viewer.stop();
        // The first may be the key frame that a newcomer asks for.
        assert!(moments.iter().skip(1).all(|m| m.sequence.is_multiple_of(u64::from(options.every))), "{options:?}");
        // The cube has two levels, and the finer one is used under the ball.
        let of_levels: Vec<u8> = moments.iter().flat_map(|m| m.levels.iter().copied()).collect();
        assert_eq!(of_levels.is_empty(), !options.levels);
        assert!(!options.levels || (of_levels.contains(&0) && of_levels.iter().max() == Some(&1)));
    }
    all.stop();
    running.stop();
}

#[test]
fn a_late_viewer_sees_the_body_before_any_frame_of_its_stream_comes() {
    let running = serve();
    let hand = Connection::open(&running.endpoints).unwrap();
    let early = Viewer::watch(&connect(&running), WatchOptions::default());
    palpate_until(&hand, "twenty moments", || early.seen().len() > 20);
    for _ in 0..8 {
        let before = early.seen().last().unwrap().sequence;
        let late = connect(&running).watch_surface(WatchOptions { every: 8, levels: true }).unwrap();
        wait_for("the first moment", || late.latest().is_some());
        // The newest key frame or what came since, never anything older.
        let first = late.latest().unwrap();
        assert!(first.sequence + KEY_INTERVAL > before, "frame {} after frame {before}", first.sequence);
        wait_for("the others to have seen it or missed it", || early.seen().last().unwrap().tick > first.tick);
        alike(&[first], &early.seen());
    }
    early.stop();
    running.stop();
}

#[test]
fn whoever_asks_gets_the_newest_key_frame_and_can_decode_it() {
    let running = serve();
    let early = Viewer::watch(&connect(&running), WatchOptions::default());
    wait_for("some moments", || early.seen().len() > 5);
    let before = early.seen().last().unwrap().sequence;
    let surface = Arc::new(connect(&running).surface_topology().unwrap());
    let stranger = stranger(&running.endpoints.surface);
    let replies = stranger.get(keys::surface_key("test")).wait().unwrap();
    let (mut decoder, mut moment) = (SurfaceDecoder::new(surface), None);
    for reply in replies {
        let key = SurfaceFrame::decode(&*reply.result().unwrap().payload().to_bytes()).unwrap();
        assert!(key.sequence.is_multiple_of(KEY_INTERVAL) && key.sequence + KEY_INTERVAL > before, "{}", key.sequence);
        moment = moment.or(decoder.receive(&key).unwrap());
    }
    let moment = moment.expect("a key frame needs nothing else");
    assert!(moment.sequence.is_multiple_of(KEY_INTERVAL) && moment.levels.len() == moment.positions.len());
    early.stop();
    running.stop();
}

#[test]
fn obstacles_are_told_and_shown_where_they_are_with_what_the_body_puts_on_them() {
    // From 2 mm above the cube to 4 mm into it, and back.
    let lid = "obstacle=[{name='lid', shape='ball', radius=0.02, position=[0.05,0.05,0.122], \
               motion={displacement=[0.0,0.0,-0.006], period=0.6}}]";
    let running = serve_with("[[5,5,5]]", lid);
    let told = connect(&running).session().unwrap().obstacles;
    let [lid] = &told[..] else { panic!("{told:?}") };
    assert_eq!((lid.name.as_str(), &lid.position[..], lid.parts.len()), ("lid", &[0.05, 0.05, 0.122][..], 1));
    let viewer = Viewer::watch(&connect(&running), WatchOptions::default());
    let heights = |seen: &[Arc<Moment>]| -> Vec<[f32; 2]> {
        seen.iter().map(|moment| [moment.obstacles[0].position[2], moment.obstacles[0].force[2]]).collect()
    };
    wait_for("it has been deep in and out", || {
        let seen = heights(&viewer.seen());
        seen.iter().any(|[z, _]| *z < 0.1165) && seen.iter().any(|[z, _]| *z > 0.1215)
    });
    for [z, newtons] in heights(&viewer.stop()) {
        assert!((0.116 - 1e-6..0.122 + 1e-6).contains(&z), "{z}");
        assert!(z < 0.1205 || newtons == 0.0, "{newtons} N at {z}");
        assert!(z > 0.117 || newtons > 0.05, "{newtons} N at {z}");
    }
    running.stop();
}

#[test]
fn with_a_tenth_of_the_messages_lost_every_moment_that_is_shown_is_right() {
    let running = serve();
    let hand = Connection::open(&running.endpoints).unwrap();
    let whole = Viewer::watch(&connect(&running), WatchOptions::default());
    let surface = Arc::new(hand.surface_topology().unwrap());
    let parts = surface.rest_positions.len().div_ceil(VERTICES_PER_PART);
    let seen = Arc::new(Mutex::new((SurfaceDecoder::new(surface), Vec::new(), Vec::new(), 0u64)));
    let (lossy, state) = (stranger(&running.endpoints.surface), seen.clone());
    let _frames = lossy
        .declare_subscriber(keys::surface_frames("test", 1, false))
        .callback(move |sample| {
            let (decoder, moments, kept, came) = &mut *state.lock().unwrap();
            assert!(sample.payload().len() <= MOST_MESSAGE_BYTES);
            *came += 1;
            // A tenth of them, key frames too, in no pattern that key frames could have.
            if came.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32 >= (1 << 32) / 10 {
                let frame = SurfaceFrame::decode(&*sample.payload().to_bytes()).unwrap();
                kept.push((frame.sequence, frame.key));
                moments.extend(decoder.receive(&frame).unwrap().map(Arc::new));
            }
        })
        .wait()
        .unwrap();
    palpate_until(&hand, "160 frames came and 60 were compared", || {
        let (_, moments, _, came) = &*seen.lock().unwrap();
        *came > 160 && alike(moments, &whole.seen()) > 60
    });
    let (_, moments, kept, came) = &*seen.lock().unwrap();
    println!("{} of {came} frames shown, {} came through", moments.len(), kept.len());
    assert!(kept.len() as u64 * 20 < came * 19);
    // Shown is every frame that came whole and whose key frame came whole: after a loss, the next key frame at the latest.
    let shown: Vec<u64> = moments.iter().map(|moment| moment.sequence).collect();
    let mut came_of = BTreeMap::new();
    kept.iter().for_each(|(own, key)| came_of.entry(*own).or_insert((*key, 0)).1 += 1);
    let whole_came = |own: &u64| came_of.get(own).is_some_and(|(_, came)| *came == parts);
    let expected: Vec<u64> =
        came_of.iter().filter(|(own, (key, _))| whole_came(own) && whole_came(key)).map(|(own, _)| *own).collect();
    assert_eq!(shown, expected);
    whole.stop();
    running.stop();
}

/// Set for the process that is stopped and resumed: the surface endpoint.
const VIEWER: &str = "PALPATE_TEST_VIEWER";

fn checksum(moment: &Moment) -> u32 {
    moment.positions.iter().flatten().fold(1, |sum, x| sum.wrapping_mul(31).wrapping_add(x.to_bits()))
}

/// Prints every moment that it is shown, for 60 s or until it is killed.
fn show(watch: &SurfaceWatch) {
    let mut last = None;
    for _ in 0..30_000 {
        if let Some(moment) = watch.latest().filter(|now| last != Some(now.tick)) {
            last = Some(moment.tick);
            println!("shown {} {}", moment.tick, checksum(&moment));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[cfg(unix)]
#[test]
fn a_viewer_stopped_for_five_seconds_and_resumed_is_right_again_and_nobody_else_notices() {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};
    if let Ok(surface) = std::env::var(VIEWER) {
        let endpoints = palpate_sdk::Endpoints { surface, session: "test".into(), ..Default::default() };
        return show(&Connection::open_surface(&endpoints).unwrap().watch_surface(WatchOptions::default()).unwrap());
    }
    let running = serve();
    let mut stopped = Command::new(std::env::current_exe().unwrap())
        .args([
            "viewers::a_viewer_stopped_for_five_seconds_and_resumed_is_right_again_and_nobody_else_notices",
            "--exact",
            "--nocapture",
        ])
        .env(VIEWER, &running.endpoints.surface)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let shown = Arc::new(Mutex::new(Vec::<(u64, u32)>::new()));
    let (lines, into) = (BufReader::new(stopped.stdout.take().unwrap()).lines(), shown.clone());
    let reading = std::thread::spawn(move || {
        for line in lines.map_while(Result::ok) {
            let words: Vec<&str> = line.split(' ').collect();
            if let ["shown", tick, sum] = words[..] {
                into.lock().unwrap().push((tick.parse().unwrap(), sum.parse().unwrap()));
            }
        }
    });
    let last = || shown.lock().unwrap().last().map_or(0, |shown| shown.0);
    let signal = |name: &str| Command::new("kill").args([name, &stopped.id().to_string()]).status().unwrap();
    wait_for("its first moments", || shown.lock().unwrap().len() > 5);

    let viewer = Viewer::watch(&connect(&running), WatchOptions::default());
    let hand = Connection::open(&running.endpoints).unwrap();
    let mut tool = hand.attach(&rigid("hand", "left", 1000.0)).unwrap();
    signal("-STOP");
    let (stopped_at, began, before) = (last(), Instant::now(), viewer.seen().len());
    // Meanwhile frames go on for the other viewer and wrenches for the hand: none of them waits for it.
    wait_for("five seconds, frames and wrenches", || {
        move_tool(&mut tool, 0.02, -0.01, 500);
        move_tool(&mut tool, -0.01, 0.02, 500);
        let (frames, wrenches) = (viewer.seen().len() - before, tool.counters().received);
        began.elapsed() > Duration::from_secs(5) && frames > 100 && wrenches > 3000
    });
    let resumed_at = running.status().tick;
    signal("-CONT");
    let after = || shown.lock().unwrap().iter().copied().filter(|(tick, _)| *tick > stopped_at).collect::<Vec<_>>();
    let compared = || {
        let (moments, after) = (viewer.seen(), after());
        let right = by_tick(&moments);
        let both: Vec<_> = after.iter().filter_map(|(tick, sum)| Some((*sum, checksum(right.get(tick)?)))).collect();
        assert!(both.iter().all(|(one, other)| one == other), "of {} some are wrong", both.len());
        both.len()
    };
    wait_for("it to catch up", || {
        tool.send_pose(above(-0.005)).unwrap();
        last() > resumed_at + 500 && compared() > 8
    });
    stopped.kill().unwrap();
    stopped.wait().unwrap();
    reading.join().unwrap();
    println!("{} moments after the stop, {} of them compared", after().len(), compared());
    viewer.stop();
    assert_eq!(running.stop().restored_states, 0);
}

#[test]
fn a_viewer_of_a_later_major_version_is_told_which_one_the_server_speaks() {
    let running = serve();
    let connection = connect(&running);
    let later = stranger(&running.endpoints.surface);
    let replies = later.get("palpate/v2/test/session").wait().unwrap();
    let reply = replies.recv().expect("an answer to whoever asks");
    let session = Session::decode(&*reply.result().unwrap().payload().to_bytes()).unwrap();
    assert_eq!(session, Session { tick: session.tick, ..connection.session().unwrap() });
    running.stop();
}
