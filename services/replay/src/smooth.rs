//! `ilns smooth`: a log directory as one batch, every estimate with what came before it and after.
//!
//! The files are those of `ilns replay`, so that the same tools score and plot them.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use hdrhistogram::Histogram;
use ilns_recording::{LogDirectory, Summary};
use ilns_runtime::{NavigatorArgs, answer};
use nav_pipeline::{Navigator, Output, SolveClock, Unmeasured};
use shared_types::{Config, EstimatorKind};

use crate::error::ReplayError;
use crate::output::ReplayOutput;
use crate::replay::{LONGEST_SOLVE, ThreadClock, facts_of};

/// Linearisations of the whole trajectory; three to six are usual.
const PASSES_MAX: u32 = 50;

/// Smooths a log directory: the whole of it as one batch, each estimate with what came after it too.
///
/// Writes estimate.csv, estimate.tum and summary.json into OUT as `ilns replay` does; in the summary, `solve_us` is the time
/// of the batch. Takes some 150 MB per hour of data.
#[derive(Args, Clone, Debug)]
pub struct SmoothArgs {
    /// The log: a folder with imu.csv, further sensors, and optionally sensors.toml and truth.csv.
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// Folder for the results; made where there is none, results of an earlier run in it are replaced.
    #[arg(long, value_name = "OUT", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub navigator: NavigatorArgs,
}

/// Runs `ilns smooth`.
///
/// # Errors
/// A log, a configuration or an output folder that cannot be used, or a log that never comes to a first estimate.
pub fn run(args: &SmoothArgs) -> Result<(), ReplayError> {
    let started = Instant::now();
    let log = LogDirectory::open(&args.dir)?;
    let config = args.navigator.load_config(log.config().map(std::slice::from_ref).unwrap_or_default())?;
    let estimator = config.navigator.estimator;
    if estimator != EstimatorKind::Fgo {
        return Err(ReplayError::NotASmoother { estimator: estimator.name() });
    }
    let Some(out) = args.out.as_ref().filter(|_| !args.navigator.print_config) else {
        return answer(&config.to_toml()).map_err(ReplayError::Print);
    };
    log.check_buoys()?;
    let output = ReplayOutput::create(out, &log, started)?;
    smooth(args, &log, &config, output)?;
    Ok(())
}

fn smooth(
    args: &SmoothArgs,
    log: &LogDirectory,
    config: &Config,
    mut output: ReplayOutput,
) -> Result<Summary, ReplayError> {
    let merged = log.merged()?;
    let mut navigator = Navigator::keeping_all(config);
    // All fixes are known, of a recording too: a smoother looks ahead.
    navigator = navigator.with_known_buoys(log.buoy_fixes()?);
    let mut sink = |event: Output<'_>| {
        if let Output::Origin(origin) = event {
            output.set_origin([origin.lat_deg, origin.lon_deg, origin.height]);
        }
    };
    for reading in merged {
        navigator.push(&reading?, &mut Unmeasured, &mut sink);
    }
    navigator.finish(&mut Unmeasured, &mut sink);

    let mut clock = ThreadClock;
    let began = clock.thread_ns();
    let smoothed = navigator.smooth(PASSES_MAX).ok_or(ReplayError::NothingToSmooth { log: args.dir.clone() })?;
    let mut solve_ns =
        Histogram::new_with_bounds(1, LONGEST_SOLVE, 3).expect("1 < LONGEST_SOLVE / 2 and 3 digits are in bounds");
    solve_ns.saturating_record(clock.thread_ns() - began);

    let mut failed = Ok(());
    navigator.along(&smoothed, |estimate| {
        if failed.is_ok() {
            failed = output.estimate(estimate);
        }
    });
    failed?;
    let mut facts = facts_of(&navigator);
    facts.estimator = "fgo batch";
    facts.window = smoothed.keyframes.len() - 1;
    facts.keyframes = smoothed.keyframes.len() as u64;
    facts.iterations = u64::from(smoothed.report.passes);
    facts.solve_ns = solve_ns;
    for &end in smoothed.ends.iter().filter(|end| **end < smoothed.keyframes.len()) {
        let (last, next) = (smoothed.keyframes[end - 1].t, smoothed.keyframes[end].t);
        eprintln!("note: the state began anew at {next}: up to {last} and from there on the log is solved apart");
    }
    if !smoothed.report.converged {
        eprintln!("warning: the batch had not converged after {} linearisations", smoothed.report.passes);
    }
    output.finish(&facts)
}
