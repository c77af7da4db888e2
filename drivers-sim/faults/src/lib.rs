//! Faults of sensors, data and stamps, injected into streams of readings.
//!
//! A [`FaultSpec`] says what goes wrong, for which sensor and when: `dvl.false_lock@600..660`, `lbl.multipath=0.2@..`. A
//! [`FaultStream`] takes readings in and gives them out as a failing instrument, cable or clock would have; it stands between
//! sensor models (or a log) and bus (or navigator), so a simulation, a live run and a replay fail alike. The truth passes by
//! it untouched.
//!
//! Pure: the same readings, specs and seed give the same faults. Every fault draws from a generator of its own, derived
//! from seed, sensor and class, so neither another fault nor another sensor's readings change what it does; a stream of one
//! sensor therefore fails as the same sensor does in a stream of all.
//!
//! The classes and their values stand in one table, `class.rs`; `README.md` beside it is that table for readers. Numbers F1 to
//! F40 are those of the fault catalogue; F-classes of processes, clocks of the host and disks are no matter of readings and
//! have no place here.
//!
//! ```
//! use shared_types::{Header, PsDepth, RawReading, Time};
//! use sim_faults::{ArrivalClock, FaultStream};
//!
//! let spec = "ps.bias=0.5@10..20".parse()?;
//! let mut stream = FaultStream::new(&[spec], 1, ArrivalClock::Valid);
//! stream.push(RawReading::Ps(PsDepth { header: Header::at(Time::from_seconds(12.0)), depth: 3.0 }));
//! assert!(matches!(stream.pop(), Some(RawReading::Ps(found)) if found.depth == 3.5));
//! # Ok::<(), sim_faults::FaultError>(())
//! ```

mod class;
mod draws;
mod effect;
mod effects;
mod spec;
mod stream;

pub use class::class_table;
pub use spec::{FaultError, FaultSpec, Span};
pub use stream::{ArrivalClock, FaultStream, Faulted, Tally};
