//! What happens in a simulated run: the vehicle's manoeuvres, the buoys, which sensors are fitted and when they fail.
//!
//! The text is TOML; the three built-in ones lie in `deploy/scenarios/`. How much noise the sensors have is not said
//! here but by the [`Preset`](crate::Preset), and which noise by the seed.

use std::path::{Path, PathBuf};

use shared_types::{Duration, Time};
use sim_faults::FaultSpec;

use crate::plan::Plan;
use crate::scenario_file::{File, Locator, Problem};

/// Names and texts of the scenarios that need no file.
pub const BUILTIN_SCENARIOS: [(&str, &str); 4] = [
    ("mission", include_str!("../../../deploy/scenarios/mission.toml")),
    ("stable", include_str!("../../../deploy/scenarios/stable.toml")),
    ("outage", include_str!("../../../deploy/scenarios/outage.toml")),
    ("survey", include_str!("../../../deploy/scenarios/survey.toml")),
];

/// A checked scenario. Times in s from its start, lengths in m, ENU of its origin. A sensor that is `None` is not fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Latitude (deg), longitude (deg), ellipsoidal height (m) of the ENU origin, as written.
    pub origin_deg: [f64; 3],
    /// Ellipsoidal height of the mean water surface, m.
    pub surface_height: f64,
    /// Where and how the estimation starts.
    pub initial: InitialSetup,
    /// The vehicle at the start and how it rides.
    pub vehicle: VehicleSetup,
    /// What it does, one after another, from 0 to the end of the scenario.
    pub segments: Vec<Segment>,
    /// Acoustic buoys.
    pub buoys: BuoySetup,
    /// Inertial measurement unit.
    pub imu: Option<ImuSetup>,
    /// Acoustic ranging.
    pub lbl: Option<LblSetup>,
    /// Satellite receiver.
    pub gnss: Option<GnssSetup>,
    /// Doppler log.
    pub dvl: Option<DvlSetup>,
    /// Compass.
    pub mcp: Option<McpSetup>,
    /// Pressure sensor.
    pub ps: Option<PsSetup>,
    /// What goes wrong; [`World::faults`](crate::World::faults) injects it.
    pub faults: Vec<FaultSpec>,
    pub(crate) source: Locator,
}

/// Where and how the estimation starts; the state itself is the truth, with an error drawn from these sigmas.
#[derive(Clone, Debug, PartialEq)]
pub struct InitialSetup {
    /// s.
    pub t: f64,
    /// m per axis.
    pub sigma_position: f64,
    /// m/s per axis.
    pub sigma_velocity: f64,
    /// About body x, body y and up, deg.
    pub sigma_attitude_deg: [f64; 3],
}

/// The vehicle at the start and how it rides.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleSetup {
    /// East, north (m) and depth below the ENU origin's height (m) at the start.
    pub east_north_depth: [f64; 3],
    /// Clockwise from north, rad.
    pub heading: f64,
    /// Speed at the start, m/s.
    pub speed: f64,
    /// Lean into a turn: roll per turn rate, s.
    pub bank: f64,
    /// Roll oscillation while under way.
    pub roll_wave: WaveSetup,
    /// Pitch oscillation while under way.
    pub pitch_wave: WaveSetup,
}

/// An oscillation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveSetup {
    /// rad.
    pub amplitude: f64,
    /// s.
    pub period: f64,
}

/// One manoeuvre between `start` and `end`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// s.
    pub start: f64,
    /// s.
    pub end: f64,
    /// What the vehicle does.
    pub manoeuvre: Manoeuvre,
}

/// What the vehicle does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Manoeuvre {
    /// Lies still; only after a stop.
    Still,
    /// Goes straight on at the speed that it has.
    Cruise,
    /// Reaches another speed, m/s.
    Accelerate {
        /// At the end of the segment.
        speed: f64,
    },
    /// Turns with a rate, rad/s, positive to the right (as a heading counts).
    Turn {
        /// Held but for a smooth beginning and end.
        rate: f64,
    },
    /// Dives to a depth, m, nose down.
    Sink {
        /// At the end of the segment.
        depth: f64,
    },
    /// Climbs to a depth, m, nose up.
    Rise {
        /// At the end of the segment.
        depth: f64,
    },
    /// Swings its heading to and fro.
    Weave {
        /// rad to each side.
        amplitude: f64,
        /// s.
        period: f64,
    },
}

