//! `ii-a`: what further sensors add (Experiment II-a, Table III), and that none of them ever harms.

use shared_types::{AIDING, Sensor};

use super::bench::{Args, Bench, BenchError, DIFFERENCES, ILNS, error_figure, over, rms};
use super::ekf_comparison::word;
use super::printed::TABLE_3;
use super::section::{Section, Table, Verdict};
use super::spread::{Standing, number};
use crate::trial::{Change, Outcome, Trial};

/// Seeds of the table of subsets.
const SUBSET_SEEDS: u64 = 5;
/// Of the buoys of the subsets' mission, m.
const DEPTH: f64 = 50.0;
/// Turns, weaving and a change of speed, s.
const SUBSETS_UNTIL: f64 = 1000.0;
/// What a further sensor may add to the error at most.
const TOLERANCE: f64 = 1.05;

/// Runs it.
///
/// # Errors
/// A trial that cannot be run, a file that cannot be written.
pub fn run(args: &Args) -> Result<Section, BenchError> {
    let bench = Bench::new(args, "ii-a");
    let mut section = bench.section(
        "II-a: FGO-ILNS and FGO-ILNS plus",
        "The mission with the errors of Table I. FGO-ILNS: IMU, range differences, depth. FGO-ILNS plus: GNSS until the dive, DVL and MCP too. \
         The table of subsets has the first 1000 s of the mission without its dive, at the surface with satellites in view, over buoys moored 50 m deep, which tell of up too; raw ranges.",
    );
    let methods: [(u64, &str, &[&str]); 4] = [
        (30, "FGO", &[ILNS[0], ILNS[1], ILNS[2], DIFFERENCES, "fgo.window=30"]),
        (30, "FGO plus", &[DIFFERENCES, "fgo.window=30"]),
        (20, "FGO", &[ILNS[0], ILNS[1], ILNS[2], DIFFERENCES]),
        (20, "FGO plus", &[DIFFERENCES]),
    ];
    let rows: Vec<Vec<Trial>> =
        methods.iter().map(|(_, _, sets)| bench.seeds(|seed| bench.trial("mission", seed, sets))).collect();
    let outcomes = bench.outcomes("sensors", &rows)?;
    let mut table = Table {
        caption: "Table III: RMS error by window and sensors".to_owned(),
        head: ["window", "method", "E, m", "N, m", "paper E / N, m", "plus to FGO"].map(str::to_owned).into(),
        note: "The paper's plus is worse north with SW = 20, and the same to two digits for both windows.".to_owned(),
        rows: Vec::new(),
    };
    let mut below_paper = true;
    let mut always_better = true;
    for ((window, method, _), row) in methods.iter().zip(&outcomes) {
        let cells = rms(row);
        let printed =
            TABLE_3.iter().find(|row| (row.0, row.1) == (*window, *method)).map_or([f64::NAN; 2], |row| row.2);
        below_paper &= cells[0].mean < printed[0] && cells[1].mean < printed[1];
        let standing = if *method == "FGO plus" {
            let without = rms(&outcomes[if *window == 30 { 0 } else { 2 }]);
            let standings = [0, 1].map(|axis| cells[axis].against(&without[axis]));
            always_better &= !standings.contains(&Standing::Higher);
            standings.map(word).join(" / ")
        } else {
            String::new()
        };
        let [pe, pn] = printed;
        let head = [window.to_string(), (*method).to_owned()].into_iter();
        let figures = [cells[0].text(), cells[1].text(), format!("{pe} / {pn}"), standing];
        table.rows.push(head.chain(figures).collect());
    }
    section.tables.push(table);
    let runs = [("FGO-ILNS", &outcomes[2][0]), ("FGO-ILNS plus", &outcomes[3][0])];
    let svg = error_figure("Errors, SW = 20, seed 1", &runs).svg();
    section.figure(
        &args.out,
        "errors",
        &svg,
        "Estimate minus truth; band: three sigmas of FGO-ILNS plus.".to_owned(),
    )?;
    section.claim(
        "RMS of FGO-ILNS plus: 0.55 / 0.45 m; of FGO-ILNS: 0.87 / 0.52 m (SW = 30), 0.67 / 0.28 m (SW = 20).",
        Verdict::of(below_paper),
        if below_paper {
            "below the printed figure in every cell"
        } else {
            "not below the printed figure in every cell"
        }
        .to_owned(),
    );
    let horizontal = |row: usize| over(&outcomes[row], |run| run.score.rms_horizontal);
    section.claim(
        "Further sensors improve the accuracy (the paper's own table loses 60.7 % north with SW = 20).",
        Verdict::of(always_better && horizontal(3).mean < horizontal(2).mean),
        format!("{} m to {} m horizontally with SW = 20", horizontal(2).text(), horizontal(3).text()),
    );
    subsets(&bench, &mut section)?;
    bench.finish(section)
}

