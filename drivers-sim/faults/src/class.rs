//! The table of the classes: which sensor each belongs to, what its values mean, which entries of the catalogue it serves.

use shared_types::Sensor;

use crate::effect::Effect;
use crate::effects::acoustics::{Identity, Multipath, RangeBias, Runs};
use crate::effects::content::{Added, Noise, Nonsense, Saturate, Scale, Spikes, Stuck};
use crate::effects::doppler::{FalseLock, Mounting};
use crate::effects::inertial::{Rail, Shock, Wiring};
use crate::effects::loss::{Blackout, Dropout, Gaps, Silent};
use crate::effects::order::{Batch, Delay, Duplicate, OutOfOrder};
use crate::effects::places::{Displaced, FixSpikes, MovedBuoy, PoorFirst, Sigma};
use crate::effects::pressure::{Disturbance, Lag, Swell};
use crate::effects::stamps::{Jitter, Offset, Reset, Stamp, Wrap};

/// What a value may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Domain {
    /// Any finite number.
    Finite,
    /// NaN and infinity, too.
    Anything,
    /// Above zero.
    Positive,
    /// Zero or above.
    NonNegative,
    /// Between 0 and 1.
    Share,
    /// Number of a buoy, a whole number.
    Buoy,
}

impl Domain {
    pub(crate) fn holds(self, value: f64) -> bool {
        match self {
            Domain::Anything => true,
            Domain::Finite => value.is_finite(),
            Domain::Positive => value.is_finite() && value > 0.0,
            Domain::NonNegative => value.is_finite() && value >= 0.0,
            Domain::Share => (0.0..=1.0).contains(&value),
            Domain::Buoy => (0.0..=f64::from(u32::MAX)).contains(&value) && value.fract() == 0.0,
        }
    }

    pub(crate) fn expected(self) -> &'static str {
        match self {
            Domain::Anything => "a number",
            Domain::Finite => "a finite number",
            Domain::Positive => "a positive number",
            Domain::NonNegative => "zero or a positive number",
            Domain::Share => "a share between 0 and 1",
            Domain::Buoy => "the number of a buoy",
        }
    }
}

