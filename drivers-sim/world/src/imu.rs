//! Inertial measurement unit: the true rate and specific force with biases that wander and white noise.
//!
//! ```text
//! ω̃ = ω_ib + b_g + n_g,   f̃ = f + b_a + n_a      n: density · √rate per sample;  b: turn-on value + random walk
//! ```

use std::sync::Arc;

use nalgebra::Vector3;
use shared_types::{Header, ImuSample, Time};

use crate::noise::Draws;
use crate::readings::Instrument;
use crate::world::Core;

#[derive(Clone, Debug)]
pub(crate) struct Imu {
    core: Arc<Core>,
    rate: f64,
    /// Drawn at the first sample.
    biases: Option<Biases>,
}

#[derive(Clone, Copy, Debug)]
struct Biases {
    gyro: Vector3<f64>,
    accel: Vector3<f64>,
}

impl Imu {
    pub(crate) fn new(core: Arc<Core>, rate: f64) -> Imu {
        Imu { core, rate, biases: None }
    }

    fn walk(&mut self, draws: &mut Draws) -> Biases {
        let noise = &self.core.noise;
        let biases = match self.biases {
            None => Biases { gyro: draws.normal3(noise.gyro_bias_sigma), accel: draws.normal3(noise.accel_bias_sigma) },
            Some(before) => {
                let root_dt = (1.0 / self.rate).sqrt();
                Biases {
                    gyro: before.gyro + draws.normal3(noise.gyro_bias_random_walk * root_dt),
                    accel: before.accel + draws.normal3(noise.accel_bias_random_walk * root_dt),
                }
            }
        };
        self.biases = Some(biases);
        biases
    }
}

impl Instrument for Imu {
    type Reading = ImuSample;

    fn read(&mut self, t: Time, draws: &mut Draws, readings: &mut Vec<ImuSample>) {
        let biases = self.walk(draws);
        let noise = &self.core.noise;
        let root_rate = self.rate.sqrt();
        let gyro_noise = draws.normal3(noise.gyro_noise_density * root_rate);
        let accel_noise = draws.normal3(noise.accel_noise_density * root_rate);
        let truth = self.core.earth.imu(&self.core.trajectory.at(t));
        readings.push(ImuSample {
            header: Header::at(t),
            gyro_body: (truth.gyro_body + biases.gyro + gyro_noise).into(),
            accel_body: (truth.accel_body + biases.accel + accel_noise).into(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Stream;
    use crate::{Preset, Scenario, World};
    use shared_types::Sensor;

    #[test]
    fn biases_wander_with_the_root_of_time() {
        let scenario = Scenario::builtin("stable").expect("it is built in");
        let core = World::new(&scenario, Preset::Paper, 1).expect("it is valid").core();
        let (mut gyro, mut accel) = (0.0, 0.0);
        const RUNS: u64 = 400;
        for seed in 0..RUNS {
            let mut imu = Imu::new(core.clone(), 10.0);
            let mut draws = Draws::new(seed, Preset::Paper, Stream::Of(Sensor::Imu));
            let first = imu.walk(&mut draws);
            let last = (0..1000).fold(first, |_, _| imu.walk(&mut draws));
            gyro += (last.gyro - first.gyro).norm_squared();
            accel += (last.accel - first.accel).norm_squared();
        }
        // 100 s, three axes; four sigmas of a deviation from 1200 values.
        let axes = 3.0 * RUNS as f64;
        let expected = 100.0_f64.sqrt();
        for (sum, density) in [(gyro, 1e-7), (accel, 1e-6)] {
            let ratio = (sum / axes).sqrt() / (density * expected);
            assert!((ratio - 1.0).abs() < 4.0 / (2.0 * axes).sqrt(), "{ratio}");
        }
    }
}
