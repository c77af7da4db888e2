//! How good the sensors are, and the random numbers that make their errors.
//!
//! A preset says the sizes; the seed says the draws. Every sensor draws from its own generator, derived from seed and
//! sensor, and draws the same number of values at every instant of its schedule, whether or not a reading comes of it:
//! neither switching a sensor off nor an outage changes any other error.

use rand::RngExt;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use shared_types::Sensor;

/// Standard gravity, the unit of accelerometer data sheets, m/s².
const G: f64 = 9.806_65;
/// Degrees per hour in rad/s.
const DEG_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;

/// How good the sensors are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Table I of the paper, with its two swapped rows put right.
    Paper,
    /// The same with an accelerometer that exists: 1e-3 m/s²/√Hz (100 µg/√Hz) instead of the printed 0.1 µg/√Hz.
    Realistic,
    /// No error at all; `sensors.toml` states the sigmas of [`Preset::Paper`].
    None,
}

/// Sizes of the sensors' errors, SI; continuous-time densities for the IMU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// rad/s/√Hz.
    pub gyro_noise_density: f64,
    /// m/s²/√Hz.
    pub accel_noise_density: f64,
    /// rad/s²/√Hz.
    pub gyro_bias_random_walk: f64,
    /// m/s³/√Hz.
    pub accel_bias_random_walk: f64,
    /// Turn-on bias, rad/s.
    pub gyro_bias_sigma: f64,
    /// Turn-on bias, m/s².
    pub accel_bias_sigma: f64,
    /// m.
    pub lbl_sigma: f64,
    /// East, north, up, m.
    pub gnss_sigma_enu: [f64; 3],
    /// m/s per axis.
    pub dvl_sigma: f64,
    /// deg, as the compass reports.
    pub mcp_sigma_deg: f64,
    /// m.
    pub ps_sigma: f64,
}

impl Preset {
    /// Every preset and its name.
    pub const ALL: [(&'static str, Preset); 3] =
        [("paper", Preset::Paper), ("realistic", Preset::Realistic), ("none", Preset::None)];

    /// The preset of that name.
    pub fn from_name(name: &str) -> Option<Preset> {
        Preset::ALL.into_iter().find(|(known, _)| *known == name).map(|(_, preset)| preset)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Paper => "paper",
            Preset::Realistic => "realistic",
            Preset::None => "none",
        }
    }

    /// The sizes that it states.
    pub fn noise(self) -> SensorNoise {
        let paper = SensorNoise {
            gyro_noise_density: 0.1_f64.to_radians() / 60.0,
            accel_noise_density: 0.1e-6 * G,
            // Not in the table: in the mission's 37 minutes they move the biases by a twentieth of their turn-on sigma.
            gyro_bias_random_walk: 1e-7,
            accel_bias_random_walk: 1e-6,
            gyro_bias_sigma: 25.0 * DEG_PER_HOUR,
            accel_bias_sigma: 100e-6 * G,
            lbl_sigma: 0.3,
            gnss_sigma_enu: [0.02, 0.02, 0.01],
            dvl_sigma: 0.01,
            mcp_sigma_deg: 0.01,
            ps_sigma: 0.01,
        };
        match self {
            Preset::Paper | Preset::None => paper,
            Preset::Realistic => SensorNoise { accel_noise_density: 1e-3, ..paper },
        }
    }

    /// 1, or 0 where readings are to be exact.
    fn scale(self) -> f64 {
        if self == Preset::None { 0.0 } else { 1.0 }
    }
}

/// What a generator is for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Stream {
    /// Errors of a sensor.
    Of(Sensor),
    /// The error of the first state.
    Initial,
    /// The paths of drifting buoys.
    BuoyPaths,
}

/// A stream of random numbers; with [`Preset::None`] its normal numbers are zero.
#[derive(Clone, Debug)]
pub(crate) struct Draws {
    generator: Pcg64,
    scale: f64,
}

impl Draws {
    pub(crate) fn new(seed: u64, preset: Preset, stream: Stream) -> Draws {
        let number = match stream {
            Stream::Of(sensor) => sensor.index() as u64,
            Stream::Initial => 100,
            Stream::BuoyPaths => 101,
        };
        let mut mixer = seed ^ split_mix(&mut (number + 1));
        let mut wide = || (u128::from(split_mix(&mut mixer)) << 64) | u128::from(split_mix(&mut mixer));
        let (state, sequence) = (wide(), wide());
        Draws { generator: Pcg64::new(state, sequence), scale: preset.scale() }
    }

    /// Normal with that sigma.
    pub(crate) fn normal(&mut self, sigma: f64) -> f64 {
        let unit: f64 = self.generator.sample(StandardNormal);
        unit * sigma * self.scale
    }

    /// Three of them.
    pub(crate) fn normal3(&mut self, sigma: f64) -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::new(self.normal(sigma), self.normal(sigma), self.normal(sigma))
    }

    /// Uniform between 0 and 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.generator.random()
    }

    /// With `probability` a value between half and one and a half `size`, else 0; always two draws.
    pub(crate) fn outlier(&mut self, probability: f64, size: f64) -> f64 {
        let (chance, extent) = (self.uniform(), self.uniform());
        if chance < probability { self.scale * size * (0.5 + extent) } else { 0.0 }
    }

    /// One of two signs; always one draw.
    pub(crate) fn sign(&mut self) -> f64 {
        if self.uniform() < 0.5 { -1.0 } else { 1.0 }
    }
}

/// One step of SplitMix64 (Steele, Lea, Flood 2014): spreads neighbouring seeds over all 64 bits.
fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_s_units_come_out_as_in_the_method() {
        let paper = Preset::Paper.noise();
        assert!((paper.gyro_bias_sigma - 1.21203e-4).abs() < 1e-9, "{}", paper.gyro_bias_sigma);
        assert!((paper.gyro_noise_density - 2.90888e-5).abs() < 1e-10, "{}", paper.gyro_noise_density);
        assert!((paper.accel_bias_sigma - 9.80665e-4).abs() < 1e-12);
        assert!((paper.accel_noise_density - 9.80665e-7).abs() < 1e-15);
    }

    #[test]
    fn a_name_leads_to_its_preset_and_back() {
        for (name, preset) in Preset::ALL {
            assert_eq!((Preset::from_name(name), preset.name()), (Some(preset), name));
        }
        assert_eq!(Preset::from_name("papper"), None);
    }

    #[test]
    fn streams_of_one_seed_are_independent_and_repeat() {
        let draw = |seed, stream| {
            let mut draws = Draws::new(seed, Preset::Paper, stream);
            (0..4000).map(|_| draws.normal(1.0)).collect::<Vec<f64>>()
        };
        let imu = draw(7, Stream::Of(Sensor::Imu));
        assert_eq!(imu, draw(7, Stream::Of(Sensor::Imu)));
        for other in [draw(7, Stream::Of(Sensor::Dvl)), draw(7, Stream::Initial), draw(8, Stream::Of(Sensor::Imu))] {
            let correlation = imu.iter().zip(&other).map(|(a, b)| a * b).sum::<f64>() / imu.len() as f64;
            // Four sigmas of the correlation of 4000 independent pairs.
            assert!(correlation.abs() < 4.0 / 4000.0_f64.sqrt(), "{correlation}");
        }
    }
}
