//! The tables of the README, each one command: `cargo run --release -p experiments -- accuracy`.

mod accuracy;
mod cases;
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
}

fn main() -> ExitCode {
    let result = match Cli::parse().experiment {
        Experiment::Accuracy(args) => accuracy::run(&args),
    };
    ilns_runtime::exit_with("experiments", result)
}
