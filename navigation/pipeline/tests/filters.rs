//! The filters through the whole navigator: exact without noise, honest with it, late readings as if they had not been late.

mod runs;

use nav_pipeline::{ChosenEstimator, Effort, Estimator, Navigator, Output, Rebase, Unmeasured};
use nav_preprocessing::Preprocessor;
use runs::Run;
use shared_types::{
    Config, ConfigText, Duration, Measurement, RawReading, RejectReason, Sensor, Solution, SolutionStatus, Time,
};
use sim_world::{Preset, Scenario, World};

const MISSION: Run<'static> = Run { scenario: "mission", preset: Preset::Realistic, seed: 2, sets: &[], until: 150.0 };
const FILTERS: [&[&str]; 3] = [&["estimator=ekf"], &["estimator=fkf"], &["estimator=fkf", "kalman.reset=false"]];
/// Nothing is weighed or refused: what is left is linear algebra.
const PLAIN: [&str; 8] = [
    "lbl.kernel=none",
    "gnss.kernel=none",
    "dvl.kernel=none",
    "mcp.kernel=none",
    "ps.kernel=none",
    "lbl.gate=false",
    "dvl.gate=false",
    "ps.gate=false",
];

#[test]
fn without_noise_the_error_vanishes() {
    for sets in &FILTERS[..2] {
        let ran = Run { preset: Preset::None, sets, until: 300.0, ..MISSION }.go();
        // The midpoint rule at 200 Hz, as for the smoother.
        assert!(ran.score.max_horizontal < 1e-3 && ran.score.max_enu[2] < 1e-3, "{sets:?}: {:?}", ran.score);
        let attitude = ran.score.attitude_max_deg.expect("the truth has attitude");
        assert!(attitude.iter().all(|a| *a < 1e-3), "{sets:?}: {attitude:?} deg");
    }
}

#[test]
fn over_seeds_the_covariance_means_what_it_says() {
    let subsets: [(&str, &[&str]); 3] = [
        ("all sensors", &["estimator=ekf"]),
        ("federated", &["estimator=fkf"]),
        ("differences, velocity, depth", &["estimator=ekf", "mcp.enabled=false", "lbl.common_offset_sigma=inf"]),
    ];
    for (name, sets) in subsets {
        let seeds = 1..=6_u64;
        let mut sums = [0.0; 3];
        for seed in seeds.clone() {
            let ran = Run { seed, sets, until: 320.0, ..MISSION }.go();
            let nees = ran.score.nees_enu.expect("sigmas are published");
            (0..3).for_each(|axis| sums[axis] += nees[axis]);
        }
        for (axis, sum) in sums.into_iter().enumerate() {
            // Some 20 independent samples an axis, of which the mean lies within 1 ± 0.95 (three sigmas).
            let nees = sum / seeds.clone().count() as f64;
            assert!((0.15..1.95).contains(&nees), "{name}, axis {axis}: NEES {nees}");
        }
    }
}

#[test]
fn a_federated_filter_with_reset_is_the_centralised_one() {
    let run = |estimator: &str| {
        let sets: Vec<&str> = PLAIN.into_iter().chain([estimator]).collect();
        Run { sets: &sets, ..MISSION }.go()
    };
    let (ekf, fkf) = (run("estimator=ekf"), run("estimator=fkf"));
    assert_eq!(ekf.solutions.len(), fkf.solutions.len());
    for (one, other) in ekf.solutions.iter().zip(&fkf.solutions) {
        for axis in 0..3 {
            // Inverted twice at every reading; sigmas are centimetres.
            let difference = one.position_enu[axis] - other.position_enu[axis];
            assert!(difference.abs() < 1e-6, "{difference:e} m at {}", one.t_keyframe);
            let ratio = one.covariance[axis][axis] / other.covariance[axis][axis];
            assert!((ratio - 1.0).abs() < 1e-5, "{ratio} at {}", one.t_keyframe);
        }
    }
}

#[test]
fn a_filter_says_what_the_smoother_says_while_nothing_needs_a_second_look() {
    let fgo = MISSION.go();
    let ekf = Run { sets: FILTERS[0], ..MISSION }.go();
    let ratio = ekf.score.rms_horizontal / fgo.score.rms_horizontal;
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
}

