//! What a gap between two IMU samples hides (§5 of the method).
//!
//! A gap is bridged by one ordinary step, a straight line between its ends. Between them the vehicle goes on swaying, and the
//! line is off by what it does not show: of a sway of angular frequency ω and amplitude A over a time T
//!
//! ```text
//! σ(T) = A T · min(½, (ωT)²/12)        the chord under the arc; half the amplitude once the sway is over
//! ```
//!
//! in angle for a rate and in velocity for a force. As white noise over T that is σ/√T; the noise of the samples is inflated to it,
//! and at least as the method says. The method's factors alone are right for an instrument as noisy as the vehicle is lively, and
//! a hundred times too small for a good one: a second unseen cost tens of sigmas.
//!
//! Who begins anew at a state from before its first sample knows one end of the gap only and holds the sample back to it. What the
//! vehicle did since is then off by a slope and not by an arc:
//!
//! ```text
//! σ(T) = A T · min(1, ωT/2)            the whole amplitude once the sway is over
//! ```

use shared_types::{Duration, ImuGateConfig, ImuNoise};

/// White noise densities are multiplied by this at least over a gap …
const GAP_INFLATION: f64 = 10.0;
/// … and by this over a long one.
const LONG_GAP_INFLATION: f64 = 100.0;
/// What an unseen vehicle may do meanwhile, 1-sigma, m/s² and rad/s …
pub(crate) const UNSEEN_ACCELERATION: f64 = 0.5;
pub(crate) const UNSEEN_RATE: f64 = 0.1;
/// … and how fast it changes its mind, rad/s: a sway of three seconds.
const SWAY: f64 = 2.0;

/// Longer than this nothing bridges: the attitude itself is not known any more, and with it where gravity pulls.
pub const BLIND: Duration = Duration(5_000_000_000);

/// Factors on the white noise densities of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inflation {
    /// Of the specific force.
    pub force: f64,
    /// Of the angular rate.
    pub rate: f64,
}

impl Inflation {
    /// Noise as it is.
    pub const NONE: Inflation = Inflation { force: 1.0, rate: 1.0 };

    /// For a step of this length between two samples.
    pub fn over(step: Duration, gate: &ImuGateConfig, noise: &ImuNoise) -> Inflation {
        Inflation::hiding(step, gate, noise, |turn| (turn * turn / 12.0).min(0.5))
    }

    /// For a step of this length with a sample at one of its ends, which is held to the other.
    pub fn held(step: Duration, gate: &ImuGateConfig, noise: &ImuNoise) -> Inflation {
        Inflation::hiding(step, gate, noise, |turn| (turn / 2.0).min(1.0))
    }

    /// `share`: of the amplitude, by how far (rad) the sway turns meanwhile.
    fn hiding(step: Duration, gate: &ImuGateConfig, noise: &ImuNoise, share: impl Fn(f64) -> f64) -> Inflation {
        let step = step.abs();
        if step <= gate.gap {
            return Inflation::NONE;
        }
        let least = if step > gate.long_gap { LONG_GAP_INFLATION } else { GAP_INFLATION };
        let seconds = step.as_seconds();
        let hidden = seconds.sqrt() * share(SWAY * seconds);
        Inflation {
            force: least.max(UNSEEN_ACCELERATION * hidden / noise.accel_noise_density),
            rate: least.max(UNSEEN_RATE * hidden / noise.gyro_noise_density),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Config;

    fn over(seconds: f64, gyro_noise_density: f64) -> Inflation {
        let config = Config::default();
        let noise = ImuNoise { gyro_noise_density, ..config.vehicle.imu.clone() };
        Inflation::over(Duration::from_seconds(seconds), &config.navigator.imu, &noise)
    }

    #[test]
    fn samples_in_step_are_as_noisy_as_they_say() {
        assert_eq!(over(0.005, 1e-5), Inflation::NONE);
        assert_eq!(over(-0.02, 1e-5), Inflation::NONE);
    }

    #[test]
    fn a_good_gyroscope_is_believed_no_more_over_a_gap_than_a_poor_one() {
        for seconds in [0.6, 1.0, 3.0, 20.0] {
            // σ = q · inflation · √T.
            let sigma = |density: f64| density * over(seconds, density).rate * f64::sqrt(seconds);
            let hidden = 0.1 * seconds * (4.0 * seconds * seconds / 12.0).min(0.5);
            assert!((sigma(1e-6) / hidden - 1.0).abs() < 1e-12, "{seconds} s");
            assert!((sigma(1e-5) / hidden - 1.0).abs() < 1e-12, "{seconds} s");
        }
        assert_eq!(over(1.0, 1e-2).rate, LONG_GAP_INFLATION);
        assert_eq!(over(0.05, 1e-3).rate, GAP_INFLATION);
    }

    #[test]
    fn the_chord_under_a_sway_is_off_by_less() {
        let (sway, amplitude) = (SWAY, 0.1);
        for seconds in [0.1, 0.5, 1.0, 2.0, 4.0] {
            let mut worst = 0.0_f64;
            for phase in 0..64 {
                let phase = f64::from(phase) / 64.0 * core::f64::consts::TAU;
                let rate = |t: f64| amplitude * (sway * t + phase).sin();
                let chord = 0.5 * (rate(0.0) + rate(seconds)) * seconds;
                let arc = amplitude / sway * (phase.cos() - (sway * seconds + phase).cos());
                worst = worst.max((chord - arc).abs());
            }
            let hidden = amplitude * seconds * ((sway * seconds).powi(2) / 12.0).min(0.5);
            assert!(worst < 2.1 * hidden, "{seconds} s: {worst} {hidden}");
        }
    }

    #[test]
    fn a_sample_held_over_a_sway_is_off_by_less() {
        let (config, amplitude) = (Config::default(), 0.1);
        let noise = ImuNoise { gyro_noise_density: 1e-9, ..config.vehicle.imu.clone() };
        for seconds in [0.1, 0.3, 0.5, 1.0, 2.0, 4.0] {
            let mut worst = 0.0_f64;
            for phase in 0..64 {
                let phase = f64::from(phase) / 64.0 * core::f64::consts::TAU;
                let rate = |t: f64| amplitude * (SWAY * t + phase).sin();
                let arc = amplitude / SWAY * (phase.cos() - (SWAY * seconds + phase).cos());
                worst = worst.max((rate(seconds) * seconds - arc).abs());
            }
            let held = Inflation::held(Duration::from_seconds(seconds), &config.navigator.imu, &noise);
            let sigma = noise.gyro_noise_density * held.rate * seconds.sqrt();
            assert!(worst < 1.5 * sigma, "{seconds} s: {worst} {sigma}");
            assert!(sigma < 2.0 * worst, "{seconds} s: {worst} {sigma}");
        }
    }
}
