//! What a set whose supervisor was killed left to the one that goes on in its place: its data time. The frame's origin and the
//! last solution lie in the same folder; whether that solution is young and whole enough to stand on is the solver's business.

use std::fs;
use std::path::Path;

use ilns_bus::Prefix;
use ilns_runtime::StartClock;

/// In the folder of a run: its start triple. Drivers that something else starts learn data time from it.
const START_FILE: &str = "start";

/// Leaves the start triple in the folder of a run, whole or not at all.
///
/// # Errors
/// When it cannot be written.
pub fn leave(folder: &Path, clock: &StartClock) -> std::io::Result<()> {
    let partial = folder.join("start.partial");
    fs::write(&partial, clock.to_string())?;
    fs::rename(partial, folder.join(START_FILE))
}

/// The start triple of a set under this prefix; `None` where none was left, or one from before the machine was last started.
pub fn clock_left(prefix: &Prefix, mono_now: i64) -> Option<StartClock> {
    let text = fs::read_to_string(prefix.run_directory().join(START_FILE)).ok()?;
    let clock: StartClock = text.parse().ok()?;
    // The monotonic clock begins anew with the machine.
    (clock.mono <= mono_now).then_some(clock)
}

#[cfg(test)]
mod tests {
    use shared_types::Time;

    use super::*;

    #[test]
    fn data_time_of_a_killed_set_is_found_unless_the_machine_was_started_since() {
        let prefix = Prefix::new(&format!("t{}-legacy", std::process::id())).expect("short enough");
        assert_eq!(clock_left(&prefix, i64::MAX), None, "nobody was there");
        fs::create_dir_all(prefix.run_directory()).expect("writable");
        let clock = StartClock { data: Time(7), mono: 1_000, rate: 2.0 };
        leave(&prefix.run_directory(), &clock).expect("writable");
        let found = [clock_left(&prefix, 999), clock_left(&prefix, 1_000)];
        fs::remove_dir_all(prefix.directory()).expect("made above");
        assert_eq!(found, [None, Some(clock)]);
    }
}
