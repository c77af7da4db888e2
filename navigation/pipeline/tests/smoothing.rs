//! The whole log as one batch: exact without noise, honest with it, never worse than what was known at the time.

mod runs;

use nav_evaluation::{EstimatePoint, Score, Scorer, Window};
use nav_geometry::Geodetic;
use nav_pipeline::{Navigator, Smoothed, Unmeasured};
use runs::{Run, assert_finite, misplaced};
use shared_types::{Config, ConfigText, RawReading, Time};
use sim_world::{Preset, Scenario, World};

const MISSION: Run<'static> = Run { scenario: "mission", preset: Preset::None, seed: 1, sets: &[], until: 300.0 };

struct Batch {
    score: Score,
    smoothed: Smoothed,
    estimates: usize,
}

/// As [`Run::with`], smoothed.
fn smooth(run: &Run<'_>, mut tamper: impl FnMut(RawReading) -> Option<RawReading>) -> Batch {
    let scenario = Scenario::builtin(run.scenario).expect("a built-in scenario");
    let world = World::new(&scenario, run.preset, run.seed).expect("a valid world");
    let sets: Vec<String> = run.sets.iter().map(|set| (*set).to_owned()).collect();
    let facts = ConfigText::new("sensors.toml", world.sensors_toml());
    let config = Config::load(&[facts], &sets).expect("a valid configuration");
    let mut navigator = Navigator::keeping_all(&config);
    let t_end = Time::from_seconds(run.until);
    for reading in world.readings().take_while(|reading| reading.t_valid() <= t_end).filter_map(&mut tamper) {
        navigator.push(&reading, &mut Unmeasured, &mut |_| {});
    }
    navigator.finish(&mut Unmeasured, &mut |_| {});
    let smoothed = navigator.smooth(50).expect("the mission determines its states");
    let [lat_deg, lon_deg, height] = scenario.origin_deg;
    let mut scorer = Scorer::new(Geodetic::from_degrees(lat_deg, lon_deg, height), Window::default());
    let mut truth = world.truth_rows(10.0).peekable();
    let mut estimates = 0;
    navigator.along(&smoothed, |estimate| {
        while let Some(row) = truth.next_if(|row| row.header.t_valid <= estimate.header.t_valid) {
            scorer.truth(&row);
        }
        assert_finite(estimate);
        scorer.estimate(&EstimatePoint::from(estimate));
        estimates += 1;
    });
    Batch { score: scorer.score().expect("estimates met the truth"), smoothed, estimates }
}

#[test]
fn without_noise_the_trajectory_is_the_truth() {
    let batch = smooth(&MISSION, Some);
    assert!(batch.smoothed.report.converged, "{:?}", batch.smoothed.report);
    assert!(batch.score.max_horizontal < 1e-3 && batch.score.max_enu[2] < 1e-3, "{:?}", batch.score);
    // One at every IMU sample from the first keyframe on.
    let first = batch.smoothed.keyframes[0].t.as_seconds();
    let expected = (300.0 - first) * 200.0;
    assert!((batch.estimates as f64 - expected).abs() <= 2.0, "{} of {expected}", batch.estimates);
}

#[test]
fn with_noise_it_is_honest_and_better_than_what_was_known_at_the_time() {
    let sets = ["dvl.enabled=false", "mcp.enabled=false", "gnss.enabled=false"];
    let (mut nees, mut smoothed_error, mut causal_error) = ([0.0; 3], 0.0, 0.0);
    const SEEDS: u64 = 4;
    for seed in 1..=SEEDS {
        let run = Run { preset: Preset::Realistic, seed, sets: &sets, ..MISSION };
        let batch = smooth(&run, Some);
        assert!(batch.smoothed.report.converged, "seed {seed}: {:?}", batch.smoothed.report);
        let of_run = batch.score.nees_enu.expect("sigmas are published");
        (0..3).for_each(|axis| nees[axis] += of_run[axis] / SEEDS as f64);
        smoothed_error += batch.score.rms_horizontal.powi(2);
        causal_error += run.go().score.rms_horizontal.powi(2);
    }
    // A smoothed error is correlated over some ten seconds: four runs are about a hundred samples, three sigmas 0.45.
    for (axis, nees) in nees.into_iter().enumerate() {
        assert!((0.55..1.45).contains(&nees), "axis {axis}: NEES {nees}");
    }
    assert!(smoothed_error < 0.6 * causal_error, "{smoothed_error} against {causal_error}, m² summed over seeds");
}

#[test]
fn a_gap_is_bridged_from_both_sides() {
    let (from, to) = (Time::from_seconds(150.0), Time::from_seconds(210.0));
    let is_quiet = |reading: &RawReading| {
        !matches!(reading, RawReading::Imu(_) | RawReading::Buoy(_) | RawReading::Ps(_))
            && (from..to).contains(&reading.t_valid())
    };
    let run = Run { preset: Preset::Realistic, seed: 5, ..MISSION };
    let tamper = |reading: RawReading| (!is_quiet(&reading)).then_some(reading);
    let (batch, causal) = (smooth(&run, tamper), run.with(tamper));
    assert!(batch.score.max_horizontal < 0.5 * causal.score.max_horizontal, "{:?} {:?}", batch.score, causal.score);
    let share = batch.score.three_sigma_share_enu.expect("sigmas are published");
    assert!(share.iter().all(|share| *share > 0.95), "{share:?} within 3 sigma");
}

