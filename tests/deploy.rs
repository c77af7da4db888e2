//! What lies in `deploy/` is what the house takes.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use ilns_runtime::{ProcessFile, WakeUp};
use shared_types::{Config, ConfigText, Process};

fn deploy(file: &str) -> PathBuf {
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

fn install(arguments: &[&str]) -> Output {
    Command::new("sh").arg(deploy("install.sh")).args(arguments).output().expect("a shell")
}

/// Every file below a folder, by its path in it.
fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(directory) = open.pop() {
        for entry in std::fs::read_dir(&directory).expect("readable") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                open.push(path);
            } else {
                found.push(path.strip_prefix(folder).expect("below it").to_string_lossy().into_owned());
            }
        }
    }
    found.sort();
    found
}

/// A staged installation.
fn staged() -> tempfile::TempDir {
    let root = tempfile::tempdir().expect("a temporary folder");
    let path = root.path().to_str().expect("temporary paths are text");
    let output = install(&["install", "--root", path, "--binary", env!("CARGO_BIN_EXE_ilns")]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    root
}

#[test]
fn the_vehicle_file_is_a_configuration() {
    let file = ConfigText::new("deploy/navigator.toml", text("navigator.toml"));
    Config::load(&[file], &[]).unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn what_is_installed_is_uninstalled_and_what_was_edited_is_kept() {
    let root = staged();
    let path = root.path().to_str().expect("temporary paths are text");
    let installed = files(root.path());
    for file in ["usr/local/bin/ilns", "etc/ilns/processes.toml", "etc/systemd/system/ilns-bus.service"] {
        assert!(installed.iter().any(|each| each == file), "{file} in {installed:?}");
    }
    let edited = root.path().join("etc/ilns/navigator.toml");
    std::fs::write(&edited, "# ours\n").expect("writable");
    let again = install(&["install", "--root", path, "--binary", env!("CARGO_BIN_EXE_ilns")]);
    assert!(again.status.success() && String::from_utf8_lossy(&again.stdout).contains("navigator.toml.new"));
    assert_eq!(std::fs::read_to_string(&edited).expect("it is there"), "# ours\n");
    assert!(install(&["uninstall", "--root", path]).status.success());
    let left = files(root.path());
    assert_eq!(left, ["etc/ilns/navigator.toml", "etc/ilns/navigator.toml.new", "etc/ilns/processes.toml"]);
    assert!(install(&["uninstall", "--root", path, "--purge"]).status.success());
    assert_eq!(files(root.path()), Vec::<String>::new());
}

#[test]
fn an_installation_that_cannot_be_is_one_line_and_code_2() {
    let cases: [(&[&str], &str); 4] = [
        (&[], "expected install or uninstall"),
        (&["remove"], "remove is unknown"),
        (&["install", "--rooot", "/x"], "--rooot is unknown"),
        (&["install", "--root", "/nowhere", "--binary", "/no/such/ilns"], "/no/such/ilns is no executable"),
    ];
    for (arguments, expected) in cases {
        let output = install(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
        assert!(errors.lines().count() == 1 && errors.contains(expected), "{arguments:?}: {errors}");
    }
}

/// Largest exposure that the units may have, as `systemd-analyze security` counts it: 10 is none protected at all. A driver
/// needs devices and a network.
const EXPOSURE: f64 = 2.5;

#[test]
fn systemd_takes_every_unit_and_finds_it_well_enclosed() {
    let root = staged();
    let staging = format!("--root={}", root.path().display());
    let analyze = |arguments: &[&str]| Command::new("systemd-analyze").args(arguments).arg(&staging).output();
    let Ok(version) = analyze(&["--version"]) else {
        eprintln!("skipped: systemd-analyze is not on this machine");
        return;
    };
    assert!(version.status.success());
    // What every system has, and the executable of a driver, which is the integrator's.
    let own = root.path().join("usr/lib/systemd/system");
    std::fs::create_dir_all(&own).expect("writable");
    for target in ["sysinit", "basic", "shutdown", "local-fs", "multi-user"] {
        std::fs::write(own.join(format!("{target}.target")), "[Unit]\nDescription=of the system\n").expect("writable");
    }
    let driver = root.path().join("usr/local/lib/ilns/driver-dvl");
    std::fs::copy("/bin/true", driver).expect("writable");
    let verified = analyze(&["verify", "ilns.target", "ilns-driver@dvl.service"]).expect("it ran before");
    let complaints = String::from_utf8_lossy(&verified.stderr);
    assert!(verified.status.success() && !complaints.contains("ilns"), "{complaints}");
    for unit in files(&root.path().join("etc/systemd/system")).iter().filter(|unit| unit.ends_with(".service")) {
        let unit = unit.replace('@', "@dvl");
        let output = analyze(&["security", "--offline=true", &unit]).expect("it ran before");
        let verdict = String::from_utf8_lossy(&output.stdout);
        let exposure = verdict
            .split_once("Overall exposure level for ")
            .and_then(|(_, rest)| rest.split_once(": ")?.1.split_whitespace().next()?.parse::<f64>().ok());
        assert!(exposure.is_some_and(|exposure| exposure <= EXPOSURE), "{unit}: {exposure:?}");
    }
}

#[test]
fn every_process_of_the_set_has_a_unit_that_is_bound_to_the_bus_and_named_by_the_target() {
    let target = text("systemd/ilns.target");
    for process in ["preprocessor", "solver", "propagator", "recorder", "monitor"] {
        let unit = format!("ilns-{process}.service");
        let text = text(&format!("systemd/{unit}"));
        for line in ["BindsTo=ilns-bus.service", "Type=notify", "WatchdogSec=5", "RemoveIPC=no", "User=ilns"] {
            assert!(text.lines().any(|each| each == line), "{line} in {unit}");
        }
        assert!(text.contains(&format!("/usr/local/bin/ilns {process} ")), "{unit} runs {process}");
        assert!(target.contains(&unit), "{unit} in the target");
    }
}
