//! Readings as one factor with the samples of their interval: late ones give the answer of those in time.

mod runs;

use runs::{Ran, Run};
use shared_types::{RawReading, RejectReason, Sensor, Solution, Time};
use sim_world::Preset;

/// The mission with one reading of a sensor, the first after `from` s, held back by `delay` s (`None`: all in time).
fn held_back(sensor: Sensor, from: f64, delay: Option<f64>, until: f64, sets: &[&str]) -> (Ran, Time) {
    let scenario = Run { scenario: "mission", preset: Preset::Realistic, seed: 1, sets, until };
    let (mut held, mut came_at): (Option<RawReading>, Option<Time>) = (None, None);
    let due = Time::from_seconds(from + delay.unwrap_or(0.0));
    let ran = scenario.with_extra(|reading, push| {
        let is_it = reading.sensor() == sensor && reading.t_valid() > Time::from_seconds(from);
        if delay.is_some() && is_it && held.is_none() && came_at.is_none() {
            held = Some(reading);
            return;
        }
        if reading.t_valid() > due
            && let Some(late) = held.take()
        {
            came_at = Some(reading.t_valid());
            push(late);
        }
        push(reading);
    });
    (ran, came_at.unwrap_or(due))
}

/// The first solution of a keyframe after `t`.
fn first_after(solutions: &[Solution], t: Time) -> &Solution {
    solutions.iter().find(|solution| Time(solution.t_keyframe) > t).expect("the run goes on")
}

fn distance(a: &Solution, b: &Solution) -> f64 {
    assert_eq!(a.t_keyframe, b.t_keyframe);
    (0..3).map(|axis| (a.position_enu[axis] - b.position_enu[axis]).powi(2)).sum::<f64>().sqrt()
}
