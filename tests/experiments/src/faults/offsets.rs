//! `offsets`: stamps that are late, per sensor, against the clean run of the same seed.
//!
//! Columns of what the estimator finds (offset, sigma, time to detect) are there; they are filled as soon as a trace has them.

use sim_faults::FaultSpec;

use crate::faults::matrix::{clean_runs, number};
use crate::faults::run::{FaultRun, Trace};
use crate::parallel::in_parallel;
use crate::trial::TrialError;

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per row, 1 to N.
    #[arg(long, default_value_t = 4)]
    pub seeds: u64,
    /// Only this sensor.
    #[arg(long, value_name = "SENSOR")]
    pub only: Option<String>,
    /// Any configuration key, for every run.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
}

const SENSORS: [&str; 5] = ["dvl", "lbl", "mcp", "ps", "gnss"];

/// What is injected: after the sensor's name and a dot.
const SHAPES: [(&str, &str); 7] = [
    ("constant 0.05 s", "stamp=0.05"),
    ("constant 0.2 s", "stamp=0.2"),
    ("constant 0.5 s", "stamp=0.5"),
    ("wanders 0.2 ± 0.1 s", "stamp_wander=0.2,0.1,120"),
    ("0.2 s appears at 120 s", "stamp=0.2@120.."),
    ("0.2 s vanishes at 120 s", "stamp=0.2@..120"),
    ("steps 0.1, 0.3 s every 60 s", "stamp_steps=0.1,0.3,60"),
];

/// What the estimator says of the offset at the end of a run.
struct Found {
    offset: f64,
    sigma: f64,
    detected_after: f64,
}

/// No estimator publishes an offset yet: every trace has none.
fn found(_trace: &Trace) -> Option<Found> {
    None
}

/// Runs the table and prints it as Markdown.
///
/// # Errors
/// [`TrialError`] of a setting, or of a run that panicked.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    let clean = clean_runs(args.seeds, &args.sets)?;
    println!(
        "| sensor | stamps late by | RMS H, m | U, m | H / clean | U / clean | NEES H | U | beyond 3 sigma, % | estimated, s | its sigma, s | detected after, s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    println!("{}", line("–", "nothing (clean)", &clean, &clean));
    for sensor in SENSORS.into_iter().filter(|sensor| args.only.as_deref().is_none_or(|only| only == *sensor)) {
        for (name, shape) in SHAPES {
            let fault: FaultSpec =
                format!("{sensor}.{shape}").parse().expect("the shapes of the house parse; a test reads them all");
            let runs: Vec<FaultRun> = (1..=args.seeds)
                .map(|seed| FaultRun { faults: vec![fault.clone()], sets: args.sets.clone(), seed })
                .collect();
            let traces: Vec<Trace> = in_parallel(&runs, |run| run.run()?.map_err(TrialError::Panicked))?;
            println!("{}", line(sensor, name, &traces, &clean));
        }
    }
    Ok(())
}

fn line(sensor: &str, name: &str, traces: &[Trace], clean: &[Trace]) -> String {
    let count = traces.len().max(1) as f64;
    let mean = |of: &dyn Fn(&Trace, &Trace) -> f64| {
        traces.iter().zip(clean).map(|(trace, clean)| of(trace, clean)).sum::<f64>() / count
    };
    let rms = |part: usize| move |trace: &Trace, _: &Trace| trace.rms_since(f64::MIN)[part];
    let ratio = |part: usize| {
        move |trace: &Trace, clean: &Trace| trace.rms_since(f64::MIN)[part] / clean.rms_since(f64::MIN)[part]
    };
    let outside = |trace: &Trace, _: &Trace| {
        let (out, all) = trace.outside();
        100.0 * out as f64 / all.max(1) as f64
    };
    let found: Vec<Found> = traces.iter().filter_map(found).collect();
    let of_found = |of: &dyn Fn(&Found) -> f64| {
        if found.is_empty() { "–".to_owned() } else { number(found.iter().map(of).sum::<f64>() / found.len() as f64) }
    };
    format!(
        "| {sensor} | {name} | {:.3} | {:.3} | {} | {} | {} | {} | {:.2} | {} | {} | {} |",
        mean(&rms(0)),
        mean(&rms(1)),
        number(mean(&ratio(0))),
        number(mean(&ratio(1))),
        number(mean(&|trace, _| trace.nees()[0])),
        number(mean(&|trace, _| trace.nees()[1])),
        mean(&outside),
        of_found(&|found| found.offset),
        of_found(&|found| found.sigma),
        of_found(&|found| found.detected_after),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shape_parses_for_every_sensor() {
        for sensor in SENSORS {
            for (_, shape) in SHAPES {
                assert!(format!("{sensor}.{shape}").parse::<FaultSpec>().is_ok(), "{sensor}.{shape}");
            }
        }
    }
}
