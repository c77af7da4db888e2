//! Is the covariance honest? NEES, NIS and containment, for every set of sensors.
//!
//! The squares of all errors over their variances have the mean 1 in each seed. Errors of one run are correlated, for seconds or, without
//! a position sensor, for as long as it lasts; seeds are not. So the spread s of the means of n seeds says how well their mean is
//! known: `± 1.96 s/√n` (95 %). With independent samples it would be the chi-square band `1 ± 1.96 √(2/samples)`.

use shared_types::{AIDING, Sensor};
use sim_world::Preset;

use crate::parallel::in_parallel;
use crate::trial::{Outcome, Trial, TrialError};

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per row, 1 to N.
    #[arg(long, default_value_t = 10)]
    pub seeds: u64,
    /// Built-in scenario.
    #[arg(long, default_value = "mission", value_parser = ["mission", "stable", "outage", "survey"])]
    pub scenario: String,
    /// All 32 sets of sensors that hold the IMU, in place of eight.
    #[arg(long)]
    pub all: bool,
    /// Seconds of data time to run instead of the whole mission.
    #[arg(long)]
    pub until: Option<f64>,
    /// Any configuration key, for every row.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
}

/// Sets worth many seeds, as bits in the order of [`AIDING`].
const EIGHT: [&[Sensor]; 8] = [
    &[Sensor::Lbl, Sensor::Ps],
    &[Sensor::Lbl, Sensor::Dvl, Sensor::Ps],
    &[Sensor::Lbl, Sensor::Mcp, Sensor::Ps],
    &[Sensor::Lbl, Sensor::Dvl, Sensor::Mcp, Sensor::Ps],
    &[Sensor::Lbl, Sensor::Gnss, Sensor::Dvl, Sensor::Mcp, Sensor::Ps],
    &[Sensor::Lbl],
    &[Sensor::Gnss, Sensor::Dvl, Sensor::Mcp, Sensor::Ps],
    &[Sensor::Dvl, Sensor::Mcp, Sensor::Ps],
];

/// Runs every row and prints the table.
///
/// # Errors
/// [`TrialError`] of the first trial that cannot be run.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    let scenario = ["mission", "stable", "outage", "survey"].into_iter().find(|name| *name == args.scenario);
    let scenario = scenario.unwrap_or("mission");
    let sets: Vec<Vec<Sensor>> = if args.all {
        (0..1_u32 << AIDING.len())
            .map(|bits| (0..AIDING.len()).filter(|at| bits >> at & 1 == 1).map(|at| AIDING[at]).collect())
            .collect()
    } else {
        EIGHT.iter().map(|set| set.to_vec()).collect()
    };
    println!("{scenario}, realistic errors, seeds 1 to {}", args.seeds);
    println!(
        "| {:<22} | {:^17} | {:^18} | {:^20} | NIS per degree of freedom |",
        "IMU and", "NEES E/N/U", "known to +- (95 %)", "in 3 sigma [%]"
    );
    println!("|{:-<24}|{:-<19}|{:-<20}|{:-<22}|{:-<27}|", "", "", "", "", "");
    for set in &sets {
        let trials: Vec<Trial> = (1..=args.seeds).map(|seed| trial(scenario, seed, set, args)).collect();
        let outcomes = in_parallel(&trials, |trial| trial.run(&[]))?;
        print_row(set, &outcomes);
    }
    Ok(())
}

fn trial(scenario: &'static str, seed: u64, set: &[Sensor], args: &Args) -> Trial {
    let off = AIDING.iter().filter(|sensor| !set.contains(sensor));
    let sets = off.map(|sensor| format!("{}.enabled=false", sensor.name())).chain(args.sets.iter().cloned()).collect();
    Trial { sets, until: args.until, ..Trial::new(scenario, Preset::Realistic, seed) }
}

#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
fn print_row(set: &[Sensor], outcomes: &[Outcome]) {
    let nees = [0, 1, 2].map(|axis| {
        let of_seeds = outcomes.iter().map(|o| o.score.nees_enu.map_or(f64::NAN, |nees| nees[axis]));
        MeanOfSeeds::of(&of_seeds.collect::<Vec<_>>())
    });
    let share = [0, 1, 2].map(|axis| {
        let shares = outcomes.iter().map(|o| o.score.three_sigma_share_enu.map_or(f64::NAN, |share| share[axis]));
        100.0 * shares.sum::<f64>() / outcomes.len() as f64
    });
    let nis: Vec<String> = AIDING
        .iter()
        .enumerate()
        .filter_map(|(at, sensor)| {
            let (sum, freedom) = outcomes.iter().fold((0.0, 0.0), |all, o| (all.0 + o.nis[at].0, all.1 + o.nis[at].1));
            (freedom > 0.0).then(|| format!("{} {:.3}", sensor.name(), sum / freedom))
        })
        .collect();
    let names: Vec<&str> = set.iter().map(|sensor| sensor.name()).collect();
    println!(
        "| {:<22} | {:>5.2} {:>5.2} {:>5.2} |   {:>4.2} {:>4.2} {:>4.2}   | {:>6.2} {:>6.2} {:>6.2} | {} |",
        if names.is_empty() { "nothing".to_owned() } else { names.join(" ") },
        nees[0].mean,
        nees[1].mean,
        nees[2].mean,
        nees[0].known_to,
        nees[1].known_to,
        nees[2].known_to,
        share[0],
        share[1],
        share[2],
        nis.join(", ")
    );
}

/// The mean of what seeds found, and how well it is known (95 %).
#[derive(Clone, Copy, Debug, PartialEq)]
struct MeanOfSeeds {
    mean: f64,
    known_to: f64,
}

impl MeanOfSeeds {
    fn of(values: &[f64]) -> MeanOfSeeds {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
        MeanOfSeeds { mean, known_to: 1.96 * (variance / count).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_is_known_by_the_spread_of_its_seeds() {
        assert_eq!(MeanOfSeeds::of(&[1.0, 1.0, 1.0]), MeanOfSeeds { mean: 1.0, known_to: 0.0 });
        let found = MeanOfSeeds::of(&[0.5, 1.5, 0.5, 1.5]);
        assert!((found.mean - 1.0).abs() < 1e-12 && (found.known_to - 1.96 * (1.0 / 12.0_f64).sqrt()).abs() < 1e-12);
        assert!(MeanOfSeeds::of(&[1.0]).known_to.is_nan(), "one seed tells nothing of it");
    }
}
