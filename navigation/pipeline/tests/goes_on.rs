//! A whole set dies, and another goes on in its place from the last solution kept: honest from its first estimate on.
//!
//! Between the last keyframe and the first sample of the new set lies what nobody has seen. The new preprocessor closes a keyframe at
//! that first sample: an interval that is nothing but the gap.

use nav_evaluation::{EstimatePoint, Pair, Scorer, Window};
use nav_geometry::Geodetic;
use nav_models::propagator::Propagator;
use nav_pipeline::{ChosenEstimator, Effort, Estimator, EstimatorError, Navigator, Output, Rebase, Unmeasured};
use nav_preprocessing::Preprocessor;
use shared_types::{Config, ConfigText, Duration, Mode, RawReading, Solution, Time};
use sim_world::{Preset, Scenario, World};

/// What a set published, and how many of its keyframes had no solution.
struct Life {
    pairs: Vec<Pair>,
    unsolved: u32,
}

/// A mission, and the solutions of the set that sails it until it dies, with the sample at which each was there.
struct Mission {
    config: Config,
    origin: Geodetic,
    world: World,
    readings: Vec<RawReading>,
    solutions: Vec<(Time, Solution)>,
}

impl Mission {
    fn new(scenario: &str, seed: u64, from: f64, until: f64) -> Mission {
        let scenario = Scenario::builtin(scenario).expect("a built-in scenario");
        let world = World::new(&scenario, Preset::Realistic, seed).expect("a valid world");
        let facts = ConfigText::new("sensors.toml", world.sensors_toml());
        let config = Config::load(&[facts], &[]).expect("a valid configuration");
        let [lat_deg, lon_deg, height] = scenario.origin_deg;
        let until = Time::from_seconds(until);
        let readings: Vec<RawReading> = world.readings().take_while(|reading| reading.t_valid() <= until).collect();
        let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
        let mut solutions = Vec::new();
        for reading in &readings {
            navigator.push(reading, &mut Unmeasured, &mut |output| {
                if let Output::Solution(solution, _) = output
                    && solution.t_keyframe >= Time::from_seconds(from).0
                {
                    solutions.push((reading.t_valid(), *solution));
                }
            });
        }
        Mission { config, origin: Geodetic::from_degrees(lat_deg, lon_deg, height), world, readings, solutions }
    }

    /// What a set publishes that begins at `begun` from the last solution before `death`, in its first `seconds`.
    fn goes_on(&self, death: Time, begun: Time, seconds: f64) -> Life {
        let (_, kept) = self.solutions.iter().rfind(|(there, _)| *there <= death).expect("there is one");
        let end = begun + Duration::from_seconds(seconds);
        let mut preprocessor = Preprocessor::new(&self.config);
        let mut estimator = ChosenEstimator::new(&self.config);
        let mut propagator = Propagator::new(&self.config);
        assert!(estimator.resume(kept));
        let mut scorer = Scorer::new(self.origin, Window::default());
        let mut truth = self.world.truth_rows(10.0).peekable();
        let (mut pairs, mut unsolved) = (Vec::new(), 0);
        // A moored buoy is heard of again.
        let first = self.readings.partition_point(|reading| reading.t_valid() < begun);
        let (before, since) = self.readings.split_at(first);
        let buoys = before.iter().filter(|reading| matches!(reading, RawReading::Buoy(_)));
        for reading in buoys.chain(since.iter().take_while(|reading| reading.t_valid() <= end)) {
            let mut newest = None;
            preprocessor.push(reading, &mut |measurement| match estimator.ingest(&measurement, Effort::Full) {
                Ok(solution) => newest = solution.or(newest),
                Err(EstimatorError::Unsolvable { .. }) => unsolved += 1,
                Err(_) => {}
            });
            if let RawReading::Imu(sample) = reading {
                while let Some(row) = truth.next_if(|row| row.header.t_valid <= sample.header.t_valid) {
                    scorer.truth(&row);
                }
                if let Ok(Some(estimate)) = propagator.advance(sample)
                    && !matches!(estimate.mode(), Mode::Initialising | Mode::Invalid)
                {
                    scorer.estimate_with(&EstimatePoint::from(&estimate), |pair| pairs.push(*pair));
                }
            }
            if let Some(solution) = newest {
                propagator.rebase(&solution).expect("it is sound");
            }
        }
        Life { pairs, unsolved }
    }
}

/// Over deaths at all phases of the swaying and of the keyframes.
fn check(scenario: &str) {
    let mission = Mission::new(scenario, 1, 40.0, 125.0);
    for dead in [0.05, 0.4, 1.0, 2.0] {
        let (mut worst, mut sums, mut count, mut unsolved) = ([0.0_f64; 3], [[0.0; 3]; 3], 0.0, 0);
        for death in 0..36 {
            let death = 60.0 + 1.53 * f64::from(death);
            let born = death + dead;
            let life = mission.goes_on(Time::from_seconds(death), Time::from_seconds(born), 6.0);
            let first = life.pairs.first().map_or(f64::INFINITY, |pair| pair.estimate.t.as_seconds());
            assert!(first < born + 0.4, "{scenario}, born at {born} s: the first estimate is that at {first} s");
            unsolved += life.unsolved;
            for pair in &life.pairs {
                let estimate = &pair.estimate;
                for (kind, (error, sigma)) in [
                    (pair.position_error_enu, estimate.sigma_position_enu),
                    (pair.velocity_error_enu, estimate.sigma_velocity_enu),
                    (pair.attitude_error, estimate.sigma_rpy),
                ]
                .into_iter()
                .enumerate()
                {
                    for axis in 0..3 {
                        let deviation: f64 = error[axis] / sigma[axis];
                        worst[kind] = worst[kind].max(deviation.abs());
                        sums[kind][axis] += deviation * deviation;
                    }
                }
                count += 1.0;
            }
        }
        let nees = sums.map(|sums| sums.map(|sum| sum / count));
        let told = format!(
            "{scenario}, dead for {dead} s: worst position, velocity, attitude {worst:.1?} sigmas, NEES {nees:.2?}, {unsolved} \
             keyframes without a solution"
        );
        assert!(worst.iter().all(|worst| *worst < 5.0), "{told}");
        // Errors of one mission hang together: as much above one is found without any death.
        assert!(nees.iter().flatten().all(|nees| *nees < 1.6), "{told}");
        assert_eq!(unsolved, 0, "{told}");
    }
}

#[test]
fn a_set_that_goes_on_straight_after_a_death_is_honest() {
    check("stable");
}

#[test]
fn a_set_that_goes_on_in_a_turn_after_a_death_is_honest() {
    check("mission");
}
