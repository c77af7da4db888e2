//! What a keyframe costs, whatever the window, and for how long.
//!
//! A keyframe is all that happens when it comes: make room, close the interval, evaluate, gate and tie what was measured, solve
//! to convergence, marginalise, covariance of the newest. The limit beside it is what the arithmetic alone would take: a cached
//! update with robust weights is 0.25 Mflop with 20 intervals in the window and 0.55 Mflop with 200 (§4.5 of the method), here
//! at 5 Gflop/s.

use nav_pipeline::{Navigator, Output, Rebase};
use shared_types::{Duration, Mode, Time};
use sim_world::{Manoeuvre, Preset, Scenario, Segment, World};

use crate::trial::{Outcome, ThreadClock, Trial, TrialError};

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per window, 1 to N.
    #[arg(long, default_value_t = 3)]
    pub seeds: u64,
    /// Instead of the windows, so many hours of data time in one run, hour by hour.
    #[arg(long, value_name = "H")]
    pub hours: Option<u32>,
    /// Any configuration key.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
}

const WINDOWS: [usize; 6] = [10, 20, 50, 100, 200, 500];
const FLOPS_PER_US: f64 = 5e3;

/// Runs it and prints the table.
///
/// # Errors
/// [`TrialError`].
pub fn run(args: &Args) -> Result<(), TrialError> {
    match args.hours {
        Some(hours) => hour_by_hour(hours, args),
        None => windows(args),
    }
}

/// Interpolated between the two windows that the method counts.
fn limit_us(window: usize) -> f64 {
    let flops = 0.25e6 + (0.55e6 - 0.25e6) * (window as f64 - 20.0) / 180.0;
    flops / FLOPS_PER_US
}

