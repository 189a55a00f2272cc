//! Test vectors for clients in other languages, in `proto/vectors`: they are what this crate makes of the messages in them.
//! `PALPATE_WRITE_VECTORS=1 cargo test -p palpate-client --test vectors` writes them anew.

use std::path::PathBuf;
use std::sync::Arc;

use palpate_client::proto::surface::{GridPoint, SurfaceCode};
use palpate_client::proto::{Message, SurfaceFrame, SurfaceTopology, ToolPhase, ToolState, ToolWrench};
use palpate_client::{Device, RenderMode, Renderer, Surface, SurfaceDecoder, Wrench};
use serde_json::{Value, json};

const MS: u64 = 1_000_000;

fn file(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "../../proto/vectors", name].iter().collect()
}

/// The vectors in the file `name`, which are those that `make` makes where they are to be written anew.
fn vectors(name: &str, make: impl FnOnce() -> Value) -> Value {
    if std::env::var_os("PALPATE_WRITE_VECTORS").is_some() {
        std::fs::write(file(name), format!("{:#}\n", make())).unwrap();
    }
    serde_json::from_str(&std::fs::read_to_string(file(name)).unwrap()).unwrap()
}

fn hex(message: &impl Message) -> String {
    message.encode_to_vec().iter().map(|byte| format!("{byte:02x}")).collect()
}

fn message<M: Message + Default>(hex: &Value) -> M {
    let digits = hex.as_str().unwrap().as_bytes();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    M::decode(&*digits.chunks(2).map(byte).collect::<Vec<u8>>()).unwrap()
}

fn list<T: serde::de::DeserializeOwned>(value: &Value) -> Vec<T> {
    serde_json::from_value(value.clone()).unwrap()
}

// ---- surface: a sheet of 5 × 4 vertices that bulges and swings ----

const WIDE: u32 = 5;
const DEEP: u32 = 4;
const STEP: f64 = 1.0 / 16384.0;

fn triangles() -> Vec<[u32; 3]> {
    let cells = (0..WIDE * (DEEP - 1)).filter(|v| v % WIDE + 1 < WIDE);
    cells.flat_map(|v| [[v, v + 1, v + WIDE], [v + 1, v + WIDE + 1, v + WIDE]]).collect()
}

fn rest() -> Vec<[f32; 3]> {
    (0..WIDE * DEEP).map(|v| [0.01 * (v % WIDE) as f32, 0.01 * (v / WIDE) as f32, -0.002]).collect()
}

/// Where the vertices stand on the grid in frame `sequence`: whole numbers, so that every language has the same.
fn grid(code: &SurfaceCode, sequence: i32) -> Vec<GridPoint> {
    let bulge = |(v, [x, y, z]): (i32, &GridPoint)| {
        let (column, row) = (v % WIDE as i32 - 2, v / WIDE as i32);
        [x - sequence * row, y + sequence * column / 2, z + sequence * (9 - column * column) * (row + 1)]
    };
    (0..).zip(code.rest()).map(bulge).collect()
}

fn levels() -> Vec<u8> {
    (0..WIDE * DEEP).map(|v| (v % WIDE / 2) as u8).collect()
}

fn surface_vectors() -> Value {
    let (triangles, rest) = (triangles(), rest());
    let code = SurfaceCode::new(&triangles, &rest, STEP).unwrap();
    let part = |part: usize| SurfaceTopology {
        topology: 77,
        vertices: rest.len() as u32,
        triangles: triangles[part * 12..(part + 1) * 12].as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect(),
        rest_positions: rest[part * 10..(part + 1) * 10].as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect(),
        part: part as u32,
        parts: 2,
        step: STEP,
        organs: vec![],
        ..SurfaceTopology::default()
    };
    let frame = |sequence: u64| {
        let key = sequence - sequence % 16;
        let now = grid(&code, sequence as i32);
        let reference = if key == sequence { code.rest().to_vec() } else { grid(&code, key as i32) };
        let tool = ToolState {
            tool: 1,
            position: vec![0.02, 0.015, 0.001],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            force: vec![0.0, 0.0, 0.25 * (sequence % 16) as f32],
            phase: ToolPhase::Engaged.into(),
            opening: 0.0,
            shape: 0,
        };
        let frame = SurfaceFrame {
            topology: 77,
            tick: 32 * sequence,
            sequence,
            tools: vec![tool],
            key,
            part: 0,
            displacements: code.encode(0, &reference, &now).unwrap(),
            levels: code.encode_levels(0, &levels()).unwrap(),
            obstacles: vec![],
        };
        let positions: Vec<[f32; 3]> = now.iter().map(|point| code.position(*point)).collect();
        json!({ "message": hex(&frame), "sequence": sequence, "key": key, "grid": now, "positions": positions })
    };
    json!({
        "about": "palpate.v1 messages in hexadecimal; positions [m] are grid times step, as f32. Decode the frames in order.",
        "topology": [hex(&part(0)), hex(&part(1))],
        "step": STEP,
        "triangles": triangles,
        "rest_positions": rest,
        "levels": levels(),
        "frames": [frame(16), frame(17), frame(29)],
    })
}

