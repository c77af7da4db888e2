//! Whether a checkpoint may be stood on: of the same configuration, and not older than what can be made up for.
//!
//! Within one start of the machine its age is told by the monotonic clock, which nobody sets. After the next start only the
//! clock that goes on while the power is off can tell it; where that was set back meanwhile, nothing does.

use std::path::{Path, PathBuf};

use shared_types::{Clocks, Solution};

use super::{Checkpoint, CheckpointError, read_checkpoint};
use crate::error::LogError;

const SECOND: i64 = 1_000_000_000;

/// Oldest solution that a run begins from after a restart of the machine, ns. What a vehicle does in more than five minutes is another
/// mission; and where it may be by then, half a kilometre about, tells no more than nothing.
const MAX_AGE_AFTER_A_RESTART: i64 = 300 * SECOND;

/// The file that outlives the machine's restart, of the set of that name; all sets of a machine may share the folder.
pub fn kept_file(folder: &Path, set: &str) -> PathBuf {
    folder.join(format!("{set}.solution"))
}

/// What a reader asks of a checkpoint beyond its being whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CheckpointTerms {
    /// [`configuration_hash`](super::configuration_hash) of the reader's own configuration.
    pub configuration: u64,
    /// The machine's clocks now.
    pub now: Clocks,
    /// Oldest that is taken, ns since its publication.
    pub max_age: i64,
}

/// A solution of before the machine was started anew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kept {
    /// As it was.
    pub solution: Solution,
    /// Since then, ns, by the machine's wall clock.
    pub age: i64,
}

impl CheckpointTerms {
    /// For a run that begins after a restart of the machine: one word for all processes of the set.
    pub fn after_a_restart(configuration: u64, now: Clocks) -> CheckpointTerms {
        CheckpointTerms { configuration, now, max_age: MAX_AGE_AFTER_A_RESTART }
    }

    /// The solution that a process of this start of the machine left in `file`; `Ok(None)` where there is no file.
    ///
    /// # Errors
    /// As [`read_checkpoint`], and [`LogError::Checkpoint`] where the terms are not met.
    pub fn last_of_this_boot(&self, file: &Path) -> Result<Option<Solution>, LogError> {
        let Some(checkpoint) = read_checkpoint(file)? else { return Ok(None) };
        self.of_this_boot(&checkpoint)
            .map(Some)
            .map_err(|reason| LogError::Checkpoint { file: file.to_owned(), reason })
    }

    /// The solution that was kept in `file` before the machine was started anew; `Ok(None)` where there is no file, or one that this
    /// start of the machine has written: whoever ended a run and begins another has not been cut off.
    ///
    /// # Errors
    /// As [`read_checkpoint`], and [`LogError::Checkpoint`] where the terms are not met.
    pub fn last_of_another_boot(&self, file: &Path) -> Result<Option<Kept>, LogError> {
        let Some(checkpoint) = read_checkpoint(file)? else { return Ok(None) };
        // A machine that does not tell its starts apart has none that is another.
        if checkpoint.written.boot == self.now.boot || self.now.boot == 0 {
            return Ok(None);
        }
        self.of_another_boot(&checkpoint)
            .map(Some)
            .map_err(|reason| LogError::Checkpoint { file: file.to_owned(), reason })
    }

    fn of_this_boot(&self, checkpoint: &Checkpoint) -> Result<Solution, CheckpointError> {
        self.is_of_its_configuration(checkpoint)?;
        let age = self.now.mono.saturating_sub(checkpoint.written.mono);
        if checkpoint.written.boot != self.now.boot || age < 0 {
            return Err(CheckpointError::OtherBoot);
        }
        self.is_young(age)?;
        Ok(checkpoint.solution)
    }

    fn of_another_boot(&self, checkpoint: &Checkpoint) -> Result<Kept, CheckpointError> {
        self.is_of_its_configuration(checkpoint)?;
        let age = self.now.wall.saturating_sub(checkpoint.written.wall);
        if age < 0 {
            let ahead_s = age.saturating_neg() / SECOND;
            return Err(CheckpointError::ClockRanBackwards { ahead_s });
        }
        self.is_young(age)?;
        Ok(Kept { solution: checkpoint.solution, age })
    }

    fn is_of_its_configuration(&self, checkpoint: &Checkpoint) -> Result<(), CheckpointError> {
        if checkpoint.configuration == self.configuration { Ok(()) } else { Err(CheckpointError::Configuration) }
    }

