//! `outliers`: what wild readings and silences cost against the clean run of the same seed.

use shared_types::{REJECT_REASONS, SENSORS, Sensor};
use sim_faults::FaultSpec;

use crate::faults::matrix::{clean_runs, number, time_of};
use crate::faults::run::{FaultRun, Setting, Trace};
use crate::parallel::in_parallel;
use crate::trial::TrialError;

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per row, 1 to N.
    #[arg(long, default_value_t = 4)]
    pub seeds: u64,
    /// Only rows with this text in their sensors or fault.
    #[arg(long)]
    pub only: Option<String>,
    /// Any configuration key, for every run.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
}

/// Sensors of a group of rows.
struct Subset {
    name: &'static str,
    sets: &'static [&'static str],
    rows: &'static [&'static str],
}

const SUBSETS: &[Subset] = &[
    Subset {
        name: "all",
        sets: &[],
        rows: &[
            "lbl.multipath=0.1",
            "lbl.multipath=0.2",
            "lbl.multipath=0.3",
            "lbl.bursts=0.1,20",
            "lbl.bursts=0.2,20",
            "lbl.clusters=0.1,20",
            "lbl.clusters=0.2,20",
            "lbl.clusters=0.2,20,5,20",
            "dvl.spikes=0.03,1",
            "dvl.spikes=0.03,0.1",
            "gnss.jump=300@240..255",
            "gnss.jump=20@240..255",
            "gnss.spikes=0.1,50",
            "ps.spikes=0.03,5",
            "mcp.spikes=0.03,30",
            "mcp.disturbance=20,60@120..180",
            "lbl.duplicate=0.3,1",
            "dvl.duplicate=0.3",
            "imu.duplicate=0.05",
            "imu.gaps=0.05,10@60..240",
            "lbl.blackout@110..170",
            "dvl.blackout@110..170",
            "mcp.blackout@110..170",
            "ps.blackout@110..170",
            "gnss.blackout@240..270",
            "lbl.multipath=0.2 dvl.spikes=0.03,1",
        ],
    },
    Subset {
        name: "LBL + PS",
        sets: &["dvl.enabled=false", "mcp.enabled=false", "gnss.enabled=false"],
        rows: &[
            "lbl.multipath=0.1",
            "lbl.multipath=0.2",
            "lbl.multipath=0.3",
            "lbl.bursts=0.1,20",
            "lbl.bursts=0.2,20",
            "lbl.clusters=0.1,20",
            "lbl.clusters=0.2,20",
            "ps.spikes=0.03,5",
            "imu.gaps=0.05,10@60..240",
            "lbl.blackout@110..170",
            "ps.blackout@110..170",
        ],
    },
];

/// Runs the table and prints it as Markdown.
///
/// # Errors
/// [`TrialError`] of a setting, or of the clean runs.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    println!(
        "| sensors | fault | RMS H, m | U, m | H / clean, mean (max) | U / clean | beyond 3 sigma, % | NEES H | U | refused, reasons (share of the spoilt) | accepted after, s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for subset in SUBSETS {
        let sets: Vec<String> =
            subset.sets.iter().map(|set| (*set).to_owned()).chain(args.sets.iter().cloned()).collect();
        let is_wanted =
            |row: &str| args.only.as_deref().is_none_or(|only| row.contains(only) || subset.name.contains(only));
        let rows: Vec<&str> = subset.rows.iter().copied().filter(|row| is_wanted(row)).collect();
        if rows.is_empty() {
            continue;
        }
        let clean = clean_runs(1..=args.seeds, &sets)?;
        println!("{}", line(subset.name, "none", &clean.iter().collect::<Vec<&Trace>>(), &clean, 0));
        let runs: Vec<FaultRun> = rows
            .iter()
            .flat_map(|row| {
                let (faults, sets) = (specs(row), sets.clone());
                (1..=args.seeds).map(move |seed| FaultRun {
                    setting: Setting::AsItIs,
                    faults: faults.clone(),
                    sets: sets.clone(),
                    seed,
                })
            })
            .collect();
        let outcomes = in_parallel(&runs, FaultRun::run)?;
        for (row, outcomes) in rows.iter().zip(outcomes.chunks(args.seeds as usize)) {
            let traces: Vec<&Trace> = outcomes.iter().filter_map(|outcome| outcome.as_ref().ok()).collect();
            println!("{}", line(subset.name, row, &traces, &clean, outcomes.len() - traces.len()));
        }
    }
    Ok(())
}

