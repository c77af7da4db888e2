//! `ilns bus`: holds the channels of a set whose processes something else starts.

use ilns_bus::{Owner, Prefix};
use ilns_runtime::{DEFAULT_PREFIX, HeartbeatBuilder, Shutdown, monotonic_now, start_logging};
use shared_types::{Process, ProcessState, channel};
use tracing::info;

use crate::Outcome;

/// What the holder is told.
#[derive(Debug, clap::Args)]
pub struct BusArgs {
    /// Name of the set. Sets with different names do not hear each other.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PREFIX)]
    prefix: String,
    /// Least severity that is logged: error, warn, info, debug or trace.
    #[arg(long, value_name = "LEVEL", default_value = "info")]
    log_level: String,
}

/// Between two looks for dead processes, ns: whoever starts them again does so sooner than a heartbeat comes.
const CLEAN: i64 = 100_000_000;

/// Locks the prefix, wipes what a dead owner left, creates every channel, and cleans up after dead processes until told to
/// stop.
pub fn run(args: &BusArgs) -> Outcome {
    start_logging(&args.log_level, false)?;
    let shutdown = Shutdown::on_signals()?;
    let owner = Owner::take(&Prefix::new(&args.prefix)?)?;
    info!(prefix = args.prefix, "the channels are open");
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
