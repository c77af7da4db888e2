//! Heartbeats: what each process says of itself, a few times a second.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::header::Header;
use crate::layout::message;
use crate::reject::REJECT_REASONS;

/// A process of the set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum Process {
    /// Supervisor: owner of the channels.
    Supervisor = 0,
    /// IMU driver or emulator.
    EmulatorImu = 1,
    /// LBL driver or emulator.
    EmulatorLbl = 2,
    /// GNSS driver or emulator.
    EmulatorGnss = 3,
    /// DVL driver or emulator.
    EmulatorDvl = 4,
    /// Compass driver or emulator.
    EmulatorMcp = 5,
    /// Pressure driver or emulator.
    EmulatorPs = 6,
    /// Buoy position receiver or emulator.
    EmulatorBuoys = 7,
    /// Truth of a scenario or log.
    EmulatorTruth = 8,
    /// Raw readings to anchored measurements.
    Preprocessor = 9,
    /// The window.
    Solver = 10,
    /// IMU rate output.
    Propagator = 11,
    /// Writes everything down.
    Recorder = 12,
    /// Shows everything.
    Monitor = 13,
}

impl Process {
    /// Every process in the order of its number.
    pub const ALL: [Process; 14] = [
        Process::Supervisor,
        Process::EmulatorImu,
        Process::EmulatorLbl,
        Process::EmulatorGnss,
        Process::EmulatorDvl,
        Process::EmulatorMcp,
        Process::EmulatorPs,
        Process::EmulatorBuoys,
        Process::EmulatorTruth,
        Process::Preprocessor,
        Process::Solver,
        Process::Propagator,
        Process::Recorder,
        Process::Monitor,
    ];

    /// The name as `ilns status` and the command line say it.
    pub const fn name(self) -> &'static str {
        match self {
            Process::Supervisor => "supervisor",
            Process::EmulatorImu => "emulator-imu",
            Process::EmulatorLbl => "emulator-lbl",
            Process::EmulatorGnss => "emulator-gnss",
            Process::EmulatorDvl => "emulator-dvl",
            Process::EmulatorMcp => "emulator-mcp",
            Process::EmulatorPs => "emulator-ps",
            Process::EmulatorBuoys => "emulator-buoys",
            Process::EmulatorTruth => "emulator-truth",
            Process::Preprocessor => "preprocessor",
            Process::Solver => "solver",
            Process::Propagator => "propagator",
            Process::Recorder => "recorder",
            Process::Monitor => "monitor",
        }
    }

    /// The process of that name.
    pub fn from_name(name: &str) -> Option<Process> {
        Process::ALL.into_iter().find(|process| process.name() == name)
    }

    /// The process of that number, as it crosses the bus.
    pub fn from_index(index: u32) -> Option<Process> {
        Process::ALL.get(index as usize).copied()
    }
}

impl core::fmt::Display for Process {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

/// Where a process stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ProcessState {
    /// Opening its channels.
    Starting = 0,
    /// In its loop.
    Running = 1,
    /// Its source is at its end; it holds its last message.
    Finished = 2,
    /// On its way out.
    Stopping = 3,
    /// Dead, to be restarted (said by the supervisor only).
    Restarting = 4,
    /// Given up after too many deaths (said by the supervisor only).
    Failed = 5,
}

impl ProcessState {
    /// Every state in the order of its number.
    pub const ALL: [ProcessState; 6] = [
        ProcessState::Starting,
        ProcessState::Running,
        ProcessState::Finished,
        ProcessState::Stopping,
        ProcessState::Restarting,
        ProcessState::Failed,
    ];

    /// The word in tables.
    pub const fn name(self) -> &'static str {
        match self {
            ProcessState::Starting => "starting",
            ProcessState::Running => "running",
            ProcessState::Finished => "finished",
            ProcessState::Stopping => "stopping",
            ProcessState::Restarting => "restarting",
            ProcessState::Failed => "failed",
        }
    }

    /// The state of that number, as it crosses the bus.
    pub fn from_index(index: u32) -> Option<ProcessState> {
        ProcessState::ALL.get(index as usize).copied()
    }
}

/// One sensor as a process has seen it since its start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[repr(C)]
pub struct SensorHealth {
    /// Readings received (or sent, by an emulator).
    pub received: u64,
    /// Readings missing by sequence number.
    pub lost: u64,
    /// Refused, by [`crate::RejectReason`].
    pub rejected: [u64; REJECT_REASONS.len()],
    /// Data time of the newest, ns; `i64::MIN` = none yet.
    pub t_newest: i64,
}

impl SensorHealth {
    /// Nothing seen yet.
    pub const NONE: SensorHealth =
        SensorHealth { received: 0, lost: 0, rejected: [0; REJECT_REASONS.len()], t_newest: i64::MIN };
}

impl Default for SensorHealth {
    fn default() -> SensorHealth {
        SensorHealth::NONE
    }
}

/// A latency distribution in brief, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[repr(C)]
pub struct HopLatency {
    /// Messages measured.
    pub count: u64,
    /// Median.
    pub p50_ns: u64,
    /// 90th percentile.
    pub p90_ns: u64,
    /// 99th percentile.
    pub p99_ns: u64,
    /// 99.9th percentile.
    pub p99_9_ns: u64,
    /// 99.99th percentile.
    pub p99_99_ns: u64,
    /// Largest.
    pub max_ns: u64,
}

message! {
    /// What a process says of itself.
    Heartbeat, "ilns.Heartbeat.3", schema 3 {
        /// Sender, order and times.
        header: Header,
        /// [`Process`] as a number.
        process: u32,
        /// [`ProcessState`] as a number.
        state: u32,
        /// Process number of the operating system.
        pid: u32,
        /// How often it was restarted.
        restarts: u32,
        /// User plus system CPU time since its start, ns.
        cpu_ns: u64,
        /// Resident memory, bytes.
        resident_bytes: u64,
        /// Messages that it published and no queue took.
        dropped: u64,
        /// Messages that it handled.
        handled: u64,
        /// Per sensor, in the order of [`crate::SENSORS`].
        sensors: [SensorHealth; 7],
        /// From publication to receipt on its main input.
        hop_in: HopLatency,
        /// From the origin's arrival to its own publication (propagator: IMU sample to estimate).
        end_to_end: HopLatency,
        /// Time of its main piece of work (solver: CPU time of a solve).
        work: HopLatency,
    }
}
