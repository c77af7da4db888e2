//! The channel table: name, type, queue policy and readers of every channel, in one place, so that two processes cannot
//! open a channel differently.
//!
//! Readings may not be lost in silence (a full queue is counted and shown); estimates may be overtaken.

use core::marker::PhantomData;

use crate::header::Message;
use crate::{
    BuoyFix, DvlVelocity, FrameOrigin, GnssFix, Heartbeat, ImuSample, KeyframeReport, LblRange, McpHeading,
    Measurement, NavEstimate, PsDepth, Solution, Truth,
};

/// What happens when a reader's queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overflow {
    /// The new message is not queued for that reader; the sender counts it.
    RefuseNewest,
    /// The oldest queued message makes room; the reader sees the gap in the sequence.
    DropOldest,
}

/// How a channel is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelSpec {
    /// `sensor/imu`, `nav/solution`, ...
    pub name: &'static str,
    /// Messages that each reader can have waiting.
    pub queue: usize,
    /// Messages that a late reader is given first (latched channels, and those a restarted process catches up from).
    pub history: usize,
    /// When a queue is full.
    pub overflow: Overflow,
    /// Senders at one time.
    pub publishers: usize,
    /// Readers at one time: those of the process set, twice over for restarts, and room for guests.
    pub subscribers: usize,
    /// Who reads it, for documentation and for the test that no navigation process reads the truth.
    pub readers: &'static [&'static str],
}

/// A channel and the type that it carries.
#[derive(Debug)]
pub struct Channel<T> {
    /// How it is opened.
    pub spec: ChannelSpec,
    carries: PhantomData<fn() -> T>,
}

impl<T> Clone for Channel<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Channel<T> {}

impl<T: Message> Channel<T> {
    const fn new(spec: ChannelSpec) -> Channel<T> {
        Channel { spec, carries: PhantomData }
    }
}

/// Does something with every channel, whatever its type.
pub trait ChannelVisitor {
    /// Why the visit stopped.
    type Error;
    /// Called once per channel.
    ///
    /// # Errors
    /// Ends the visit.
    fn visit<T: Message>(&mut self, channel: &Channel<T>) -> Result<(), Self::Error>;
}

const SUBSCRIBERS: usize = 10;

macro_rules! channel_table {
    ($( $(#[$meta:meta])* $name:ident : $type:ty = $text:literal, queue $queue:literal, history $history:literal,
        $overflow:ident, publishers $publishers:literal, readers [$($reader:literal),*]; )*) => {
        pub(crate) mod table {
            use super::*;
            $(
                $(#[$meta])*
                pub const $name: Channel<$type> = Channel::new(ChannelSpec {
                    name: $text,
                    queue: $queue,
                    history: $history,
                    overflow: Overflow::$overflow,
                    publishers: $publishers,
                    subscribers: SUBSCRIBERS,
                    readers: &[$($reader),*],
                });
            )*
        }

        /// Every channel's policy, in the order of the table.
        pub const EVERY_CHANNEL: &[ChannelSpec] = &[$(table::$name.spec),*];

        /// Shows every channel with its type to `visitor`, in the order of the table.
        ///
        /// # Errors
        /// The first that the visitor returns.
        pub fn visit_channels<V: ChannelVisitor>(visitor: &mut V) -> Result<(), V::Error> {
            $( visitor.visit(&table::$name)?; )*
            Ok(())
        }
    };
}

channel_table! {
    /// IMU samples; the history lets a restarted propagator or preprocessor catch up, even where it hung for the 5 s after which
    /// it is killed: 8 s at 200 Hz. The queue has room for what is sent before it has read them.
    IMU: ImuSample = "sensor/imu", queue 2048, history 1600, RefuseNewest, publishers 1,
        readers ["preprocessor", "propagator", "recorder"];
    /// Slant ranges, one message each.
    LBL: LblRange = "sensor/lbl", queue 256, history 0, RefuseNewest, publishers 1,
        readers ["preprocessor", "monitor", "recorder"];
    /// Satellite fixes.
    GNSS: GnssFix = "sensor/gnss", queue 64, history 0, RefuseNewest, publishers 1,
        readers ["preprocessor", "monitor", "recorder"];
    /// Doppler velocities.
    DVL: DvlVelocity = "sensor/dvl", queue 64, history 0, RefuseNewest, publishers 1, readers ["preprocessor", "recorder"];
    /// Compass headings.
    MCP: McpHeading = "sensor/mcp", queue 64, history 0, RefuseNewest, publishers 1, readers ["preprocessor", "recorder"];
    /// Depths.
    PS: PsDepth = "sensor/ps", queue 64, history 0, RefuseNewest, publishers 1, readers ["preprocessor", "recorder"];
    /// Buoy positions; the history gives a restarted preprocessor the moored ones.
    BUOYS: BuoyFix = "sensor/buoys", queue 256, history 128, RefuseNewest, publishers 1,
        readers ["preprocessor", "monitor", "recorder"];
    /// The truth of a scenario or log, for scoring.
    TRUTH: Truth = "sim/truth", queue 256, history 1, DropOldest, publishers 1, readers ["monitor", "recorder"];
    /// Origin of the ENU frame, latched.
    FRAME_ORIGIN: FrameOrigin = "nav/frame_origin", queue 4, history 1, DropOldest, publishers 1,
        readers ["solver", "propagator", "monitor", "recorder"];
    /// Anchored measurements: 20 s of them, and a history from which a restarted solver takes up.
    MEASUREMENTS: Measurement = "nav/measurements", queue 8192, history 2048, RefuseNewest, publishers 1,
        readers ["solver", "recorder"];
    /// Newest keyframe, latched: a restarted propagator begins from it. (A restarted solver does not: a latched message
    /// dies with its sender, so the solver keeps its last solution on disk.)
    SOLUTION: Solution = "nav/solution", queue 16, history 1, DropOldest, publishers 1,
        readers ["propagator", "monitor", "recorder"];
    /// What each keyframe held.
    DIAGNOSTICS: KeyframeReport = "nav/diagnostics", queue 16, history 0, DropOldest, publishers 1,
        readers ["monitor", "recorder"];
    /// Where the vehicle is.
    ESTIMATE: NavEstimate = "nav/estimate", queue 2048, history 1, DropOldest, publishers 1,
        readers ["vehicle", "monitor", "recorder"];
    /// Where the vehicle was a window ago, given all that has come since: with `fgo.fixed_lag`, one per keyframe.
    LAGGED: NavEstimate = "nav/lagged", queue 64, history 0, DropOldest, publishers 1, readers ["recorder"];
    /// Heartbeats of all processes.
    HEALTH: Heartbeat = "health", queue 64, history 0, DropOldest, publishers 20, readers ["monitor", "ilns"];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_a_queue_takes_the_whole_history() {
        for (index, spec) in EVERY_CHANNEL.iter().enumerate() {
            assert!(EVERY_CHANNEL[..index].iter().all(|other| other.name != spec.name), "{}", spec.name);
            assert!(spec.history <= spec.queue, "{}", spec.name);
        }
    }

    #[test]
    fn no_navigation_process_reads_the_truth() {
        for reader in table::TRUTH.spec.readers {
            assert!(["monitor", "recorder"].contains(reader), "{reader}");
        }
    }
}