#[test]
fn the_frames_of_the_vectors_stand_where_they_say() {
    let vectors = vectors("surface.json", surface_vectors);
    let parts = vectors["topology"].as_array().unwrap().iter().map(message::<SurfaceTopology>).collect();
    let surface = Surface::from_parts(parts).unwrap();
    assert_eq!(surface.triangles, list::<[u32; 3]>(&vectors["triangles"]));
    assert_eq!(surface.rest_positions, list::<[f32; 3]>(&vectors["rest_positions"]));
    assert_eq!((surface.triangles.clone(), surface.rest_positions.clone()), (triangles(), rest()));
    let code = SurfaceCode::new(&surface.triangles, &surface.rest_positions, surface.step).unwrap();
    let frames = vectors["frames"].as_array().unwrap();
    assert_eq!(
        frames.iter().filter(|frame| frame["sequence"] != frame["key"]).count(),
        2,
        "frames that are no key frame"
    );
    let mut decoder = SurfaceDecoder::new(Arc::new(surface));
    for frame in frames {
        let sequence = frame["sequence"].as_u64().unwrap();
        let points = list::<GridPoint>(&frame["grid"]);
        assert_eq!(points, grid(&code, sequence as i32));
        let moment = decoder.receive(&message(&frame["message"])).unwrap().unwrap();
        assert_eq!(moment.positions, list::<[f32; 3]>(&frame["positions"]));
        assert_eq!(moment.positions, points.iter().map(|point| code.position(*point)).collect::<Vec<_>>());
        assert_eq!((moment.sequence, moment.tick, &moment.levels), (sequence, 32 * sequence, &levels()));
        assert_eq!(moment.tools[0].force[2], 0.25 * (sequence % 16) as f32);
    }
}

// ---- wrenches, and the forces that a renderer makes of them ----

/// A floor at z = 0 of `k` [N/m], as a tool at height `z` [m] feels it; `range` 0: without a model.
fn floor(sequence: u64, k: f32, z: f32, range: f32) -> ToolWrench {
    ToolWrench {
        tool: 1,
        epoch: 7,
        sequence,
        tick: sequence,
        pose_sequence: sequence as u32,
        pose_time_ns: sequence * MS,
        position: vec![0.0, 0.0, z],
        orientation: vec![0.0, 0.0, 0.0, 1.0],
        physical_force: vec![0.0, 0.0, (-k * z).max(0.0)],
        physical_torque: vec![0.0; 3],
        force: vec![0.0, 0.0, (-k * z).max(0.0)],
        torque: vec![0.0, 0.3, 0.0],
        contact_points: 1,
        phase: ToolPhase::Engaged.into(),
        model_position: vec![0.0, 0.0, z],
        model_force: vec![0.05, 0.0, -k * z],
        model_normal: vec![0.0, 0.0, 1.0],
        model_stiffness: vec![0.1 * k, 0.1 * k, k, 0.0, 0.05 * k, 0.0],
        model_range: range,
        ..Default::default()
    }
}

/// What happens to a renderer: a wrench comes, or a force is asked for at (position, velocity).
#[allow(clippy::large_enum_variant, reason = "there are some hundred of them")]
enum Step {
    Wrench(ToolWrench),
    Force([f64; 3], [f64; 3]),
}

