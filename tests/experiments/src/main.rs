//! The tables of the README, each one command: `cargo run --release -p experiments -- accuracy`.

mod accuracy;
mod bound;
mod bound_table;
mod cases;
mod consistency;
mod faults;
mod parallel;
mod trial;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "experiments", about = "Runs simulated missions through the navigator and prints tables.")]
struct Cli {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(Subcommand)]
enum Experiment {
    /// RMS, consistency and containment over seeds, for the built-in missions and several sensor subsets.
    Accuracy(accuracy::Args),
    /// The estimator and the smoother beside the information bound, over seeds.
    Bound(bound_table::Args),
    /// NEES, NIS and containment for every set of sensors, over seeds.
    Consistency(consistency::Args),
    /// The fault matrix: each class of the catalogue that readings can have, over seeds, against its expectations.
    Faults(faults::matrix::Args),
    /// What outliers, gaps and blackouts cost against the clean run of the same seed.
    Outliers(faults::outliers::Args),
    /// What late stamps cost against the clean run of the same seed, per sensor.
    Offsets(faults::offsets::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().experiment {
        Experiment::Accuracy(args) => accuracy::run(&args),
        Experiment::Bound(args) => bound_table::run(&args),
        Experiment::Consistency(args) => consistency::run(&args),
        Experiment::Faults(args) => faults::matrix::run(&args),
        Experiment::Outliers(args) => faults::outliers::run(&args),
        Experiment::Offsets(args) => faults::offsets::run(&args),
    };
    ilns_runtime::exit_with("experiments", result)
}
