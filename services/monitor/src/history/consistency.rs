//! Innovations over time: per sensor, the squared normalised innovation summed over stretches, so that a long run still
//! shows a number that the chi-square distribution bounds.
//!
//! ```text
//! Σ NIS over a stretch ~ χ²(Σ rows)          if innovations are white and as large as modelled
//! ```

use core::fmt::Write;

use shared_types::{AIDING, Sensor};

use super::sample::push_numbers;
use super::series::Series;
use crate::detail::KeyframeDetail;

/// One stretch of one sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    /// Data time of its first keyframe, s.
    t: f64,
    /// Sum over the used factors.
    nis: f64,
    /// Their rows.
    rows: u32,
    /// Refused factors that were judged by their innovation.
    refused: u32,
    /// Largest √(NIS / rows) of a factor, refused ones included.
    largest: f64,
}

impl Stretch {
    fn of(keyframe: &KeyframeDetail, sensor: Sensor) -> Option<Stretch> {
        let judged = || keyframe.factors.iter().filter(move |factor| factor.sensor == sensor && factor.rows > 0);
        judged().next()?;
        let used = || judged().filter(|factor| factor.refused.is_none());
        Some(Stretch {
            t: keyframe.t,
            nis: used().map(|factor| factor.nis).filter(|nis| nis.is_finite()).sum(),
            rows: used().map(|factor| factor.rows).sum(),
            refused: judged().filter(|factor| factor.refused.is_some()).count() as u32,
            largest: judged().map(|factor| (factor.nis / f64::from(factor.rows)).sqrt()).fold(0.0, f64::max),
        })
    }

    fn add(&mut self, later: Stretch) {
        self.nis += later.nis;
        self.rows += later.rows;
        self.refused += later.refused;
        self.largest = self.largest.max(later.largest);
    }
}

/// One series per aiding sensor.
#[derive(Clone, Debug)]
pub(super) struct Consistency([Series<Stretch>; AIDING.len()]);

impl Consistency {
    pub(super) fn new(limit: usize) -> Consistency {
        Consistency(core::array::from_fn(|_| Series::new(limit, Stretch::add)))
    }

    pub(super) fn push(&mut self, keyframe: &KeyframeDetail) {
        for (sensor, series) in AIDING.into_iter().zip(&mut self.0) {
            if let Some(stretch) = Stretch::of(keyframe, sensor) {
                series.push(stretch);
            }
        }
    }

    /// `{"lbl":{"t":[..],"nis":[..],"rows":[..],"refused":[..],"largest":[..]},..}`.
    pub(super) fn json(&self, out: &mut String) {
        for (index, (sensor, series)) in AIDING.into_iter().zip(&self.0).enumerate() {
            let _ = write!(out, "{}\"{sensor}\":{{\"t\":", if index == 0 { '{' } else { ',' });
            push_numbers(out, series.items().iter().map(|stretch| stretch.t), 3);
            out.push_str(",\"nis\":");
            push_numbers(out, series.items().iter().map(|stretch| stretch.nis), 3);
            out.push_str(",\"rows\":");
            push_numbers(out, series.items().iter().map(|stretch| f64::from(stretch.rows)), 0);
            out.push_str(",\"refused\":");
            push_numbers(out, series.items().iter().map(|stretch| f64::from(stretch.refused)), 0);
            out.push_str(",\"largest\":");
            push_numbers(out, series.items().iter().map(|stretch| stretch.largest), 2);
            out.push('}');
        }
        out.push('}');
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::keyframe_at;

    #[test]
    fn sums_over_stretches_are_those_of_their_keyframes() {
        let mut consistency = Consistency::new(4);
        (0..64).for_each(|index| consistency.push(&keyframe_at(f64::from(index))));
        let mut out = String::new();
        consistency.json(&mut out);
        let json: serde_json::Value = serde_json::from_str(&out).expect("valid JSON");
        let sum = |key: &str| -> f64 {
            json["lbl"][key].as_array().expect("a column").iter().filter_map(serde_json::Value::as_f64).sum()
        };
        // Each keyframe of the fixture has two used ranges of NIS 1 and one refused of NIS 25.
        assert_eq!((sum("nis"), sum("rows"), sum("refused")), (128.0, 128.0, 64.0));
        assert!(json["lbl"]["t"].as_array().expect("a column").len() <= 4);
        assert_eq!(json["lbl"]["largest"][0], 5.0);
        assert_eq!(json["gnss"]["t"], serde_json::json!([]), "a sensor without factors has an empty column");
    }
}
