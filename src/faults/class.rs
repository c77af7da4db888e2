//! The classes of the fault catalogue that are done to processes, and what is expected of each.

use core::fmt;

use shared_types::Process;

/// What is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Deed {
    /// Nothing for 10 s: what the others are held against.
    Nothing,
    /// `kill -9`.
    Kill,
    /// `kill -9`, and again while the process that comes in its place starts.
    KillTwice,
    /// SIGSTOP, and SIGCONT after 50 ms to 2 s.
    Stop,
    /// SIGSTOP without SIGCONT.
    StopForGood,
    /// A tenth of the CPU for 2 s: stopped for 90 of every 100 ms.
    Slow,
    /// The solver is killed, and its checkpoint is not what it was.
    Damage(Damage),
    /// What the solver writes its checkpoint to has no room left, for 3 s; then the solver is killed.
    CheckpointDiskFull,
    /// Every write of the recorder is refused for 4 s, as on a disk that is full.
    RecordDiskFull,
    /// Every core is kept busy for 3 s.
    Starve,
    /// Every core is kept busy for 10 s, and the victim is given a tenth of the CPU beside: stopped for 90 of every 100 ms.
    StarveAndSlow,
    /// Every core is kept busy and the victim stopped for most of the time: it goes on for 0.5 s after every 4.2 s, so that keyframes pile up.
    StarveAndHalt,
    /// A reader of every channel that never reads, for 4 s.
    SilentReader,
    /// Readers that are killed while they join and read.
    DyingReader,
    /// Everybody is killed at once, and shared memory and the folder of the run are gone. After 3 to 15 s the machine has started again,
    /// under water: no satellites for 25 s, and no ranges for 10 s.
    PowerLoss,
    /// `ilns reload` with what is wrong or may not change, and then with other noises, and back after 5 s.
    Reload,
    /// The DVL is taken off and another put on, turned by a right angle; `ilns reload` tells of its mounting and noise.
    Swap,
}

/// In which way a checkpoint is spoilt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Damage {
    /// Cut off in the middle.
    Torn,
    /// One bit.
    Flipped,
    /// Another file.
    Foreign,
}

/// A figure that must be reached beyond the general rule. Times in s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Expect {
    /// An estimate for every inertial sample, in order: no way between two of them longer than one period.
    NoGap,
    /// The first estimate, whose mode says what it is worth, from the start of the processes on.
    Flagged(f64),
    /// Largest error, sigmas, or what there was while nothing was done, where that is more.
    Within(f64),
    /// The longest way between the data times of two estimates.
    Gap(f64),
    /// INVALID, from the deed on.
    Declared(f64),
    /// The process is back: its heartbeat, or for those of the fast path a valid estimate.
    Back(f64),
    /// Largest step, sigmas, or what there was while nothing was done, where that is more.
    Step(f64),
    /// A line of the log holds this.
    Says(&'static str),
    /// Largest step while another configuration is taken up, sigmas, or what there was while nothing was done, where that is more.
    StepAtTake(f64),
    /// What is wrong or may not change was refused and has changed nothing, and the rest was taken up.
    Answered,
    /// The victim has counted so many messages as dropped, at least.
    Counts(u64),
}

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Class {
    /// To whom.
    pub(super) victim: Process,
    /// What.
    pub(super) deed: Deed,
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let victim = self.victim.name();
        match self.deed {
            Deed::Nothing => write!(f, "nothing done for 10 s"),
            Deed::Kill => write!(f, "{victim}: kill -9"),
            Deed::KillTwice => write!(f, "{victim}: kill -9, again in its start"),
            Deed::Stop => write!(f, "{victim}: stopped for 0.05 to 2 s"),
            Deed::StopForGood => write!(f, "{victim}: stopped for good"),
            Deed::Slow => write!(f, "{victim}: a tenth of the CPU for 2 s"),
            Deed::Damage(Damage::Torn) => write!(f, "{victim}: killed, checkpoint torn"),
            Deed::Damage(Damage::Flipped) => write!(f, "{victim}: killed, a bit of the checkpoint flipped"),
            Deed::Damage(Damage::Foreign) => write!(f, "{victim}: killed, checkpoint of another kind"),
            Deed::CheckpointDiskFull => write!(f, "no room for the checkpoint, then {victim} killed"),
            Deed::RecordDiskFull => write!(f, "{victim}: disk full for 4 s"),
            Deed::Starve => write!(f, "every core kept busy for 3 s"),
            Deed::StarveAndSlow => write!(f, "every core kept busy for 10 s, a tenth of the CPU for {victim}"),
            Deed::StarveAndHalt => write!(f, "every core kept busy for 10 s, {victim} stopped for most of it"),
            Deed::SilentReader => write!(f, "a reader that never reads"),
            Deed::DyingReader => write!(f, "readers killed while they read"),
            Deed::PowerLoss => write!(f, "power lost under water for 3 to 15 s"),
            Deed::Reload => write!(f, "six bad configurations, then other noises and back"),
            Deed::Swap => write!(f, "another DVL, turned by 90 deg, is told of"),
        }
    }
}

