//! The tables of the README, each one command: `cargo run --release -p experiments -- accuracy`.

mod accuracy;
mod bound;
mod bound_table;
mod cases;
mod consistency;
mod faults;
mod paper;
mod parallel;
mod speed;
mod trial;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "experiments", version, about = "Runs simulated missions through the navigator and prints tables.")]
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
    /// What a keyframe costs with windows from 10 to 500, beside the limit of the arithmetic; with `--hours`, over a day.
    Speed(speed::Args),
    /// NEES, NIS and containment for every set of sensors, over seeds.
    Consistency(consistency::Args),
    /// I-a of the paper: windows from 10 to 200 keyframes and the batch.
    #[command(name = "i-a")]
    WindowSize(paper::Args),
    /// I-b, Table II: EKF and FGO, stable and complex motion.
    #[command(name = "i-b")]
    EkfComparison(paper::Args),
    /// II-a, Table III: FGO and FGO plus; all 24 sets of sensors with a position.
    #[command(name = "ii-a")]
    AddedSensors(paper::Args),
    /// II-b: an outage of 100 s, FKF and FGO.
    #[command(name = "ii-b")]
    Outage(paper::Args),
    /// PF, FPF and FBPF, sensors 0 to 0.5 s off the keyframes.
    #[command(name = "pf")]
    Anchoring(paper::Args),
    /// III, Table IV: recorded drives (ILNS_LOGS), and a KAIST sequence.
    #[command(name = "iii")]
    Recorded(paper::Args),
    /// Outliers, a wrong start, late data: FGO against EKF and FKF.
    SmootherGain(paper::Args),
    /// All of the paper's experiments, and the report.
    All(paper::Args),
    /// The fault matrix: each class of the catalogue that readings can have, over seeds, against its expectations.
    Faults(faults::matrix::Args),
    /// What outliers, gaps and blackouts cost against the clean run of the same seed.
    Outliers(faults::outliers::Args),
    /// What late stamps cost against the clean run of the same seed, per sensor.
    Offsets(faults::offsets::Args),
    /// What a wrong sound speed and a wrong scale of the DVL cost, with their calibration and without.
    Calibrations(faults::calibrations::Args),
}

fn main() -> ExitCode {
    let result: Result<(), Box<dyn std::error::Error>> = match Cli::parse().experiment {
        Experiment::Accuracy(args) => accuracy::run(&args).map_err(Into::into),
        Experiment::Bound(args) => bound_table::run(&args).map_err(Into::into),
        Experiment::Speed(args) => speed::run(&args).map_err(Into::into),
        Experiment::Consistency(args) => consistency::run(&args).map_err(Into::into),
        Experiment::WindowSize(args) => of_paper(paper::Experiment::WindowSize, &args),
        Experiment::EkfComparison(args) => of_paper(paper::Experiment::EkfComparison, &args),
        Experiment::AddedSensors(args) => of_paper(paper::Experiment::AddedSensors, &args),
        Experiment::Outage(args) => of_paper(paper::Experiment::Outage, &args),
        Experiment::Anchoring(args) => of_paper(paper::Experiment::Anchoring, &args),
        Experiment::Recorded(args) => of_paper(paper::Experiment::Recorded, &args),
        Experiment::SmootherGain(args) => of_paper(paper::Experiment::SmootherGain, &args),
        Experiment::All(args) => of_paper(paper::Experiment::All, &args),
        Experiment::Faults(args) => faults::matrix::run(&args).map_err(Into::into),
        Experiment::Outliers(args) => faults::outliers::run(&args).map_err(Into::into),
        Experiment::Offsets(args) => faults::offsets::run(&args).map_err(Into::into),
        Experiment::Calibrations(args) => faults::calibrations::run(&args).map_err(Into::into),
    };
    ilns_runtime::exit_with("experiments", result)
}

fn of_paper(experiment: paper::Experiment, args: &paper::Args) -> Result<(), Box<dyn std::error::Error>> {
    Ok(paper::run(experiment, args)?)
}
