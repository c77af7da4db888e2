//! The manoeuvres of a scenario as profiles of speed, heading and path angle.
//!
//! The vehicle goes where its nose points: `d(east, north, depth)/dt = speed · (cos ϑ cos ψ, cos ϑ sin ψ, −sin ϑ)`, with
//! ψ counted from east to the left and ϑ upwards. How steep a dive must be is solved for here, so that it ends at the
//! depth that the scenario names.

use std::f64::consts::FRAC_PI_2;

use crate::jet::Jet;
use crate::profile::{Profile, Ramp, RampOf, Wave, plateau};
use crate::scenario::{Manoeuvre, Scenario, Segment, WaveSetup};
use crate::scenario_file::Problem;

/// s: how long a turn, a dive or a weave takes to begin and to end, if it is long enough.
const FLANK: f64 = 5.0;
/// rad: the steepest path of a dive.
const STEEPEST: f64 = std::f64::consts::FRAC_PI_4;

/// The manoeuvres as profiles of time, s.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// East, north (m) and depth (m) at the start.
    pub(crate) start: [f64; 3],
    /// m/s.
    pub(crate) speed: Profile,
    /// From east to the left, rad.
    pub(crate) heading: Profile,
    /// Of the path, positive upwards, rad.
    pub(crate) path_angle: Profile,
    /// What the vehicle rolls beyond its lean into turns, rad.
    pub(crate) roll_wave: Profile,
    /// What it pitches beyond its path angle, positive upwards, rad.
    pub(crate) pitch_wave: Profile,
    /// Roll per turn rate, s.
    pub(crate) bank: f64,
    /// s.
    pub(crate) end: f64,
}

impl Plan {
    /// Follows the segments one after another.
    pub(crate) fn new(scenario: &Scenario) -> Result<Plan, Problem> {
        let vehicle = &scenario.vehicle;
        let mut plan = Plan {
            start: vehicle.east_north_depth,
            speed: Profile::constant(vehicle.speed),
            heading: Profile::constant(FRAC_PI_2 - vehicle.heading),
            path_angle: Profile::default(),
            roll_wave: Profile::default(),
            pitch_wave: Profile::default(),
            bank: vehicle.bank,
            end: scenario.segments.last().map_or(0.0, |segment| segment.end),
        };
        let (mut speed, mut depth) = (vehicle.speed, vehicle.east_north_depth[2]);
        // 0 at rest, 1 under way: the envelope of the oscillations.
        let mut under_way = Vec::new();
        if speed > 0.0 {
            under_way.push(ramp(-1.0, 1.0, 1.0));
        }
        for (nth, segment) in scenario.segments.iter().enumerate() {
            let problem = |key, found: f64, expected: String| Problem {
                section: "segment",
                nth,
                key,
                found: found.to_string(),
                expected,
            };
            let Segment { start, end, manoeuvre } = *segment;
            let flank = FLANK.min((end - start) / 3.0);
            match manoeuvre {
                Manoeuvre::Still if speed > 0.0 => {
                    let expected = "another manoeuvre, or come after one that accelerates to speed = 0.0".to_owned();
                    let problem = problem("manoeuvre", speed, expected);
                    return Err(Problem { found: format!("\"still\" at {speed} m/s"), ..problem });
                }
                Manoeuvre::Still | Manoeuvre::Cruise => {}
                Manoeuvre::Accelerate { speed: target } => {
                    plan.speed.step(start, end, target - speed);
                    let change = f64::from(u8::from(target > 0.0)) - f64::from(u8::from(speed > 0.0));
                    if change != 0.0 {
                        under_way.push(ramp(start, end - start, change));
                    }
                    speed = target;
                }
                // A heading counts to the right, the yaw angle to the left.
                Manoeuvre::Turn { rate } => plan.heading.turn(start, end, flank, -rate),
                Manoeuvre::Weave { amplitude, period } => {
                    let envelope = plateau(start, end, flank, 1.0).into();
                    plan.heading.waves.push(Wave { amplitude, period, phase: 0.0, envelope });
                }
                Manoeuvre::Sink { depth: target } | Manoeuvre::Rise { depth: target } => {
                    let sinks = matches!(manoeuvre, Manoeuvre::Sink { .. });
                    if sinks != (target > depth) {
                        let (word, side) = if sinks { ("sink", "more") } else { ("rise", "less") };
                        let expected = format!("{side} than {depth} m, the depth before, to {word} to");
                        return Err(problem("depth", target, expected));
                    }
                    let angle = path_angle(start, end, flank, speed, depth - target).ok_or_else(|| {
                        let reach = climb(start, end, flank, speed, STEEPEST);
                        let expected = format!("within {reach:.1} m of {depth} m: steeper than 45 deg at {speed} m/s");
                        problem("depth", target, expected)
                    })?;
                    plan.path_angle.plateau(start, end, flank, angle);
                    depth = target;
                }
            }
        }
        plan.roll_wave.waves.extend(oscillation(&vehicle.roll_wave, 0.0, &under_way));
        // A quarter period apart from the roll, so that the two do not cancel or repeat one another.
        plan.pitch_wave.waves.extend(oscillation(&vehicle.pitch_wave, FRAC_PI_2, &under_way));
        Ok(plan)
    }

    /// Velocity east, north and downwards at `t`, m/s, with its derivatives.
    pub(crate) fn velocity(&self, t: f64) -> [Jet; 3] {
        let speed = self.speed.at(t);
        let (sin_heading, cos_heading) = self.heading.at(t).sin_cos();
        let (sin_path, cos_path) = self.path_angle.at(t).sin_cos();
        let level = speed * cos_path;
        [level * cos_heading, level * sin_heading, -(speed * sin_path)]
    }
}

fn ramp(start: f64, length: f64, amount: f64) -> Ramp {
    Ramp { start, length, amount, of: RampOf::Value }
}

fn oscillation(wave: &WaveSetup, phase: f64, envelope: &[Ramp]) -> Option<Wave> {
    let WaveSetup { amplitude, period } = *wave;
    (amplitude != 0.0).then(|| Wave { amplitude, period, phase, envelope: envelope.to_vec() })
}

/// Height gained on a path whose angle rises to `angle` and returns: ∫ speed · sin ϑ dt, m.
fn climb(start: f64, end: f64, flank: f64, speed: f64, angle: f64) -> f64 {
    /// Of Simpson's rule; the integrand is smooth over tens of seconds.
    const STEPS: usize = 2000;
    let mut profile = Profile::default();
    profile.plateau(start, end, flank, angle);
    let step = (end - start) / STEPS as f64;
    let sum: f64 = (0..=STEPS)
        .map(|index| {
            let weight = match index {
                0 | STEPS => 1.0,
                odd if odd % 2 == 1 => 4.0,
                _ => 2.0,
            };
            weight * profile.at(start + index as f64 * step).value().sin()
        })
        .sum();
    speed * sum * step / 3.0
}

/// The path angle that gains `height`; `None` when it would be steeper than [`STEEPEST`].
fn path_angle(start: f64, end: f64, flank: f64, speed: f64, height: f64) -> Option<f64> {
    let (mut low, mut high) = (-STEEPEST, STEEPEST);
    if height.abs() > climb(start, end, flank, speed, STEEPEST) {
        return None;
    }
    // The gain grows with the angle; fifty halvings are below the rounding of an angle.
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if climb(start, end, flank, speed, middle) < height {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}
