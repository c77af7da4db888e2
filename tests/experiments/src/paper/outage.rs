//! `ii-b`: out of the reach of the buoys for 100 s, then up to the satellites (Experiment II-b, Fig. 10).

use ilns_replay::figure::{BarFigure, CurveFigure, Panel};

use super::bench::{Args, Bench, BenchError, error_curve, over};
use super::ekf_comparison::word;
use super::section::{Section, Table, Verdict};
use super::spread::{Spread, Standing};
use crate::trial::{Change, Outcome, Trial};

/// LBL and DVL are lost, s; GNSS comes back at the end.
const OUTAGE: [f64; 2] = [1683.0, 1783.0];
/// Shown in the figure around it, s.
const SHOWN: [f64; 2] = [1640.0, 1830.0];
/// Converged again, m.
const CONVERGED: f64 = 0.1;
/// Both readings of the paper.
const READINGS: [(&str, Change); 2] = [("lost", Change::Nothing), ("kept", Change::McpKept)];
const METHODS: [(&str, &[&str]); 6] = [
    ("FKF plus", &["estimator=fkf"]),
    ("EKF plus", &["estimator=ekf"]),
    ("FGO plus, SW = 50", &["fgo.window=50"]),
    ("FGO plus, SW = 100", &["fgo.window=100"]),
    ("FGO plus, SW = 150", &["fgo.window=150"]),
    ("FGO plus, SW = 200", &["fgo.window=200"]),
];
const FIRST_FGO: usize = 2;
/// SW = 100.
const HUNDRED: usize = 3;

/// Runs it.
///
/// # Errors
/// A trial that cannot be run, a file that cannot be written.
pub fn run(args: &Args) -> Result<Section, BenchError> {
    let bench = Bench::new(args, "ii-b");
    let mut section = bench.section(
        "II-b: an outage of 100 s",
        "The outage mission with the errors of Table I, all sensors, raw ranges. From 1683 s to 1783 s LBL and DVL are lost while the vehicle \
         climbs; the paper says in one place that the MCP is lost too and in another that it is not: both are run. GNSS comes at 1783 s.",
    );
    let mut rows: Vec<Vec<Trial>> = Vec::new();
    for (_, change) in READINGS {
        for (_, sets) in METHODS {
            rows.push(bench.seeds(|seed| Trial {
                change,
                curve_every: Some(0.5),
                ..bench.trial("outage", seed, sets)
            }));
        }
    }
    let outcomes = bench.outcomes("outage", &rows)?;
    for ((reading, _), outcomes) in READINGS.iter().zip(outcomes.chunks(METHODS.len())) {
        section.tables.push(table(reading, outcomes));
        figures(args, &mut section, reading, outcomes)?;
    }
    claims(&mut section, &outcomes);
    bench.finish(section)
}

/// Largest horizontal error from the beginning of the outage to a minute after it, m.
fn drift(outcome: &Outcome) -> f64 {
    let during = outcome.curve.iter().filter(|point| OUTAGE[0] <= point.t && point.t <= OUTAGE[1] + 60.0);
    during.map(|point| point.error_enu[0].hypot(point.error_enu[1])).fold(0.0, f64::max)
}

/// From the first fix to the last horizontal error beyond [`CONVERGED`] within a minute, s.
fn converged_after(outcome: &Outcome) -> f64 {
    let after = outcome.curve.iter().filter(|point| OUTAGE[1] <= point.t && point.t <= OUTAGE[1] + 60.0);
    let mut large = after.filter(|point| point.error_enu[0].hypot(point.error_enu[1]) > CONVERGED);
    large.next_back().map_or(0.0, |point| point.t - OUTAGE[1])
}

/// Largest horizontal error in sigmas of its axis during the outage.
fn worst_sigmas(outcome: &Outcome) -> f64 {
    let during = outcome.curve.iter().filter(|point| OUTAGE[0] <= point.t && point.t <= OUTAGE[1]);
    let sigmas = during.flat_map(|point| [0, 1].map(|axis| (point.error_enu[axis] / point.sigma_enu[axis]).abs()));
    sigmas.fold(0.0, f64::max)
}

fn table(reading: &str, outcomes: &[Vec<Outcome>]) -> Table {
    let fkf = over(&outcomes[0], drift);
    let line = |((name, _), row): (&(&str, &[&str]), &Vec<Outcome>)| {
        let drift = over(row, drift);
        vec![
            (*name).to_owned(),
            drift.text(),
            over(row, worst_sigmas).text(),
            over(row, converged_after).text(),
            over(row, |run| run.score.rms_horizontal).text(),
            if name.starts_with("FGO") { word(drift.against(&fkf)).to_owned() } else { String::new() },
        ]
    };
    Table {
        caption: format!("Outage of LBL and DVL with the MCP {reading}"),
        head: [
            "method",
            "largest drift, m",
            "largest error, sigmas",
            "below 0.1 m after, s",
            "RMS horizontal of the mission, m",
            "drift to FKF",
        ]
        .map(str::to_owned)
        .into(),
        rows: METHODS.iter().zip(outcomes).map(line).collect(),
        note: "The paper gives the drift in a figure only: FKF the largest, SW = 100 the smallest.".to_owned(),
    }
}

