//! `ilns bus`: holds the channels of a set whose processes something else starts.

use std::fs;

use ilns_bus::{Owner, Prefix};
use ilns_runtime::{DEFAULT_PREFIX, HeartbeatBuilder, LogFormat, Shutdown, monotonic_now, start_logging};
use shared_types::{Process, ProcessState, channel};
use tracing::info;

use crate::Outcome;

/// What the holder is told.
#[derive(Debug, clap::Args)]
pub struct BusArgs {
    /// Name of the set. Sets with different names do not hear each other.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PREFIX)]
    prefix: String,
    /// Least severity that is logged: error, warn, info, debug or trace; of one part, as in warn,ilns_solver=debug.
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log_level: String,
    /// Shape of the log's lines.
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    log_format: LogFormat,
}

/// Another after each start of the machine: what was left before it is another mission's.
const BOOT_ID: &str = "/proc/sys/kernel/random/boot_id";

/// Between two looks for dead processes, ns: whoever starts them again does so sooner than a heartbeat comes.
const CLEAN: i64 = 100_000_000;

/// Locks the prefix, wipes what a dead owner left but for the folder of the run, creates every channel, and cleans up after dead
/// processes until told to stop.
pub fn run(args: &BusArgs) -> Outcome {
    start_logging(&args.log_level, args.log_format)?;
    let shutdown = Shutdown::on_signals()?;
    let prefix = Prefix::new(&args.prefix)?;
    // Whoever held the channels before and was killed leaves the folder of the run: origin, last solution, data time. The processes
    // find their channels gone, end, and whoever restarts them lets them go on from there.
    let boot = fs::read_to_string(BOOT_ID).unwrap_or_default();
    let boot_file = prefix.run_directory().join("boot");
    // A machine that does not say which start this is proves nothing.
    let goes_on = !boot.is_empty() && fs::read_to_string(&boot_file).is_ok_and(|before| before == boot);
    let owner = if goes_on { Owner::take_over(&prefix)? } else { Owner::take(&prefix)? };
    fs::create_dir_all(prefix.run_directory()).and_then(|()| fs::write(&boot_file, &boot))?;
    info!(prefix = args.prefix, goes_on, "the channels are open");
    let mut health = owner.bus().publisher(&channel::HEALTH)?;
    let mut heartbeat = HeartbeatBuilder::new(Process::Supervisor, 0);
    heartbeat.state = ProcessState::Running;
    while shutdown.sleep_until(monotonic_now() + CLEAN) {
        let cleaned = owner.cleanup_dead_nodes();
        if cleaned > 0 {
            info!(cleaned, "cleaned up after dead processes");
        }
        if let Some(beat) = heartbeat.beat(monotonic_now()) {
            health.publish_quietly(beat);
        }
    }
    drop(health);
    owner.close();
    Ok(())
}