/// Times [ns] and steps: what models, silence and bad wrenches do. The hand jumps from place to place.
fn models() -> Vec<(u64, Step)> {
    use Step::{Force, Wrench};
    const STILL: [f64; 3] = [0.0; 3];
    let not_finite = ToolWrench { force: vec![0.0, f32::NAN, 0.0], ..floor(6, 200.0, -0.002, 0.005) };
    let mut steps = vec![(0, Force([0.0, 0.0, 0.01], STILL))]; // before the first wrench
    // The force rises from zero.
    for (sequence, ms) in [(1, 1), (2, 10), (3, 25), (4, 40)] {
        steps.push((ms * MS, Wrench(floor(sequence, 200.0, -0.002, 0.005))));
        steps.push((ms * MS, Force([0.0, 0.0, -0.002], STILL)));
    }
    steps.extend([
        (58 * MS, Force([0.001, 0.0, -0.004], [0.0, 0.0, -0.1])),
        (59 * MS, Force([0.0, 0.0, -0.05], STILL)),        // beyond the range
        (60 * MS, Force([0.0, 0.0, 0.003], STILL)),        // where the model would pull
        (60 * MS, Wrench(floor(5, 400.0, -0.004, 0.005))), // another force: it fades in
        (60 * MS, Force([0.0, 0.0, -0.004], STILL)),
        (64 * MS, Force([0.0, 0.0, -0.004], STILL)),
        (68 * MS, Force([0.0, 0.0, -0.004], STILL)),
        (70 * MS, Wrench(floor(5, 100.0, -0.004, 0.005))), // not newer: not taken
        (70 * MS, Wrench(not_finite)),                     // not taken
        (70 * MS, Wrench(floor(7, 1600.0, -0.004, 0.005))), // stiffer than the device, and above its force
        (70 * MS, Force([0.0, 0.0, -0.004], STILL)),
        (78 * MS, Force([0.0, 0.0, -0.0035], STILL)),
        (90 * MS, Force([0.0, 0.0, -0.0035], STILL)),
    ]);
    // Wrenches stop: in full up to 20 ms, none from 70 ms on.
    steps.extend([100, 115, 130, 139, 140, 200].map(|ms| (ms * MS, Force([0.0, 0.0, -0.0035], STILL))));
    steps.push((210 * MS, Wrench(floor(8, 300.0, -0.003, 0.0)))); // without a model: held
    steps.extend([210, 214, 250].map(|ms| (ms * MS, Force([0.0, 0.0, -0.001], STILL))));
    // A clock that has run for a while.
    steps.into_iter().map(|(at_ns, step)| (1000 * MS + at_ns, step)).collect()
}

/// Times [ns] and steps: a floor that is pressed four times and pushes back twice as hard on the way out, until the passivity
/// controller takes back what it gives to the hand.
fn energy() -> Vec<(u64, Step)> {
    let mut steps = Vec::new();
    for i in 0..80u32 {
        let (at_ns, phase) = ((1000 + 8 * u64::from(i)) * MS, i % 20);
        let (depth, k) = if phase < 10 { (phase, 300.0) } else { (20 - phase, 600.0) };
        let z = -4e-4 * f64::from(depth);
        steps.push((at_ns, Step::Wrench(floor(u64::from(i) + 1, k, z as f32, 0.005))));
        let v = if phase < 10 { -0.05 } else { 0.05 };
        steps.push((at_ns + MS, Step::Force([0.0, 0.0, z], [0.0, 0.0, v])));
    }
    steps
}

/// Times [ns] and steps: a floor is pressed, the hand is snatched out of it between two forces, by a device that tells no velocity,
/// presses again, turns twice on the way, and comes out.
fn debt() -> Vec<(u64, Step)> {
    let ways = [
        (0..20).collect::<Vec<_>>(),
        (-5..16).collect(),
        (10..15).rev().collect(),
        (11..18).collect(),
        (-1..17).rev().collect(),
    ];
    let step = |(i, depth): (u64, i32)| {
        let (at_ns, z) = ((1000 + 4 * i) * MS, -4e-4 * f64::from(depth));
        [
            (at_ns, Step::Wrench(floor(i + 1, 300.0, z as f32, 0.005))),
            (at_ns + MS, Step::Force([0.0, 0.0, z], [0.0; 3])),
        ]
    };
    (0..).zip(ways.into_iter().flatten()).flat_map(step).collect()
}

