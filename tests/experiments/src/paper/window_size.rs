//! `i-a`: what the length of the window buys, and what it costs (Experiment I-a, Fig. 7).

use ilns_replay::figure::{BarFigure, Curve, CurveFigure, Panel};

use super::bench::{
    Args, Bench, BenchError, DIFFERENCES, ILNS, buoys_of, error_figure, horizontal_rms, over, plan_figure, rms,
};
use super::printed;
use super::section::{Section, Table, Verdict};
use super::spread::{Spread, Standing, number};
use crate::trial::{Outcome, Trial, median};

const WINDOWS: [u32; 6] = [10, 20, 30, 50, 100, 200];
/// The dive, where the paper's errors jump, s.
const DIVE: [f64; 2] = [400.0, 500.0];
/// The initial convergence is over, s.
const SETTLED: f64 = 100.0;

/// Runs it.
///
/// # Errors
/// A trial that cannot be run, a file that cannot be written.
pub fn run(args: &Args) -> Result<Section, BenchError> {
    let bench = Bench::new(args, "i-a");
    let mut section = bench.section(
        "I-a: the length of the window",
        "The mission of 2217 s with the errors of Table I (its two swapped rows put right): IMU, range differences of four buoys, depth. \
         Errors are those of the newest estimate at 200 Hz, from the start of the estimation on; `global` is the whole mission as one \
         batch, every state with what came after it too. CPU time of one thread.",
    );
    let trial = |window: u32, seed: u64| {
        let window = format!("fgo.window={window}");
        bench.trial("mission", seed, &[&ILNS[..], &[DIFFERENCES, &window]].concat())
    };
    let mut rows: Vec<Vec<Trial>> = WINDOWS.iter().map(|&window| bench.seeds(|seed| trial(window, seed))).collect();
    rows.push(bench.seeds(|seed| {
        let mut trial = trial(20, seed);
        trial.sets.push("ps.enabled=false".to_owned());
        trial
    }));
    let mut outcomes = bench.outcomes("windows", &rows)?;
    let without_depth = outcomes.pop().unwrap_or_default();
    let batch = bench.rows("batch", &[bench.seeds(|seed| trial(20, seed))], Trial::smooth)?.remove(0);
    let batch_rms = [0, 1, 2].map(|axis| Spread::of(batch.iter().map(|run| run.score.rms_enu[axis])));

    let mut table = Table {
        caption: "RMS error and run time by length of the window (the paper gives a figure only)".to_owned(),
        head: ["window", "E, m", "N, m", "U, m", "largest horizontal, m", "per keyframe, µs", "whole run, s of CPU"]
            .map(str::to_owned)
            .into(),
        note: "Paper: decimetres horizontally, 0.015 m up, SW = 20 the best.".to_owned(),
        rows: Vec::new(),
    };
    for (window, row) in WINDOWS.iter().zip(&outcomes) {
        let [east, north, up] = rms(row).map(|spread| spread.text());
        table.rows.push(vec![
            window.to_string(),
            east,
            north,
            up,
            over(row, |run| run.score.max_horizontal).text(),
            over(row, |run| median(&run.solve_us)).text(),
            over(row, |run| run.cpu_s).text(),
        ]);
    }
    let [east, north, up] = batch_rms.map(|spread| spread.text());
    let largest = Spread::of(batch.iter().map(|run| run.score.max_horizontal)).text();
    let seconds = Spread::of(batch.iter().map(|run| run.cpu_s));
    table.rows.push(vec!["global".to_owned(), east, north, up, largest, "–".to_owned(), seconds.text()]);
    let [east, north, up] = rms(&without_depth).map(|spread| spread.text());
    let largest = over(&without_depth, |run| run.score.max_horizontal).text();
    table.rows.push(vec!["20, no PS".to_owned(), east, north, up, largest, "–".to_owned(), "–".to_owned()]);
    section.tables.push(table);
    figures(&bench, &mut section, &outcomes, &batch_rms)?;
    claims(&mut section, &outcomes, &without_depth, &seconds);
    bench.finish(section)
}