/// One run after another: another one beside it would share its caches.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
fn windows(args: &Args) -> Result<(), TrialError> {
    println!(
        "| window | p50, µs | p99, µs | max, µs | limit, µs | p50 / limit | passes | linearised anew | RMS H, m |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for window in WINDOWS {
        let mut outcomes = Vec::new();
        for seed in 1..=args.seeds {
            let sets = args.sets.iter().cloned().chain([format!("fgo.window={window}")]).collect();
            outcomes.push(Trial { sets, ..Trial::new("mission", Preset::Realistic, seed) }.run(&[])?);
        }
        let mut solve_us: Vec<f64> = outcomes.iter().flat_map(|outcome| outcome.solve_us.iter().copied()).collect();
        solve_us.sort_by(f64::total_cmp);
        let of_all = |value: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(value).sum::<f64>() / outcomes.len() as f64;
        let (median, limit) = (quantile(&solve_us, 0.5), limit_us(window));
        println!(
            "| {window} | {median:.0} | {:.0} | {:.0} | {limit:.0} | {:.1} | {:.2} | {:.1} | {:.4} |",
            quantile(&solve_us, 0.99),
            quantile(&solve_us, 1.0),
            median / limit,
            of_all(&|outcome| outcome.iterations),
            of_all(&|outcome| outcome.linearised),
            of_all(&|outcome| outcome.score.rms_horizontal),
        );
    }
    Ok(())
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted.get((share * sorted.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(f64::NAN)
}

/// The mission's dive, and then circles to the left and to the right below the net for as long as is asked.
fn endless(hours: u32) -> Result<Scenario, TrialError> {
    const DIVED: f64 = 560.0;
    const CIRCLE: f64 = 360.0;
    let mut scenario = Scenario::builtin("mission")?;
    scenario.segments.retain(|segment| segment.end <= DIVED);
    let t_end = f64::from(hours) * 3600.0;
    let mut side = 1.0;
    let mut start = DIVED;
    while start < t_end {
        let end = start + CIRCLE;
        let rate = side * 1.0_f64.to_radians();
        scenario.segments.push(Segment { start, end, manoeuvre: Manoeuvre::Turn { rate } });
        (start, side) = (end, -side);
    }
    Ok(scenario)
}

#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
fn hour_by_hour(hours: u32, args: &Args) -> Result<(), TrialError> {
    let trial = Trial { sets: args.sets.clone(), ..Trial::new("mission", Preset::Realistic, 1) };
    let world = World::new(&endless(hours)?, trial.preset, trial.seed)?;
    let config = trial.config(&world)?;
    let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
    let mut clock = ThreadClock;
    println!(
        "| hour | keyframes | passes | solve p10, µs | p50, µs | p99, µs | resident, MiB | modes other than OK, % |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let (mut quick, mut residents) = (Vec::new(), Vec::new());
    let (mut solve_us, mut passes, mut estimates, mut not_ok) = (Vec::new(), 0.0, 0_u64, 0_u64);
    let mut hour = 1;
    let t_end = Time::from_seconds(f64::from(hours) * 3600.0);
    for reading in world.readings() {
        let t = reading.t_valid();
        if t >= Time::from_seconds(f64::from(hour) * 3600.0) {
            solve_us.sort_by(f64::total_cmp);
            // A busy machine slows most keyframes now and then, the quickest tenth hardly.
            let (tenth, resident) = (quantile(&solve_us, 0.1), resident_mib());
            let share = 100.0 * not_ok as f64 / estimates.max(1) as f64;
            println!(
                "| {hour} | {} | {:.3} | {tenth:.1} | {:.1} | {:.1} | {resident:.2} | {share:.3} |",
                solve_us.len(),
                passes / solve_us.len() as f64,
                quantile(&solve_us, 0.5),
                quantile(&solve_us, 0.99)
            );
            quick.push(tenth);
            residents.push(resident);
            solve_us.clear();
            (passes, estimates, not_ok) = (0.0, 0, 0);
            hour += 1;
        }
        if t >= t_end {
            break;
        }
        navigator.push(&reading, &mut clock, &mut |output| match output {
            Output::Solution(solution, _) => {
                passes += f64::from(solution.iterations);
                solve_us.push(solution.solve_ns as f64 * 1e-3);
            }
            Output::Estimate(estimate) if estimate.mode() != Mode::Initialising => {
                estimates += 1;
                not_ok += u64::from(estimate.mode() != Mode::Ok);
            }
            Output::Estimate(_) | Output::Origin(_) | Output::Lagged(_) => {}
        });
    }
    println!(
        "\nslope per hour after the first: {:+.3} % of the solve time (p10), {:+.4} MiB",
        100.0 * slope(&quick) / quick.get(1).copied().unwrap_or(f64::NAN),
        slope(&residents)
    );
    Ok(())
}

/// Least squares over the hours from the second on; the first holds the start.
fn slope(values: &[f64]) -> f64 {
    let values = values.get(1..).unwrap_or_default();
    let n = values.len() as f64;
    let (mean_x, mean_y) = ((n - 1.0) / 2.0, values.iter().sum::<f64>() / n);
    let (mut xy, mut xx) = (0.0, 0.0);
    for (index, value) in values.iter().enumerate() {
        let x = index as f64 - mean_x;
        xy += x * (value - mean_y);
        xx += x * x;
    }
    if xx > 0.0 { xy / xx } else { f64::NAN }
}

/// Of this process; NaN where the system does not say.
fn resident_mib() -> f64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = text.split_whitespace().nth(1).and_then(|pages| pages.parse::<f64>().ok());
    pages.map_or(f64::NAN, |pages| pages * rustix::param::page_size() as f64 / (1024.0 * 1024.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_its_slope_and_the_first_hour_does_not_count() {
        assert!((slope(&[90.0, 1.0, 3.0, 5.0, 7.0]) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_endless_mission_is_one_that_can_be_driven() {
        let scenario = endless(2).expect("built in");
        let world = World::new(&scenario, Preset::Realistic, 1).expect("it can be driven");
        let mut navigator_hears = 0;
        for reading in world.readings().take(1000) {
            navigator_hears += usize::from(reading.t_valid() < Time::from_seconds(7200.0));
        }
        assert_eq!(navigator_hears, 1000);
        assert!(scenario.segments.last().is_some_and(|segment| segment.end >= 7200.0));
    }
}
