//! Range differences alone, which hardly see the height, beside an accelerometer that is nearly free of noise.

mod runs;

use runs::Run;
use sim_world::Preset;

#[test]
fn what_little_is_known_of_the_height_is_not_lost_to_rounding() {
    let off = ["dvl", "gnss", "mcp", "ps"].map(|sensor| format!("{sensor}.enabled=false"));
    let mut sets: Vec<&str> = off.iter().map(String::as_str).collect();
    sets.push("lbl.common_offset_sigma=inf");
    for seed in [1, 3] {
        let run = Run { scenario: "mission", preset: Preset::Paper, seed, sets: &sets, until: 900.0 };
        let score = run.go().score;
        assert!(score.rms_horizontal < 0.5 && score.rms_enu[2] < 10.0, "seed {seed}: {:?} m", score.rms_enu);
        let nees = score.nees_enu.expect("sigmas are published");
        assert!(nees.iter().all(|&nees| nees < 4.0), "seed {seed}: NEES {nees:?}");
    }
}
