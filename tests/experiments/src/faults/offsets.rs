//! `offsets`: stamps that are late, per sensor, against the clean run of the same seed.
//!
use std::f64::consts::TAU;

use shared_types::AIDING;
use sim_faults::FaultSpec;

use crate::faults::matrix::{clean_runs, number};
use crate::faults::run::{FaultRun, Offsets, Setting, Trace};
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

/// What is injected.
struct Shape {
    name: &'static str,
    /// After the sensor's name and a dot.
    fault: &'static str,
    /// The offset at a time in s.
    injected: fn(f64) -> f64,
    /// Times at which it appears, vanishes or steps, s; the first counts as the beginning.
    changes: &'static [f64],
}

const SHAPES: [Shape; 7] = [
    Shape { name: "constant 0.05 s", fault: "stamp=0.05", injected: |_| 0.05, changes: &[0.0] },
    Shape { name: "constant 0.2 s", fault: "stamp=0.2", injected: |_| 0.2, changes: &[0.0] },
    Shape { name: "constant 0.5 s", fault: "stamp=0.5", injected: |_| 0.5, changes: &[0.0] },
    Shape {
        name: "wanders 0.2 ± 0.1 s",
        fault: "stamp_wander=0.2,0.1,120",
        injected: |t| 0.2 + 0.1 * (TAU * t / 120.0).sin(),
        changes: &[0.0],
    },
    Shape {
        name: "0.2 s appears at 120 s",
        fault: "stamp=0.2@120..",
        injected: |t| if t < 120.0 { 0.0 } else { 0.2 },
        changes: &[120.0],
    },
    Shape {
        name: "0.2 s vanishes at 120 s",
        fault: "stamp=0.2@..120",
        injected: |t| if t < 120.0 { 0.2 } else { 0.0 },
        changes: &[120.0],
    },
    Shape {
        name: "steps 0.1, 0.3 s every 60 s",
        fault: "stamp_steps=0.1,0.3,60",
        injected: |t| if t.rem_euclid(120.0) < 60.0 { 0.1 } else { 0.3 },
        changes: &[0.0, 60.0, 120.0, 180.0, 240.0],
    },
];

/// Old enough for an offset to be found after it has changed, s.
const SETTLED: f64 = 30.0;

/// What the estimator says of the offset.
struct Found {
    /// Root mean square of estimated less injected, 30 s after a change and later, s.
    error: f64,
    /// Root mean square of the sigma that it states meanwhile, s.
    sigma: f64,
    /// From the first change to the first estimate that is nearer to the new value than to what was before, s.
    detected_after: Option<f64>,
}

fn found(trace: &Trace, shape: &Shape, sensor: usize) -> Found {
    let last_change = |t: f64| shape.changes.iter().copied().filter(|&change| change <= t).fold(f64::NAN, f64::max);
    let settled = || trace.offsets.iter().filter(|at| at.t - last_change(at.t) >= SETTLED);
    let mean_square = |of: &dyn Fn(&Offsets) -> f64| {
        (settled().map(|at| of(at).powi(2)).sum::<f64>() / settled().count().max(1) as f64).sqrt()
    };
    let first = shape.changes[0];
    let (before, after) = match (shape.injected)(first - 1.0) {
        before if first > 0.0 => (before, (shape.injected)(first + 1.0)),
        _ => (0.0, (shape.injected)(first + 1.0)),
    };
    let is_new = |at: &&Offsets| at.t >= first && (at.found[sensor] - after).abs() < (at.found[sensor] - before).abs();
    let begun = first.max(trace.offsets.first().map_or(first, |at| at.t));
    Found {
        error: mean_square(&|at| at.found[sensor] - (shape.injected)(at.t)),
        sigma: mean_square(&|at| at.sigma[sensor]),
        detected_after: trace.offsets.iter().find(is_new).map(|at| at.t - begun),
    }
}

/// Runs the table and prints it as Markdown.
///
/// # Errors
/// [`TrialError`] of a setting, or of a run that panicked.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    let clean = clean_runs(1..=args.seeds, &args.sets)?;
    println!(
        "| sensor | stamps late by | RMS H, m | U, m | H / clean | U / clean | NEES H | U | beyond 3 sigma, % | estimated - injected, s | its sigma, s | found after, s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    println!("{}", line("–", "nothing (clean)", &clean, &clean, None));
    for sensor in SENSORS.into_iter().filter(|sensor| args.only.as_deref().is_none_or(|only| only == *sensor)) {
        for shape in &SHAPES {
            let fault: FaultSpec = format!("{sensor}.{}", shape.fault)
                .parse()
                .expect("the shapes of the house parse; a test reads them all");
            let runs: Vec<FaultRun> = (1..=args.seeds)
                .map(|seed| FaultRun {
                    setting: Setting::AsItIs,
                    faults: vec![fault.clone()],
                    sets: args.sets.clone(),
                    seed,
                })
                .collect();
            let traces: Vec<Trace> = in_parallel(&runs, |run| run.run()?.map_err(TrialError::Panicked))?;
            println!("{}", line(sensor, shape.name, &traces, &clean, Some(shape)));
        }
    }
    Ok(())
}

fn line(sensor: &str, name: &str, traces: &[Trace], clean: &[Trace], shape: Option<&Shape>) -> String {
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
    let place = AIDING.iter().position(|aiding| aiding.name() == sensor);
    let found: Vec<Found> = match (shape, place) {
        (Some(shape), Some(place)) => traces.iter().map(|trace| found(trace, shape, place)).collect(),
        _ => Vec::new(),
    };
    let of_found = |of: &dyn Fn(&Found) -> f64| {
        if found.is_empty() { "–".to_owned() } else { format!("{:.3}", found.iter().map(of).sum::<f64>() / count) }
    };
    let times: Vec<f64> = found.iter().filter_map(|found| found.detected_after).collect();
    let detected = match times.len() {
        0 => "–".to_owned(),
        some => format!("{} ({some} of {})", number(times.iter().sum::<f64>() / some as f64), found.len()),
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
        of_found(&|found| found.error),
        of_found(&|found| found.sigma),
        detected,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shape_parses_for_every_sensor() {
        for sensor in SENSORS {
            for Shape { fault, .. } in &SHAPES {
                assert!(format!("{sensor}.{fault}").parse::<FaultSpec>().is_ok(), "{sensor}.{fault}");
            }
        }
    }
}