#[test]
fn before_and_after_a_gap_of_the_imu_there_is_a_piece_each() {
    let (from, to) = (Time::from_seconds(150.0), Time::from_seconds(160.0));
    let is_lost =
        |reading: &RawReading| matches!(reading, RawReading::Imu(_)) && (from..to).contains(&reading.t_valid());
    let run = Run { preset: Preset::Realistic, seed: 6, ..MISSION };
    let batch = smooth(&run, |reading| (!is_lost(&reading)).then_some(reading));
    let Smoothed { keyframes, ends, report, .. } = &batch.smoothed;
    assert!(report.converged, "{report:?}");
    assert_eq!(ends.len(), 2, "{ends:?}");
    assert_eq!(ends[1], keyframes.len());
    assert!(keyframes[ends[0] - 1].t < from && keyframes[ends[0]].t >= to);
    // At every sample of both pieces.
    let expected = (300.0 - keyframes[0].t.as_seconds() - 10.0) * 200.0;
    assert!((batch.estimates as f64 - expected).abs() <= 4.0, "{} of {expected}", batch.estimates);
    assert!(batch.score.max_horizontal < 1.0, "{:?}", batch.score);
    let share = batch.score.three_sigma_share_enu.expect("sigmas are published");
    assert!(share.iter().all(|share| *share > 0.97), "{share:?} within 3 sigma");
}

#[test]
fn a_wrong_start_is_forgotten() {
    // Some 25 m off, with sigmas that admit it, and no compass.
    let sets = ["initial.position=[20, -15, -50]", "initial.sigma_position=30", "mcp.enabled=false"];
    let batch = smooth(&Run { preset: Preset::Realistic, seed: 2, sets: &sets, ..MISSION }, Some);
    assert!(batch.smoothed.report.converged, "{:?}", batch.smoothed.report);
    assert!(batch.smoothed.report.cost[1] <= batch.smoothed.report.cost[0], "{:?}", batch.smoothed.report);
    assert!(batch.score.rms_horizontal < 0.1, "{:?}", batch.score);
}

#[test]
fn what_moored_buoys_are_off_by_is_in_every_covariance() {
    const SEEDS: u64 = 8;
    let (mut nees, mut least) = (0.0, 1.0_f64);
    for seed in 1..=SEEDS {
        let run = Run { preset: Preset::Realistic, seed, sets: &["lbl.buoy_sigma=0.5"], ..MISSION };
        let score = smooth(&run, misplaced(seed, 0.5)).score;
        let of_run = score.nees_enu.expect("sigmas are published");
        nees += (of_run[0] + of_run[1]) / (2 * SEEDS) as f64;
        least = score.three_sigma_share_enu.expect("sigmas are published").into_iter().fold(least, f64::min);
    }
    // As noise it would be 20 and more.
    assert!((0.2..1.7).contains(&nees) && least > 0.95, "NEES {nees}, {least} within 3 sigma");
}

#[test]
fn what_leaves_the_window_knows_what_came_since() {
    let sets = ["dvl.enabled=false", "mcp.enabled=false", "gnss.enabled=false", "fgo.window=30", "fgo.fixed_lag=true"];
    let run = Run { preset: Preset::Realistic, sets: &sets, until: 200.0, ..MISSION };
    let (ran, batch) = (run.go(), smooth(&run, Some));
    assert_eq!(ran.lagged.len() + 30, ran.solutions.len(), "each keyframe once, but those still in the window");
    let (mut causal_off, mut lagged_off) = (0.0, 0.0);
    for lagged in &ran.lagged {
        assert_finite(lagged);
        let t = Time(lagged.header.t_valid);
        let solution = ran.solutions.iter().find(|solution| Time(solution.t_keyframe) == t).expect("its keyframe");
        let whole = batch.smoothed.keyframes.iter().find(|keyframe| keyframe.t == t).expect("its keyframe");
        for axis in 0..2 {
            let sigma = lagged.position_cov[[0, 3][axis]].sqrt();
            let of_batch = whole.covariance[(axis, axis)].sqrt();
            assert!(sigma > 0.98 * of_batch, "no more than is known of the whole log at {t}: {sigma} {of_batch}");
            let known = whole.state.position_enu[axis];
            causal_off += (solution.position_enu[axis] - known).powi(2);
            lagged_off += (lagged.position_enu[axis] - known).powi(2);
        }
    }
    // Half a minute later nearly all is known that will ever be.
    assert!(lagged_off < 0.04 * causal_off, "{lagged_off} {causal_off}");
}
