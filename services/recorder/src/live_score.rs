//! The score of a live run, as the run goes by: what `ilns score` says of its files, without reading them again.
//!
//! Truth and estimates come over two channels. The scorer wants each row of the truth before the first later estimate, so
//! estimates wait until the truth has had time to arrive.

use std::collections::VecDeque;

use nav_evaluation::{EstimatePoint, Scorer, Window};
use nav_geometry::Geodetic;
use shared_types::{Duration, NavEstimate, Truth};

/// How far the truth may be behind the estimates, data time: five rows of the usual 10 Hz.
const PATIENCE: Duration = Duration(500_000_000);

/// Estimates against the truth, once the frame is known.
#[derive(Debug, Default)]
pub(crate) struct LiveScore {
    scorer: Option<Scorer>,
    waiting: VecDeque<EstimatePoint>,
}

impl LiveScore {
    /// The frame's origin: latitude, longitude in degrees, ellipsoidal height in m. Only the first counts; it never moves.
    pub(crate) fn origin(&mut self, [lat_deg, lon_deg, height]: [f64; 3]) {
        self.scorer
            .get_or_insert_with(|| Scorer::new(Geodetic::from_degrees(lat_deg, lon_deg, height), Window::default()));
    }

    pub(crate) fn truth(&mut self, truth: &Truth) {
        if let Some(scorer) = &mut self.scorer {
            scorer.truth(truth);
        }
    }

    /// Takes an estimate that is later than the one before.
    pub(crate) fn estimate(&mut self, estimate: &NavEstimate) {
        let Some(scorer) = &mut self.scorer else { return };
        let newest = EstimatePoint::from(estimate);
        while let Some(first) = self.waiting.pop_front_if(|first| newest.t - first.t >= PATIENCE) {
            scorer.estimate(&first);
        }
        self.waiting.push_back(newest);
    }

    /// For the summary; `None` where no row of the truth has met an estimate.
    pub(crate) fn finish(mut self) -> Option<serde_json::Value> {
        let scorer = self.scorer.as_mut()?;
        for estimate in &self.waiting {
            scorer.estimate(estimate);
        }
        serde_json::to_value(scorer.score()?).ok()
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use crate::estimate_log::tests::estimate;
    use shared_types::{Header, Mode, Time};

    /// A metre above the estimates of this test.
    fn truth(t: f64) -> Truth {
        Truth {
            header: Header::at(Time::from_seconds(t)),
            lat_deg: 36.0,
            lon_deg: 127.0,
            height: 1.0,
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            velocity_enu: [0.0; 3],
        }
    }

    #[test]
    fn truth_that_lags_behind_the_estimates_is_met_all_the_same() {
        let mut live_score = LiveScore::default();
        live_score.origin([36.0, 127.0, 0.0]);
        for step in 0..=200 {
            let t = f64::from(step) * 0.01;
            live_score.estimate(&estimate(t, Mode::Ok));
            // 0.4 s late.
            if step >= 40 && step % 10 == 0 {
                live_score.truth(&truth(t - 0.4));
            }
        }
        let score = live_score.finish().unwrap();
        assert_eq!((score["samples"].as_u64(), score["missed"].as_u64()), (Some(17), Some(0)));
        let rms_up = score["rms_enu"][2].as_f64().unwrap();
        assert!((rms_up - 1.0).abs() < 1e-6, "{score}");
    }

    #[test]
    fn a_run_without_truth_has_no_score() {
        let mut live_score = LiveScore::default();
        live_score.origin([36.0, 127.0, 0.0]);
        live_score.estimate(&estimate(1.0, Mode::Ok));
        assert_eq!(live_score.finish(), None);
        assert_eq!(LiveScore::default().finish(), None);
    }
}
