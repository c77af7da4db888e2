//! A recording in one MCAP file, as Foxglove, PlotJuggler and the `mcap` packages read it.
//!
//! ```text
//! readings, estimates, reports --> McapWriter --> FILE.mcap
//! FILE.mcap --> inspect (what is in it), recover (whole again after a crash), export (the log directory)
//! ```
//!
//! Messages are JSON with JSON schemas: every reader of MCAP shows them without generated code, and a number in its shortest
//! form is the number itself. A reading's message has the columns of its file in the log directory as keys and the very
//! text of its cells as values, so that what is exported is what was recorded, to the byte. What an instrument did not
//! report has no key (JSON knows no NaN); an infinity is `1e999`, which JSON's grammar allows and readers take for one.
//! Binary messages would take a third of the space, and each reader would have to be taught them.
//!
//! `log_time` is data time in ns (0 where it is negative, the message says the true one). Chunks are not compressed:
//! a torn file is then readable up to its last byte, and the recorder's processor time stays with the vehicle.

mod composer;
mod export;
mod inspect;
mod json;
mod messages;
mod reader;
mod recover;
mod scene;
mod schemas;
mod solutions;
mod thinning;
mod topics;
mod writer;

pub use composer::{Composer, MessageChannel, MessageSink, message_channels};
pub use export::{Exported, export};
pub use inspect::{ChannelReport, Inspection, inspect};
pub use reader::{Ending, McapFault};
pub use recover::{Recovered, recover};
pub use solutions::solutions;
pub use thinning::EstimateThinning;
pub use writer::{McapWriter, RecorderStatus};
