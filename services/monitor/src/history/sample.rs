//! One point of the track, with what strip charts draw of it, and how points become JSON columns.

use core::fmt::Write;

use shared_types::Mode;

use crate::snapshot::Snapshot;

/// The state at one look. What is not known is NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Data time, s.
    pub t: f64,
    /// m.
    pub position_enu: [f64; 3],
    /// Heading of the body, degrees.
    pub heading_deg: f64,
    /// Over ground, m/s.
    pub speed: f64,
    /// [`Mode`] as a number; −1 without an estimate.
    pub mode: i32,
    /// 1-sigma, m.
    pub sigma_enu: [f64; 3],
    /// Covariance of east and north, m².
    pub covariance_en: f64,
    /// Estimate minus truth, m.
    pub error_enu: [f64; 3],
    /// Truth, m.
    pub truth_en: [f64; 2],
}

/// Name, decimals and value of a column.
type Column = (&'static str, usize, fn(&Sample) -> f64);

const COLUMNS: [Column; 16] = [
    ("t", 3, |sample| sample.t),
    ("e", 3, |sample| sample.position_enu[0]),
    ("n", 3, |sample| sample.position_enu[1]),
    ("u", 3, |sample| sample.position_enu[2]),
    ("heading", 1, |sample| sample.heading_deg),
    ("speed", 3, |sample| sample.speed),
    ("mode", 0, |sample| f64::from(sample.mode)),
    ("se", 4, |sample| sample.sigma_enu[0]),
    ("sn", 4, |sample| sample.sigma_enu[1]),
    ("su", 4, |sample| sample.sigma_enu[2]),
    ("cen", 6, |sample| sample.covariance_en),
    ("de", 4, |sample| sample.error_enu[0]),
    ("dn", 4, |sample| sample.error_enu[1]),
    ("du", 4, |sample| sample.error_enu[2]),
    ("te", 3, |sample| sample.truth_en[0]),
    ("tn", 3, |sample| sample.truth_en[1]),
];

impl Sample {
    /// `None` before anything is known of time.
    pub(crate) fn of(snapshot: &Snapshot) -> Option<Sample> {
        const UNKNOWN: [f64; 3] = [f64::NAN; 3];
        let (pose, error) = (snapshot.pose.as_ref(), snapshot.error.as_ref());
        Some(Sample {
            t: snapshot.t.filter(|t| t.is_finite())?,
            position_enu: pose.map_or(UNKNOWN, |pose| pose.position_enu),
            heading_deg: pose.map_or(f64::NAN, |pose| pose.roll_pitch_heading_deg[2]),
            speed: pose.map_or(f64::NAN, |pose| pose.speed),
            mode: snapshot.mode.map_or(-1, |mode| mode as i32),
            sigma_enu: pose.map_or(UNKNOWN, |pose| pose.sigma_position_enu),
            covariance_en: pose.map_or(f64::NAN, |pose| pose.covariance_horizontal[1]),
            error_enu: error.map_or(UNKNOWN, |error| error.position_enu),
            truth_en: error.map_or([f64::NAN; 2], |error| [error.truth_enu[0], error.truth_enu[1]]),
        })
    }

    /// Of two samples of one stretch the one that matters more stands for both: worse mode, then larger error in sigmas.
    pub(crate) fn outweigh(earlier: &mut Sample, later: Sample) {
        let weight = |sample: &Sample| {
            let in_sigmas = |axis: usize| (sample.error_enu[axis] / sample.sigma_enu[axis]).abs();
            let worst = (0..3).map(in_sigmas).filter(|x| x.is_finite()).fold(0.0, f64::max);
            (sample.mode > Mode::Ok as i32, worst)
        };
        if weight(&later) > weight(earlier) {
            *earlier = later;
        }
    }

    /// As one JSON object.
    pub(crate) fn json(&self) -> String {
        let mut out = String::with_capacity(256);
        for (index, (name, decimals, value)) in COLUMNS.iter().enumerate() {
            let _ = write!(out, "{}\"{name}\":", if index == 0 { '{' } else { ',' });
            push_number(&mut out, value(self), *decimals);
        }
        out.push('}');
        out
    }
}

/// `{"t":[..],"e":[..],..}`.
pub(super) fn columns<'a>(out: &mut String, samples: impl Iterator<Item = &'a Sample> + Clone) {
    for (index, (name, decimals, value)) in COLUMNS.iter().enumerate() {
        let _ = write!(out, "{}\"{name}\":", if index == 0 { '{' } else { ',' });
        push_numbers(out, samples.clone().map(value), *decimals);
    }
    out.push('}');
}

/// `[..]`.
pub(super) fn push_numbers(out: &mut String, numbers: impl Iterator<Item = f64>, decimals: usize) {
    out.push('[');
    for (index, number) in numbers.enumerate() {
        if index > 0 {
            out.push(',');
        }
        push_number(out, number, decimals);
    }
    out.push(']');
}

/// With so many decimals at most; what is no number is `null`.
pub(super) fn push_number(out: &mut String, number: f64, decimals: usize) {
    if !number.is_finite() {
        out.push_str("null");
        return;
    }
    let begin = out.len();
    let _ = write!(out, "{number:.decimals$}");
    if decimals > 0 {
        let trimmed = out.trim_end_matches('0').trim_end_matches('.').len();
        out.truncate(trimmed.max(begin));
    }
    if &out[begin..] == "-0" {
        out.replace_range(begin.., "0");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{mission_in_an_outage, mission_under_way, poisoned};

    #[test]
    fn numbers_are_short_and_what_is_none_is_null() {
        let text = |number, decimals| {
            let mut out = String::from("1");
            push_number(&mut out, number, decimals);
            out[1..].to_owned()
        };
        assert_eq!(text(1.500_01, 3), "1.5");
        assert_eq!(text(-0.000_01, 3), "0");
        assert_eq!(text(120.0, 0), "120");
        assert_eq!(text(100.0, 2), "100");
        assert_eq!((text(f64::NAN, 3), text(f64::INFINITY, 0)), ("null".into(), "null".into()));
    }

    #[test]
    fn a_sample_is_the_snapshot_in_brief() {
        let sample = Sample::of(&mission_under_way().snapshot()).expect("time is known");
        let json: serde_json::Value = serde_json::from_str(&sample.json()).expect("valid JSON");
        assert_eq!((json["t"].as_f64(), json["e"].as_f64(), json["mode"].as_i64()), (Some(123.4), Some(23.4), Some(1)));
        assert_eq!(json["de"].as_f64(), Some(0.061));
        let poisoned = Sample::of(&poisoned().snapshot()).expect("time is known").json();
        let json: serde_json::Value = serde_json::from_str(&poisoned).expect("valid JSON");
        assert!(json["e"].is_null() && json["se"].is_null(), "{json}");
    }

    #[test]
    fn an_outage_is_not_thinned_away() {
        let good = Sample::of(&mission_under_way().snapshot()).expect("time is known");
        let bad = Sample::of(&mission_in_an_outage().snapshot()).expect("time is known");
        let mut kept = good;
        Sample::outweigh(&mut kept, bad);
        assert_eq!(kept, bad);
        Sample::outweigh(&mut kept, good);
        assert_eq!(kept, bad);
    }
}
