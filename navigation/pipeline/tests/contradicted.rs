//! A Doppler log that is wrong for a while, without leaving its gate by much.

mod runs;

use runs::{Ran, Run};
use shared_types::{RawReading, Time};
use sim_world::Preset;

/// The mission under water, where its velocities between 600 and 660 s are passed through `tamper`.
fn mission(seed: u64, tamper: impl Fn([f64; 3]) -> Option<[f64; 3]>) -> Ran {
    let run = Run { scenario: "mission", preset: Preset::Realistic, seed, sets: &[], until: 760.0 };
    run.with(|mut reading| {
        let t = reading.t_valid();
        if let RawReading::Dvl(dvl) = &mut reading
            && (Time::from_seconds(600.0)..Time::from_seconds(660.0)).contains(&t)
        {
            dvl.velocity_dvl = tamper(dvl.velocity_dvl)?;
        }
        Some(reading)
    })
}

/// Sum over seeds of the squared horizontal RMS, m², and the mean NEES of east and north.
fn over_seeds(tamper: impl Fn([f64; 3]) -> Option<[f64; 3]>) -> (f64, f64) {
    const SEEDS: u64 = 4;
    (1..=SEEDS).fold((0.0, 0.0), |(squares, nees), seed| {
        let score = mission(seed, &tamper).score;
        let of_run = score.nees_enu.expect("sigmas are published");
        let mean = (of_run[0] + of_run[1]) / (2.0 * SEEDS as f64);
        (squares + score.rms_horizontal.powi(2), nees + mean)
    })
}

#[test]
fn a_biased_doppler_log_costs_what_its_absence_costs() {
    let (absent, _) = over_seeds(|_| None);
    for bias in [[0.1, 0.0, 0.0], [0.0, -0.12, 0.0], [0.08, 0.08, 0.0]] {
        let (biased, nees) = over_seeds(|v| Some([v[0] + bias[0], v[1] + bias[1], v[2] + bias[2]]));
        assert!(biased < 1.5 * absent, "{bias:?}: {biased} against {absent}, m² summed over seeds");
        assert!(nees < 1.6, "{bias:?}: NEES {nees}");
    }
}

#[test]
fn a_doppler_log_that_reads_three_per_cent_too_much_is_believed_less_once_ranges_see_the_vehicle_elsewhere() {
    // Where nobody asks the ranges it is 3.1 m² and a NEES of 34.
    let (scaled, nees) = over_seeds(|v| Some(v.map(|v| 1.03 * v)));
    assert!(scaled < 2.0, "{scaled} m² summed over seeds");
    assert!(nees < 20.0, "NEES {nees}");
}
