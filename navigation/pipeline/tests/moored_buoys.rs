//! Moored buoys that do not lie where the survey has them: what they are off by does not average out.

mod runs;

use runs::{Run, misplaced};
use shared_types::{NavEstimate, RawReading, Time};
use sim_world::Preset;

const SIGMA: &str = "lbl.buoy_sigma=0.5";

/// Mean over seeds of the NEES by axis, and the smallest share within 3 sigma of all samples of one run, with every reading passed through
/// `tamper` once its buoy is misplaced.
fn over_seeds(sets: &[&str], tamper: impl Fn(RawReading) -> RawReading) -> ([f64; 3], f64) {
    const SEEDS: u64 = 12;
    let (mut nees, mut least) = ([0.0; 3], 1.0_f64);
    for seed in 1..=SEEDS {
        let run = Run { scenario: "stable", preset: Preset::Realistic, seed, sets, until: 200.0 };
        let mut misplaced = misplaced(seed, 0.5);
        let score = run.with(|reading| misplaced(reading).map(&tamper)).score;
        for (mean, of_run) in nees.iter_mut().zip(score.nees_enu.expect("sigmas are published")) {
            *mean += of_run / SEEDS as f64;
        }
        least = score.three_sigma_share_enu.expect("sigmas are published").into_iter().fold(least, f64::min);
    }
    (nees, least)
}

#[track_caller]
fn assert_honest(sets: &[&str], tamper: impl Fn(RawReading) -> RawReading) {
    let (nees, least) = over_seeds(sets, tamper);
    assert!(nees[..2].iter().all(|nees| (0.2..1.7).contains(nees)), "{sets:?}: NEES {nees:?}");
    assert!((0.5..1.4).contains(&nees[2]), "{sets:?}: NEES {nees:?}");
    assert!(least > 0.95, "{sets:?}: {least} within 3 sigma");
}

#[test]
fn what_the_survey_may_be_off_by_is_in_the_covariance() {
    // A covariance that takes the survey's error for noise has a NEES beyond 10 here.
    for also in [&[][..], &["dvl.enabled=false", "mcp.enabled=false"], &["lbl.common_offset_sigma=0.5"]] {
        assert_honest(&[&[SIGMA], also].concat(), |reading| reading);
    }
}

#[test]
fn ranges_between_keyframes_know_it_too_where_those_are_joined() {
    // A tenth of a second is 6 cm at the vehicle's speed, beside 0.5 m.
    let later = |mut reading| {
        if let RawReading::Lbl(range) = &mut reading
            && range.buoy > 1
        {
            range.header.t_valid += 100_000_000;
        }
        reading
    };
    assert_honest(&[SIGMA, "keyframes.anchor=joint"], later);
}

#[test]
fn what_leaves_the_window_is_not_surer_of_it() {
    let sets = [SIGMA, "fgo.window=20", "fgo.fixed_lag=true"];
    let run = Run { scenario: "stable", preset: Preset::Realistic, seed: 1, sets: &sets, until: 200.0 };
    let ran = run.with(misplaced(1, 0.5));
    let horizontal = |cov: &NavEstimate| (cov.position_cov[0] + cov.position_cov[3]).sqrt();
    for lagged in ran.lagged.iter().skip(100) {
        let of_buoys = horizontal(lagged);
        // Four buoys off by 0.5 m an axis; the noise of the ranges has gone from a position of a window ago.
        assert!((0.2..0.8).contains(&of_buoys), "{of_buoys} m at {}", Time(lagged.header.t_valid));
    }
    assert!(ran.lagged.len() > 150);
}
