//! A simulated mission through the navigator, scored.

#![expect(dead_code, reason = "each test file uses its own part")]

use nav_evaluation::{EstimatePoint, Pair, Score, Scorer, Window};
use nav_geometry::Geodetic;
use nav_pipeline::{Navigator, Output, Rebase, Unmeasured};
use shared_types::{Config, ConfigText, Duration, Mode, NavEstimate, RawReading, Solution, Time};
use sim_world::{Preset, Scenario, World};

/// What to run.
pub struct Run<'a> {
    pub scenario: &'a str,
    pub preset: Preset,
    pub seed: u64,
    pub sets: &'a [&'a str],
    /// Data time to stop at, s.
    pub until: f64,
}

/// What came of it.
pub struct Ran {
    pub score: Score,
    pub pairs: Vec<Pair>,
    pub solutions: Vec<Solution>,
    pub lagged: Vec<NavEstimate>,
    pub modes: [u64; 5],
    pub navigator: Navigator,
}

impl Run<'_> {
    pub fn go(&self) -> Ran {
        self.with(Some)
    }

    /// Runs with every reading passed through `tamper`; `None` drops it.
    pub fn with(&self, mut tamper: impl FnMut(RawReading) -> Option<RawReading>) -> Ran {
        self.delivered(|reading, deliver| {
            if let Some(reading) = tamper(reading) {
                deliver(reading);
            }
        })
    }

    /// Runs with what `courier` delivers when it is handed each reading in order of time.
    pub fn delivered(&self, mut courier: impl FnMut(RawReading, &mut dyn FnMut(RawReading))) -> Ran {
        let scenario = Scenario::builtin(self.scenario).expect("a built-in scenario");
        let world = World::new(&scenario, self.preset, self.seed).expect("a valid world");
        let sets: Vec<String> = self.sets.iter().map(|set| (*set).to_owned()).collect();
        let facts = ConfigText::new("sensors.toml", world.sensors_toml());
        let config = Config::load(&[facts], &sets).expect("a valid configuration");
        let [lat_deg, lon_deg, height] = scenario.origin_deg;
        let mut scorer = Scorer::new(Geodetic::from_degrees(lat_deg, lon_deg, height), Window::default());
        let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
        let mut truth = world.truth_rows(10.0).peekable();
        let (mut pairs, mut solutions, mut lagged, mut modes) = (Vec::new(), Vec::new(), Vec::new(), [0; 5]);
        let t_end = Time::from_seconds(self.until);
        for reading in world.readings().take_while(|reading| reading.t_valid() <= t_end) {
            if let RawReading::Imu(sample) = &reading {
                while let Some(row) = truth.next_if(|row| row.header.t_valid <= sample.header.t_valid) {
                    scorer.truth(&row);
                }
            }
            courier(reading, &mut |reading| {
                navigator.push(&reading, &mut Unmeasured, &mut |output| match output {
                    Output::Estimate(estimate) => {
                        assert_finite(estimate);
                        modes[estimate.mode() as usize] += 1;
                        if estimate.mode() != Mode::Initialising {
                            scorer.estimate_with(&EstimatePoint::from(estimate), |pair| pairs.push(*pair));
                        }
                    }
                    Output::Solution(solution, _) => solutions.push(*solution),
                    Output::Lagged(estimate) => lagged.push(*estimate),
                    Output::Origin(_) => {}
                });
            });
        }
        Ran { score: scorer.score().expect("estimates met the truth"), pairs, solutions, lagged, modes, navigator }
    }
}

/// Puts every moored buoy where no survey has it, by `sigma` m an axis, drawn for each buoy and `seed`.
pub fn misplaced(seed: u64, sigma: f64) -> impl FnMut(RawReading) -> Option<RawReading> {
    const METRES_PER_DEG: f64 = 111_200.0;
    move |mut reading| {
        if let RawReading::Buoy(fix) = &mut reading {
            let mut draw = Lcg::new(seed * 1000 + u64::from(fix.buoy));
            fix.lat_deg += sigma * draw.normal() / METRES_PER_DEG;
            fix.lon_deg += sigma * draw.normal() / (METRES_PER_DEG * fix.lat_deg.to_radians().cos());
            fix.height += sigma * draw.normal();
        }
        Some(reading)
    }
}

/// Numbers between 0 and 1.
pub fn uniform(seed: u64) -> impl FnMut() -> f64 {
    let mut draw = Lcg::new(seed);
    move || draw.uniform()
}

struct Lcg(u64);

impl Lcg {
    fn new(seed: u64) -> Lcg {
        let mut lcg = Lcg(seed);
        (0..8).for_each(|_| _ = lcg.uniform());
        lcg
    }

    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Of twelve uniform numbers.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// No number of an estimate may be NaN or infinite, but for the age of a sensor that never spoke.
pub fn assert_finite(estimate: &NavEstimate) {
    let numbers = [
        &estimate.position_enu[..],
        &estimate.velocity_enu,
        &estimate.q_enu_body,
        &estimate.accel_bias,
        &estimate.gyro_bias,
        &estimate.position_cov,
        &estimate.velocity_cov,
        &estimate.attitude_cov,
        &estimate.sigma_rpy,
        &estimate.lat_lon_h,
    ];
    for number in numbers.into_iter().flatten() {
        assert!(number.is_finite(), "{estimate:?}");
    }
}