/// A name, times [ns] and steps, and the modes that they are for.
type Sequence = (&'static str, Vec<(u64, Step)>, [RenderMode; 2]);

fn sequences() -> [Sequence; 3] {
    [
        ("models", models(), [RenderMode::Raw, RenderMode::LocalModel]),
        ("energy", energy(), [RenderMode::Passive, RenderMode::LocalModelPassive]),
        ("debt", debt(), [RenderMode::Passive, RenderMode::LocalModelPassive]),
    ]
}

/// The steps with what the renderers of `modes` make of them.
fn render(steps: &[(u64, Step)], modes: &[RenderMode]) -> Vec<Value> {
    let device = Device { max_torque: 0.188, max_angular_stiffness: 0.3, ..Device::default() };
    let mut renderers: Vec<Renderer> = modes.iter().map(|mode| Renderer::new(&device, *mode)).collect();
    let rendered = steps.iter().map(|(at_ns, step)| match step {
        Step::Wrench(message) => {
            let wrench = Wrench::try_from(message).unwrap();
            let taken: Vec<bool> = renderers.iter_mut().map(|renderer| renderer.receive(&wrench, *at_ns)).collect();
            assert!(taken.iter().all(|one| *one == taken[0]), "it does not depend on the mode");
            json!({ "at_ns": at_ns, "wrench": hex(message), "taken": taken[0] })
        }
        Step::Force(position, velocity) => {
            let force = |(renderer, mode): (&mut Renderer, &RenderMode)| {
                (mode.name().to_owned(), json!(renderer.force(*position, *velocity, *at_ns)))
            };
            let force: serde_json::Map<String, Value> = renderers.iter_mut().zip(modes).map(force).collect();
            let torque = renderers[0].torque(*at_ns);
            json!({ "at_ns": at_ns, "position": position, "velocity": velocity, "force": force, "torque": torque })
        }
    });
    rendered.collect()
}

fn wrench_vectors() -> Value {
    let sequence = |(name, steps, modes): Sequence| json!({ "name": name, "steps": render(&steps, &modes) });
    json!({
        "about": "Each sequence is for a fresh renderer: a palpate.v1.ToolWrench in hexadecimal comes, or the force [N] (by mode) \
                  and torque [N·m] are asked for, at_ns [ns] on the client's clock, with the handle at position [m] and velocity [m/s].",
        "device": { "max_force": 3.3, "max_torque": 0.188, "max_stiffness": 700.0, "max_damping": 5.0, "resolution": 55e-6 },
        "sequences": sequences().map(sequence),
    })
}

/// A step as the vectors have it.
fn read(step: &Value) -> (u64, Step) {
    let vector = |key: &str| list::<f64>(&step[key]).try_into().unwrap();
    let is = match step.get("wrench") {
        Some(wrench) => Step::Wrench(message(wrench)),
        None => Step::Force(vector("position"), vector("velocity")),
    };
    (step["at_ns"].as_u64().unwrap(), is)
}

/// Forces along z [N] of the sequence `steps` in `mode`.
fn upward(steps: &[Value], mode: RenderMode) -> Vec<f64> {
    steps.iter().filter_map(|step| step.get("force")).map(|force| list::<f64>(&force[mode.name()])[2]).collect()
}

fn near(a: &Value, b: &Value) -> bool {
    list::<f64>(a).into_iter().zip(list::<f64>(b)).all(|(a, b)| (a - b).abs() < 1e-9)
}

#[test]
fn the_renderer_gives_the_forces_of_the_vectors() {
    let vectors = vectors("wrench.json", wrench_vectors);
    let given = vectors["sequences"].as_array().unwrap();
    for (given, (name, _, modes)) in given.iter().zip(sequences()) {
        assert_eq!(given["name"], name);
        let then = given["steps"].as_array().unwrap();
        let steps: Vec<(u64, Step)> = then.iter().map(read).collect();
        for (now, then) in render(&steps, &modes).iter().zip(then) {
            assert_eq!(now.get("taken"), then.get("taken"), "{then}");
            if then.get("force").is_some() {
                let by_mode = |mode: &RenderMode| near(&now["force"][mode.name()], &then["force"][mode.name()]);
                assert!(modes.iter().all(by_mode) && near(&now["torque"], &then["torque"]), "{now} for {then}");
            }
        }
    }
    let [models, energy, debt] = [0, 1, 2].map(|i| given[i]["steps"].as_array().unwrap());
    // What the vectors are to show is in them.
    let (raw, model) = (upward(models, RenderMode::Raw), upward(models, RenderMode::LocalModel));
    assert!(raw[0] == 0.0 && model[1] == 0.0, "nothing before the first wrench, and from there it rises");
    assert!((raw[5] - 0.4).abs() < 0.05 && (model[5] - 0.8).abs() < 0.1, "the model answers for another place");
    assert!((model[6] - 1.4).abs() < 0.1 && model[7] < 0.05, "its range, and no pull: {model:?}");
    assert!(model[8] < 0.9 && model[9] < model[10] && model[10] < 1.6, "another force fades in");
    assert!(raw.iter().any(|force| (force - 3.3).abs() < 1e-4), "the greatest force of the device: {raw:?}");
    assert!(model[18] == 0.0 && model[17] > 0.0, "wrenches have stopped");
    // The way out of the last press, and that of the first, which begins as it does.
    for mode in [RenderMode::Passive, RenderMode::LocalModelPassive] {
        let forces = upward(energy, mode);
        let (first, last): (f64, f64) = (forces[11..20].iter().sum(), forces[71..80].iter().sum());
        assert!(first > 5.0 && last < 0.8 * first, "{mode:?}: the hand is given no more: {first}, {last}");
        let forces = upward(debt, mode);
        // Held at 2.3 N and snatched; back inside; turned at 0.006 m, and there again.
        assert!(forces[19] > 2.2 && forces[25] < 0.05 && forces[40] > 1.0, "it feels again: {forces:?}");
        assert!(forces[44] < 0.1 && forces[52] > 0.9, "it is given little, and feels again: {forces:?}");
    }
}
