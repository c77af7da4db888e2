//! `pf`: readings taken as if at the keyframe (PF), carried forward (FPF), carried forward or backward (FBPF); Fig. 5.

use ilns_replay::figure::{Curve, CurveFigure, Panel};

use super::bench::{Args, Bench, BenchError, over, rms};
use super::section::{Section, Table, Verdict};
use super::spread::{Spread, Standing, number};
use crate::trial::{Change, Outcome, Trial};

/// After the ping, s.
const OFFSETS: [f64; 6] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
const METHODS: [(&str, &str); 3] =
    [("PF", "keyframes.anchor=pf"), ("FPF", "keyframes.anchor=fpf"), ("FBPF", "keyframes.anchor=fbpf")];
/// Otherwise the detector would take what PF does to a stamp for a late clock, and mend a part of it.
const STAMPS_BELIEVED: [&str; 6] = [
    "lbl.time_offset=off",
    "gnss.time_offset=off",
    "dvl.time_offset=off",
    "mcp.time_offset=off",
    "ps.time_offset=off",
    "lbl.calibrate=false",
];
/// Dive, turn and a part of the weaving, s.
const UNTIL: f64 = 700.0;

/// Runs it.
///
/// # Errors
/// A trial that cannot be run, a file that cannot be written.
pub fn run(args: &Args) -> Result<Section, BenchError> {
    let bench = Bench::new(args, "pf");
    let mut section = bench.section(
        "PF, FPF and FBPF: sensors off the keyframes",
        "The first 700 s of the mission (turns, dive, weaving) with the errors of Table I. DVL, MCP, PS and GNSS read once a second, all of them \
         so long after the ping that makes the keyframe. Stamps are right and believed.",
    );
    let mut rows: Vec<Vec<Trial>> = Vec::new();
    for offset in OFFSETS {
        for (_, anchor) in METHODS {
            rows.push(bench.seeds(|seed| Trial {
                change: Change::AfterPing(offset),
                until: bench.until(UNTIL),
                curve_every: None,
                ..bench.trial("mission", seed, &[&STAMPS_BELIEVED[..], &[anchor]].concat())
            }));
        }
    }
    let outcomes = bench.outcomes("offsets", &rows)?;
    let of = |offset: usize, method: usize| &outcomes[offset * METHODS.len() + method];
    let mut table = Table {
        caption: "RMS error by offset of the sensors".to_owned(),
        head: ["offset, s", "method", "E, m", "N, m", "U, m", "heading, deg"].map(str::to_owned).into(),
        note: "The paper shows the three as factor graphs, without figures.".to_owned(),
        rows: Vec::new(),
    };
    for (at, offset) in OFFSETS.iter().enumerate() {
        for (method, (name, _)) in METHODS.iter().enumerate() {
            let row = of(at, method);
            let [east, north, up] = rms(row).map(|spread| spread.text());
            table.rows.push(vec![number(*offset), (*name).to_owned(), east, north, up, heading(row).text()]);
        }
    }
    section.tables.push(table);
    let horizontal = |row: &[Outcome]| over(row, |run| run.score.rms_horizontal);
    let curve = |method: usize, figure: &dyn Fn(&[Outcome]) -> Spread| {
        let spread = |at: usize| figure(of(at, method));
        Curve {
            name: METHODS[method].0.to_owned(),
            points: (0..OFFSETS.len()).map(|at| [OFFSETS[at], spread(at).mean]).collect(),
            band: Vec::new(),
        }
    };
    let panel = |label: &str, figure: &dyn Fn(&[Outcome]) -> Spread| Panel {
        y_label: label.to_owned(),
        curves: (0..METHODS.len()).map(|method| curve(method, figure)).collect(),
        y_range: None,
    };
    let svg = CurveFigure {
        title: "Error by offset of the sensors".to_owned(),
        x_label: "readings after the ping, s".to_owned(),
        panels: vec![panel("horizontal, m", &horizontal), panel("heading, deg", &heading)],
        ..CurveFigure::default()
    }
    .svg();
    section.figure(&args.out, "offsets", &svg, "Mean RMS over seeds.".to_owned())?;
    let last = OFFSETS.len() - 1;
    let [pf, fpf, fbpf] = [0, 1, 2].map(|method| horizontal(of(last, method)));
    section.claim(
        "Sensor factors by forward and backward preintegration (FBPF) make full use of readings with a time offset, PF does not.",
        Verdict::of(fbpf.against(&pf) == Standing::Lower),
        format!("0.5 s off the keyframe: PF {} m, FBPF {} m horizontally", pf.text(), fbpf.text()),
    );
    section.claim(
        "FBPF is better than forward preintegration alone.",
        Verdict::of(fbpf.against(&fpf) == Standing::Lower),
        format!(
            "FPF {} m, FBPF {} m at 0.5 s: over a second the IMU carries a state almost without loss in either direction",
            fpf.text(),
            fbpf.text()
        ),
    );
    bench.finish(section)
}

fn heading(row: &[Outcome]) -> Spread {
    over(row, |run| run.score.attitude_rms_deg.map_or(f64::NAN, |rms| rms[2]))
}
