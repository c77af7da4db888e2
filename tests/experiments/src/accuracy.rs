//! RMS, NEES, containment over seeds.

use crate::cases::{CASES, Case};
use crate::parallel::in_parallel;
use crate::trial::{Outcome, Trial, TrialError};
use sim_world::Preset;

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per row, 1 to N.
    #[arg(long, default_value_t = 5)]
    pub seeds: u64,
    /// Only rows whose name or scenario contains this text.
    #[arg(long)]
    pub only: Option<String>,
    /// Any configuration key, for every row.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
    /// Seconds of data time to run instead of the whole mission.
    #[arg(long)]
    pub until: Option<f64>,
    /// Show refusals and every seed.
    #[arg(long)]
    pub verbose: bool,
}

/// Instants of the outage experiment: end of the outage, three seconds after.
const INSTANTS: [f64; 2] = [1783.0, 1786.0];

/// Runs every row and prints the table.
///
/// # Errors
/// [`TrialError`] of the first trial that cannot be run.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    let cases: Vec<&Case> = CASES
        .iter()
        .filter(|case| args.only.as_deref().is_none_or(|text| case.name.contains(text) || case.scenario.contains(text)))
        .collect();
    let trials: Vec<(usize, Trial)> = cases
        .iter()
        .enumerate()
        .flat_map(|(row, case)| {
            (1..=if case.exact { 1 } else { args.seeds }).map(move |seed| (row, trial(case, seed, args)))
        })
        .collect();
    let outcomes = in_parallel(&trials, |(_, trial)| trial.run(&INSTANTS))?;
    println!(
        "{:<28} {:<9} {:>5}  {:^23}  {:^17}  {:^20}  {:>8} {:>8} {:>9} {:>6}",
        "sensors",
        "preset",
        "seeds",
        "RMS E/N/U [m]",
        "NEES E/N/U",
        "in 3 sigma [%]",
        "max [m]",
        "att [deg]",
        "solve[us]",
        "x real"
    );
    for (row, case) in cases.iter().enumerate() {
        let of_row: Vec<&Outcome> =
            outcomes.iter().zip(&trials).filter(|(_, (r, _))| *r == row).map(|(outcome, _)| outcome).collect();
        print_row(case, &of_row);
        if case.scenario == "outage" {
            print_outage(&of_row);
        }
        if args.verbose {
            for outcome in &of_row {
                print_details(outcome);
            }
        }
    }
    Ok(())
}

fn trial(case: &Case, seed: u64, args: &Args) -> Trial {
    let sets = case.sets.iter().map(|set| (*set).to_owned()).chain(args.sets.iter().cloned()).collect();
    Trial { sets, until: args.until, ..Trial::new(case.scenario, case.preset, seed) }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

fn preset_name(preset: Preset) -> &'static str {
    match preset {
        Preset::Paper => "paper",
        Preset::Realistic => "realistic",
        Preset::None => "none",
    }
}

#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
fn print_row(case: &Case, outcomes: &[&Outcome]) {
    let over = |value: &dyn Fn(&Outcome) -> f64| mean(outcomes.iter().map(|outcome| value(outcome)));
    let rms = [0, 1, 2].map(|axis| over(&|o| o.score.rms_enu[axis]));
    let nees = [0, 1, 2].map(|axis| over(&|o| o.score.nees_enu.map_or(f64::NAN, |nees| nees[axis])));
    let share =
        [0, 1, 2].map(|axis| over(&|o| o.score.three_sigma_share_enu.map_or(f64::NAN, |share| 100.0 * share[axis])));
    let attitude =
        outcomes.iter().filter_map(|o| o.score.attitude_max_deg).flat_map(|max| max.into_iter()).fold(0.0, f64::max);
    let worst = outcomes.iter().map(|o| o.score.max_horizontal).fold(0.0, f64::max);
    let solve = over(&|o| o.solve_us.get(o.solve_us.len() / 2).copied().unwrap_or(f64::NAN));
    let speed = over(&|o| o.duration_s / o.cpu_s);
    println!(
        "{:<28} {:<9} {:>5}  {:>7.4} {:>7.4} {:>7.4}  {:>5.2} {:>5.2} {:>5.2}  {:>6.2} {:>6.2} {:>6.2}  {:>8.4} {:>8.4} {:>9.1} {:>6.0}",
        case.name,
        preset_name(case.preset),
        outcomes.len(),
        rms[0],
        rms[1],
        rms[2],
        nees[0],
        nees[1],
        nees[2],
        share[0],
        share[1],
        share[2],
        worst,
        attitude,
        solve,
        speed
    );
}

#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
fn print_outage(outcomes: &[&Outcome]) {
    for outcome in outcomes {
        let at = |index: usize| {
            let (t, error, sigma) = outcome.at[index];
            format!(
                "at {t:.0} s error {:.3} {:.3} {:.3} m (sigma {:.3} {:.3} {:.3})",
                error[0], error[1], error[2], sigma[0], sigma[1], sigma[2]
            )
        };
        let settled = outcome.settled_at.map_or("never".to_owned(), |t| format!("{t:.1} s"));
        println!("    {}; {}; below 0.1 m for good from {settled}", at(0), at(1));
    }
}

#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
fn print_details(outcome: &Outcome) {
    let score = &outcome.score;
    println!(
        "    rms {:.4?} max {:.4?} att rms {:.5?} deg, max {:.5?} deg, nees att {:.2?} vel {:.2?}; worst {:.1} sigma at {:.1} s; keyframes {} iterations {:.2} linearised {:.2}; solve p50 {:.1} p99 {:.1} max {:.1} us",
        score.rms_enu,
        score.max_enu,
        score.attitude_rms_deg,
        score.attitude_max_deg,
        score.nees_attitude,
        score.nees_velocity_enu,
        outcome.worst_sigmas.0,
        outcome.worst_sigmas.1,
        outcome.keyframes,
        outcome.iterations,
        outcome.linearised,
        outcome.solve_us[outcome.solve_us.len() / 2],
        outcome.solve_us[outcome.solve_us.len() * 99 / 100],
        outcome.solve_us[outcome.solve_us.len() - 1],
    );
    println!("    rejected {:?}", outcome.rejected);
}
