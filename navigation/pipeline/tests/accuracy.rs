//! The whole navigator on simulated missions: exact without noise, honest with it.

mod runs;

use runs::Run;
use sim_world::Preset;

const MISSION: Run<'static> = Run { scenario: "mission", preset: Preset::None, seed: 1, sets: &[], until: 300.0 };

#[test]
fn without_noise_the_error_vanishes() {
    let ran = MISSION.go();
    // The simulator's motion is exact; what is left is the midpoint rule at 200 Hz.
    assert!(ran.score.max_horizontal < 1e-3 && ran.score.max_enu[2] < 1e-3, "{:?}", ran.score);
    let attitude = ran.score.attitude_max_deg.expect("the truth has attitude");
    assert!(attitude.iter().all(|a| *a < 1e-3), "{attitude:?} deg");
}

#[test]
fn the_cost_of_a_window_is_about_half_of_what_was_measured() {
    for sets in [&[][..], &["dvl.enabled=false"], &["keyframes.anchor=joint"]] {
        let ran = Run { preset: Preset::Realistic, sets, until: 120.0, ..MISSION }.go();
        // Four ranges, ten headings and ten depths a second, three components of a fix and of each of five Doppler velocities.
        let rows = 21.0 * if sets.contains(&"dvl.enabled=false") { 27.0 } else { 42.0 };
        let full = ran.solutions.iter().filter(|solution| solution.keyframes == 21);
        let costs: Vec<f64> = full.map(|solution| solution.cost).collect();
        assert!(costs.len() > 60, "{} windows", costs.len());
        // Kernels take a little off.
        let is_plausible = |cost: &f64| (0.25..0.65).contains(&(cost / rows));
        let odd: Vec<&f64> = costs.iter().filter(|cost| !is_plausible(cost)).collect();
        assert!(odd.is_empty(), "{sets:?}, {rows} rows: {odd:?}");
    }
}

#[test]
fn time_offsets_that_are_not_modelled_show() {
    // Left alone, the detector takes what PF does to a stamp for a late clock, and mends a part of it.
    let mut sets = vec!["keyframes.anchor=pf".to_owned()];
    sets.extend(shared_types::AIDING.iter().map(|sensor| format!("{}.time_offset=off", sensor.name())));
    let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
    let pf = Run { sets: &sets, ..MISSION }.go();
    let fpf = Run { sets: &["keyframes.anchor=fpf"], ..MISSION }.go();
    assert!(pf.score.rms_horizontal > 0.05, "PF {}", pf.score.rms_horizontal);
    assert!(fpf.score.rms_horizontal < 1e-3, "FPF {}", fpf.score.rms_horizontal);
}

#[test]
fn over_seeds_the_covariance_means_what_it_says() {
    let subsets: [(&str, &[&str]); 3] = [
        ("all sensors", &[]),
        ("ranges and depth", &["dvl.enabled=false", "mcp.enabled=false", "gnss.enabled=false"]),
        ("differences, velocity, depth", &["mcp.enabled=false", "lbl.common_offset_sigma=inf"]),
    ];
    for (name, sets) in subsets {
        let seeds = 1..=6_u64;
        let mut sums = [0.0; 3];
        for seed in seeds.clone() {
            let ran = Run { preset: Preset::Realistic, seed, sets, until: 320.0, ..MISSION }.go();
            let nees = ran.score.nees_enu.expect("sigmas are published");
            let share = ran.score.three_sigma_share_enu.expect("sigmas are published");
            assert!(share.iter().all(|share| *share > 0.93), "{name}, seed {seed}: {share:?} within 3 sigma");
            (0..3).for_each(|axis| sums[axis] += nees[axis]);
        }
        let count = seeds.count() as f64;
        for (axis, sum) in sums.into_iter().enumerate() {
            // Errors are correlated over minutes: six runs of five minutes are some 20 independent samples an axis,
            // of which the mean lies within 1 ± 0.95 (three sigmas).
            let nees = sum / count;
            assert!((0.15..1.95).contains(&nees), "{name}, axis {axis}: NEES {nees}");
        }
    }
}

#[test]
fn the_newest_estimate_hardly_depends_on_the_window() {
    let run = |window: &str| {
        let sets = [window];
        Run { preset: Preset::Realistic, sets: &sets, until: 120.0, ..MISSION }.go()
    };
    let short = run("fgo.window=3");
    let long = run("fgo.window=60");
    for (near, far) in short.pairs.iter().zip(&long.pairs).skip(600) {
        // Relinearisation and reweighting of older keyframes is all that a longer window adds.
        let difference = (near.estimate.position_enu - far.estimate.position_enu).norm();
        assert!(difference < 0.01, "{difference} m at {}", near.estimate.t);
    }
}

#[test]
fn the_same_readings_give_the_same_bits() {
    let run = || Run { preset: Preset::Paper, until: 60.0, ..MISSION }.go();
    assert_eq!(run().solutions, run().solutions);
}

#[test]
fn an_outage_ends_within_its_sigmas_and_the_first_fixes_end_it() {
    // The mission's own readings; ranges, velocities and headings are taken away for a minute.
    let quiet = 150.0..210.0;
    let ran = Run { preset: Preset::Realistic, seed: 3, until: 260.0, ..MISSION }.with(|reading| {
        let silent = matches!(
            reading,
            shared_types::RawReading::Lbl(_)
                | shared_types::RawReading::Dvl(_)
                | shared_types::RawReading::Mcp(_)
                | shared_types::RawReading::Gnss(_)
        );
        (!(silent && quiet.contains(&reading.t_valid().as_seconds()))).then_some(reading)
    });
    for pair in &ran.pairs {
        let t = pair.estimate.t.as_seconds();
        let error = pair.position_error_enu.xy().norm();
        let sigma = pair.estimate.sigma_position_enu.xy().norm();
        assert!(error < 4.0 * sigma, "{error} m, sigma {sigma} m at {t} s");
        if t > 213.5 {
            assert!(error < 0.25, "{error} m at {t} s");
        }
    }
    let dead_reckoning = ran.modes[shared_types::Mode::DeadReckoning as usize] as f64 / 200.0;
    assert!((54.0..60.0).contains(&dead_reckoning), "{dead_reckoning} s of dead reckoning");
}
