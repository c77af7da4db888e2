//! `smoother-gain`: what a smoother buys that a filter cannot: outliers, a wrong start, late data.

use ilns_replay::figure::BarFigure;
use sim_faults::FaultSpec;

use super::bench::{Args, Bench, BenchError, ILNS, lower_in, over};
use super::ekf_comparison::word;
use super::section::{Section, Table, Verdict};
use super::spread::{Spread, Standing};
use crate::trial::{Outcome, Trial};

struct Condition {
    name: &'static str,
    faults: &'static [&'static str],
    /// deg.
    initial_heading_error: f64,
}

const CONDITIONS: [Condition; 5] = [
    Condition { name: "clean", faults: &[], initial_heading_error: 0.0 },
    Condition { name: "10 % multipath", faults: &["lbl.multipath=0.1"], initial_heading_error: 0.0 },
    Condition { name: "30° heading", faults: &[], initial_heading_error: 30.0 },
    Condition { name: "5 s late", faults: &["lbl.delay=5"], initial_heading_error: 0.0 },
    Condition { name: "all three", faults: &["lbl.multipath=0.1", "lbl.delay=5"], initial_heading_error: 30.0 },
];
const METHODS: [(&str, &str); 3] = [("EKF", "estimator=ekf"), ("FKF", "estimator=fkf"), ("FGO", "estimator=fgo")];
const FGO: usize = 2;
/// Turns and the dive, s.
const UNTIL: f64 = 700.0;

/// Runs it.
///
/// # Errors
/// A trial that cannot be run, a file that cannot be written.
pub fn run(args: &Args) -> Result<Section, BenchError> {
    let bench = Bench::new(args, "smoother-gain");
    let mut section = bench.section(
        "What the smoother buys",
        "The first 700 s of the mission with the errors of Table I: IMU, raw ranges, depth; window 20. Multipath lengthens each range with a \
         probability of 10 % by 5 to 300 m. The heading is wrong by 30° at the start and its sigma says so. Ranges arrive 5 s late, with right \
         stamps; filters roll back. `batch`: the whole run at once, every state with what came after it.",
    );
    let trial = |condition: &Condition, seed: u64, estimator: &str| {
        let parse = |fault: &&str| fault.parse::<FaultSpec>().expect("a test reads them all");
        Trial {
            faults: condition.faults.iter().map(parse).collect(),
            initial_heading_error: condition.initial_heading_error.to_radians(),
            until: bench.until(UNTIL),
            ..bench.trial("mission", seed, &[&ILNS[..], &[estimator]].concat())
        }
    };
    let mut rows: Vec<Vec<Trial>> = Vec::new();
    for condition in &CONDITIONS {
        for (_, estimator) in METHODS {
            rows.push(bench.seeds(|seed| trial(condition, seed, estimator)));
        }
    }
    let outcomes = bench.outcomes("filters", &rows)?;
    let batches: Vec<Vec<Trial>> =
        CONDITIONS.iter().map(|condition| bench.seeds(|seed| trial(condition, seed, METHODS[FGO].1))).collect();
    let batches = bench.rows("batch", &batches, Trial::smooth)?;

    let horizontal = |row: &[Outcome]| over(row, |run| run.score.rms_horizontal);
    let mut table = Table {
        caption: "Outliers, a wrong start, late data".to_owned(),
        head: [
            "condition",
            "method",
            "RMS horizontal, m",
            "largest horizontal, m",
            "RMS up, m",
            "heading, deg",
            "FGO to it",
        ]
        .map(str::to_owned)
        .into(),
        note: "`tie`: the means differ by less than the spread of one seed.".to_owned(),
        rows: Vec::new(),
    };
    let mut standings = Vec::new();
    for (at, condition) in CONDITIONS.iter().enumerate() {
        let of_condition = &outcomes[at * METHODS.len()..][..METHODS.len()];
        let fgo = horizontal(&of_condition[FGO]);
        for (method, ((name, _), row)) in METHODS.iter().zip(of_condition).enumerate() {
            let standing = (method != FGO).then(|| fgo.against(&horizontal(row)));
            standings.extend(standing);
            table.rows.push(vec![
                condition.name.to_owned(),
                (*name).to_owned(),
                horizontal(row).text(),
                over(row, |run| run.score.max_horizontal).text(),
                over(row, |run| run.score.rms_enu[2]).text(),
                over(row, |run| run.score.attitude_rms_deg.map_or(f64::NAN, |rms| rms[2])).text(),
                standing.map_or(String::new(), |standing| word(standing).to_owned()),
            ]);
        }
        let batch = |figure: &dyn Fn(&nav_evaluation::Score) -> f64| {
            Spread::of(batches[at].iter().map(|run| figure(&run.score))).text()
        };
        table.rows.push(vec![
            condition.name.to_owned(),
            "batch".to_owned(),
            batch(&|score| score.rms_horizontal),
            batch(&|score| score.max_horizontal),
            batch(&|score| score.rms_enu[2]),
            batch(&|score| score.attitude_rms_deg.map_or(f64::NAN, |rms| rms[2])),
            String::new(),
        ]);
    }
    section.tables.push(table);
    let series = |method: usize| {
        let rows = outcomes.iter().skip(method).step_by(METHODS.len());
        let bars = rows.map(|row| over(row, |run| run.score.rms_horizontal));
        (METHODS[method].0.to_owned(), bars.map(|spread| Some([spread.mean, spread.sd])).collect())
    };
    let batch_bars = batches.iter().map(|row| Spread::of(row.iter().map(|run| run.score.rms_horizontal)));
    let batch = ("batch".to_owned(), batch_bars.map(|spread| Some([spread.mean, spread.sd])).collect());
    let svg = BarFigure {
        title: "Horizontal error by condition".to_owned(),
        y_label: "RMS horizontal, m".to_owned(),
        groups: CONDITIONS.iter().map(|condition| condition.name.to_owned()).collect(),
        series: (0..METHODS.len()).map(series).chain([batch]).collect(),
    }
    .svg();
    section.figure(&args.out, "conditions", &svg, "Mean and spread of one seed over seeds.".to_owned())?;
    let higher = standings.iter().filter(|standing| **standing == Standing::Higher).count();
    let lower = standings.iter().filter(|standing| **standing == Standing::Lower).count();
    let pairs = outcomes.chunks(METHODS.len()).flat_map(|row| (0..FGO).map(|filter| lower_in(&row[FGO], &row[filter])));
    let (below, runs) = pairs.fold((0, 0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
    let batch_gain = outcomes.chunks(METHODS.len()).zip(&batches).map(|(row, batch)| {
        horizontal(&row[FGO]).mean / Spread::of(batch.iter().map(|run| run.score.rms_horizontal)).mean
    });
    let (least, most) = batch_gain.fold((f64::INFINITY, 0.0_f64), |(low, high), gain| (low.min(gain), high.max(gain)));
    section.claim(
        "Factor graphs suppress outliers and linearisation errors better than filters.",
        Verdict::of(lower > 0 && higher == 0),
        format!(
            "newest estimate against EKF and FKF: lower in {lower}, higher in {higher} of {} cells, else a tie, and seed by seed lower in {below} \
             of {runs} runs: with the same gates and kernels a filter survives all of this. What it cannot do is look back: the batch is {least:.1} \
             to {most:.1} times better than the newest estimate, and late data and outliers cost it next to nothing",
            standings.len()
        ),
    );
    bench.finish(section)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_of_the_conditions_parses() {
        for fault in CONDITIONS.iter().flat_map(|condition| condition.faults) {
            assert!(fault.parse::<FaultSpec>().is_ok(), "{fault}");
        }
    }
}