impl Class {
    /// What the others are held against.
    pub(super) const CLEAN: Class = Class { victim: Process::Supervisor, deed: Deed::Nothing };

    /// Its number in the catalogue; 0 where nothing is done.
    pub(super) fn number(&self) -> u8 {
        match (self.deed, self.victim) {
            (Deed::Nothing, _) => 0,
            (Deed::Kill | Deed::KillTwice, Process::EmulatorImu) => 1,
            (Deed::Stop, Process::EmulatorImu) => 2,
            (Deed::Kill | Deed::KillTwice, Process::Supervisor) => 28,
            (Deed::PowerLoss, _) => 29,
            (Deed::Reload, _) => 34,
            (Deed::Swap, _) => 35,
            (Deed::Damage(_), _) => 30,
            (Deed::CheckpointDiskFull | Deed::RecordDiskFull, _) => 31,
            (Deed::Starve | Deed::StarveAndSlow | Deed::StarveAndHalt, _) => 32,
            (Deed::SilentReader | Deed::DyingReader, _) => 33,
            (_, Process::Solver) => 26,
            _ => 27,
        }
    }

    /// How often the victim is killed by it.
    pub(super) fn kills(&self) -> u64 {
        match self.deed {
            Deed::Kill => 1,
            Deed::KillTwice => 2,
            _ => 0,
        }
    }

    /// Whether it is one of the random kills.
    pub(super) fn is_a_kill(&self) -> bool {
        self.kills() > 0
    }

    /// Whether estimates come from it or from what it sends at once.
    pub(super) fn is_on_fast_path(&self) -> bool {
        matches!(self.victim, Process::EmulatorImu | Process::Propagator | Process::Supervisor)
    }