/// When a sensor reads, and when it fails to.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Readings per second.
    pub rate: f64,
    /// Time of the first reading, s.
    pub phase: f64,
    /// What the sensor's clock is ahead of the vehicle's: its stamps are late by so much.
    pub clock_offset: Duration,
    /// Closed intervals without readings.
    pub outages: Vec<[Time; 2]>,
    /// Probability that a reading is lost.
    pub dropout: f64,
    /// Probability that a reading is wild.
    pub outlier_probability: f64,
    /// How wild, in the unit of the reading: between half and one and a half of this.
    pub outlier_size: f64,
}

/// Inertial measurement unit.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuSetup {
    /// When it reads.
    pub schedule: Schedule,
}

/// Acoustic ranging.
#[derive(Clone, Debug, PartialEq)]
pub struct LblSetup {
    /// When it reads.
    pub schedule: Schedule,
    /// From the IMU to the transducer, m.
    pub lever_arm_body: [f64; 3],
    /// Buoy of the filters' plain differences.
    pub reference_buoy: u32,
    /// A buoy further away than this does not answer, m.
    pub max_range: f64,
}

/// Satellite receiver: it has a fix while its antenna is above the water.
#[derive(Clone, Debug, PartialEq)]
pub struct GnssSetup {
    /// When it reads.
    pub schedule: Schedule,
    /// From the IMU to the antenna, m.
    pub lever_arm_body: [f64; 3],
}

/// Doppler log.
#[derive(Clone, Debug, PartialEq)]
pub struct DvlSetup {
    /// When it reads.
    pub schedule: Schedule,
    /// From the IMU to the transducer, m.
    pub lever_arm_body: [f64; 3],
    /// Roll, pitch, yaw of the instrument in the body frame, deg.
    pub mounting_rpy_deg: [f64; 3],
}

/// Compass.
#[derive(Clone, Debug, PartialEq)]
pub struct McpSetup {
    /// When it reads.
    pub schedule: Schedule,
    /// True heading minus reported heading, deg.
    pub declination_deg: f64,
}

/// Pressure sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct PsSetup {
    /// When it reads.
    pub schedule: Schedule,
    /// From the IMU to the port, m.
    pub lever_arm_body: [f64; 3],
}

/// The acoustic buoys.
#[derive(Clone, Debug, PartialEq)]
pub struct BuoySetup {
    /// 1-sigma per axis of a reported position, m.
    pub sigma: f64,
    /// What the buoys' clocks are ahead of the vehicle's.
    pub clock_offset: Duration,
    /// Each of them.
    pub all: Vec<Buoy>,
}

/// One acoustic buoy.
#[derive(Clone, Debug, PartialEq)]
pub struct Buoy {
    /// Its number.
    pub number: u32,
    /// Where it is, or begins to drift.
    pub position_enu: [f64; 3],
    /// `None`: moored.
    pub drift: Option<Drift>,
}

/// How a buoy drifts, and how often it says where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Steady part, m/s.
    pub velocity_enu: [f64; 3],
    /// Amplitude of the slow wander to each side, m.
    pub wander: f64,
    /// Period of the wander, s.
    pub wander_period: f64,
    /// Time between two reports, s.
    pub fix_every: f64,
}

/// A scenario that cannot be played.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// No built-in scenario has that name.
    #[error(
        "there is no scenario `{name}`: built in are {builtin}; a file is named by its path, such as ./{name}.toml"
    )]
    Unknown {
        /// As asked for.
        name: String,
        /// Those that exist.
        builtin: String,
    },
    /// Not TOML, an unknown or missing key, or a value of the wrong type.
    #[error("{}:{line}:{column}: {message}", file.display())]
    Parse {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// What is wrong.
        message: String,
    },
    /// A value outside its domain.
    #[error("{}:{line}: `{key}` is {found}; it must be {expected}", file.display())]
    Value {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// `section.key`.
        key: String,
        /// What stands there.
        found: String,
        /// What may stand there.
        expected: String,
    },
}