/// Specs of a row, parted by blanks.
fn specs(row: &str) -> Vec<FaultSpec> {
    row.split(' ').map(|text| text.parse().expect("the rows of the house parse; a test reads them all")).collect()
}

fn line(sensors: &str, fault: &str, traces: &[&Trace], clean: &[Trace], panics: usize) -> String {
    let mean =
        |of: &dyn Fn(&Trace) -> f64| traces.iter().map(|trace| of(trace)).sum::<f64>() / traces.len().max(1) as f64;
    let rms = [0, 1].map(|part| mean(&|trace| trace.rms_since(f64::MIN)[part]));
    let nees = [0, 1].map(|part| mean(&|trace| trace.nees()[part]));
    let ratios = |part: usize| -> Vec<f64> {
        let of = |trace: &Trace| trace.rms_since(f64::MIN)[part];
        traces.iter().zip(clean).map(|(trace, clean)| of(trace) / of(clean)).collect()
    };
    let average = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let (horizontal, vertical) = (ratios(0), ratios(1));
    let outside = traces.iter().map(|trace| trace.outside()).fold((0, 0), |sum, next| (sum.0 + next.0, sum.1 + next.1));
    let mark = if average(&horizontal) > 1.25 { " !" } else { "" };
    format!(
        "| {sensors} | `{fault}` | {:.3} | {:.3} | {} ({}){mark} | {} | {:.2} | {} | {} | {} | {} |{}",
        rms[0],
        rms[1],
        number(average(&horizontal)),
        number(horizontal.iter().copied().fold(0.0, f64::max)),
        number(average(&vertical)),
        100.0 * outside.0 as f64 / outside.1.max(1) as f64,
        number(nees[0]),
        number(nees[1]),
        refusals(traces, clean),
        accepted(traces),
        if panics > 0 { format!(" {panics} runs panicked") } else { String::new() }
    )
}

/// Mean number of refusals beyond those of the clean runs, by sensor and reason.
fn refusals(traces: &[&Trace], clean: &[Trace]) -> String {
    let mut parts = Vec::new();
    for sensor in SENSORS {
        let index = sensor.index();
        let mut reasons = Vec::new();
        let mut total = 0.0;
        for reason in REJECT_REASONS {
            let of = |trace: &Trace| trace.rejected[index][reason.index()] as f64;
            let more: f64 = traces.iter().zip(clean).map(|(trace, clean)| of(trace) - of(clean)).sum::<f64>()
                / traces.len().max(1) as f64;
            if more.abs() >= 0.5 {
                reasons.push(format!("{} {more:+.0}", reason.name()));
                total += more;
            }
        }
        if !reasons.is_empty() {
            let spoilt = spoilt(traces, sensor);
            let share = if spoilt > 0.0 { format!(" ({:.0} %)", 100.0 * total / spoilt) } else { String::new() };
            parts.push(format!("{sensor} {}{share}", reasons.join(", ")));
        }
    }
    if parts.is_empty() { "–".to_owned() } else { parts.join("; ") }
}

/// Mean number of readings of a sensor that were changed or sent twice.
fn spoilt(traces: &[&Trace], sensor: Sensor) -> f64 {
    let all = traces.iter().flat_map(|trace| &trace.tallies).filter(|(spec, _)| spec.sensor() == sensor);
    all.map(|(_, tally)| (tally.touched + tally.repeated) as f64).sum::<f64>() / traces.len().max(1) as f64
}

/// The longest time from the end of a blackout, jump or disturbance to the first reading accepted, s.
fn accepted(traces: &[&Trace]) -> String {
    let longest = traces.iter().filter_map(|trace| {
        let specs: Vec<FaultSpec> = trace.tallies.iter().map(|(spec, _)| spec.clone()).collect();
        let end = time_of(&specs).to;
        let (spec, _) = trace.tallies.first().filter(|(spec, _)| end.is_finite() && spec.sensor() != Sensor::Imu)?;
        Some(trace.accepted_after(spec.sensor(), end).unwrap_or(f64::INFINITY))
    });
    longest.reduce(f64::max).map_or_else(|| "–".to_owned(), number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_parses() {
        assert!(SUBSETS.iter().flat_map(|subset| subset.rows).all(|row| !specs(row).is_empty()));
    }
}
