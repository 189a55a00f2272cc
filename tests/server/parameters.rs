//! Parameters that clients set while the server runs.

use super::*;
use palpate_core::simulation::Parameter;

fn set(connection: &Connection, name: &str, values: &[f64]) -> Result<(), SdkError> {
    connection.set_parameters([(name.to_owned(), values.to_vec())])
}

/// Depth of the ball [m].
const DEPTH: f64 = 0.003;
/// Factors on the stiffness of the body, trial by trial: each 1.26 times another, shuffled.
const TRIALS: [f64; 10] = [2.0, 0.794, 5.04, 1.0, 0.63, 3.17, 1.587, 4.0, 1.26, 2.52];

/// What a hand that rests on the body feels along its normal [N], 300 times, once the body rests, too.
fn forces_of_a_trial(tool: &mut Tool) -> Vec<f64> {
    loop {
        move_tool(tool, -DEPTH, -DEPTH, 500);
        let felt = |wrench: &Wrench| wrench.flags == 0 && wrench.contact_points > 0;
        // What swings after the change is left out by the mean.
        let look = |_| {
            let lost = |wrench: &Wrench| wrench.phase != ToolPhase::Engaged;
            let wrench = send_until(tool, -DEPTH, "a trial", |wrench| lost(wrench) || felt(wrench));
            move_tool(tool, -DEPTH, -DEPTH, 1);
            (!lost(&wrench)).then_some(wrench.force[2])
        };
        let forces: Vec<f64> = (0..300).map_while(look).collect();
        if forces.len() == 300 {
            return forces;
        }
        // A busy machine has let the tool go for a while: it comes from outside again.
        send_until(tool, 0.02, "contact outside", |wrench| wrench.phase == ToolPhase::Engaged);
        move_tool(tool, 0.02, -DEPTH, 200);
    }
}

/// As in an experiment: the hand rests on the body, whose stiffness is another from trial to trial.
#[test]
fn ten_stiffnesses_in_random_order_are_felt_in_order_and_replay_bit_for_bit() {
    let running = serve_one_level();
    let connection = Connection::open(&running.endpoints).unwrap();
    let mut tool = connection.attach(&rigid("test", "left", 1000.0)).unwrap();
    move_tool(&mut tool, 0.02, 0.02, 30);
    let ask = |request| connection.control(request).unwrap();
    ask(Request::StartRecording(proto::StartRecording { path: "trials.mcap".into() }));
    move_tool(&mut tool, 0.02, -DEPTH, 200);
    let mut felt: Vec<(f64, f64)> = Vec::new();
    for factor in TRIALS {
        set(&connection, "stiffness", &[factor]).unwrap();
        let forces = forces_of_a_trial(&mut tool);
        felt.push((factor, forces.iter().sum::<f64>() / forces.len() as f64));
    }
    let done = ask(Request::StopRecording(proto::StopRecording {})).recording.unwrap();
    assert!(done.fault.is_empty(), "{done:?}");
    felt.sort_by(|a, b| a.0.total_cmp(&b.0));
    println!("{felt:.4?}");
    let compliance = felt[3].0 / felt[3].1;
    for (factor, force) in &felt {
        // A step is 26 %.
        assert!((force * compliance / factor - 1.0).abs() < 0.05, "{factor} times as stiff: {force} N");
    }
    let recording = Recording::read(&running.folder.path().join("trials.mcap")).unwrap();
    let parameters = recording.inputs.iter().filter_map(|(_, inputs)| inputs.parameter);
    let expected = TRIALS.map(|factor| Parameter::Stiffness { tissue: 0, factor });
    assert_eq!(parameters.collect::<Vec<_>>(), expected);
    for path in Simd::available() {
        let report = replay(&recording, path).unwrap();
        println!("{path:?}: {}", report.verdict());
        assert_eq!((report.difference, report.ticks), (None, done.ticks));
    }
}

#[test]
fn what_cannot_be_set_is_refused_with_its_name_and_range_and_the_session_lists_what_can() {
    let running = serve_one_level();
    let connection = Connection::open_surface(&running.endpoints).unwrap();
    let refused = |name: &str, values: &[f64]| match set(&connection, name, values) {
        Err(SdkError::Refused(why)) => why,
        other => panic!("{name}: {other:?}"),
    };
    for (name, values, words) in [
        ("stiffness", &[50.0][..], "stiffness.cube is 50: 0.05 to 20"),
        ("stiffness.cube", &[f64::NAN], "stiffness.cube is NaN"),
        ("stiffness.0", &[0.0], "stiffness.cube is 0: 0.05 to"),
        (
            "stiffness.1",
            &[1.0],
            "no parameter of that name: there is gravity, damping, supports, stiffness.cube, friction.left",
        ),
        ("gravity", &[0.0, 0.0, -900.0], "gravity is -900: -100 to 100"),
        ("gravity", &[9.81], "gravity has 3 values, not 1"),
        ("friction.right", &[2.5], "friction.right is 2.5: 0 to 2"),
        ("shape.left", &[2.0], "shape.left is 2: 0 to 1"),
        ("shape.left", &[0.5], "shape.left is 0.5: give the number of a tool"),
        ("damping", &[0.0], "damping is 0: 0.1 to 1"),
        ("resolution.reach", &[11.0], "resolution.reach is 11: 0 to 10"),
        ("resolution", &[1.0], "no parameter of that name"),
        ("colour", &[1.0], "no parameter of that name"),
    ] {
        let why = refused(name, values);
        assert!(why.contains(words), "{why}");
    }
    // All of a request or nothing.
    let both = [("damping".to_owned(), vec![0.5]), ("friction".to_owned(), vec![-1.0])];
    assert!(matches!(connection.set_parameters(both), Err(SdkError::Refused(_))));
    set(&connection, "friction", &[0.5]).unwrap();
    set(&connection, "gravity", &[0.0, 1.0, -2.0]).unwrap();
    set(&connection, "shape.left", &[1.0]).unwrap();
    let listed = connection.session().unwrap().parameters;
    let listed: Vec<_> = listed.iter().map(|p| (&*p.name, &*p.values, p.least, p.most)).collect();
    assert_eq!(
        listed,
        [
            ("gravity", &[0.0, 1.0, -2.0][..], -100.0, 100.0),
            ("damping", &[1.0], 0.1, 1.0),
            ("supports", &[1.0], 0.01, 1.0),
            ("stiffness.cube", &[1.0], 0.05, 20.0),
            ("friction.left", &[0.5], 0.0, 2.0),
            ("friction.right", &[0.5], 0.0, 2.0),
            ("shape.left", &[1.0], 0.0, 1.0),
            ("shape.right", &[1.0], 0.0, 1.0),
            ("resolution.split", &[0.1], 1e-4, 10.0),
            ("resolution.merge", &[0.3], 0.0, 0.9),
            ("resolution.reach", &[1.4], 0.0, 10.0)
        ]
    );
}
