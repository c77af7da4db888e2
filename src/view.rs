//! `ilns view`: a finished run in the page that shows live ones.

use std::path::{Path, PathBuf};

use ilns_monitor::{Finished, Run, WebArgs, export, show};
use ilns_recording::mcap::export as export_log;
use ilns_recording::{ESTIMATE_FILES, LogDirectory, LogError};
use ilns_replay::{ReplayError, Watcher, navigate};
use ilns_runtime::{LogFormat, NavigatorArgs, Shutdown, start_logging};
use shared_types::{
    ConfigText, FrameOrigin, KeyframeReport, NavEstimate, RawReading, SensorHealth, Solution, Time, Truth,
};

use crate::Outcome;
use crate::recording::condition;

/// What a view is told.
#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    /// A log directory or the MCAP of a recording (all of them, in their order), which is navigated first, so that every
    /// keyframe can be looked into; or a folder of `ilns replay`, of which the estimates are shown.
    #[arg(value_name = "LOG|OUT|FILE.mcap", required = true)]
    runs: Vec<PathBuf>,
    /// The log that OUT came from: its truth, buoys and fixes are shown, too.
    #[arg(long, value_name = "DIR")]
    log: Option<PathBuf>,
    /// Write one HTML file that holds everything and needs no server, and end.
    #[arg(long, value_name = "FILE.html")]
    export: Option<PathBuf>,
    /// Heading of the page; the folder's name without it.
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    #[command(flatten)]
    web: WebArgs,
    #[command(flatten)]
    navigator: NavigatorArgs,
}

/// A folder of which there is nothing to show.
#[derive(Debug, thiserror::Error)]
enum ViewError {
    /// Neither a log nor estimates.
    #[error("{}: neither a log directory (no imu.csv) nor a replay's folder (no estimate.csv)", .0.display())]
    NotARun(PathBuf),
    /// Several that are not one.
    #[error("one run at a time; only the MCAP files of one recording can be given together, and {} is none", .0.display())]
    Several(PathBuf),
    /// A recording that ended before it began.
    #[error("{}: no inertial sample in it can be read (`ilns recording info` shows what can)", .0.display())]
    NoSamples(PathBuf),
    /// Its log directory has no place.
    #[error("no folder can be made for the log directory of the recording (set TMPDIR to one with room for it)")]
    NoRoom(#[source] std::io::Error),
    /// Nothing was estimated.
    #[error("{}: no estimate in it: the measurements never gave a first state (`ilns replay` shows what was refused, and why)", .0.display())]
    Empty(PathBuf),
    /// The name is that of a file in use.
    #[error("--log belongs to a replay's folder; {} has its log in itself", .0.display())]
    TwoLogs(PathBuf),
}

/// Shows a finished run, or writes it into a file.
pub fn run(args: &ViewArgs) -> Outcome {
    start_logging("warn", LogFormat::Auto)?;
    let shutdown = Shutdown::on_signals()?;
    let given = &args.runs[0];
    let path = given.canonicalize().unwrap_or_else(|_| given.clone());
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let run = open(args, args.title.as_deref().unwrap_or(&name))?.ok_or_else(|| ViewError::Empty(given.clone()))?;
    match &args.export {
        Some(file) => Ok(export(&run, file)?),
        None => Ok(show(run, &args.web, &shutdown)?),
    }
}

fn is_mcap(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "mcap")
}

fn open(args: &ViewArgs, title: &str) -> Result<Option<Run>, Box<dyn std::error::Error>> {
    let run = &args.runs[0];
    if args.runs.len() > 1
        && let Some(other) = args.runs.iter().find(|path| !is_mcap(path))
    {
        return Err(ViewError::Several(other.clone()).into());
    }
    let is_recording = is_mcap(run) && !run.is_dir();
    if (is_recording || run.join("imu.csv").exists()) && args.log.is_some() {
        return Err(ViewError::TwoLogs(run.clone()).into());
    }
    if is_recording {
        return recorded(args, title);
    }
    if run.join("imu.csv").exists() {
        let log = LogDirectory::open(run)?;
        let published = run.join(ESTIMATE_FILES[0]);
        let follow = if log.is_recording() && published.exists() { vec![published] } else { Vec::new() };
        return Ok(navigated(args, title, &log, log.config(), &follow)?);
    }
    let is_replay = run.is_file() || run.join(ESTIMATE_FILES[0]).exists();
    if !is_replay && run.exists() {
        return Err(ViewError::NotARun(run.clone()).into());
    }
    let log = args.log.as_ref().map(LogDirectory::open).transpose()?;
    Ok(Finished::from_files(run, log.as_ref(), title)?)
}

/// Navigates the log directory that the MCAPs hold.
fn recorded(args: &ViewArgs, title: &str) -> Result<Option<Run>, Box<dyn std::error::Error>> {
    let folder = tempfile::Builder::new().prefix("ilns-view-").tempdir().map_err(ViewError::NoRoom)?;
    let exported = export_log(&args.runs, folder.path())?;
    let log = match LogDirectory::open(folder.path()) {
        Err(LogError::NoImu { .. }) => return Err(ViewError::NoSamples(args.runs[0].clone()).into()),
        opened => opened?,
    };
    for (file, ending) in args.runs.iter().zip(&exported.endings).filter(|(_, ending)| !ending.is_whole()) {
        eprintln!("ilns view: {}: {}", file.display(), condition(ending));
    }
    // What is wrong in it is to be looked for where it came from.
    let named = |config: &ConfigText| ConfigText { file: args.runs[0].join("sensors.toml"), text: config.text.clone() };
    Ok(navigated(args, title, &log, log.config().map(named).as_ref(), &args.runs)?)
}

/// A recording is repeated as it was live, which `follow` tells of; any other log as `ilns replay` runs it.
fn navigated(
    args: &ViewArgs,
    title: &str,
    log: &LogDirectory,
    config: Option<&ConfigText>,
    follow: &[PathBuf],
) -> Result<Option<Run>, ReplayError> {
    let config = args.navigator.load_config(config.map(std::slice::from_ref).unwrap_or_default())?;
    let mut folding = Folding(Finished::new(title));
    navigate(log, &config, follow, &mut folding)?;
    Ok(folding.0.end())
}

/// The monitor's model sees what the navigator says.
struct Folding(Finished);

impl Watcher for Folding {
    fn reading(&mut self, reading: &RawReading) {
        match reading {
            RawReading::Buoy(fix) => self.0.model.buoy(fix),
            RawReading::Gnss(fix) => self.0.model.gnss(fix),
            RawReading::Lbl(range) => self.0.model.lbl(range),
            _ => {}
        }
    }

    fn truth(&mut self, truth: &Truth) {
        self.0.model.truth(truth);
    }

    fn origin(&mut self, origin: &FrameOrigin) {
        self.0.model.frame_origin(origin);
    }

    fn solution(&mut self, solution: &Solution, report: &KeyframeReport) {
        self.0.model.solution(solution);
        self.0.model.diagnostics(report);
    }

    fn estimate(&mut self, estimate: &NavEstimate) {
        self.0.estimate(estimate);
    }

    fn sensors(&mut self, health: &[SensorHealth; 7], t: Time) {
        self.0.sensors(health, t);
    }
}
