//! A wrong sound speed and a wrong scale of the DVL: found, taken out, covered until then; readings that are right are left alone.

mod runs;

use runs::{Ran, Run};
use shared_types::{CALIBRATIONS, Calibration, RawReading};
use sim_world::Preset;

const SEEDS: u64 = 3;

/// The mission until some minutes after the dive, where fixes no longer hold the position, with ranges and velocities scaled.
fn scaled(range: f64, velocity: f64, seed: u64, sets: &[&str]) -> Ran {
    let run = Run { scenario: "mission", preset: Preset::Realistic, seed, sets, until: 700.0 };
    run.with(|mut reading| {
        match &mut reading {
            RawReading::Lbl(ping) => ping.range *= range,
            RawReading::Dvl(dvl) => dvl.velocity_dvl = dvl.velocity_dvl.map(|component| component * velocity),
            _ => {}
        }
        Some(reading)
    })
}

/// Sum over seeds of the squared horizontal RMS, m², and the mean NEES of east and north.
fn over_seeds(range: f64, velocity: f64, sets: &[&str], mut look: impl FnMut(&Ran)) -> (f64, f64) {
    let (mut squares, mut nees) = (0.0, 0.0);
    for seed in 1..=SEEDS {
        let ran = scaled(range, velocity, seed, sets);
        squares += ran.score.rms_horizontal.powi(2);
        let of_run = ran.score.nees_enu.expect("sigmas are published");
        nees += (of_run[0] + of_run[1]) / (2.0 * SEEDS as f64);
        look(&ran);
    }
    (squares, nees)
}

fn found(ran: &Ran, calibration: Calibration) -> (f64, f64) {
    let (found, sigmas) = ran.navigator.calibrations();
    (found[calibration.index()], sigmas[calibration.index()])
}

#[test]
fn sensors_that_are_right_are_left_alone() {
    let (estimated, _) = over_seeds(1.0, 1.0, &["dvl.calibrate=true"], |ran| {
        for solution in &ran.solutions {
            assert_eq!(solution.calibration, [0.0; CALIBRATIONS.len()], "at {} ns", solution.t_keyframe);
        }
    });
    let (without, _) = over_seeds(1.0, 1.0, &["lbl.calibrate=false"], |_| {});
    assert!((0.96..1.04).contains(&(estimated / without)), "{estimated} against {without}, m² summed over seeds");
}

#[test]
fn a_wrong_sound_speed_is_found_and_the_error_with_it() {
    for scale in [1.003, 0.993] {
        let (with, nees) = over_seeds(scale, 1.0, &[], |ran| {
            let (found, sigma) = found(ran, Calibration::RangeScale);
            // Measured = (1 + κ) true.
            assert!((found - (scale - 1.0)).abs() < 4.0 * sigma.max(5e-5), "{scale}: {found} ± {sigma}");
        });
        let (without, _) = over_seeds(scale, 1.0, &["lbl.calibrate=false"], |_| {});
        assert!(with < 0.2 * without, "{scale}: {with} against {without}, m² summed over seeds");
        assert!(nees < 2.0, "{scale}: NEES {nees}");
    }
}

#[test]
fn a_wrong_scale_of_the_dvl_is_found_where_it_is_asked_for() {
    let (with, nees) = over_seeds(1.0, 1.01, &["dvl.calibrate=true"], |ran| {
        let (found, sigma) = found(ran, Calibration::DvlScale);
        assert!((found - 0.01).abs() < 4.0 * sigma.max(3e-4), "{found} ± {sigma}");
    });
    let (without, _) = over_seeds(1.0, 1.01, &[], |ran| {
        assert_eq!(found(ran, Calibration::DvlScale), (0.0, 0.0), "nobody asked");
    });
    assert!(with < 0.2 * without, "{with} against {without}, m² summed over seeds");
    assert!(nees < 3.0, "NEES {nees}");
}
