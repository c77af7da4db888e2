//! `iii`: recorded drives, and urban38 where it is at hand (Experiment III, Table IV).

use std::path::{Path, PathBuf};

use clap::Parser;
use ilns_recording::{LogDirectory, LogError};
use ilns_replay::{ConvertArgs, ReplayError, convert};
use nav_evaluation::{EstimatePoint, Score, Scorer, Window};
use nav_geometry::Geodetic;
use nav_pipeline::{Navigator, Output, Rebase, Unmeasured};
use shared_types::{BuoyFix, Config, Duration, Mode, NavEstimate, RawReading, Truth};

use super::bench::{Args, Bench, BenchError};
use super::printed::TABLE_4;
use super::section::{Section, Table, Verdict};
use super::spread::number;
use super::withheld;
use crate::parallel::in_parallel_on;

/// Every reading counts as much as its sigma says.
const LEAST_SQUARES: [&str; 3] = ["lbl.kernel=none", "dvl.kernel=none", "ps.kernel=none"];

const METHODS: [(&str, &[&str]); 9] = [
    ("SW = 10", &["fgo.window=10"]),
    ("SW = 20", &["fgo.window=20"]),
    ("SW = 50", &["fgo.window=50"]),
    ("SW = 100", &["fgo.window=100"]),
    ("EKF", &["estimator=ekf"]),
    ("FKF", &["estimator=fkf"]),
    ("SW = 20, least squares", &LEAST_SQUARES),
    ("EKF, least squares", &["estimator=ekf", LEAST_SQUARES[0], LEAST_SQUARES[1], LEAST_SQUARES[2]]),
    (BATCH, &[]),
];
const BATCH: &str = "batch";
const USUAL: usize = 1;
const EKF: usize = 4;
const FKF: usize = 5;
/// As in the paper: ranges, not satellites, say where the vehicle is.
const NO_GNSS: &str = "gnss.enabled=false";

/// Runs it.
///
/// # Errors
/// A log that cannot be read, a file that cannot be written.
pub fn run(args: &Args) -> Result<Section, BenchError> {
    let bench = Bench::new(args, "iii");
    let mut section = bench.section(
        "III: recorded drives",
        "Real inertial data; ranges to four buoys simulated from the reference, as in the paper; GNSS withheld. A car (KITTI), a rover on \
         planetary terrain, a small underwater vehicle in a fjord. The error is that of `evo_ape` without alignment: root mean square of the \
         distance in space between the newest estimate and the reference. References are smoothers over the same logs and good to decimetres.",
    );
    section.seeds = "recorded logs, nothing is drawn".to_owned();
    let folder = tempfile::tempdir().map_err(|source| ReplayError::Io {
        file: std::env::temp_dir(),
        action: "make a folder in",
        source,
    })?;
    let mut logs = recorded_logs();
    if let Some(dir) = &args.kaist {
        let log = folder.path().join("kaist");
        convert_kaist(dir, &log)?;
        logs.push((dir.file_name().map_or("kaist".to_owned(), |name| name.to_string_lossy().into_owned()), log));
    }
    let runs: Vec<(&Path, &str, &[&str])> =
        logs.iter().flat_map(|(_, log)| METHODS.map(|(name, sets)| (log.as_path(), name, sets))).collect();
    let scores = in_parallel_on(bench.threads(), &runs, |(log, name, sets)| score(log, name, sets))?;
    let mut table = Table {
        caption: "Absolute trajectory error, m (horizontal part in brackets)".to_owned(),
        head: ["log", "length"].into_iter().chain(METHODS.map(|(name, _)| name)).map(str::to_owned).collect(),
        note: "`iii --kaist DIR` adds the paper's urban38; any other system's trajectory is scored by `ilns score --tum FILE --truth \
               DIR/truth.csv --align se3`."
            .to_owned(),
        rows: Vec::new(),
    };
    for ((name, _), scores) in logs.iter().zip(scores.chunks(METHODS.len())) {
        let length = format!("{:.0} s, {:.0} m", scores[0].duration_s, scores[0].distance_m);
        let cells = scores.iter().map(|score| format!("{} ({})", number(score.rms_3d), number(score.rms_horizontal)));
        table.rows.push([name.clone(), length].into_iter().chain(cells).collect());
    }
    let printed = METHODS.map(|(name, _)| {
        let row = TABLE_4.iter().find(|row| row.0 == name);
        row.map_or("–".to_owned(), |row| row.1.to_string())
    });
    let paper = ["paper: urban38".to_owned(), "2154 s, 11191 m".to_owned()];
    table.rows.push(paper.into_iter().chain(printed).collect());
    section.tables.push(table);
    section.tables.push(withheld::table(&bench, &logs)?);
    claims(&mut section, &logs, &scores, args.kaist.is_some());
    bench.finish(section)
}