fn figures(args: &Args, section: &mut Section, reading: &str, outcomes: &[Vec<Outcome>]) -> Result<(), BenchError> {
    let shown = |outcome: &Outcome| {
        let mut outcome = outcome.clone();
        outcome.curve.retain(|point| SHOWN[0] <= point.t && point.t <= SHOWN[1]);
        outcome
    };
    let runs: Vec<(&str, Outcome)> = [0, FIRST_FGO, HUNDRED].map(|at| (METHODS[at].0, shown(&outcomes[at][0]))).into();
    let panel = |(axis, name): (usize, &str)| Panel {
        y_label: format!("{name}, m"),
        curves: runs.iter().enumerate().map(|(at, (name, run))| error_curve(name, run, axis, at == 2)).collect(),
        y_range: None,
    };
    let figure = CurveFigure {
        title: format!("Errors around the outage, MCP {reading}, seed 1"),
        x_label: "time, s".to_owned(),
        panels: [(0, "east"), (1, "north")].map(panel).into(),
        shaded: vec![OUTAGE],
        is_logarithmic: false,
    };
    let caption = "Estimate minus truth; shaded: the outage; band: three sigmas of SW = 100.".to_owned();
    section.figure(&args.out, &format!("errors-{reading}"), &figure.svg(), caption)?;
    let bars = |figure: fn(&Outcome) -> f64| {
        outcomes.iter().map(|row| over(row, figure)).map(|spread| Some([spread.mean, spread.sd])).collect()
    };
    let figure = BarFigure {
        title: format!("Largest drift, MCP {reading}"),
        y_label: "largest horizontal error, m".to_owned(),
        groups: ["FKF", "EKF", "SW 50", "SW 100", "SW 150", "SW 200"].map(str::to_owned).into(),
        series: vec![("mean and spread of one seed".to_owned(), bars(drift))],
    };
    section.figure(
        &args.out,
        &format!("drift-{reading}"),
        &figure.svg(),
        "From 1683 s to a minute after the outage.".to_owned(),
    )?;
    Ok(())
}

fn claims(section: &mut Section, outcomes: &[Vec<Outcome>]) {
    let of = |figure: fn(&Outcome) -> f64| outcomes.iter().map(|row| over(row, figure)).collect::<Vec<Spread>>();
    let drifts = of(drift);
    let fgo = |reading: usize| &drifts[reading * METHODS.len() + FIRST_FGO..(reading + 1) * METHODS.len()];
    let fkf = |reading: usize| drifts[reading * METHODS.len()];
    let standings: Vec<Standing> = (0..2)
        .flat_map(|reading| fgo(reading).iter().map(move |spread| (reading, *spread)))
        .map(|(reading, spread)| spread.against(&fkf(reading)))
        .collect();
    let lower = standings.iter().filter(|standing| **standing == Standing::Lower).count();
    let higher = standings.iter().filter(|standing| **standing == Standing::Higher).count();
    section.claim(
        "The drift of FGO-ILNS plus is smaller than that of FKF-ILNS plus for every window.",
        Verdict::of(lower == standings.len()),
        format!(
            "MCP lost: FKF {} m, SW = 100 {} m; kept: {} m, {} m; lower in {lower}, higher in {higher} of {} cells, else a tie: with neither \
             positions nor velocities nobody has anything to smooth, and the drift is that of the last state's own errors",
            fkf(0).text(),
            drifts[HUNDRED].text(),
            fkf(1).text(),
            drifts[METHODS.len() + HUNDRED].text(),
            standings.len()
        ),
    );
    let reach = |reading: usize| {
        let means = fgo(reading).iter().map(|spread| spread.mean);
        means.fold((f64::INFINITY, 0.0_f64), |(low, high), mean| (low.min(mean), high.max(mean)))
    };
    let (low, high) = reach(0);
    section.claim(
        "The drift is smallest with SW = 100.",
        Verdict::of(fgo(0).iter().all(|other| drifts[HUNDRED].mean <= other.mean) && high / low > 1.05),
        format!("the four windows lie within {:.2} % of each other", 100.0 * (high / low - 1.0)),
    );
    let after = of(converged_after);
    section.claim(
        "Once GNSS is received, the errors decrease dramatically.",
        Verdict::of(after[HUNDRED].mean < 10.0),
        format!(
            "below {CONVERGED} m for good {} s after the first fix (SW = 100), {} s (FKF)",
            after[HUNDRED].text(),
            after[0].text()
        ),
    );
}
