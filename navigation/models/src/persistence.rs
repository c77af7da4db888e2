//! Is a sensor off on average?
//!
//! A reading that passes its gate may be the tail of an error that goes on: a clogged port comes back slowly, waves pass through the
//! truth, a Doppler log that is wrong by a tenth of a metre per second agrees with a state that has become unsure. A sensor that others
//! contradict returns when the mean m of its latest whitened innovations is no more than noise and state explain:
//!
//! ```text
//! m ← m + α (clip(ν) − m)    √(1 + s) |m| ≤ a + b √s
//! ```
//!
//! s is the state's share of the innovation covariance, the left side the mean in sigmas of the sensor.

use shared_types::Sensor;

use crate::innovation::Innovation;

/// α, the clip in sigmas, a and b.
#[derive(Clone, Copy, Debug)]
struct Rule {
    latest: f64,
    clip: f64,
    sensor: f64,
    state: f64,
}

const PRESSURE: Rule = Rule { latest: 0.1, clip: f64::INFINITY, sensor: 0.5, state: 2.0 };
/// Quicker: what is right again is wanted, and neither a false lock nor a wreck that is passed by leaves a tail.
const VELOCITY_OR_HEADING: Rule = Rule { latest: 0.2, clip: 10.0, sensor: 1.5, state: 3.0 };

/// Mean of the latest whitened innovations of one sensor.
#[derive(Clone, Copy, Debug, Default)]
pub struct Persistence {
    mean: [f64; 3],
}

impl Persistence {
    /// Takes in an innovation; whether the sensor is off on average. Never for a sensor that has no such rule.
    pub fn observe(&mut self, sensor: Sensor, innovation: &Innovation) -> bool {
        let rule = match sensor {
            Sensor::Ps => PRESSURE,
            Sensor::Dvl | Sensor::Mcp => VELOCITY_OR_HEADING,
            _ => return false,
        };
        if innovation.whitened.iter().all(|whitened| whitened.is_finite()) {
            for (mean, whitened) in self.mean.iter_mut().zip(innovation.whitened) {
                *mean += rule.latest * (whitened.clamp(-rule.clip, rule.clip) - *mean);
            }
        }
        let share = innovation.state_share.max(0.0);
        let norm = self.mean.iter().map(|mean| mean * mean).sum::<f64>().sqrt();
        norm * (1.0 + share).sqrt() > rule.sensor + rule.state * share.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After how many readings like these one is off on average, and after how many that are right none is any more.
    fn off_and_back(sensor: Sensor, whitened: [f64; 3], state_share: f64) -> (Option<usize>, Option<usize>) {
        let mut persistence = Persistence::default();
        let mut is_off = |whitened: [f64; 3]| {
            let nis = whitened.iter().map(|x| x * x).sum();
            persistence.observe(sensor, &Innovation { whitened, nis, state_share, slopes: Default::default() })
        };
        let offs = [(); 100].map(|()| is_off(whitened));
        let off = offs.iter().position(|&off| off);
        (off, (0..100).position(|_| !is_off([0.0; 3])))
    }

    #[test]
    fn what_goes_on_is_off_and_what_is_right_again_returns() {
        assert_eq!(off_and_back(Sensor::Ps, [1.0, 0.0, 0.0], 0.0), (Some(6), Some(6)));
        assert_eq!(off_and_back(Sensor::Dvl, [2.0, -1.0, 1.0], 0.0), (Some(4), Some(2)));
        assert_eq!(
            off_and_back(Sensor::Dvl, [80.0, 0.0, 0.0], 0.1),
            (Some(1), Some(6)),
            "no wild reading counts for more than ten"
        );
    }

    #[test]
    fn an_unsure_state_explains_much_and_a_number_that_is_none_nothing() {
        assert_eq!(off_and_back(Sensor::Dvl, [2.0, -1.0, 1.0], 4.0).0, None);
        assert_eq!(off_and_back(Sensor::Lbl, [9.0, 0.0, 0.0], 0.0).0, None, "ranges have no such rule");
        assert_eq!(off_and_back(Sensor::Ps, [f64::NAN, 0.0, 0.0], 0.0).0, None);
    }
}