fn claims(section: &mut Section, logs: &[(String, PathBuf)], scores: &[Score], has_kaist: bool) {
    let usual = scores.chunks(METHODS.len()).map(|scores| scores[USUAL].rms_3d);
    let worst = usual.fold(0.0, f64::max);
    section.claim(
        "Metre-level positions over a long drive with real inertial data (3.99 m on urban38 with SW = 20).",
        if logs.is_empty() { Verdict::NotTestable } else { Verdict::of(worst < TABLE_4[2].1) },
        match (logs.len(), has_kaist) {
            (0, _) => "no recorded log is at hand: `ILNS_LOGS` names a folder of log directories".to_owned(),
            (count, true) => {
                format!("at most {} m with SW = 20 on {count} logs, urban38 of KAIST among them", number(worst))
            }
            (count, false) => {
                format!("at most {} m with SW = 20 on {count} other logs; urban38 itself is not at hand", number(worst))
            }
        },
    );
    let best = |scores: &[Score]| (0..4).min_by(|&a, &b| scores[a].rms_3d.total_cmp(&scores[b].rms_3d)) == Some(USUAL);
    let spreads = scores.chunks(METHODS.len()).map(|scores| {
        let (low, high) = scores[..4]
            .iter()
            .fold((f64::INFINITY, 0.0_f64), |(low, high), score| (low.min(score.rms_3d), high.max(score.rms_3d)));
        100.0 * (high / low - 1.0)
    });
    section.claim(
        "SW = 20 is the best on recorded data.",
        if logs.is_empty() { Verdict::NotTestable } else { Verdict::of(scores.chunks(METHODS.len()).all(best)) },
        format!("the windows from 10 to 100 differ by {:.1} % at most", spreads.fold(0.0, f64::max)),
    );
    // References are good to decimetres, and so are differences of errors.
    let behind = |of: usize| {
        let logs = logs.iter().zip(scores.chunks(METHODS.len()));
        let worse = logs.filter(|(_, scores)| scores[USUAL].rms_3d > scores[of].rms_3d + 0.1);
        worse.map(|((name, _), _)| name.as_str()).collect::<Vec<&str>>()
    };
    let (to_ekf, to_fkf) = (behind(EKF), behind(FKF));
    section.claim(
        "The smoother is ahead of the filters on real data (the paper compares on simulated data only).",
        if logs.is_empty() { Verdict::NotTestable } else { Verdict::of(to_ekf.is_empty() && to_fkf.is_empty()) },
        match (to_ekf.is_empty(), to_fkf.is_empty()) {
            (true, true) => "never more than 0.1 m behind EKF or FKF".to_owned(),
            _ => format!(
                "more than 0.1 m behind the EKF on: {}; behind the FKF on: {}. Where inertial data and \
                 positions contradict each other beyond their sigmas, a kernel may take good ranges for outliers; the columns `least squares` show \
                 how much of it that is",
                list(&to_ekf),
                list(&to_fkf)
            ),
        },
    );
    section.claim(
        "The method is ahead of ORB-SLAM3 (105.15 m).",
        Verdict::NotTestable,
        "odometry without positions against ranges simulated from the reference is not a comparison of like with like; its trajectory \
         can stand in the table by `ilns score --tum`"
            .to_owned(),
    );
}