/// Sets of aiding sensors, as bits in the order of [`AIDING`], that hold LBL or GNSS.
fn positioned() -> Vec<u32> {
    let bit = |sensor: Sensor| 1 << AIDING.iter().position(|&aiding| aiding == sensor).expect("it is an aiding sensor");
    let fixes = bit(Sensor::Lbl) | bit(Sensor::Gnss);
    (0..1_u32 << AIDING.len()).filter(|set| set & fixes != 0).collect()
}

fn names(set: u32) -> String {
    let of_set = AIDING.iter().enumerate().filter(|(at, _)| set >> at & 1 == 1);
    of_set.map(|(_, sensor)| sensor.name().to_uppercase()).collect::<Vec<_>>().join(" ")
}

fn subsets(bench: &Bench<'_>, section: &mut Section) -> Result<(), BenchError> {
    let sets = positioned();
    let seeds = bench.args.seeds.min(SUBSET_SEEDS);
    let trial = |set: u32, seed: u64| {
        let off = AIDING.iter().enumerate().filter(|(at, _)| set >> at & 1 == 0);
        let off: Vec<String> = off.map(|(_, sensor)| format!("{}.enabled=false", sensor.name())).collect();
        let off: Vec<&str> = off.iter().map(String::as_str).collect();
        let until = bench.until(SUBSETS_UNTIL);
        Trial { until, change: Change::OverMoorings(DEPTH), curve_every: None, ..bench.trial("mission", seed, &off) }
    };
    let rows: Vec<Vec<Trial>> = sets.iter().map(|&set| (1..=seeds).map(|seed| trial(set, seed)).collect()).collect();
    let outcomes = bench.outcomes("subsets", &rows)?;
    let of = |set: u32| sets.iter().position(|&other| other == set).map(|at| &outcomes[at]);
    let error = |row: &Vec<Outcome>| over(row, |run| run.score.rms_3d);
    let mut table = Table {
        caption: format!("All 24 sets of sensors with the IMU and LBL or GNSS ({seeds} seeds)"),
        head: ["IMU and", "E, m", "N, m", "U, m", "in space, m", "worst change by a further sensor"]
            .map(str::to_owned)
            .into(),
        note: "The change is that of the mean RMS in space; a further sensor may never add more than 5 %.".to_owned(),
        rows: Vec::new(),
    };
    let mut worst: (f64, String) = (0.0, String::new());
    for (&set, row) in sets.iter().zip(&outcomes) {
        let added = (0..AIDING.len()).filter(|at| set >> at & 1 == 0).filter_map(|at| {
            let more = error(of(set | 1 << at)?);
            Some((more.mean / error(row).mean, AIDING[at].name().to_uppercase()))
        });
        let added = added.max_by(|a, b| a.0.total_cmp(&b.0));
        let change = added.map_or("–".to_owned(), |(ratio, name)| {
            if ratio > worst.0 {
                worst = (ratio, format!("{name} added to {}", names(set)));
            }
            let mark = if ratio > TOLERANCE { " (!)" } else { "" };
            format!("{:+.1} % ({name}){mark}", 100.0 * (ratio - 1.0))
        });
        let [east, north, up] = rms(row).map(|spread| spread.text());
        table.rows.push(vec![names(set), east, north, up, error(row).text(), change]);
    }
    section.tables.push(table);
    let (ratio, what) = worst;
    section.claim(
        "The fusion of more sensors is never worse (shown here for every set, not only the paper's two).",
        Verdict::of(ratio <= TOLERANCE),
        format!("worst of all: {what}, {} %", number(100.0 * (ratio - 1.0))),
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twenty_four_sets_hold_a_sensor_of_position() {
        let sets = positioned();
        assert_eq!(sets.len(), 24);
        assert!(sets.iter().all(|&set| names(set).contains("LBL") || names(set).contains("GNSS")));
    }
}
