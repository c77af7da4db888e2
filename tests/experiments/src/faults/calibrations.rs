//! `calibrations`: a wrong sound speed and a wrong scale of the DVL, looked for and not, against the clean run of the same seed.

use shared_types::{CALIBRATIONS, Calibration};
use sim_faults::FaultSpec;

use crate::faults::matrix::{clean_runs, number};
use crate::faults::run::{FaultRun, Setting, Trace};
use crate::parallel::in_parallel;
use crate::trial::TrialError;

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per row, 1 to N.
    #[arg(long, default_value_t = 4)]
    pub seeds: u64,
    /// Any configuration key, for every run.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
}

/// What is injected, and what the calibrations are at the end of it.
struct Wrong {
    faults: &'static [&'static str],
    at_end: &'static [(Calibration, f64)],
}

const ROWS: [Wrong; 8] = [
    Wrong { faults: &[], at_end: &[] },
    Wrong { faults: &["lbl.scale=1.001@.."], at_end: &[(Calibration::RangeScale, 0.001)] },
    Wrong { faults: &["lbl.scale=1.003@.."], at_end: &[(Calibration::RangeScale, 0.003)] },
    Wrong { faults: &["lbl.scale=1.01@.."], at_end: &[(Calibration::RangeScale, 0.01)] },
    Wrong { faults: &["lbl.scale=1.01@150.."], at_end: &[(Calibration::RangeScale, 0.01)] },
    Wrong { faults: &["dvl.scale=1.003@.."], at_end: &[(Calibration::DvlScale, 0.003)] },
    Wrong { faults: &["dvl.scale=1.01@.."], at_end: &[(Calibration::DvlScale, 0.01)] },
    Wrong {
        faults: &["lbl.scale=1.003@..", "dvl.scale=1.01@.."],
        at_end: &[(Calibration::RangeScale, 0.003), (Calibration::DvlScale, 0.01)],
    },
];

/// What is looked for.
const SEARCHES: [(&str, &[&str]); 3] = [
    ("nothing", &["lbl.calibrate=false", "dvl.calibrate=false"]),
    ("ranges", &["lbl.calibrate=true", "dvl.calibrate=false"]),
    ("ranges, DVL", &["lbl.calibrate=true", "dvl.calibrate=true"]),
];

/// Runs the table and prints it as Markdown.
///
/// # Errors
/// [`TrialError`] of a setting, or of a run that panicked.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    let clean = clean_runs(1..=args.seeds, &[&args.sets[..], &owned(SEARCHES[0].1)].concat())?;
    println!(
        "| wrong | looked for | RMS H, m | H / clean | NEES H | beyond 3 sigma, % | estimated - injected at the end, % | its sigma, % |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for wrong in &ROWS {
        let faults: Vec<FaultSpec> = wrong
            .faults
            .iter()
            .map(|fault| fault.parse().expect("the faults of the house parse; a test reads them all"))
            .collect();
        for (name, sets) in SEARCHES {
            let sets = [&args.sets[..], &owned(sets)].concat();
            let runs: Vec<FaultRun> = (1..=args.seeds)
                .map(|seed| FaultRun { setting: Setting::AsItIs, faults: faults.clone(), sets: sets.clone(), seed })
                .collect();
            let traces: Vec<Trace> = in_parallel(&runs, |run| run.run()?.map_err(TrialError::Panicked))?;
            println!("{}", line(wrong, name, &traces, &clean));
        }
    }
    Ok(())
}

fn owned(sets: &[&str]) -> Vec<String> {
    sets.iter().map(|set| (*set).to_owned()).collect()
}

fn line(wrong: &Wrong, search: &str, traces: &[Trace], clean: &[Trace]) -> String {
    let count = traces.len().max(1) as f64;
    let mean = |of: &dyn Fn(&Trace) -> f64| traces.iter().map(of).sum::<f64>() / count;
    let horizontal = |trace: &Trace| trace.rms_since(f64::MIN)[0];
    let ratio =
        traces.iter().zip(clean).map(|(trace, clean)| horizontal(trace) / horizontal(clean)).sum::<f64>() / count;
    let outside = mean(&|trace| {
        let (out, all) = trace.outside();
        100.0 * out as f64 / all.max(1) as f64
    });
    let at_end = |of: &dyn Fn(&Trace) -> Option<f64>| {
        (traces.iter().filter_map(of).map(|value| value * value).sum::<f64>() / count).sqrt() * 100.0
    };
    let found: Vec<String> = CALIBRATIONS
        .into_iter()
        .filter_map(|calibration| {
            let (_, injected) = wrong.at_end.iter().find(|(of, _)| *of == calibration)?;
            let at = calibration.index();
            let error = at_end(&|trace| Some(trace.offsets.last()?.calibration[at] - injected));
            let sigma = at_end(&|trace| Some(trace.offsets.last()?.calibration_sigma[at]));
            Some(format!("{error:.3} | {sigma:.3}"))
        })
        .collect();
    let found = match found.as_slice() {
        [one] => one.clone(),
        [first, second] => {
            let halves = [first, second].map(|both| both.split_once(" | ").unwrap_or((both, "")));
            format!("{}, {} | {}, {}", halves[0].0, halves[1].0, halves[0].1, halves[1].1)
        }
        _ => "– | –".to_owned(),
    };
    let name = match wrong.faults {
        [] => "nothing (clean)".to_owned(),
        faults => faults.iter().map(|fault| format!("`{fault}`")).collect::<Vec<_>>().join(" "),
    };
    format!(
        "| {name} | {search} | {:.3} | {} | {} | {outside:.2} | {found} |",
        mean(&horizontal),
        number(ratio),
        number(mean(&|trace| trace.nees()[0])),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_parses() {
        for fault in ROWS.iter().flat_map(|wrong| wrong.faults) {
            assert!(fault.parse::<FaultSpec>().is_ok(), "{fault}");
        }
    }
}
