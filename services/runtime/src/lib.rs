//! What any process needs around its core: arguments, configuration, clocks, log lines, shutdown, heartbeat, exit.
//!
//! A process is a loop around a pure value, and begins the same way everywhere:
//!
//! ```no_run
//! # use ilns_runtime::{ProcessArgs, RuntimeError};
//! # fn run(args: &ProcessArgs) -> Result<(), RuntimeError> {
//! let shutdown = args.begin()?;
//! let config = args.load_config()?;
//! while !shutdown.requested() {
//!     // wait, receive, think, publish
//! }
//! # Ok(())
//! # }
//! ```

mod arguments;
mod clock;
mod configuration;
mod error;
mod exit;
mod heartbeat;
mod latency;
mod log_queue;
mod logging;
mod notify;
mod process_file;
mod real_time;
mod reload;
mod shutdown;

pub use arguments::{DEFAULT_PREFIX, NavigatorArgs, ProcessArgs};
pub use clock::{StartClock, clocks_now, monotonic_now};
pub use configuration::{load_config, read_config_text};
pub use error::RuntimeError;
pub use exit::{FAILURE, answer, exit_with, one_line};
pub use heartbeat::{BEAT, HeartbeatBuilder};
pub use latency::Latency;
pub use logging::{LogFormat, start_logging};
pub use process_file::{ProcessFile, ProcessFileError, ProcessSettings, WakeUp};
pub use real_time::RealTime;
pub use reload::{NOTICE, Reloads, config_in_force, leave_config};
pub use shutdown::Shutdown;