/// A value of a class: its name, what it may be, what it is where it is not given.
pub(crate) type Value = (&'static str, Domain, f64);

/// One class of faults.
#[derive(Debug)]
pub(crate) struct Class {
    pub(crate) sensors: &'static [Sensor],
    pub(crate) name: &'static str,
    pub(crate) values: &'static [Value],
    /// Entries of the fault catalogue.
    pub(crate) catalogue: &'static str,
    pub(crate) says: &'static str,
    pub(crate) make: fn(&[f64]) -> Box<dyn Effect>,
}

use Domain::{Anything, Buoy, Finite, NonNegative, Positive, Share};
use Sensor::{Buoys, Dvl, Gnss, Imu, Lbl, Mcp, Ps};

const ANY: &[Sensor] = &[Imu, Lbl, Gnss, Dvl, Mcp, Ps, Buoys];

macro_rules! class {
    ($sensors:expr, $name:literal, [$($value:expr),* $(,)?], $catalogue:literal, $says:literal, |$v:pat_param| $make:expr) => {
        Class {
            sensors: $sensors,
            name: $name,
            values: &[$($value),*],
            catalogue: $catalogue,
            says: $says,
            make: |values| {
                let $v = values else { unreachable!("a parsed spec has a value for every name of its class") };
                Box::new($make)
            },
        }
    };
}

/// Every class. Names repeat where sensors differ in what the fault means.
pub(crate) const CLASSES: &[Class] = &[
    class!(ANY, "blackout", [], "F1 F6 F13 F36", "no reading at all", |[]| Blackout),
    class!(ANY, "dropout", [("share", Share, 0.3)], "F6", "a share of the readings is lost, each by itself", |[
        share,
    ]| {
        Dropout { share: *share }
    }),
    class!(
        ANY,
        "gaps",
        [("length s", Positive, 0.3), ("every s", Positive, 60.0)],
        "F2",
        "silences again and again, the first at once",
        |[length, every]| Gaps { length: *length, every: *every }
    ),
    class!(ANY, "stuck", [], "F5 F9 F15 F16", "the last numbers for ever, under running stamps", |[]| Stuck::default()),
    class!(ANY, "nan", [("share", Share, 0.01)], "F20", "one number of a reading is NaN", |[share]| Nonsense {
        share: *share,
        value: f64::NAN
    }),
    class!(ANY, "inf", [("share", Share, 0.01)], "F20", "one number of a reading is infinite", |[share]| Nonsense {
        share: *share,
        value: f64::INFINITY
    }),
    class!(ANY, "huge", [("share", Share, 0.01)], "F20", "one number of a reading is 1e30", |[share]| Nonsense {
        share: *share,
        value: 1e30
    }),
    class!(
        ANY,
        "duplicate",
        [("share", Share, 0.1), ("after s", NonNegative, 0.0)],
        "F12",
        "readings arrive twice",
        |[share, after]| Duplicate { share: *share, after: *after }
    ),
    class!(
        ANY,
        "out_of_order",
        [("share", Share, 0.1), ("by s", NonNegative, 0.5)],
        "F12",
        "readings are overtaken by those that follow",
        |[share, by]| OutOfOrder { share: *share, by: *by }
    ),
    class!(
        ANY,
        "delay",
        [("delay s", NonNegative, 1.0), ("jitter s", NonNegative, 0.0)],
        "F12",
        "every reading arrives late, with its right stamp",
        |[delay, jitter]| Delay { delay: *delay, jitter: *jitter }
    ),
    class!(ANY, "batch", [("every s", Positive, 5.0)], "F12", "silence, then all of it at once", |[every]| Batch {
        every: *every
    }),
    class!(ANY, "stamp", [("offset s", Finite, 0.2)], "F21 F22", "stamps late by a constant", |[offset]| Stamp(
        Offset::Constant(*offset)
    )),
    class!(
        ANY,
        "stamp_wander",
        [("mean s", Finite, 0.2), ("amplitude s", Finite, 0.1), ("period s", Positive, 120.0)],
        "F22",
        "stamps late by a slowly varying offset",
        |[mean, amplitude, period]| Stamp(Offset::Wander { mean: *mean, amplitude: *amplitude, period: *period })
    ),
    class!(ANY, "stamp_ramp", [("rate s/s", Finite, 1e-4)], "F22", "a clock that is too fast", |[rate]| Stamp(
        Offset::Ramp { rate: *rate }
    )),
    class!(
        ANY,
        "stamp_steps",
        [("first s", Finite, 0.1), ("second s", Finite, 0.3), ("every s", Positive, 60.0)],
        "F22",
        "stamps late by two offsets in turn",
        |[first, second, every]| Stamp(Offset::Steps { first: *first, second: *second, every: *every })
    ),
    class!(ANY, "stamp_jitter", [("sigma s", NonNegative, 0.005)], "F22 F23", "stamps with noise", |[sigma]| Jitter {
        sigma: *sigma,
        last: None
    }),
    class!(
        ANY,
        "stamp_wrap",
        [("period s", Positive, 4294.967296)],
        "F21",
        "stamps begin again from 0 when the counter is full",
        |[period]| Wrap { period: *period }
    ),
    class!(ANY, "stamp_reset", [], "F21 F22", "the sensor's clock begins again from 0", |[]| Reset),
    class!(
        &[Imu],
        "gyro_bias",
        [("x rad/s", Finite, 1e-3), ("y rad/s", Finite, 0.0), ("z rad/s", Finite, 1e-3)],
        "F4",
        "a step of the gyroscope bias",
        |[x, y, z]| Added::offset(&[*x, *y, *z])
    ),
    class!(
        &[Imu],
        "accel_bias",
        [("x m/s²", Finite, 0.02), ("y m/s²", Finite, 0.02), ("z m/s²", Finite, 0.02)],
        "F4",
        "a step of the accelerometer bias",
        |[x, y, z]| Added::offset(&[0.0, 0.0, 0.0, *x, *y, *z])
    ),
    class!(
        &[Imu],
        "gyro_ramp",
        [("rate rad/s²", Finite, 1e-6)],
        "F4",
        "gyroscope biases that warm up, all axes",
        |[rate]| Added::ramp(&[*rate; 3])
    ),
    class!(
        &[Imu],
        "saturate",
        [("rad/s", Positive, 0.05), ("m/s²", Positive, 9.9)],
        "F3",
        "no number beyond a rail",
        |[rate, accel]| Saturate { limits: vec![*rate, *rate, *rate, *accel] }
    ),
    class!(
        &[Imu],
        "rail",
        [("rad/s", Positive, 8.7), ("m/s²", Positive, 78.0)],
        "F3",
        "every axis at its rail",
        |[rate, accel]| Rail { rate: *rate, accel: *accel }
    ),
    class!(
        &[Imu],
        "shock",
        [("share", Share, 0.05), ("m/s²", NonNegative, 30.0)],
        "F3",
        "knocks on the accelerometers",
        |[share, accel]| Shock { share: *share, accel: *accel }
    ),
    class!(&[Imu], "axes", [], "F5", "x and y swapped", |[]| Wiring::Swapped),
    class!(&[Imu], "sign", [], "F5", "z turned round", |[]| Wiring::Negated),
    class!(
        &[Lbl],
        "multipath",
        [("share", Share, 0.2), ("least m", NonNegative, 5.0), ("most m", NonNegative, 300.0)],
        "F7",
        "ranges too long, each by itself",
        |[share, least, most]| Multipath { share: *share, least: *least, most: *most }
    ),
    class!(
        &[Lbl],
        "bursts",
        [
            ("share", Share, 0.2),
            ("pings", Positive, 20.0),
            ("least m", NonNegative, 5.0),
            ("most m", NonNegative, 300.0)
        ],
        "F7",
        "runs of ranges of a beacon too long, each by its own excess",
        |[share, pings, least, most]| Runs {
            share: *share,
            pings: *pings,
            least: *least,
            most: *most,
            coherent: false,
            under_way: Vec::new()
        }
    ),
    class!(
        &[Lbl],
        "clusters",
        [
            ("share", Share, 0.2),
            ("pings", Positive, 20.0),
            ("least m", NonNegative, 5.0),
            ("most m", NonNegative, 300.0)
        ],
        "F7",
        "runs of ranges of a beacon too long by one excess: they agree with each other",
        |[share, pings, least, most]| Runs {
            share: *share,
            pings: *pings,
            least: *least,
            most: *most,
            coherent: true,
            under_way: Vec::new()
        }
    ),
    class!(
        &[Lbl],
        "bias",
        [("m", Finite, 5.0), ("buoy", Buoy, 0.0)],
        "F8 F10",
        "ranges of a beacon (0: of all) off: turn-around time",
        |[bias, buoy]| RangeBias { bias: *bias, buoy: *buoy as u32 }
    ),
    class!(
        &[Lbl],
        "identity",
        [("one", Buoy, 1.0), ("other", Buoy, 2.0), ("share", Share, 0.1)],
        "F8",
        "two beacons taken for each other",
        |[one, other, share]| Identity { one: *one as u32, other: *other as u32, share: *share, last: None }
    ),
    class!(&[Lbl], "silent", [("buoy", Buoy, 1.0)], "F6", "one beacon does not answer", |[buoy]| Silent {
        buoy: *buoy as u32
    }),
    class!(
        &[Lbl, Dvl],
        "scale",
        [("factor", Positive, 1.01)],
        "F11 F15",
        "too large by a factor: speed of sound",
        |[factor]| Scale { factor: *factor }
    ),
    class!(
        &[Gnss],
        "jump",
        [("m", Finite, 300.0), ("course deg", Finite, 90.0)],
        "F18 F19",
        "fixes elsewhere by a constant",
        |[metres, course]| Displaced { metres: *metres, speed: 0.0, course_deg: *course }
    ),
    class!(
        &[Gnss],
        "drag",
        [("m/s", Finite, 5.0), ("course deg", Finite, 90.0)],
        "F19",
        "fixes dragged away by a spoofer",
        |[speed, course]| Displaced { metres: 0.0, speed: *speed, course_deg: *course }
    ),
    class!(&[Gnss], "spikes", [("share", Share, 0.1), ("m", NonNegative, 50.0)], "F18", "single wild fixes", |[
        share,
        size,
    ]| {
        FixSpikes { share: *share, size: *size }
    }),
    class!(
        &[Gnss],
        "poor",
        [("m", NonNegative, 20.0), ("decay s", Positive, 5.0)],
        "F18",
        "the first fixes after a silence are off and settle",
        |[size, decay]| PoorFirst { size: *size, decay: *decay, last: None, began: None }
    ),
    class!(
        &[Gnss],
        "sigma",
        [("m", Anything, 0.0)],
        "F20",
        "every fix claims this sigma: 0, negative, nan, absurd",
        |[sigma]| Sigma { sigma: *sigma }
    ),
    class!(
        &[Dvl],
        "spikes",
        [("share", Share, 0.03), ("m/s", NonNegative, 1.0)],
        "F15",
        "single wild velocities",
        |[share, size]| Spikes { share: *share, size: *size }
    ),
    class!(
        &[Dvl],
        "false_lock",
        [
            ("share of the truth", Finite, 0.2),
            ("x m/s", Finite, 0.25),
            ("y m/s", Finite, -0.15),
            ("z m/s", Finite, 0.0)
        ],
        "F15 F37",
        "lock on something that goes along: a share of the truth and a velocity of its own",
        |[share, x, y, z]| FalseLock { share: *share, layer_dvl: [*x, *y, *z] }
    ),
    class!(
        &[Dvl],
        "bias",
        [("x m/s", Finite, 0.1), ("y m/s", Finite, 0.0), ("z m/s", Finite, 0.0)],
        "F15",
        "a constant velocity too much",
        |[x, y, z]| Added::offset(&[*x, *y, *z])
    ),
    class!(
        &[Dvl],
        "mounting",
        [("yaw deg", Finite, 180.0)],
        "F15",
        "turned about its vertical against the configuration",
        |[yaw]| Mounting { yaw_deg: *yaw }
    ),
    class!(&[Dvl], "saturate", [("m/s", Positive, 0.8)], "F15", "no number beyond a rail", |[limit]| Saturate {
        limits: vec![*limit]
    }),
    class!(
        &[Mcp],
        "disturbance",
        [("deg", Finite, 20.0), ("period s", Positive, 60.0)],
        "F17",
        "iron passes: swells and falls",
        |[size, period]| Disturbance { size_deg: *size, period: *period }
    ),
    class!(&[Mcp], "bias", [("deg", Finite, 10.0)], "F17", "a wrong declination", |[bias]| Added::offset(&[*bias])),
    class!(
        &[Mcp],
        "spikes",
        [("share", Share, 0.03), ("deg", NonNegative, 30.0)],
        "F17",
        "single wild headings",
        |[share, size]| Spikes { share: *share, size: *size }
    ),
    class!(&[Ps], "spikes", [("share", Share, 0.03), ("m", NonNegative, 5.0)], "F16", "single wild depths", |[
        share,
        size,
    ]| {
        Spikes { share: *share, size: *size }
    }),
    class!(&[Ps], "bias", [("m", Finite, 0.3)], "F16", "atmospheric pressure has changed", |[bias]| Added::offset(&[
        *bias
    ])),
    class!(&[Ps], "ramp", [("m/s", Finite, 0.002)], "F16", "a drift", |[rate]| Added::ramp(&[*rate])),
    class!(&[Ps], "swell", [("m", Finite, 0.5), ("period s", Positive, 8.0)], "F16", "waves of the sea", |[
        amplitude,
        period,
    ]| {
        Swell { amplitude: *amplitude, period: *period }
    }),
    class!(&[Ps], "lag", [("time constant s", Positive, 10.0)], "F16", "a clogged port", |[time_constant]| Lag {
        time_constant: *time_constant,
        state: None
    }),
    class!(
        &[Lbl, Dvl, Mcp, Ps],
        "noise",
        [("sigma", NonNegative, 0.1)],
        "F15 F16",
        "more noise than stated, in the unit of the reading",
        |[sigma]| Noise { sigma: *sigma }
    ),
    class!(
        &[Buoys],
        "moved",
        [("m", Finite, 50.0), ("course deg", Finite, 90.0), ("buoy", Buoy, 0.0)],
        "F8 F9",
        "a buoy (0: every one) is not where it says",
        |[metres, course, buoy]| MovedBuoy { metres: *metres, course_deg: *course, buoy: *buoy as u32 }
    ),
];

impl Class {
    pub(crate) fn of(sensor: Sensor, name: &str) -> Option<&'static Class> {
        CLASSES.iter().find(|class| class.name == name && class.sensors.contains(&sensor))
    }

    /// `multipath=share,least m,most m`, as a person has to write it.
    pub(crate) fn usage(&self) -> String {
        let values: Vec<&str> = self.values.iter().map(|(name, ..)| *name).collect();
        if values.is_empty() { self.name.to_owned() } else { format!("{}={}", self.name, values.join(",")) }
    }
}

