//! `ilns run`: the whole set, from one command.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use ilns_bus::{Owner, Prefix};
use ilns_monitor::{FoxgloveArgs, WebAddress, WebArgs, listen};
use ilns_runtime::{
    DEFAULT_PREFIX, LogFormat, NavigatorArgs, ProcessFile, Shutdown, StartClock, answer, monotonic_now, start_logging,
};
use shared_types::{Duration, ProcessState, Time};
use sim_emulators::process::EMULATORS;
use sim_emulators::source::{Source, SourceArgs};
use tracing::{info, warn};

use crate::Outcome;
use crate::legacy::clock_left;
use crate::plan::{Wishes, children, common_arguments};
use crate::supervisor::Supervisor;

/// What a run is told.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    source: SourceArgs,
    /// Seconds of data time per second.
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = positive)]
    rate: f64,
    /// Seconds of data time after which the run ends; without it, it ends with the mission or log.
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,
    /// Folder that receives the recorded log and the estimates published live.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    navigator: NavigatorArgs,
    /// Name of this set. Sets with different names run side by side.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PREFIX)]
    prefix: String,
    /// Go on where a run of this name was killed: data time has run on meanwhile, and the solver takes up from its last
    /// solution. Where none was killed, the run begins as always.
    #[arg(long)]
    resume: bool,
    /// Folder that outlives a restart of the machine, such as /var/lib/ilns: the last solution is kept there once a second, and a run that
    /// begins within five minutes of it, after a restart, begins from it. It takes a clock that goes on without power.
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// TOML file with cores, priorities and wake-ups of the processes, and which of them something else starts, such as a
    /// real driver.
    #[arg(long, value_name = "FILE")]
    processes: Option<PathBuf>,
    #[command(flatten)]
    web: WebArgs,
    #[command(flatten)]
    foxglove: FoxgloveArgs,
    /// Serve no page.
    #[arg(long, conflicts_with = "web")]
    no_web: bool,
    /// Show nothing: neither the terminal view nor a page.
    #[arg(long, conflicts_with_all = ["web", "no_web", "foxglove"])]
    headless: bool,
    /// Least severity that is logged: error, warn, info, debug or trace; of one part, as in warn,ilns_solver=debug.
    #[arg(long, value_name = "FILTER", default_value = "warn")]
    log_level: String,
    /// Shape of the log's lines.
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    log_format: LogFormat,
}

/// From the first process's start to the first reading, ns: everybody listens by then.
const LEAD: i64 = 600_000_000;

/// From the last reading to the end, ns: the solver has worked off what it was sent.
const DRAIN: i64 = 1_000_000_000;

/// A run of a given duration ends so long (s of data time) after it even if an emulator never says that it has finished.
const OVERTIME: f64 = 5.0;

/// Nothing that was asked for has gone on to the end.
#[derive(Debug, thiserror::Error)]
#[error("{} ended again and again and had to be given up (the lines above say why)", .0.join(", "))]
struct GivenUp(Vec<&'static str>);

/// A recording that would mix with what is there.
#[derive(Debug, thiserror::Error)]
#[error("--out {}: it exists and is not an empty directory (choose another or delete it)", .0.display())]
struct OutInUse(PathBuf);

fn refuse_used(out: &Path) -> Result<(), OutInUse> {
    let is_free = match std::fs::read_dir(out) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) => error.kind() == std::io::ErrorKind::NotFound,
    };
    if is_free { Ok(()) } else { Err(OutInUse(out.to_owned())) }
}

fn positive(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if number.is_finite() && number > 0.0 { Ok(number) } else { Err("expected a positive number".to_owned()) }
}

/// Where the monitor is to serve its page: settled here once, so that a restarted monitor is found at the same place, and a
/// port in use is told before anything starts.
fn page_address(args: &RunArgs) -> Result<Option<SocketAddr>, Box<dyn std::error::Error>> {
    if args.headless || args.no_web {
        return Ok(None);
    }
    let (listener, _) = listen(args.web.web.unwrap_or(WebAddress::Auto), args.web.web_token.as_deref())?;
    let address = listener.local_addr()?;
    eprintln!("ilns run: page at http://{address}");
    Ok(Some(address))
}

/// Runs the set until its sources have ended, its duration is over, or it is told to stop.
pub fn run(args: &RunArgs) -> Outcome {
    start_logging(&args.log_level, args.log_format)?;
    let prefix = Prefix::new(&args.prefix)?;
    let source = Source::open(&args.source)?;
    let config = args.navigator.load_config(source.config().as_slice())?;
    if args.navigator.print_config {
        answer(&config.to_toml())?;
        return Ok(());
    }
    args.out.as_deref().map_or(Ok(()), refuse_used)?;
    let shutdown = Shutdown::on_signals()?;
    let processes = args.processes.as_deref().map(ProcessFile::read).transpose()?.unwrap_or_default();
    let start = source.start()?;
    let left = if args.resume { clock_left(&prefix, monotonic_now()) } else { None };
    let owner = if left.is_some() { Owner::take_over(&prefix)? } else { Owner::take(&prefix)? };
    // Last: its address is told at once, and nothing may go wrong after that.
    let foxglove = args.foxglove.settle()?;
    let web = page_address(args)?;
    if let Some(address) = foxglove {
        eprintln!("ilns run: Foxglove at ws://{address}");
    }
    let wishes = Wishes {
        source: &args.source,
        duration: args.duration,
        out: args.out.clone(),
        keep: args.keep.clone(),
        headless: args.headless,
        processes: &processes,
        web,
        web_token: args.web.web_token.clone(),
        foxglove,
    };
    let plans = children(&wishes, &source);
    let mono = monotonic_now() + LEAD;
    let clock = match left {
        Some(left) => {
            // Every moment of waiting is a gap in the readings; who comes late to the IMU finds its history.
            let mono = monotonic_now();
            warn!("going on where a run under this prefix was killed");
            StartClock { data: left.data_at(mono), mono, rate: left.rate }
        }
        None => StartClock { data: start, mono, rate: args.rate },
    };
    let log = (args.log_level.as_str(), args.log_format);
    let common = common_arguments(&prefix, &config, args.processes.as_deref(), &clock, log)?;
    let mut supervisor = Supervisor::start(owner, plans, common)?;
    let end = args.duration.map_or(Time::MAX, |seconds| clock.data + Duration::from_seconds(seconds + OVERTIME));
    watch(&mut supervisor, &shutdown, &clock, end);
    let given_up = supervisor.failed();
    supervisor.stop();
    if given_up.is_empty() {
        Ok(())
    } else {
        Err(GivenUp(given_up.into_iter().map(|process| process.name()).collect()).into())
    }
}

/// Until told to stop, or until the sources are at their end and the rest has worked off what they sent.
fn watch(supervisor: &mut Supervisor, shutdown: &Shutdown, clock: &StartClock, end: Time) {
    let mut sources_ended: Option<i64> = None;
    while !shutdown.requested() && clock.data_now() < end {
        supervisor.watch();
        let mut sources = supervisor.processes().filter(|process| EMULATORS.contains(process));
        let ended = sources.all(|process| {
            supervisor.has_in_state(ProcessState::Finished, process)
                || supervisor.has_in_state(ProcessState::Failed, process)
        });
        sources_ended = if ended { sources_ended.or_else(|| Some(monotonic_now())) } else { None };
        if sources_ended.is_some_and(|since| monotonic_now() - since > DRAIN) {
            info!("the sources are at their end");
            return;
        }
    }
}
