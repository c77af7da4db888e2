//! A start while the vehicle moves, without a state to begin with: honest from the first estimate on.
//!
//! The errors of a run of a minute hang together over some ten seconds: twenty seeds are some hundred independent samples an
//! axis, of which the mean square lies within 1 ± 0.42 (three sigmas), and at worst one in a hundred beyond three sigmas. What
//! is known worse than it is (velocity and tilt under way, a heading beside a compass) may fall below, not lie above.

mod runs;

use runs::Run;
use shared_types::RawReading;
use sim_world::Preset;

const NO_GNSS: &str = "gnss.enabled=false";
const NO_DVL: &str = "dvl.enabled=false";
const NO_MCP: &str = "mcp.enabled=false";
const DIFFERENCES: &str = "lbl.common_offset_sigma=inf";

/// What of errors and sigmas is summed: squares of position, velocity and attitude, and positions within three sigmas.
#[derive(Default)]
struct Sums {
    position: [f64; 3],
    velocity: [f64; 3],
    attitude: [f64; 3],
    within: [f64; 3],
    count: f64,
}

/// The first minute of runs of `scenario` of which nothing but the buoys is heard before `from`, over 20 seeds.
fn check(scenario: &str, from: f64, sets: &[&str]) {
    let mut sums = Sums::default();
    for seed in 1..=20 {
        let run = Run { scenario, preset: Preset::Realistic, seed, sets, until: from + 62.0 };
        let is_heard =
            |reading: &RawReading| matches!(reading, RawReading::Buoy(_)) || reading.t_valid().as_seconds() >= from;
        let ran = run.with(|reading| is_heard(&reading).then_some(reading));
        let first = ran.pairs.first().expect("it started").estimate.t.as_seconds();
        assert!(first < from + 4.0, "{scenario} from {from} s, seed {seed}: the first estimate is that at {first} s");
        for pair in &ran.pairs {
            let estimate = &pair.estimate;
            for axis in 0..3 {
                let of_position = pair.position_error_enu[axis] / estimate.sigma_position_enu[axis];
                sums.position[axis] += of_position.powi(2);
                sums.velocity[axis] += (pair.velocity_error_enu[axis] / estimate.sigma_velocity_enu[axis]).powi(2);
                sums.attitude[axis] += (pair.attitude_error[axis] / estimate.sigma_rpy[axis]).powi(2);
                sums.within[axis] += f64::from(of_position.abs() < 3.0);
            }
            sums.count += 1.0;
        }
    }
    let [position, velocity, attitude, within] =
        [sums.position, sums.velocity, sums.attitude, sums.within].map(|sum| sum.map(|sum| sum / sums.count));
    let told = format!(
        "{scenario} from {from} s, {sets:?}: NEES of position {position:.2?}, velocity {velocity:.2?}, attitude \
         {attitude:.2?}, positions within 3 sigma {within:.4?}"
    );
    assert!(position.iter().all(|nees| (0.5..1.42).contains(nees)), "{told}");
    assert!(velocity.iter().chain(&attitude).all(|nees| *nees < 1.42), "{told}");
    assert!(within.iter().all(|share| *share > 0.985), "{told}");
}

#[test]
fn under_way_at_the_surface_a_start_is_as_good_as_it_says() {
    check("mission", 60.0, &[]);
    check("mission", 60.0, &[NO_DVL]);
    check("mission", 60.0, &[NO_MCP]);
    check("mission", 60.0, &[NO_MCP, NO_DVL]);
}

#[test]
fn while_it_gathers_speed_or_turns_a_start_is_as_good_as_it_says() {
    check("mission", 25.0, &[]);
    check("mission", 160.0, &[NO_MCP]);
    check("mission", 160.0, &[NO_GNSS, NO_DVL]);
}

#[test]
fn below_the_surface_a_start_is_as_good_as_it_says() {
    check("stable", 60.0, &[NO_DVL]);
    check("stable", 60.0, &[DIFFERENCES]);
    // While it sinks.
    check("mission", 440.0, &[]);
}