/// Every class as a Markdown table: sensor, class with its values and their defaults, catalogue, what it does.
pub fn class_table() -> String {
    let mut table =
        "| sensors | class | values (default) | catalogue | what goes wrong |\n|---|---|---|---|---|\n".to_owned();
    for class in CLASSES {
        let sensors: Vec<&str> = class.sensors.iter().map(|sensor| sensor.name()).collect();
        let sensors = if class.sensors.len() == ANY.len() { "any".to_owned() } else { sensors.join(" ") };
        let values: Vec<String> = class.values.iter().map(|(name, _, default)| format!("{name} ({default})")).collect();
        table += &format!(
            "| {sensors} | `{}` | {} | {} | {} |\n",
            class.name,
            values.join(", "),
            class.catalogue,
            class.says
        );
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_has_each_class_once_and_every_default_fits() {
        for sensor in shared_types::SENSORS {
            let names: Vec<&str> =
                CLASSES.iter().filter(|class| class.sensors.contains(&sensor)).map(|class| class.name).collect();
            let mut once = names.clone();
            once.sort_unstable();
            once.dedup();
            assert_eq!(names.len(), once.len(), "{sensor}: {names:?}");
        }
        for class in CLASSES {
            for (name, domain, default) in class.values {
                assert!(domain.holds(*default), "{}: {name} is {default}", class.name);
            }
            let defaults: Vec<f64> = class.values.iter().map(|(_, _, default)| *default).collect();
            (class.make)(&defaults);
        }
    }

    #[test]
    fn the_table_for_readers_is_this_table() {
        let readme = include_str!("../README.md");
        assert!(readme.contains(&class_table()), "put this into drivers-sim/faults/README.md:\n{}", class_table());
    }
}