fn list(names: &[&str]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// Name and folder of every log in the folder that `ILNS_LOGS` names.
fn recorded_logs() -> Vec<(String, PathBuf)> {
    let Some(folder) = std::env::var_os("ILNS_LOGS") else {
        eprintln!("iii: ILNS_LOGS is not set, no recorded log is run");
        return Vec::new();
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let logs = entries.filter(|path| path.join("imu.csv").exists() && path.join("truth.csv").exists());
    let mut logs: Vec<(String, PathBuf)> =
        logs.filter_map(|path| Some((path.file_name()?.to_str()?.to_owned(), path))).collect();
    logs.sort();
    logs
}

#[derive(Parser)]
struct Convert {
    #[command(flatten)]
    args: ConvertArgs,
}

fn convert_kaist(dir: &Path, log: &Path) -> Result<(), ReplayError> {
    let words = ["convert".as_ref(), "kaist".as_ref(), dir.as_os_str(), "--out".as_ref(), log.as_os_str()];
    convert::run(&Convert::parse_from(words).args)
}

/// One log with one method.
fn score(dir: &Path, method: &str, sets: &[&str]) -> Result<Score, ReplayError> {
    let log = LogDirectory::open(dir)?;
    let mut truth = log.truth()?.collect::<Result<Vec<Truth>, LogError>>()?.into_iter().peekable();
    let mut scorer = None;
    let sets: Vec<&str> = sets.iter().copied().chain([NO_GNSS]).collect();
    navigate(
        dir,
        method == BATCH,
        &sets,
        |_| true,
        |origin, estimate| {
            let scorer = scorer.get_or_insert_with(|| Scorer::new(origin, Window::default()));
            if estimate.mode() != Mode::Initialising {
                while let Some(row) = truth.next_if(|row| row.header.t_valid <= estimate.header.t_valid) {
                    scorer.truth(&row);
                }
                scorer.estimate(&EstimatePoint::from(estimate));
            }
        },
    )?;
    let no_time = || ReplayError::NoCommonTime { estimate: dir.to_owned(), truth: dir.join("truth.csv") };
    scorer.and_then(|scorer| scorer.score()).ok_or_else(no_time)
}

/// Every estimate of a log with `sets` on top of its own configuration, by the batch if `is_batch`. Readings that are not to
/// be kept the navigator does not hear.
pub(super) fn navigate(
    dir: &Path,
    is_batch: bool,
    sets: &[&str],
    mut keep: impl FnMut(&RawReading) -> bool,
    mut take: impl FnMut(Geodetic, &NavEstimate),
) -> Result<(), ReplayError> {
    let log = LogDirectory::open(dir)?;
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    let config = Config::load(log.config().map(std::slice::from_ref).unwrap_or_default(), &sets);
    let config = config.map_err(ilns_runtime::RuntimeError::from)?;
    let fixes = log.buoys()?.collect::<Result<Vec<BuoyFix>, LogError>>()?;
    let mut navigator =
        if is_batch { Navigator::keeping_all(&config) } else { Navigator::new(&config, Rebase::After(Duration::ZERO)) }
            .with_known_buoys(fixes);
    let mut frame = None;
    let mut sink = |output: Output<'_>| match output {
        Output::Origin(origin) => frame = Some(Geodetic::from_degrees(origin.lat_deg, origin.lon_deg, origin.height)),
        Output::Estimate(estimate) if !is_batch => {
            if let Some(origin) = frame {
                take(origin, estimate);
            }
        }
        Output::Estimate(_) | Output::Solution(..) | Output::Lagged(_) => {}
    };
    for reading in log.merged()? {
        let reading = reading?;
        if keep(&reading) {
            navigator.push(&reading, &mut Unmeasured, &mut sink);
        }
    }
    navigator.finish(&mut Unmeasured, &mut sink);
    if is_batch {
        const PASSES_MAX: u32 = 50;
        let nothing = || ReplayError::NothingToSmooth { log: dir.to_owned() };
        let smoothed = navigator.smooth(PASSES_MAX).ok_or_else(nothing)?;
        let origin = frame.ok_or_else(nothing)?;
        navigator.along(&smoothed, |estimate| take(origin, estimate));
    }
    Ok(())
}
