//! Transponders that are asked one after the other: no two ranges belong together.

mod runs;

use nav_evaluation::Pair;
use runs::{Ran, Run, uniform};
use shared_types::{RawReading, SolutionStatus};
use sim_world::Preset;

/// The mission without fixes, one buoy a second in turn, every reading passed through `tamper`.
fn in_turn(seed: u64, sets: &[&str], mut tamper: impl FnMut(RawReading) -> Option<RawReading>) -> Ran {
    let sets: Vec<&str> = ["gnss.enabled=false"].into_iter().chain(sets.iter().copied()).collect();
    let run = Run { scenario: "mission", preset: Preset::Realistic, seed, sets: &sets, until: 300.0 };
    run.with(|reading| match &reading {
        RawReading::Lbl(range) => {
            let second = range.header.t_valid.div_euclid(1_000_000_000);
            (i64::from(range.buoy) == 1 + second % 4).then_some(reading).and_then(&mut tamper)
        }
        _ => tamper(reading),
    })
}

fn loosened(ran: &Ran) -> usize {
    ran.solutions.iter().filter(|solution| solution.status == SolutionStatus::Loosened as u32).count()
}

#[test]
fn a_start_that_is_far_off_is_found_out_within_some_rounds() {
    for (position, off) in [("[60.0, -40.0, 0.0]", 72.0), ("[-900.0, 500.0, 0.0]", 1030.0)] {
        for seed in 1..=3 {
            let ran = in_turn(seed, &[&format!("initial.position={position}")], Some);
            let error = |pair: &Pair| pair.position_error_enu.xy().norm();
            let t_first = ran.pairs[0].estimate.t;
            let at = |seconds: f64| {
                ran.pairs
                    .iter()
                    .find(|pair| (pair.estimate.t - t_first).as_seconds() >= seconds)
                    .expect("the run is longer")
            };
            assert!((error(&ran.pairs[0]) - off).abs() < 2.0, "it starts {} m off", error(&ran.pairs[0]));
            // Two rounds of four, and one to come in.
            assert!(error(at(40.0)) < 2.0, "{position}, seed {seed}: {} m after 40 s", error(at(40.0)));
            assert!(loosened(&ran) >= 1);
        }
    }
}

#[test]
fn echoes_one_by_one_are_no_place() {
    for seed in 1..=6 {
        let mut draw = uniform(seed);
        let ran = in_turn(seed, &[], |mut reading| {
            if let RawReading::Lbl(range) = &mut reading
                && draw() < 0.2
            {
                range.range += 5.0 + 100.0 * draw();
            }
            Some(reading)
        });
        assert_eq!(loosened(&ran), 0, "seed {seed}");
        assert!(ran.score.rms_horizontal < 0.6, "seed {seed}: {} m", ran.score.rms_horizontal);
    }
}