    fn is_young(&self, age: i64) -> Result<(), CheckpointError> {
        let stale = CheckpointError::Stale { age_s: age / SECOND, most_s: self.max_age / SECOND };
        if age <= self.max_age { Ok(()) } else { Err(stale) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::checkpoint;
    use super::super::{Durability, configuration_hash, write_checkpoint};
    use super::*;

    fn terms() -> CheckpointTerms {
        let Checkpoint { configuration, written, .. } = checkpoint();
        let now = Clocks { mono: written.mono + SECOND / 2, wall: written.wall + SECOND / 2, ..written };
        CheckpointTerms { configuration, now, max_age: 10 * SECOND }
    }

    /// The machine has been started since, 40 s ago, and its wall clock says that `seconds` have passed.
    fn after_a_start(seconds: i64) -> CheckpointTerms {
        let wall = checkpoint().written.wall + seconds * SECOND;
        CheckpointTerms { now: Clocks { boot: 7, mono: 40 * SECOND, wall }, max_age: 300 * SECOND, ..terms() }
    }

    #[test]
    fn another_configuration_or_time_is_refused_with_the_reason() {
        let with = |terms: CheckpointTerms| terms.of_this_boot(&checkpoint()).map(|solution| solution.id);
        assert_eq!(with(terms()), Ok(41));
        assert_eq!(with(CheckpointTerms { configuration: 1, ..terms() }), Err(CheckpointError::Configuration));
        let written = checkpoint().written;
        let at = |mono: i64| with(CheckpointTerms { now: Clocks { mono, ..written }, ..terms() });
        assert_eq!([at(written.mono), at(written.mono + terms().max_age)], [Ok(41); 2]);
        assert_eq!(at(written.mono + 11 * SECOND), Err(CheckpointError::Stale { age_s: 11, most_s: 10 }));
        // The monotonic clock began anew: the machine was started since, whatever it calls its starts.
        assert_eq!(at(written.mono - 1), Err(CheckpointError::OtherBoot));
        assert_eq!(
            with(CheckpointTerms { now: Clocks { boot: 7, ..terms().now }, ..terms() }),
            Err(CheckpointError::OtherBoot)
        );
        assert_ne!(configuration_hash("[dvl]\nsigma = 0.1\n"), configuration_hash("[dvl]\nsigma = 0.2\n"));
    }

    #[test]
    fn after_a_start_of_the_machine_the_wall_clock_tells_the_age_or_the_checkpoint_is_refused() {
        let with =
            |terms: CheckpointTerms| terms.of_another_boot(&checkpoint()).map(|kept| (kept.solution.id, kept.age));
        assert_eq!(with(after_a_start(50)), Ok((41, 50 * SECOND)));
        assert_eq!(with(after_a_start(300)), Ok((41, 300 * SECOND)));
        assert_eq!(with(after_a_start(301)), Err(CheckpointError::Stale { age_s: 301, most_s: 300 }));
        assert_eq!(with(after_a_start(-5)), Err(CheckpointError::ClockRanBackwards { ahead_s: 5 }));
        // A clock without a battery begins in 1970.
        let battery = CheckpointTerms { now: Clocks { wall: 0, ..after_a_start(0).now }, ..after_a_start(0) };
        assert_eq!(with(battery), Err(CheckpointError::ClockRanBackwards { ahead_s: 1_700_000_000 }));
        assert_eq!(
            with(CheckpointTerms { configuration: 1, ..after_a_start(50) }),
            Err(CheckpointError::Configuration)
        );
    }

    #[test]
    fn what_this_start_of_the_machine_has_kept_is_none_of_another() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("main.solution");
        assert_eq!(after_a_start(50).last_of_another_boot(&file).expect("no file is no error"), None);
        write_checkpoint(&file, &checkpoint(), Durability::Power).expect("it can be written");
        assert_eq!(terms().last_of_another_boot(&file).expect("it is whole"), None);
        let nameless = CheckpointTerms { now: Clocks { boot: 0, ..terms().now }, ..terms() };
        assert_eq!(nameless.last_of_another_boot(&file).expect("it is whole"), None);
        let kept = after_a_start(50).last_of_another_boot(&file).expect("its terms are met").expect("there is one");
        assert_eq!(kept, Kept { solution: checkpoint().solution, age: 50 * SECOND });
        let error = after_a_start(-5).last_of_another_boot(&file).expect_err("nothing tells its age").to_string();
        assert!(error.contains("main.solution: ") && error.contains("5 s from now"), "{error}");
    }
}
