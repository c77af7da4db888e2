//! Stamps that are late: found, taken out, covered until then; stamps that are right are left alone.

mod runs;

use runs::{Ran, Run};
use shared_types::{AIDING, Duration, RawReading, Sensor};
use sim_world::Preset;

const SEEDS: u64 = 3;

fn place(sensor: Sensor) -> usize {
    AIDING.iter().position(|&aiding| aiding == sensor).expect("an aiding sensor")
}

/// The first minutes of the mission with a sensor's stamps late by `offset` from `from` s on.
fn late(sensor: Sensor, offset: f64, from: f64, seed: u64, sets: &[&str]) -> Ran {
    let run = Run { scenario: "mission", preset: Preset::Realistic, seed, sets, until: 400.0 };
    run.with(|mut reading| {
        if reading.sensor() == sensor && reading.t_valid().as_seconds() >= from {
            let header = match &mut reading {
                RawReading::Lbl(range) => &mut range.header,
                RawReading::Gnss(fix) => &mut fix.header,
                RawReading::Dvl(velocity) => &mut velocity.header,
                RawReading::Mcp(heading) => &mut heading.header,
                RawReading::Ps(depth) => &mut depth.header,
                RawReading::Imu(_) | RawReading::Buoy(_) => return Some(reading),
            };
            header.t_valid += Duration::from_seconds(offset).0;
        }
        Some(reading)
    })
}

fn off(sensor: Sensor) -> String {
    format!("{}.time_offset=off", sensor.name())
}

#[test]
fn right_stamps_are_left_alone() {
    for seed in 1..=SEEDS {
        let run = |sets: &[&str]| Run { scenario: "mission", preset: Preset::Realistic, seed, sets, until: 400.0 }.go();
        let estimated = run(&[]);
        let offs = AIDING.map(off);
        let without = run(&offs.each_ref().map(String::as_str));
        for solution in &estimated.solutions {
            assert_eq!(solution.time_offset, [0.0; 5], "seed {seed} at {} ns", solution.t_keyframe);
        }
        let ratio = estimated.score.rms_horizontal / without.score.rms_horizontal;
        assert!((0.98..1.02).contains(&ratio), "seed {seed}: {ratio}");
    }
}

#[test]
fn late_headings_and_ranges_are_found_and_the_error_with_them() {
    // Where nobody looks for the offset of a compass, it is soon refused: ranges contradict it.
    for (sensor, offset, at_most) in [(Sensor::Mcp, 0.3, 1.05), (Sensor::Lbl, 0.4, 0.5)] {
        let (mut found_error, mut with, mut without) = (0.0_f64, 0.0, 0.0);
        let off = off(sensor);
        let mut nees = 0.0;
        for seed in 1..=SEEDS {
            let ran = late(sensor, offset, 0.0, seed, &[]);
            let (found, sigma) = ran.navigator.time_offsets();
            let (found, sigma) = (found[place(sensor)], sigma[place(sensor)]);
            assert!((found - offset).abs() < 4.0 * sigma.max(0.01), "{sensor}, seed {seed}: {found} ± {sigma} s");
            found_error = found_error.max((found - offset).abs());
            with += ran.score.rms_horizontal.powi(2);
            let of_run = ran.score.nees_enu.expect("sigmas are published");
            nees += (of_run[0] + of_run[1]) / (2.0 * SEEDS as f64);
            without += late(sensor, offset, 0.0, seed, &[&off]).score.rms_horizontal.powi(2);
        }
        assert!(found_error < 0.25 * offset, "{sensor}: off by {found_error} s");
        assert!(with < at_most * without, "{sensor}: {with} against {without}, m² summed over seeds");
        assert!(nees < 3.0, "{sensor}: NEES {nees}");
    }
}

#[test]
fn an_offset_that_appears_under_way_is_found() {
    let appears = 150.0;
    let ran = late(Sensor::Mcp, 0.3, appears, 1, &[]);
    let place = place(Sensor::Mcp);
    let at = |solution: &&shared_types::Solution| (solution.time_offset[place] - 0.3).abs() < 0.1;
    let found = ran.solutions.iter().find(at).expect("it is found").t_keyframe as f64 * 1e-9;
    assert!((appears..appears + 60.0).contains(&found), "found at {found} s");
}

#[test]
fn a_fixed_offset_is_taken_out_without_being_asked_for() {
    let sets = ["ps.time_offset=fixed", "ps.time_offset_value=0.4"];
    let fixed = late(Sensor::Ps, 0.4, 0.0, 1, &sets);
    let clean = Run { scenario: "mission", preset: Preset::Realistic, seed: 1, sets: &[], until: 400.0 }.go();
    // The first depth counts 0.4 s later, so the initial error stays that much longer; and so does each that follows,
    // since a reading waits for its stamp.
    let settled = |ran: &Ran| -> f64 {
        let pairs = ran.pairs.iter().filter(|pair| pair.estimate.t.as_seconds() > 30.0);
        pairs.map(|pair| pair.position_error_enu[2].powi(2)).sum()
    };
    let ratio = (settled(&fixed) / settled(&clean)).sqrt();
    assert!((0.9..1.3).contains(&ratio), "{ratio}");
}
