//! A scenario as it is written: the shape of the TOML file, and the check that makes a [`Scenario`] of it.
//!
//! Angles are degrees here and radians after the check, but for those that only pass through to `sensors.toml`.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use shared_types::{Duration, Time};
use sim_faults::{FaultError, FaultSpec};

use crate::scenario::{
    Buoy, BuoySetup, Drift, DvlSetup, GnssSetup, ImuSetup, InitialSetup, LblSetup, Manoeuvre, McpSetup, PsSetup,
    Scenario, ScenarioError, Schedule, Segment, VehicleSetup, WaveSetup,
};

/// A value outside its domain: the `nth` section of that name, the key, what stands there and what may.
#[derive(Debug)]
pub(crate) struct Problem {
    pub(crate) section: &'static str,
    pub(crate) nth: usize,
    pub(crate) key: &'static str,
    pub(crate) found: String,
    pub(crate) expected: String,
}

fn problem(section: &'static str, key: &'static str, found: impl ToString, expected: &str) -> Problem {
    Problem { section, nth: 0, key, found: found.to_string(), expected: expected.to_owned() }
}

/// The text of a scenario and where it came from, to name lines.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Locator {
    file: PathBuf,
    text: String,
}

impl Locator {
    pub(crate) fn new(text: &str, file: &Path) -> Locator {
        Locator { file: file.to_owned(), text: text.to_owned() }
    }

    pub(crate) fn parse_error(&self, error: &toml::de::Error) -> ScenarioError {
        let offset = error.span().map_or(0, |span| span.start).min(self.text.len());
        let before = &self.text[..offset];
        ScenarioError::Parse {
            file: self.file.clone(),
            line: before.matches('\n').count() + 1,
            column: before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1,
            message: error.message().trim().replace('\n', ", "),
        }
    }

    pub(crate) fn value_error(&self, problem: Problem) -> ScenarioError {
        let Problem { section, nth, key, found, expected } = problem;
        let name = if section.is_empty() { key.to_owned() } else { format!("{section}.{key}") };
        ScenarioError::Value { file: self.file.clone(), line: self.line(section, nth, key), key: name, found, expected }
    }

    /// Line of a key in the `nth` section of that name, else that of the section, else the first.
    fn line(&self, section: &str, nth: usize, key: &str) -> usize {
        let (mut inside, mut seen, mut fallback) = (section.is_empty(), 0, 1);
        for (index, line) in self.text.lines().enumerate() {
            let plain = line.trim();
            if let Some(header) = plain.strip_prefix('[') {
                let name = header.trim_start_matches('[').split(']').next().unwrap_or_default().trim();
                inside = name == section && seen == nth;
                seen += usize::from(name == section);
                if inside {
                    fallback = index + 1;
                }
            } else if inside && plain.split_once('=').is_some_and(|(name, _)| name.trim() == key) {
                return index + 1;
            }
        }
        fallback
    }
}

/// The file's shape.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    origin: [f64; 3],
    #[serde(default)]
    surface_height: f64,
    initial: InitialSection,
    vehicle: VehicleSection,
    segment: Vec<SegmentSection>,
    #[serde(default)]
    buoys: BuoysSection,
    #[serde(default)]
    buoy: Vec<BuoySection>,
    imu: Option<ImuSection>,
    lbl: Option<LblSection>,
    gnss: Option<GnssSection>,
    dvl: Option<DvlSection>,
    mcp: Option<McpSection>,
    ps: Option<PsSection>,
    #[serde(default)]
    faults: FaultsSection,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct FaultsSection {
    #[serde(default)]
    inject: Vec<Fault>,
}

/// A fault as it stands in the file: a text that is checked while it is read, so that a mistake has its line.
#[derive(Debug, Deserialize)]
#[serde(try_from = "String")]
struct Fault(FaultSpec);

impl TryFrom<String> for Fault {
    type Error = FaultError;

