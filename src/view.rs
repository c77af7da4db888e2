//! `ilns view`: a finished run in the page that shows live ones.

use std::path::{Path, PathBuf};

use ilns_monitor::{Finished, Run, WebArgs, export, show};
use ilns_recording::{ESTIMATE_FILES, LogDirectory};
use ilns_replay::{Watcher, navigate};
use ilns_runtime::{NavigatorArgs, Shutdown, start_logging};
use shared_types::{FrameOrigin, KeyframeReport, NavEstimate, RawReading, SensorHealth, Solution, Time, Truth};

use crate::Outcome;

/// What a view is told.
#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    /// A log directory, which is navigated first, so that every keyframe can be looked into; or a folder of `ilns replay`, of
    /// which the estimates are shown.
    #[arg(value_name = "LOG|OUT")]
    run: PathBuf,
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
    /// Another format.
    #[error("{}: MCAP files are not opened here; give the log directory that was recorded with it, or one taken from it", .0.display())]
    Mcap(PathBuf),
    /// Nothing was estimated.
    #[error("{}: no estimate in it: the measurements never gave a first state (`ilns replay` shows what was refused, and why)", .0.display())]
    Empty(PathBuf),
    /// The name is that of a file in use.
    #[error("--log belongs to a replay's folder; {} is a log itself", .0.display())]
    TwoLogs(PathBuf),
}

/// Shows a finished run, or writes it into a file.
pub fn run(args: &ViewArgs) -> Outcome {
    start_logging("warn", false)?;
    let shutdown = Shutdown::on_signals()?;
    let folder = args.run.canonicalize().unwrap_or_else(|_| args.run.clone());
    let name = folder.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let run = open(args, args.title.as_deref().unwrap_or(&name))?.ok_or_else(|| ViewError::Empty(args.run.clone()))?;
    match &args.export {
        Some(file) => Ok(export(&run, file)?),
        None => Ok(show(run, &args.web, &shutdown)?),
    }
}

fn open(args: &ViewArgs, title: &str) -> Result<Option<Run>, Box<dyn std::error::Error>> {
    let is_log = args.run.join("imu.csv").exists();
    if args.run.extension().is_some_and(|extension| extension == "mcap") {
        return Err(ViewError::Mcap(args.run.clone()).into());
    }
    if is_log && args.log.is_some() {
        return Err(ViewError::TwoLogs(args.run.clone()).into());
    }
    if is_log {
        return Ok(navigated(args, title)?);
    }
    let is_replay = args.run.is_file() || args.run.join(ESTIMATE_FILES[0]).exists();
    if !is_replay && args.run.exists() {
        return Err(ViewError::NotARun(args.run.clone()).into());
    }
    let log = args.log.as_ref().map(LogDirectory::open).transpose()?;
    Ok(Finished::from_files(&args.run, log.as_ref(), title)?)
}

/// A recording is repeated as it was live, any other log as `ilns replay` runs it.
fn navigated(args: &ViewArgs, title: &str) -> Result<Option<Run>, ilns_replay::ReplayError> {
    let log = LogDirectory::open(&args.run)?;
    let config = args.navigator.load_config(log.config().cloned().as_slice())?;
    let published = args.run.join(ESTIMATE_FILES[0]);
    let follow: Option<&Path> = (log.is_recording() && published.exists()).then_some(&published);
    let mut folding = Folding(Finished::new(title));
    navigate(&log, &config, follow, &mut folding)?;
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
