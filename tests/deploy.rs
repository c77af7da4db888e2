//! What lies in `deploy/` is what the house takes.

use std::path::Path;

use ilns_runtime::{ProcessFile, WakeUp};
use shared_types::Process;

fn deploy(file: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(file)
}

fn text(file: &str) -> String {
    std::fs::read_to_string(deploy(file)).unwrap_or_else(|error| panic!("deploy/{file}: {error}"))
}

/// For a computer of four cores, as the files say.
fn process_file(file: &str) -> ProcessFile {
    ProcessFile::parse(&text(file), &deploy(file), 4).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_bench_file_asks_for_nothing_and_a_vehicle_file_sets_the_fast_path_above_all_else() {
    let bench = process_file("bench.toml");
    for process in Process::ALL {
        assert_eq!(bench.of(process), Default::default(), "{process}");
    }
    let vehicle = process_file("vehicle.toml");
    let priority = |process: Process| vehicle.of(process).priority.unwrap_or(0);
    let fast = [Process::EmulatorImu, Process::Propagator];
    for other in Process::ALL.into_iter().filter(|process| !fast.contains(process)) {
        assert!(fast.iter().all(|&process| priority(process) > priority(other)), "{other}");
    }
    assert_eq!(vehicle.of(Process::Propagator).wake_up, WakeUp::Event);
    assert!(fast.iter().all(|&process| vehicle.of(process).lock_memory));
}
