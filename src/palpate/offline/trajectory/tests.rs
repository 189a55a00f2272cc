//! Rows that are read, refused and written again.

use super::*;
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::model::body::BodyParts;
use palpate_core::model::{Body, Material};
use palpate_core::simulation::Threshold;

fn with_events(rows: &str) -> String {
    format!("{TRAJECTORY_HEADER},{EVENT_COLUMNS}\n{rows}")
}

#[test]
fn a_column_of_openings_may_stand_behind_a_pose_in_either_form_and_is_written_again() {
    let alone =
        format!("{TRAJECTORY_HEADER},opening\n0,0,0.1,0.1,0.2,0,0,0,1,0,0.25\n0.001,0,0.1,0.1,0.2,0,0,0,1,0,\n");
    let events = format!(
        "{TRAJECTORY_HEADER},opening,{EVENT_COLUMNS}\n0,0,,,,,,,,,,attach,0.001,,\n\
         0.001,0,0.1,0.1,0.2,0,0,0,1,0,0.25,pose,,,\n0.002,0,,,,,,,,,,detach,,,\n"
    );
    for text in [&alone, &events] {
        let trajectory = Trajectory::parse(text, "t.csv", 1).unwrap();
        let openings = |trajectory: &Trajectory| -> Vec<Real> {
            let opening = |(.., event): &(u64, usize, ToolEvent)| match event {
                ToolEvent::Pose(sample) => Some(sample.opening),
                _ => None,
            };
            trajectory.events.iter().filter_map(opening).collect()
        };
        assert_eq!(openings(&trajectory)[0], 0.25, "{text}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("again.csv");
        trajectory.write(&path).unwrap();
        let again = Trajectory::parse(&std::fs::read_to_string(&path).unwrap(), "again.csv", 1).unwrap();
        assert_eq!(openings(&again), openings(&trajectory));
    }
    for (cell, fault) in [("1.5", "not a number within 0 to 1"), ("wide", "not a number within 0 to 1")] {
        let text = alone.replace("0.25", cell);
        assert!(Trajectory::parse(&text, "t.csv", 1).unwrap_err().what.contains(fault));
    }
    let idle = events.replace(",,,,,,,,,,attach", ",,,,,,,,,0.5,attach");
    assert!(Trajectory::parse(&idle, "t.csv", 1).unwrap_err().what.contains("opening: a row \"attach\" has none"));
}

#[test]
fn a_trajectory_gives_one_event_per_tool_and_tick() {
    let text = format!(
        "{TRAJECTORY_HEADER}\n0.000,0,0,0,0.1,0,0,0,1,0\n0.0002,0,0,0,0.2,0,0,0,1,0\n0.010,0,0,0,0.3,0,0,0,2,1\n"
    );
    let trajectory = Trajectory::parse(&text, "t.csv", 1).unwrap();
    assert_eq!(
        trajectory.inputs(1).tools[0],
        Some(ToolEvent::Attach { epoch: 1, period_ticks: 10, coupling: Coupling::RIGID })
    );
    let Some(ToolEvent::Pose(pose)) = trajectory.inputs(2).tools[0] else { panic!("a pose") };
    assert_eq!((pose.pose.position.z, pose.sequence), (0.2, 1));
    let Some(ToolEvent::Pose(pose)) = trajectory.inputs(12).tools[0] else { panic!("a pose") };
    assert_eq!((pose.pose.orientation, pose.buttons, trajectory.last_tick()), ([0.0, 0.0, 0.0, 1.0], 1, 12));
    assert_eq!(trajectory.inputs(5), Inputs::default());
}

#[test]
fn rows_with_events_attach_with_their_coupling_detach_and_reset() {
    let text = with_events(
        "0,1,,,,,,,,,attach,0.014,0.00125,\n0.001,1,0,0,0.1,0,0,0,1,5,pose,,,\n0.002,1,,,,,,,,,detach,,,\n\
         0.002,,,,,,,,,,reset,,,\n0.003,1,,,,,,,,,attach,0.001,,2.5\n0.004,1,0,0,0.2,0,0,0,1,0,pose,,,\n",
    );
    let trajectory = Trajectory::parse(&text, "t.csv", 2).unwrap();
    let attach = |epoch, period_ticks, compliance, angular_compliance| {
        let coupling = Coupling { compliance, angular_compliance };
        Some(ToolEvent::Attach { epoch, period_ticks, coupling })
    };
    assert_eq!(trajectory.inputs(1).tools[1], attach(1, 14, 0.00125, 0.0));
    let Some(ToolEvent::Pose(pose)) = trajectory.inputs(2).tools[1] else { panic!("a pose") };
    assert_eq!((pose.sequence, pose.buttons), (1, 5));
    let third = trajectory.inputs(3);
    assert_eq!((third.tools[1], third.reset), (Some(ToolEvent::Detach), true));
    assert_eq!(trajectory.inputs(4).tools[1], attach(2, 1, 0.0, 2.5));
    let Some(ToolEvent::Pose(pose)) = trajectory.inputs(5).tools[1] else { panic!("a pose") };
    assert_eq!((pose.sequence, trajectory.last_tick()), (1, 5));
}

#[test]
fn what_is_written_reads_back_the_same() {
    let text = with_events(
        "0,0,,,,,,,,,attach,0.004,0.0014285714285714286,0.7\n0.001,0,0.1,0.30000001192092896,-2e-9,0,0,0,1,7,pose,,,\n\
         0.04,,,,,,,,,,reset,,,\n0.04,0,,,,,,,,,detach,,,\n0.05,,,,,,,,,,reset,,,\n",
    );
    let trajectory = Trajectory::parse(&text, "t.csv", 1).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("t.csv");
    trajectory.write(&file).unwrap();
    let written = std::fs::read_to_string(&file).unwrap();
    assert_eq!(Trajectory::parse(&written, "t.csv", 1).unwrap(), trajectory);
    assert_eq!(trajectory.last_tick(), 51);
    let budgets =
        vec![(41, Budget::of(700), None), (42, Budget { change: 3, ..Budget::of(800) }, Some(Prices::COMMON))];
    let budgeted = Trajectory { budgets, ..trajectory };
    budgeted.write(&file).unwrap();
    let again = Trajectory::parse(&std::fs::read_to_string(&file).unwrap(), "t.csv", 1).unwrap();
    assert_eq!(again, budgeted);
    let parameters = vec![
        (7, Parameter::Stiffness { tissue: 1, factor: 0.3 }),
        (41, Parameter::Gravity(Vec3::new(0.1, -2e-9, -9.81))),
        (60, Parameter::Damping(0.5)),
        (61, Parameter::Friction { tool: 0, coefficient: 0.7 }),
        (62, Parameter::Resolution { threshold: Threshold::Reach, value: 2.0 }),
        (63, Parameter::Shape { tool: 0, of: 1 }),
    ];
    let set = Trajectory { parameters, ..again.clone() };
    set.write(&file).unwrap();
    assert_eq!(Trajectory::parse(&std::fs::read_to_string(&file).unwrap(), "t.csv", 1).unwrap(), set);
    assert_eq!(set.inputs(7).parameter, Some(Parameter::Stiffness { tissue: 1, factor: 0.3 }));
    assert_eq!((set.inputs(8).parameter, set.last_tick()), (None, 63));
    // From a tick on; prices are told once.
    assert_eq!(again.inputs(40).budget, Budget::UNLIMITED);
    assert_eq!((again.inputs(41).budget, again.inputs(41).prices), (Budget::of(700), None));
    assert_eq!(again.inputs(42).prices, Some(Prices::COMMON));
    assert_eq!((again.inputs(90).budget.change, again.inputs(90).prices), (3, None));
}

#[test]
fn a_recording_that_began_with_a_held_tool_attaches_it_first() {
    let coupling = Coupling { compliance: 1e-3, angular_compliance: 0.0 };
    let held = ToolState { phase: Phase::Engaged, epoch: 9, period_ticks: 4, coupling, ..ToolState::default() };
    let tools = [ToolState::default(), held];
    let pose = ToolEvent::Pose(PoseSample { sequence: 88, ..PoseSample::default() });
    let mut inputs = Inputs { lapsed: 2, reset: true, ..Inputs::default() };
    inputs.tools[1] = Some(pose);
    let body = Body::new(BodyParts::of_mesh(
        "cube",
        box_mesh(Vec3::repeat(0.1), [1; 3]),
        box_surface(Vec3::repeat(0.1), [1; 3]),
        Material::from_young(1e4, 0.3, 1e3),
    ))
    .unwrap();
    let start = Snapshot { tick: 64, tools: tools.to_vec(), ..Snapshot::at_rest(&body, 0, 2) };
    let trajectory = Trajectory::recorded(&start, &[(65, Inputs::default()), (68, inputs)]);
    let attach = ToolEvent::Attach { epoch: 9, period_ticks: 4, coupling };
    assert_eq!(trajectory.inputs(1).tools[1], Some(attach));
    // Two ticks were lost before it; it is the fourth, and one later than in the recording.
    let fifth = trajectory.inputs(5);
    assert_eq!((fifth.tools[1], fifth.reset, trajectory.last_tick()), (Some(pose), true, 5));
    let parameters = vec![Parameter::Damping(0.5), Parameter::Stiffness { tissue: 0, factor: 2.0 }];
    let set = Trajectory::recorded(&Snapshot { parameters: parameters.clone(), ..start }, &[(65, inputs)]);
    assert_eq!([1, 2, 3].map(|tick| set.inputs(tick).parameter), [Some(parameters[0]), Some(parameters[1]), None]);
    assert!(set.inputs(3).reset);
}

#[test]
fn a_bad_row_is_named_with_its_line() {
    let poses = |row: &str| format!("{TRAJECTORY_HEADER}\n0,0,0,0,0,0,0,0,1,0\n{row}\n");
    let refused = |text: &str| Trajectory::parse(text, "t.csv", 1).unwrap_err().to_string();
    for (bad, what) in [
        ("0.1,0,0,0,NaN,0,0,0,1,0", "z_m: \"NaN\" is not a finite number"),
        ("0.1,0,0,0,0,0,0,0,1,0,0", "10 columns are expected, found 11"),
        ("0.1,0,0,0", "found 4"),
        ("0.1,3,0,0,0,0,0,0,1,0", "tools 0 to 0"),
        ("0.1,0,0,0,0,0,0,0,0,0", "quaternion"),
        ("0.1,0,0,0,0,0,0,0,1,-1", "buttons: -1 is not within"),
        ("-1,0,0,0,0,0,0,0,1,0", "time_s: -1 is not within 0 to"),
    ] {
        let e = refused(&poses(bad));
        assert!(e.contains("t.csv, line 3") && e.contains(what), "{e}");
    }
    let attach = "0,0,,,,,,,,,attach,0.001,,";
    for (bad, what) in [
        ("0.1,0,0,0,0,0,0,0,1,0,grasp,,,", "event \"grasp\""),
        ("0.1,0,0,0,0,0,0,0,1,0,detach,,,", "x_m: a row \"detach\" has none"),
        ("0.1,0,0,0,0,0,0,0,1,0,pose,0.001,,", "period_s: a row \"pose\" has none"),
        ("0.1,0,,,,,,,,,reset,,,", "tool: a row \"reset\" has none"),
        ("0.1,0,,,,,,,,,attach,,,", "period_s: \"\" is not a finite number"),
        ("0.1,0,,,,,,,,,attach,0.001,-1,", "coupling_m_per_N: -1 is not within"),
        ("0.1,,,,,,,,,,budget,,,", "event \"budget\""),
        ("0.0004,0,,,,,,,,,detach,,,", "another event in the same millisecond"),
    ] {
        let e = refused(&with_events(&format!("{attach}\n{bad}\n")));
        assert!(e.contains("t.csv, line 3") && e.contains(what), "{e}");
    }
    let e = refused(&with_events("0,0,0,0,0,0,0,0,1,0,pose,,,\n"));
    assert!(e.contains("line 2: tool 0 is not attached"), "{e}");
    for blank in ["\n\n", "\r\n \r\n", " \n\t\n"] {
        let e = refused(&poses(&format!("{blank}oops")));
        assert!(e.contains("t.csv, line 5"), "lines without content count: {e}");
    }
    assert!(refused("a,b\n").contains("the first line must be"));
}
