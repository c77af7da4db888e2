//! Readings that come late, inside an interval that was closed without them, give the answer of those in time.

mod runs;

use runs::{Ran, Run};
use shared_types::{AIDING, RawReading, RejectReason, SENSORS, Sensor, Solution, Time};
use sim_world::Preset;

/// When the reading that is held back was taken, s: after this. Fixes come at the surface alone.
const TAKEN: f64 = 150.3;
const GNSS_TAKEN: f64 = 25.3;

/// Neither gates nor kernels nor offsets, in the joint form.
fn exactly() -> Vec<String> {
    let plain = AIDING.iter().flat_map(|sensor| {
        ["kernel=none", "gate=false", "time_offset=off"].map(|key| format!("{}.{key}", sensor.name()))
    });
    plain.chain(["keyframes.anchor=joint".to_owned()]).collect()
}

/// The mission with the first reading of a sensor after `taken` held back by `delay` s; and when it came.
fn held_back(sensor: Sensor, taken: f64, delay: f64, sets: &[String]) -> (Ran, Time) {
    let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
    let due = Time::from_seconds(taken + delay);
    let run = Run {
        scenario: "mission",
        preset: Preset::Realistic,
        seed: 1,
        sets: &sets,
        until: taken + if delay > 10.0 { 45.0 } else { 10.0 },
    };
    let (mut held, mut came) = (None, None);
    let ran = run.delivered(|reading, deliver| {
        let is_it = reading.sensor() == sensor && reading.t_valid() > Time::from_seconds(taken);
        if is_it && delay > 0.0 && held.is_none() && came.is_none() {
            held = Some(reading);
            return;
        }
        if reading.t_valid() > due
            && matches!(reading, RawReading::Imu(_))
            && let Some(late) = held.take()
        {
            came = Some(reading.t_valid());
            deliver(late);
        }
        deliver(reading);
    });
    (ran, came.unwrap_or(due))
}

/// The first two of one keyframe after `t`.
fn first_after<'a>(in_time: &'a Ran, late: &'a Ran, t: Time) -> (&'a Solution, &'a Solution) {
    let first = |ran: &'a Ran| ran.solutions.iter().find(|solution| Time(solution.t_keyframe) > t);
    let (in_time, late) = (first(in_time).expect("the run goes on"), first(late).expect("the run goes on"));
    assert_eq!(in_time.t_keyframe, late.t_keyframe);
    (in_time, late)
}

fn distance(a: &Solution, b: &Solution) -> f64 {
    (0..3).map(|axis| (a.position_enu[axis] - b.position_enu[axis]).powi(2)).sum::<f64>().sqrt()
}

/// Distance in sigmas of the first.
fn sigmas(a: &Solution, b: &Solution) -> f64 {
    (0..3)
        .map(|axis| (a.position_enu[axis] - b.position_enu[axis]).powi(2) / a.covariance[axis][axis])
        .fold(0.0, f64::max)
        .sqrt()
}

#[test]
fn a_late_reading_in_the_joint_form_gives_the_answer_of_one_in_time() {
    for (sensor, taken) in [(Sensor::Dvl, TAKEN), (Sensor::Mcp, TAKEN), (Sensor::Ps, TAKEN), (Sensor::Gnss, GNSS_TAKEN)]
    {
        let (in_time, _) = held_back(sensor, taken, 0.0, &exactly());
        for delay in [1.5, 4.0] {
            let (late, came) = held_back(sensor, taken, delay, &exactly());
            let (expected, found) = first_after(&in_time, &late, came);
            let off = distance(expected, found);
            assert!(off < 1e-6, "{} {delay} s late: {off:e} m", sensor.name());
            // That it is in is seen before it comes.
            let (with, without) = first_after(&in_time, &late, Time::from_seconds(taken + 0.9));
            assert!(distance(with, without) > 1e-6, "{} makes no difference", sensor.name());
        }
    }
}

#[test]
fn a_late_ping_or_reading_by_default_gives_nearly_the_answer_of_one_in_time() {
    for sets in [vec![], vec!["keyframes.anchor=joint".to_owned()]] {
        for (sensor, taken) in [
            (Sensor::Lbl, TAKEN),
            (Sensor::Dvl, TAKEN),
            (Sensor::Mcp, TAKEN),
            (Sensor::Ps, TAKEN),
            (Sensor::Gnss, GNSS_TAKEN),
        ] {
            let (in_time, _) = held_back(sensor, taken, 0.0, &sets);
            let (late, came) = held_back(sensor, taken, 2.0, &sets);
            let (expected, found) = first_after(&in_time, &late, came);
            assert!(sigmas(expected, found) < 0.05, "{}: {} sigma", sensor.name(), sigmas(expected, found));
        }
    }
}

#[test]
fn a_reading_later_than_the_window_is_counted() {
    let (late, _) = held_back(Sensor::Dvl, TAKEN, 40.0, &exactly());
    let place = SENSORS.iter().position(|&sensor| sensor == Sensor::Dvl).expect("a sensor");
    let counted = late.navigator.rejected(place).find(|(reason, _)| *reason == RejectReason::OlderThanWindow);
    assert_eq!(counted.map(|(_, count)| count), Some(1));
}