impl Scenario {
    /// The built-in scenario of that name.
    ///
    /// # Errors
    /// [`ScenarioError::Unknown`], listing the names that exist.
    pub fn builtin(name: &str) -> Result<Scenario, ScenarioError> {
        match BUILTIN_SCENARIOS.iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Scenario::parse(text, Path::new(&format!("{name}.toml"))),
            None => Err(ScenarioError::Unknown {
                name: name.to_owned(),
                builtin: BUILTIN_SCENARIOS.map(|(known, _)| known).join(", "),
            }),
        }
    }

    /// Reads and checks a scenario; `file` is for messages.
    ///
    /// # Errors
    /// [`ScenarioError::Parse`] and [`ScenarioError::Value`], with the line and what may stand there.
    pub fn parse(text: &str, file: &Path) -> Result<Scenario, ScenarioError> {
        let source = Locator::new(text, file);
        let parsed: File = toml::from_str(text).map_err(|error| source.parse_error(&error))?;
        let scenario = parsed.check(&source).map_err(|problem| source.value_error(problem))?;
        // A dive that is too steep shows only here.
        scenario.plan()?;
        Ok(scenario)
    }

    /// The manoeuvres as profiles.
    pub(crate) fn plan(&self) -> Result<Plan, ScenarioError> {
        Plan::new(self).map_err(|problem: Problem| self.source.value_error(problem))
    }

    /// Its length.
    pub fn duration(&self) -> Duration {
        Duration::from_seconds(self.segments.last().map_or(0.0, |segment| segment.end))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        Scenario::parse(text, Path::new("s.toml")).expect_err("the scenario is wrong").to_string()
    }

    fn mission_with(old: &str, new: &str) -> String {
        let text = BUILTIN_SCENARIOS[0].1;
        assert!(text.contains(old), "{old}");
        text.replacen(old, new, 1)
    }

    fn line_of(text: &str, part: &str) -> usize {
        text.lines().position(|line| line.contains(part)).expect("it is there") + 1
    }

    #[test]
    fn every_built_in_scenario_is_valid() {
        for (name, _) in BUILTIN_SCENARIOS {
            Scenario::builtin(name).unwrap_or_else(|error| panic!("{name}: {error}"));
        }
    }

    #[test]
    fn an_unknown_name_lists_those_that_exist() {
        let error = Scenario::builtin("misson").expect_err("misspelt").to_string();
        assert!(error.contains("`misson`") && error.contains("mission, stable, outage"), "{error}");
    }

    #[test]
    fn a_misspelt_key_is_refused_with_its_line_and_the_keys_that_exist() {
        let text = mission_with("max_range", "max_rang");
        let error = error(&text);
        assert!(error.starts_with(&format!("s.toml:{}:", line_of(&text, "max_rang"))), "{error}");
        assert!(error.contains("max_rang") && error.contains("`max_range`"), "{error}");
    }

    #[test]
    fn a_value_outside_its_domain_names_line_key_and_mend() {
        let text = mission_with("rate = 200.0", "rate = -200.0");
        let error = error(&text);
        let line = line_of(&text, "rate = -200.0");
        assert_eq!(error, format!("s.toml:{line}: `imu.rate` is -200; it must be a positive number, at most 10000"));
    }

    #[test]
    fn faults_are_read_and_a_mistake_names_its_line() {
        let text =
            format!("{}\n[faults]\ninject = [\"ps.stuck@5..6\", \"lbl.multipath=0.1\"]\n", BUILTIN_SCENARIOS[0].1);
        let scenario = Scenario::parse(&text, Path::new("s.toml")).expect("valid");
        let faults: Vec<String> = scenario.faults.iter().map(ToString::to_string).collect();
        assert_eq!(faults, ["ps.stuck@5..6", "lbl.multipath=0.1,5,300@.."]);
        let wrong = text.replace("ps.stuck", "ps.stick");
        let error = error(&wrong);
        assert!(error.starts_with(&format!("s.toml:{}:", line_of(&wrong, "inject"))), "{error}");
        assert!(error.contains("ps has no class \"stick\"; it has blackout"), "{error}");
    }

    #[test]
    fn segments_must_follow_one_another() {
        let text = mission_with("until = 400.0", "until = 10.0");
        let error = error(&text);
        assert!(
            error.starts_with(&format!("s.toml:{}: `segment.until` is 10;", line_of(&text, "until = 10.0"))),
            "{error}"
        );
    }

    #[test]
    fn a_dive_that_is_too_steep_is_refused() {
        let text = mission_with("depth = 50.0", "depth = 500.0");
        let error = error(&text);
        assert!(
            error.starts_with(&format!("s.toml:{}: `segment.depth` is 500;", line_of(&text, "depth = 500.0"))),
            "{error}"
        );
        assert!(error.contains("45 deg"), "{error}");
    }

    #[test]
    fn a_key_of_another_manoeuvre_is_refused_and_a_missing_one_asked_for() {
        let text = mission_with("manoeuvre = \"sink\"", "manoeuvre = \"turn\"");
        assert!(error(&text).contains("`segment.rate` is missing"), "{}", error(&text));
        let text = mission_with("manoeuvre = \"cruise\"", "manoeuvre = \"cruise\"\nspeed = 3.0");
        assert!(error(&text).contains("`segment.speed` is 3; it must be left out"), "{}", error(&text));
    }
}