/// Runs with every reading late by `delay(reading)`, and returns the last solution and the counts of a sensor.
fn last_solution(sets: &[&str], until: f64, delay: impl Fn(&RawReading) -> f64) -> (Solution, Navigator) {
    let scenario = Scenario::builtin("mission").expect("a built-in scenario");
    let world = World::new(&scenario, Preset::Realistic, 2).expect("a valid world");
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    let facts = ConfigText::new("sensors.toml", world.sensors_toml());
    let config = Config::load(&[facts], &sets).expect("a valid configuration");
    let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
    let mut readings: Vec<RawReading> =
        world.readings().take_while(|reading| reading.t_valid() <= Time::from_seconds(until)).collect();
    readings.sort_by_key(|reading| reading.t_valid() + Duration::from_seconds(delay(reading)));
    let mut last = None;
    for reading in &readings {
        navigator.push(reading, &mut Unmeasured, &mut |output| {
            if let Output::Solution(solution, _) = output {
                last = Some(*solution);
            }
        });
    }
    (last.expect("it was solved"), navigator)
}

/// Velocities of the second minute come 5 s late.
fn late_dvl(reading: &RawReading) -> f64 {
    let is_late = reading.sensor() == Sensor::Dvl && (40.0..70.0).contains(&reading.t_valid().as_seconds());
    if is_late { 5.0 } else { 0.0 }
}

#[test]
fn late_velocities_end_where_punctual_ones_do() {
    for sets in FILTERS {
        let (punctual, before) = last_solution(sets, 90.0, |_| 0.0);
        let (late, after) = last_solution(sets, 90.0, late_dvl);
        assert_eq!(punctual.t_keyframe, late.t_keyframe);
        let numbers = |s: &Solution| {
            let state = [&s.position_enu[..], &s.velocity_enu, &s.q_enu_body, &s.accel_bias, &s.gyro_bias];
            state.into_iter().flatten().copied().chain(s.covariance.into_iter().flatten()).collect::<Vec<f64>>()
        };
        for (index, (one, other)) in numbers(&punctual).into_iter().zip(numbers(&late)).enumerate() {
            assert!((one - other).abs() < 1e-9, "{sets:?}, number {index}: {one} {other}");
        }
        assert_eq!(before.counts(), after.counts(), "{sets:?}");
    }
}

#[test]
fn readings_older_than_the_horizon_are_counted_and_left() {
    let sets = ["estimator=ekf", "kalman.horizon=3.0"];
    let (_, navigator) = last_solution(&sets, 90.0, late_dvl);
    let dvl = Sensor::Dvl.index();
    let old = navigator.counts()[dvl].rejected[RejectReason::OlderThanWindow.index()];
    assert!((145..=155).contains(&old), "{old} of 150 late velocities");
}

#[test]
fn every_subset_of_the_sensors_navigates() {
    let names = ["lbl", "gnss", "dvl", "mcp", "ps"];
    for filter in &FILTERS {
        for subset in 0..32_u32 {
            let off = (0..5).filter(|bit| subset & (1 << bit) == 0);
            let sets: Vec<String> = off.map(|bit| format!("{}.enabled=false", names[bit])).collect();
            let sets: Vec<&str> = sets.iter().map(String::as_str).chain(filter.iter().copied()).collect();
            let ran = Run { sets: &sets, until: 60.0, ..MISSION }.go();
            let last = ran.pairs.last().expect("it published");
            for axis in 0..3 {
                let (error, sigma) = (last.position_error_enu[axis].abs(), last.estimate.sigma_position_enu[axis]);
                assert!(error < 4.5 * sigma, "{filter:?} {subset:05b}, axis {axis}: {error} m, sigma {sigma} m");
            }
        }
    }
}

#[test]
fn an_inertial_glitch_that_no_noise_explains_is_recovered_from() {
    for filter in &FILTERS[..2] {
        let sets: Vec<&str> =
            ["dvl.enabled=false", "gnss.enabled=false", "mcp.enabled=false"].iter().chain(*filter).copied().collect();
        let ran = Run { sets: &sets, ..MISSION }.with(|reading| match reading {
            RawReading::Imu(mut sample) if (80.0..82.0).contains(&Time(sample.header.t_valid).as_seconds()) => {
                sample.accel_body[0] += 3.0;
                Some(RawReading::Imu(sample))
            }
            other => Some(other),
        });
        assert!(ran.solutions.iter().any(|s| s.status == SolutionStatus::Loosened as u32), "{filter:?}");
        for pair in ran.pairs.iter().filter(|pair| pair.estimate.t.as_seconds() > 120.0) {
            let error = pair.position_error_enu.xy().norm();
            assert!(error < 2.0, "{filter:?}: {error} m at {}", pair.estimate.t);
        }
    }
}