fn figures(
    bench: &Bench<'_>,
    section: &mut Section,
    outcomes: &[Vec<Outcome>],
    batch_rms: &[Spread; 3],
) -> Result<(), BenchError> {
    let out = &bench.args.out;
    let (short, usual, long) = (&outcomes[0][0], &outcomes[1][0], &outcomes[5][0]);
    let runs = [("SW = 10", short), ("SW = 200", long), ("SW = 20", usual)];
    let svg = error_figure("Errors over time, seed 1", &runs).svg();
    section.figure(out, "errors", &svg, "Estimate minus truth; band: three sigmas of SW = 20.".to_owned())?;
    let buoys = buoys_of(&bench.trial("mission", 1, &ILNS))?;
    let svg = plan_figure("Trajectory, seed 1", &[("SW = 20", usual)], buoys).svg();
    section.figure(out, "trajectory", &svg, "Truth, estimate and buoys.".to_owned())?;
    let bars = |axis: usize| {
        let of_row = |row: &Vec<Outcome>| rms(row)[axis];
        let all = outcomes.iter().map(of_row).chain([batch_rms[axis]]);
        all.map(|spread| Some([spread.mean, spread.sd])).collect()
    };
    let names = WINDOWS.iter().map(ToString::to_string).chain(["global".to_owned()]);
    let svg = BarFigure {
        title: "RMS error by length of the window".to_owned(),
        y_label: "RMS, m".to_owned(),
        groups: names.collect(),
        series: vec![("east".to_owned(), bars(0)), ("north".to_owned(), bars(1)), ("up".to_owned(), bars(2))],
    }
    .svg();
    section.figure(out, "rms", &svg, "Mean and spread of one seed over seeds.".to_owned())?;
    let points = |figure: &dyn Fn(&Outcome) -> f64| -> Vec<[f64; 2]> {
        WINDOWS.iter().zip(outcomes).map(|(&window, row)| [f64::from(window), over(row, figure).mean]).collect()
    };
    let curve = |name: &str, points: Vec<[f64; 2]>| Curve { name: name.to_owned(), points, band: Vec::new() };
    let panel = Panel {
        y_label: "CPU per keyframe, µs".to_owned(),
        curves: vec![
            curve("median", points(&|run| median(&run.solve_us))),
            curve("99th percentile", points(&|run| run.solve_us[run.solve_us.len() * 99 / 100])),
        ],
        y_range: None,
    };
    let svg = CurveFigure {
        title: "Run time by length of the window".to_owned(),
        x_label: "window, keyframes".to_owned(),
        panels: vec![panel],
        is_logarithmic: true,
        shaded: Vec::new(),
    }
    .svg();
    section.figure(out, "time", &svg, "A keyframe comes every second.".to_owned())?;
    Ok(())
}

fn claims(section: &mut Section, outcomes: &[Vec<Outcome>], without_depth: &[Outcome], batch_seconds: &Spread) {
    let horizontal: Vec<Spread> = outcomes.iter().map(|row| over(row, |run| run.score.rms_horizontal)).collect();
    let means = horizontal.iter().map(|spread| spread.mean);
    let (low, high) = means.fold((f64::INFINITY, 0.0_f64), |(low, high), mean| (low.min(mean), high.max(mean)));
    section.claim(
        "The horizontal accuracy reaches the decimetre level for every window.",
        Verdict::of(high < 1.0),
        format!("{} to {} m horizontally", number(low), number(high)),
    );
    let up = outcomes.iter().map(|row| rms(row)[2].mean).fold(0.0, f64::max);
    section.claim(
        "The height error is stable at 0.015 m with SINS and LBL.",
        Verdict::of(rms(without_depth)[2].mean <= printed::HEIGHT),
        format!(
            "{} m with the pressure sensor, which the experiment does not name; {} m without it: differences of ranges to buoys at the surface tell \
             little of up",
            number(up),
            rms(without_depth)[2].text()
        ),
    );
    let jump = |row: &[Outcome]| {
        let ratios = row
            .iter()
            .filter_map(|run| Some(horizontal_rms(run, DIVE[0], DIVE[1])? / horizontal_rms(run, SETTLED, f64::MAX)?));
        let ratios: Vec<f64> = ratios.collect();
        (!ratios.is_empty()).then(|| Spread::of(ratios))
    };
    if let (Some(short), Some(long)) = (jump(&outcomes[1]), jump(&outcomes[5])) {
        section.claim(
            "The error jumps in the dive from 400 s to 500 s, most with SW = 20 and 30; longer windows suppress it.",
            Verdict::of(short.mean - short.sd > 1.0 && long.mean < short.mean - short.sd),
            format!(
                "error of the dive over that of the mission: {} with SW = 20, {} with SW = 200",
                short.text(),
                long.text()
            ),
        );
    }
    let us = |row: &[Outcome]| over(row, |run| median(&run.solve_us)).mean;
    section.claim(
        "Computation grows with the window, most for global optimisation.",
        Verdict::of(us(&outcomes[5]) > us(&outcomes[0])),
        format!(
            "{} µs per keyframe with SW = 10, {} with SW = 200; the batch of the whole mission takes {} s once, but would take that at every keyframe",
            number(us(&outcomes[0])),
            number(us(&outcomes[5])),
            number(batch_seconds.mean)
        ),
    );
    let spread = 100.0 * horizontal[1].sd / horizontal[1].mean;
    let within = 100.0 * (high / low - 1.0);
    section.claim(
        "A longer window does not noticeably improve accuracy.",
        Verdict::of(horizontal.iter().all(|other| other.against(&horizontal[1]) != Standing::Lower)),
        format!(
            "all windows lie within {within:.1} % of each other, where the spread of one seed is {spread:.0} %: with exact marginalisation the \
             newest state hardly depends on the window"
        ),
    );
    let others = || horizontal.iter().enumerate().filter(|(at, _)| *at != 1);
    section.claim(
        "SW = 20 is the best.",
        Verdict::of(others().all(|(_, other)| horizontal[1].against(other) == Standing::Lower)),
        format!("none is: the differences of {within:.1} % are ties"),
    );
    let slowest = outcomes.iter().flatten().flat_map(|run| run.solve_us.last().copied()).fold(0.0, f64::max);
    section.claim(
        "The sliding window makes the method fit for real time.",
        Verdict::of(slowest < 1e6),
        format!("the slowest keyframe of all took {} ms of the second that it has", number(slowest * 1e-3)),
    );
}