    /// Beyond the general rule: numbers finite, no error beyond five sigmas, everybody is back.
    pub(super) fn expectations(&self) -> Vec<Expect> {
        use Expect::{Answered, Back, Counts, Declared, Flagged, Gap, NoGap, Says, Step, StepAtTake, Within};
        match (self.deed, self.victim) {
            (Deed::Nothing, _) => vec![NoGap],
            (Deed::Kill, Process::EmulatorImu) => vec![Declared(0.02), Back(0.5), Step(3.0)],
            (Deed::KillTwice, Process::EmulatorImu) => vec![Declared(0.02), Back(1.0), Step(3.0)],
            (Deed::Kill | Deed::KillTwice, Process::Supervisor) => vec![Back(2.0), Step(3.0)],
            (Deed::Kill | Deed::KillTwice, Process::Propagator) => vec![Gap(1.0), Back(1.0), Step(3.0)],
            (Deed::Kill, Process::Solver) => vec![NoGap, Back(0.5), Step(1.0)],
            (Deed::Kill | Deed::KillTwice, _) => vec![NoGap, Back(1.0), Step(1.0)],
            (Deed::Stop, Process::EmulatorImu) => vec![Back(1.0), Step(1.0)],
            // Samples wait meanwhile, and each has its estimate afterwards.
            (Deed::Stop, _) => vec![NoGap, Back(1.0), Step(1.0)],
            // Killed after 5 s without a heartbeat.
            (Deed::StopForGood, _) if self.is_on_fast_path() => vec![Back(7.0), Step(3.0)],
            (Deed::StopForGood, _) => vec![NoGap, Back(7.0), Step(3.0)],
            (Deed::Slow, _) => vec![NoGap, Back(1.0), Step(1.0)],
            (Deed::Damage(_), _) => vec![NoGap, Says("cannot be taken up; initialising anew"), Back(1.0), Step(3.0)],
            (Deed::CheckpointDiskFull, _) => vec![NoGap, Says("cannot be kept"), Back(1.0), Step(3.0)],
            // Some 450 rows a second; it says that it loses them, how many, and that it goes on.
            (Deed::RecordDiskFull, _) => vec![
                NoGap,
                Counts(100),
                Says("the disk takes no more of the record"),
                Says("the disk takes the record again"),
                Back(1.0),
                Step(1.0),
            ],
            (Deed::StarveAndHalt, _) => vec![NoGap, Says("the solver is behind"), Back(1.0), Step(3.0)],
            (Deed::StarveAndSlow, _) => vec![NoGap, Back(1.0), Step(1.0)],
            // Two seconds of samples tell which way is down, and keyframes are a second apart.
            (Deed::PowerLoss, _) => {
                vec![Flagged(3.0), Back(5.0), Step(3.0), Within(3.0), Says("beginning from the last place kept")]
            }
            (Deed::Reload | Deed::Swap, _) => vec![NoGap, Answered, StepAtTake(0.5), Back(1.0)],
            (Deed::Starve | Deed::SilentReader | Deed::DyingReader, _) => vec![NoGap, Step(1.0)],
        }
    }
}

/// Classes of the catalogue that this bench does.
pub(super) const LIVE: [u8; 12] = [1, 2, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35];

/// Classes of the catalogue that this bench cannot do, with the reason.
pub(super) const MISSING: [(u8, &str); 1] = [(
    21,
    "missing: a step of the machine's clock needs its rights and disturbs everybody on it; stamps are stepped in replay",
)];

/// What is done to a set besides killing, with how often: once for each of `victims` where no victim is named by the deed.
pub(super) fn besides_kills(victims: &[Process]) -> Vec<Class> {
    let to_each = |deed: Deed| victims.iter().map(move |&victim| Class { victim, deed });
    let to_solver = |deed: Deed| Class { victim: Process::Solver, deed };
    let own = |victim: Process, deed: Deed| Class { victim, deed };
    to_each(Deed::Stop)
        .chain(to_each(Deed::Slow))
        .chain(
            [Process::Solver, Process::Propagator, Process::Preprocessor].map(|victim| own(victim, Deed::StopForGood)),
        )
        .chain([Damage::Torn, Damage::Flipped, Damage::Foreign].map(|damage| to_solver(Deed::Damage(damage))))
        .chain([
            to_solver(Deed::CheckpointDiskFull),
            own(Process::Recorder, Deed::RecordDiskFull),
            own(Process::Supervisor, Deed::Starve),
            to_solver(Deed::StarveAndSlow),
            to_solver(Deed::StarveAndHalt),
            own(Process::Supervisor, Deed::SilentReader),
            own(Process::Supervisor, Deed::DyingReader),
            own(Process::Supervisor, Deed::PowerLoss),
            own(Process::Supervisor, Deed::PowerLoss),
            to_solver(Deed::Reload),
            to_solver(Deed::Swap),
        ])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_live_class_of_the_catalogue_is_done_or_missing() {
        let victims = [Process::EmulatorImu, Process::Solver, Process::Propagator];
        let mut numbers: Vec<u8> = besides_kills(&victims).iter().map(Class::number).collect();
        for victim in [Process::EmulatorImu, Process::Supervisor, Process::Solver, Process::Recorder] {
            numbers.push(Class { victim, deed: Deed::Kill }.number());
        }
        for number in [1, 2, 21, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35] {
            assert_eq!(numbers.contains(&number), LIVE.contains(&number), "F{number}");
            assert_ne!(LIVE.contains(&number), MISSING.iter().any(|(missing, _)| *missing == number), "F{number}");
        }
    }
}