    fn try_from(text: String) -> Result<Fault, FaultError> {
        text.parse().map(Fault)
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct InitialSection {
    t: f64,
    sigma_position: f64,
    sigma_velocity: f64,
    sigma_attitude: [f64; 3],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct VehicleSection {
    #[serde(default)]
    start: [f64; 3],
    heading: f64,
    #[serde(default)]
    speed: f64,
    #[serde(default)]
    bank: f64,
    roll_wave: Option<WaveSection>,
    pitch_wave: Option<WaveSection>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WaveSection {
    amplitude: f64,
    period: f64,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum ManoeuvreName {
    Still,
    Cruise,
    Accelerate,
    Turn,
    Sink,
    Rise,
    Weave,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SegmentSection {
    manoeuvre: ManoeuvreName,
    until: f64,
    speed: Option<f64>,
    rate: Option<f64>,
    depth: Option<f64>,
    amplitude: Option<f64>,
    period: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct BuoysSection {
    sigma: f64,
    clock_offset: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct BuoySection {
    number: u32,
    position: [f64; 3],
    velocity: Option<[f64; 3]>,
    wander: Option<WaveSection>,
    fix_every: Option<f64>,
}

/// A sensor's section: the keys that every sensor has, and its own.
macro_rules! sensor_section {
    ($name:ident, $section:literal { $($(#[$meta:meta])* $key:ident : $type:ty,)* }) => {
        #[derive(Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        struct $name {
            rate: f64,
            #[serde(default)]
            phase: f64,
            #[serde(default)]
            clock_offset: f64,
            #[serde(default)]
            outages: Vec<[f64; 2]>,
            #[serde(default)]
            dropout: f64,
            #[serde(default)]
            outlier_probability: f64,
            #[serde(default)]
            outlier_size: f64,
            $($(#[$meta])* $key: $type,)*
        }

        impl $name {
            fn schedule(&self) -> Result<Schedule, Problem> {
                check_schedule($section, Schedule {
                    rate: self.rate,
                    phase: self.phase,
                    clock_offset: Duration::from_seconds(self.clock_offset),
                    outages: self.outages.iter().map(|span| span.map(Time::from_seconds)).collect(),
                    dropout: self.dropout,
                    outlier_probability: self.outlier_probability,
                    outlier_size: self.outlier_size,
                })
            }
        }
    };
}

sensor_section!(ImuSection, "imu" {});
sensor_section!(LblSection, "lbl" {
    #[serde(default)]
    lever_arm: [f64; 3],
    reference_buoy: u32,
    #[serde(default = "unlimited")]
    max_range: f64,
});
sensor_section!(GnssSection, "gnss" {
    #[serde(default)]
    lever_arm: [f64; 3],
});
sensor_section!(DvlSection, "dvl" {
    #[serde(default)]
    lever_arm: [f64; 3],
    #[serde(default)]
    mounting_rpy: [f64; 3],
});
sensor_section!(McpSection, "mcp" {
    #[serde(default)]
    declination: f64,
});
sensor_section!(PsSection, "ps" {
    #[serde(default)]
    lever_arm: [f64; 3],
});

fn unlimited() -> f64 {
    f64::INFINITY
}

fn finite(section: &'static str, key: &'static str, value: f64) -> Result<f64, Problem> {
    if value.is_finite() { Ok(value) } else { Err(problem(section, key, value, "a finite number")) }
}

fn finite3(section: &'static str, key: &'static str, values: [f64; 3]) -> Result<[f64; 3], Problem> {
    if values.iter().all(|value| value.is_finite()) {
        Ok(values)
    } else {
        Err(problem(section, key, format!("{values:?}"), "three finite numbers"))
    }
}

fn positive(section: &'static str, key: &'static str, value: f64) -> Result<f64, Problem> {
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(problem(section, key, value, "a positive number")) }
}

fn non_negative(section: &'static str, key: &'static str, value: f64) -> Result<f64, Problem> {
    if value.is_finite() && value >= 0.0 {
        Ok(value)
    } else {
        Err(problem(section, key, value, "zero or a positive number"))
    }
}

fn check_schedule(section: &'static str, schedule: Schedule) -> Result<Schedule, Problem> {
    /// Hz: beyond it the step is so short that a mistake is likelier than an instrument.
    const RATE_MAX: f64 = 10_000.0;
    if !(schedule.rate > 0.0 && schedule.rate <= RATE_MAX) {
        return Err(problem(section, "rate", schedule.rate, "a positive number, at most 10000"));
    }
    non_negative(section, "phase", schedule.phase)?;
    if let Some(span) = schedule.outages.iter().find(|[from, to]| from > to) {
        let found = format!("[{}, {}]", span[0], span[1]);
        return Err(problem(section, "outages", found, "pairs of times, the earlier first"));
    }
    for (key, value) in [("dropout", schedule.dropout), ("outlier_probability", schedule.outlier_probability)] {
        if !(0.0..=1.0).contains(&value) {
            return Err(problem(section, key, value, "a probability, between 0 and 1"));
        }
    }
    non_negative(section, "outlier_size", schedule.outlier_size)?;
    Ok(schedule)
}

impl File {
    /// The checked scenario.
    pub(crate) fn check(self, source: &Locator) -> Result<Scenario, Problem> {
        let [lat_deg, lon_deg, _] = finite3("", "origin", self.origin)?;
        if lat_deg.abs() > 90.0 || lon_deg.abs() > 360.0 {
            let found = format!("{:?}", self.origin);
            return Err(problem("", "origin", found, "latitude within 90 deg, longitude within 360 deg, height"));
        }
        let segments = check_segments(&self.segment)?;
        let end = segments.last().map_or(0.0, |segment| segment.end);
        if !(0.0..end).contains(&self.initial.t) {
            return Err(problem("initial", "t", self.initial.t, "a time between 0 and the end of the last segment"));
        }
        for value in self.initial.sigma_attitude {
            positive("initial", "sigma_attitude", value)?;
        }
        Ok(Scenario {
            origin_deg: self.origin,
            surface_height: finite("", "surface_height", self.surface_height)?,
            initial: InitialSetup {
                t: self.initial.t,
                sigma_position: positive("initial", "sigma_position", self.initial.sigma_position)?,
                sigma_velocity: positive("initial", "sigma_velocity", self.initial.sigma_velocity)?,
                sigma_attitude_deg: self.initial.sigma_attitude,
            },
            vehicle: VehicleSetup {
                east_north_depth: finite3("vehicle", "start", self.vehicle.start)?,
                heading: finite("vehicle", "heading", self.vehicle.heading)?.to_radians(),
                speed: non_negative("vehicle", "speed", self.vehicle.speed)?,
                bank: finite("vehicle", "bank", self.vehicle.bank)?,
                roll_wave: check_wave("roll_wave", self.vehicle.roll_wave.as_ref())?,
                pitch_wave: check_wave("pitch_wave", self.vehicle.pitch_wave.as_ref())?,
            },
            segments,
            buoys: check_buoys(&self.buoys, &self.buoy)?,
            imu: self.imu.map(|imu| Ok(ImuSetup { schedule: imu.schedule()? })).transpose()?,
            lbl: self.lbl.map(|lbl| check_lbl(&lbl, &self.buoy)).transpose()?,
            gnss: match self.gnss {
                None => None,
                Some(gnss) => Some(GnssSetup {
                    schedule: gnss.schedule()?,
                    lever_arm_body: finite3("gnss", "lever_arm", gnss.lever_arm)?,
                }),
            },
            dvl: match self.dvl {
                None => None,
                Some(dvl) => Some(DvlSetup {
                    schedule: dvl.schedule()?,
                    lever_arm_body: finite3("dvl", "lever_arm", dvl.lever_arm)?,
                    mounting_rpy_deg: finite3("dvl", "mounting_rpy", dvl.mounting_rpy)?,
                }),
            },
            mcp: match self.mcp {
                None => None,
                Some(mcp) => Some(McpSetup {
                    schedule: mcp.schedule()?,
                    declination_deg: finite("mcp", "declination", mcp.declination)?,
                }),
            },
            ps: match self.ps {
                None => None,
                Some(ps) => Some(PsSetup {
                    schedule: ps.schedule()?,
                    lever_arm_body: finite3("ps", "lever_arm", ps.lever_arm)?,
                }),
            },
            faults: self.faults.inject.into_iter().map(|fault| fault.0).collect(),
            source: source.clone(),
        })
    }
}

fn check_wave(key: &'static str, wave: Option<&WaveSection>) -> Result<WaveSetup, Problem> {
    let Some(wave) = wave else {
        return Ok(WaveSetup { amplitude: 0.0, period: 1.0 });
    };
    let fits = wave.amplitude.is_finite() && wave.amplitude.abs() <= 45.0 && wave.period.is_finite();
    if fits && wave.period >= 0.1 {
        Ok(WaveSetup { amplitude: wave.amplitude.to_radians(), period: wave.period })
    } else {
        let found = format!("{{ amplitude = {}, period = {} }}", wave.amplitude, wave.period);
        Err(problem("vehicle", key, found, "an amplitude within 45 deg and a period of 0.1 s or more"))
    }
}

fn check_lbl(lbl: &LblSection, buoys: &[BuoySection]) -> Result<LblSetup, Problem> {
    if buoys.is_empty() {
        return Err(problem(
            "lbl",
            "rate",
            lbl.rate,
            "left out with its section, or given [[buoy]] sections to range to",
        ));
    }
    if !buoys.iter().any(|buoy| buoy.number == lbl.reference_buoy) {
        return Err(problem("lbl", "reference_buoy", lbl.reference_buoy, "the number of a [[buoy]]"));
    }
    if lbl.max_range.is_nan() || lbl.max_range <= 0.0 {
        return Err(problem("lbl", "max_range", lbl.max_range, "a positive number"));
    }
    Ok(LblSetup {
        schedule: lbl.schedule()?,
        lever_arm_body: finite3("lbl", "lever_arm", lbl.lever_arm)?,
        reference_buoy: lbl.reference_buoy,
        max_range: lbl.max_range,
    })
}

fn check_buoys(common: &BuoysSection, buoys: &[BuoySection]) -> Result<BuoySetup, Problem> {
    let mut all: Vec<Buoy> = Vec::with_capacity(buoys.len());
    for (nth, buoy) in buoys.iter().enumerate() {
        let located = |problem: Problem| Problem { nth, ..problem };
        if all.iter().any(|other| other.number == buoy.number) {
            return Err(located(problem("buoy", "number", buoy.number, "a number that no other buoy has")));
        }
        let moves = buoy.velocity.is_some() || buoy.wander.is_some();
        let drift = match buoy.fix_every {
            None if moves => {
                return Err(located(problem(
                    "buoy",
                    "fix_every",
                    "missing",
                    "given: how often the drifting buoy reports, s",
                )));
            }
            None => None,
            Some(fix_every) => {
                let wander = buoy.wander.as_ref();
                Some(Drift {
                    velocity_enu: finite3("buoy", "velocity", buoy.velocity.unwrap_or_default()).map_err(located)?,
                    wander: finite("buoy", "wander", wander.map_or(0.0, |w| w.amplitude)).map_err(located)?,
                    wander_period: positive("buoy", "wander", wander.map_or(1.0, |w| w.period)).map_err(located)?,
                    fix_every: positive("buoy", "fix_every", fix_every).map_err(located)?,
                })
            }
        };
        let position_enu = finite3("buoy", "position", buoy.position).map_err(located)?;
        all.push(Buoy { number: buoy.number, position_enu, drift });
    }
    Ok(BuoySetup {
        sigma: non_negative("buoys", "sigma", common.sigma)?,
        clock_offset: Duration::from_seconds(finite("buoys", "clock_offset", common.clock_offset)?),
        all,
    })
}

fn check_segments(sections: &[SegmentSection]) -> Result<Vec<Segment>, Problem> {
    /// s: below it the smooth beginning and end of a manoeuvre become jolts.
    const SHORTEST: f64 = 1.0;
    if sections.is_empty() {
        return Err(problem("segment", "until", "missing", "given in at least one [[segment]]"));
    }
    let mut segments: Vec<Segment> = Vec::with_capacity(sections.len());
    for (nth, section) in sections.iter().enumerate() {
        let located = |problem: Problem| Problem { nth, ..problem };
        let start = segments.last().map_or(0.0, |segment| segment.end);
        if !(section.until.is_finite() && section.until >= start + SHORTEST) {
            let expected = format!("at least {} s, one second after the segment begins", start + SHORTEST);
            return Err(located(problem("segment", "until", section.until, &expected)));
        }
        let manoeuvre = check_manoeuvre(section).map_err(located)?;
        segments.push(Segment { start, end: section.until, manoeuvre });
    }
    Ok(segments)
}

fn check_manoeuvre(section: &SegmentSection) -> Result<Manoeuvre, Problem> {
    use ManoeuvreName as Name;
    let name = section.manoeuvre;
    let keys: [(&'static str, Option<f64>, bool); 5] = [
        ("speed", section.speed, name == Name::Accelerate),
        ("rate", section.rate, name == Name::Turn),
        ("depth", section.depth, name == Name::Sink || name == Name::Rise),
        ("amplitude", section.amplitude, name == Name::Weave),
        ("period", section.period, name == Name::Weave),
    ];
    let mut given = [0.0; 5];
    for (value, (key, found, belongs)) in given.iter_mut().zip(keys) {
        *value = match (found, belongs) {
            (Some(found), true) => finite("segment", key, found)?,
            (None, false) => 0.0,
            (None, true) => {
                return Err(problem("segment", key, "missing", &format!("given for {name:?}").to_lowercase()));
            }
            (Some(found), false) => {
                return Err(problem("segment", key, found, &format!("left out of {name:?}").to_lowercase()));
            }
        };
    }
    let [speed, rate, depth, amplitude, period] = given;
    Ok(match name {
        Name::Still => Manoeuvre::Still,
        Name::Cruise => Manoeuvre::Cruise,
        Name::Accelerate => Manoeuvre::Accelerate { speed: non_negative("segment", "speed", speed)? },
        Name::Turn => Manoeuvre::Turn { rate: rate.to_radians() },
        Name::Sink => Manoeuvre::Sink { depth },
        Name::Rise => Manoeuvre::Rise { depth },
        Name::Weave => {
            Manoeuvre::Weave { amplitude: amplitude.to_radians(), period: positive("segment", "period", period)? }
        }
    })
}