#[test]
fn a_second_without_inertial_data_is_bridged() {
    for filter in FILTERS {
        let ran = Run { sets: filter, ..MISSION }.with(|reading| {
            let is_gap =
                matches!(reading, RawReading::Imu(_)) && (90.0..91.0).contains(&reading.t_valid().as_seconds());
            (!is_gap).then_some(reading)
        });
        for pair in ran.pairs.iter().filter(|pair| pair.estimate.t.as_seconds() > 100.0) {
            let (error, sigma) = (pair.position_error_enu, pair.estimate.sigma_position_enu);
            assert!((0..2).all(|axis| error[axis].abs() < 4.5 * sigma[axis]), "{filter:?}: {pair:?}");
        }
    }
}

#[test]
fn the_same_readings_give_the_same_bits() {
    for filter in FILTERS {
        let run = || Run { sets: filter, preset: Preset::Paper, until: 60.0, ..MISSION }.go();
        assert_eq!(run().solutions, run().solutions, "{filter:?}");
    }
}

#[test]
fn a_filter_takes_up_from_the_last_solution_of_one_that_died() {
    let scenario = Scenario::builtin("mission").expect("a built-in scenario");
    let world = World::new(&scenario, Preset::Realistic, 2).expect("a valid world");
    let facts = ConfigText::new("sensors.toml", world.sensors_toml());
    for estimator in ["ekf", "fkf"] {
        let sets = [format!("estimator={estimator}")];
        let config = Config::load(std::slice::from_ref(&facts), &sets).expect("a valid configuration");
        let mut preprocessor = Preprocessor::new(&config);
        let mut measurements = Vec::new();
        for reading in world.readings().take_while(|reading| reading.t_valid() <= Time::from_seconds(60.0)) {
            preprocessor.push(&reading, &mut |measurement| measurements.push(measurement));
        }
        let run = |filter: &mut ChosenEstimator, from: f64, until: f64| -> Option<Solution> {
            let among = |m: &&Measurement| (from..until).contains(&m.t_valid().as_seconds());
            let solutions = measurements.iter().filter(among).filter_map(|m| filter.ingest(m, Effort::Full).ok()?);
            solutions.last()
        };
        let mut whole = ChosenEstimator::new(&config);
        whole.set_origin(&preprocessor.origin().expect("it is configured"));
        let kept = run(&mut whole, 0.0, 40.0).expect("it was solved");
        let unbroken = run(&mut whole, 40.0, 61.0).expect("it was solved");

        let mut second = ChosenEstimator::new(&config);
        assert!(!second.resume(&Solution { q_enu_body: [f64::NAN; 4], ..kept }), "no state");
        assert!(second.resume(&kept));
        // It hears nothing for 0.3 s, and meets readings that the kept solution holds already.
        let t_again = kept.t_keyframe as f64 * 1e-9 + 0.3;
        let late = measurements.iter().find(|m| m.sensor() == Some(Sensor::Ps) && m.t_valid().as_seconds() > 39.0);
        let ps = Sensor::Ps.index();
        let before = second.counts()[ps].rejected[RejectReason::BeforeStart.index()];
        second.ingest(late.expect("depths come"), Effort::Full).expect("a valid measurement");
        assert_eq!(second.counts()[ps].rejected[RejectReason::BeforeStart.index()], before + 1);
        let resumed = run(&mut second, t_again, 61.0).expect("it was solved");
        assert_eq!(resumed.t_keyframe, unbroken.t_keyframe);
        assert!(resumed.id > kept.id, "numbers go on");
        for axis in 0..3 {
            let difference = resumed.position_enu[axis] - unbroken.position_enu[axis];
            // The held sample that bridges 0.3 s of waves is off by more than its inflated noise: some velocities are refused.
            assert!(difference.abs() < 0.1, "{estimator}, axis {axis}: {difference} m");
        }
    }
}
