//! The model as a whole: messages in, snapshot out.

use shared_types::{Header, HopLatency};

use super::*;
use crate::testing::{
    estimate_at, frame, heartbeat, mission_in_an_outage, mission_under_way, poisoned, solution_at, truth_at,
};

const SECOND: i64 = 1_000_000_000;

#[test]
fn a_mission_under_way_is_known_whole() {
    let known = mission_under_way().snapshot();
    assert_eq!(known.mode, Some(Mode::Ok));
    assert!((known.t.expect("known") - 123.4).abs() < 1e-9);
    assert!((known.speed.expect("known") - 1.0).abs() < 1e-6);
    assert!((known.estimates.rate.expect("known") - 200.0).abs() < 0.01, "{:?}", known.estimates);
    assert_eq!((known.estimates.received, known.estimates.lost), (6001, 0));
    let error = known.error.expect("there is a truth");
    assert!((error.horizontal - 0.061_f64.hypot(0.038)).abs() < 1e-6, "{}", error.horizontal);
    let solver = known.solver.expect("there is a solution");
    assert_eq!((solver.window, solver.iterations, solver.solutions), (20, 2, 123));
    assert!((solver.age.expect("known") - 0.4).abs() < 1e-9);
    assert_eq!(known.end_to_end.expect("told").p99, 120e-6);
    assert_eq!(known.buoys.len(), 4);
    assert_eq!(known.events.len(), 1, "{:?}", known.events);
}

#[test]
fn the_newest_keyframe_is_summed_up_over_its_used_factors() {
    let keyframe = mission_under_way().snapshot().keyframe.expect("reported");
    assert_eq!((keyframe.used, keyframe.refused), (5, 1));
    assert!((keyframe.nis_per_row.expect("rows") - 0.95).abs() < 1e-12);
}

#[test]
fn what_happened_is_listed_in_its_order() {
    let events: Vec<String> =
        mission_in_an_outage().snapshot().events.iter().map(|event| event.kind.to_string()).collect();
    assert_eq!(events, ["mode OK", "lbl is silent", "mode OK -> DEAD_RECKONING", "solver ended"]);
}

#[test]
fn while_initialising_there_is_no_pose_and_no_error() {
    let mut model = Model::new("main");
    model.solution(&solution_at(1.0));
    let mut estimate = estimate_at(1.0, [0.0; 3]);
    estimate.mode = Mode::Initialising as u32;
    model.estimate(&estimate);
    model.truth(&truth_at(1.0, [5.0, 0.0, 0.0]));
    model.settle(0);
    let known = model.snapshot();
    assert_eq!((known.pose, known.error), (None, None));
    assert_eq!(known.mode, Some(Mode::Initialising));
}

#[test]
fn the_heading_is_against_north_at_the_vehicle() {
    let mut model = Model::new("main");
    model.solution(&solution_at(1.0));
    let east = 5_000.0;
    model.estimate(&estimate_at(1.0, [east, 0.0, 0.0]));
    let heading = model.snapshot().pose.expect("navigating").roll_pitch_heading_deg[2];
    // Meridian convergence: the vehicle looks along the origin's east, and its own north lies west of the origin's.
    let origin = frame().origin();
    let [_, lon_deg, _] = frame().to_geodetic(&Vector3::new(east, 0.0, 0.0)).to_degrees();
    let convergence = (lon_deg - origin.to_degrees()[1]) * origin.latitude.sin();
    assert!(convergence > 0.03);
    assert!((heading - (90.0 + convergence)).abs() < 1e-4, "{heading} and {convergence}");
}

#[test]
fn a_truth_needs_a_frame_and_may_come_before_it() {
    let mut model = Model::new("main");
    model.truth(&truth_at(1.0, [0.0, 0.3, 0.0]));
    model.estimate(&estimate_at(1.0, [0.0; 3]));
    model.settle(0);
    assert_eq!(model.snapshot().error, None);
    model.solution(&solution_at(1.0));
    model.settle(0);
    let error = model.snapshot().error.expect("all three are there");
    assert!((error.horizontal - 0.3).abs() < 1e-7, "{}", error.horizontal);
}

#[test]
fn the_error_is_forgotten_when_the_truth_has_ended() {
    let mut model = Model::new("main");
    model.solution(&solution_at(1.0));
    model.truth(&truth_at(1.0, [0.0; 3]));
    for (t, is_known) in [(1.0, true), (3.9, true), (4.1, false)] {
        model.estimate(&estimate_at(t, [0.0; 3]));
        model.settle(0);
        assert_eq!(model.snapshot().error.is_some(), is_known, "at {t} s");
    }
}

#[test]
fn without_a_propagator_data_time_is_that_of_the_imu() {
    let mut model = Model::new("main");
    let mut beat = heartbeat(Process::Preprocessor, 0);
    beat.sensors[Sensor::Imu.index()].t_newest = 7 * SECOND;
    model.heartbeat(&beat);
    assert_eq!(model.snapshot().t, Some(7.0));
}

#[test]
fn only_the_preprocessor_itself_speaks_for_the_sensors() {
    let mut model = Model::new("main");
    for process in [Process::EmulatorImu, Process::Recorder] {
        let mut beat = heartbeat(process, 0);
        beat.sensors[Sensor::Imu.index()].received = 99;
        model.heartbeat(&beat);
    }
    let mut word = heartbeat(Process::Preprocessor, 0);
    word.header = Header { source: Process::Supervisor as u16, ..Header::default() };
    word.sensors[Sensor::Imu.index()].received = 99;
    model.heartbeat(&word);
    assert_eq!(model.snapshot().sensors[0].received, 0);
}

#[test]
fn a_heartbeat_of_nobody_is_passed_over() {
    let mut model = Model::new("main");
    let mut beat = heartbeat(Process::Solver, 0);
    (beat.process, beat.work) = (4_711, HopLatency { count: 1, ..HopLatency::default() });
    model.heartbeat(&beat);
    assert!(model.snapshot().processes.is_empty());
}

#[test]
fn json_names_everything_and_turns_what_is_no_number_into_null() {
    let known: serde_json::Value = serde_json::to_value(poisoned().snapshot()).expect("every key is a string");
    assert_eq!(known["mode"], "OK");
    assert_eq!(known["pose"]["position_enu"], serde_json::json!([null, null, null]));
    assert_eq!(known["sensors"][1]["sensor"], "lbl");
    assert_eq!(known["sensors"][1]["rejected"]["gated"], 9);
    assert_eq!(known["solver"]["status"], serde_json::Value::Null);
    assert_eq!(known["processes"][0]["name"], "supervisor");
    assert_eq!(known["events"][0]["what"], "mode OK");
}
