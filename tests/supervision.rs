//! The set from outside: the real executable, its processes, what they say and what they leave behind.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use harness::{ILNS, PATIENCE, STOP_LIMIT, Set, adopt_orphans, assert_nothing_left, ilns, kill, lives, process};
use ilns_recording::{Checkpoint, Durability, kept_file, read_checkpoint, write_checkpoint};
use ilns_runtime::clocks_now;
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::Signal;
use serde_json::Value;
use shared_types::Clocks;

fn rate(status: &Value, channel: &str) -> f64 {
    let channels = status["channels"].as_array().expect("a list");
    let found = channels.iter().find(|row| row["name"] == channel).expect("in the table");
    found["rate"].as_f64().expect("a number")
}

fn flows(status: &Value) -> bool {
    rate(status, "sensor/imu") > 100.0 && process(status, "emulator-imu")["state"] == "running"
}

const MISSION: [&str; 2] = ["run", "--headless"];

#[test]
fn a_run_ends_with_its_duration_and_leaves_nothing_behind() {
    let mut set = Set::start("ends", &["run", "--headless", "--duration", "2", "--log-level", "info"]);
    let (code, errors) = set.end(PATIENCE);
    assert_eq!(code, Some(0), "{errors}");
    // Two seconds at 200 Hz, both ends included.
    assert!(errors.contains("sent=401"), "{errors}");
    assert_nothing_left(&set.prefix);
}

#[test]
fn a_standard_error_that_nobody_reads_holds_nobody_up() {
    let (reader, mut full) = std::io::pipe().expect("a pipe");
    let flags = fcntl_getfl(&full).expect("its flags");
    fcntl_setfl(&full, flags | OFlags::NONBLOCK).expect("filling it must not wait");
    while full.write(&[b'\n'; 4096]).is_ok() {}
    fcntl_setfl(&full, flags).expect("as before: whoever writes now waits");
    let prefix = format!("s{}-unread", std::process::id());
    let child = Command::new(ILNS)
        .args(["run", "--prefix", &prefix, "--headless", "--rate", "4", "--log-level", "debug"])
        .stdout(Stdio::null())
        .stderr(full)
        .spawn()
        .expect("the executable was built");
    let mut set = Set { prefix, child };
    // The preprocessor has said by then that the frame is fixed, and the solver one line a keyframe.
    set.status_when("solutions come", |status| rate(status, "nav/solution") > 1.0);
    set.signal(Signal::TERM);
    assert_eq!(set.child_code(PATIENCE), Some(0));
    assert_nothing_left(&set.prefix);
    drop(reader);
}

#[test]
fn a_prefix_in_use_is_refused_in_one_line_that_names_its_owner() {
    let mut set = Set::start("taken", &MISSION);
    set.status_when("readings flow", flows);
    let output = ilns(&["run", "--headless", "--prefix", &set.prefix]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert_eq!(errors.lines().count(), 1, "{errors}");
    assert!(errors.contains(&set.child.id().to_string()) && errors.contains("--prefix NAME"), "{errors}");
    set.status_when("the first set goes on", flows);
}

#[test]
fn a_request_that_cannot_be_met_is_one_line_and_code_2() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("processes.toml");
    std::fs::write(&file, "[propagater]\ncore = 0\n").expect("it is writable");
    let processes = file.to_str().expect("temporary paths are text");
    let cases: [(&[&str], &str); 10] = [
        (&["run", "--log-level", "wran"], "--log-level wran"),
        (&["run", "--scenario", "misson"], "misson"),
        (&["run", "--log", "/no/such/log"], "/no/such/log"),
        (&["run", "--set", "fgo.windw=9"], "fgo.window"),
        (&["run", "--window", "1"], "fgo.window"),
        (&["run", "--processes", processes], "processes.toml:1: `propagater` is no process"),
        (&["run", "--processes", "/no/such.toml"], "/no/such.toml"),
        (&["run", "--prefix", "a/b"], "a/b"),
        (&["run", "--out", "/tmp"], "not an empty directory"),
        (&["status", "--prefix", "nobody-is-here"], "nobody-is-here"),
    ];
    for (arguments, named) in cases {
        let output = ilns(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
        assert_eq!(errors.lines().count(), 1, "{arguments:?}: {errors}");
        assert!(errors.starts_with(&format!("ilns {}: ", arguments[0])) && errors.contains(named), "{errors}");
    }
}

#[test]
fn two_sets_run_side_by_side() {
    let (mut one, mut other) = (Set::start("side", &MISSION), Set::start("side-b", &MISSION));
    let pid_one = process(&one.status_when("readings flow", flows), "emulator-imu")["pid"].clone();
    let pid_other = process(&other.status_when("readings flow", flows), "emulator-imu")["pid"].clone();
    assert_ne!(pid_one, pid_other);
    drop(other);
    let status = one.status_when("the one outlives the other", flows);
    assert!(rate(&status, "sensor/imu") < 300.0, "only its own readings: {status}");
}

#[test]
fn a_killed_process_is_restarted_and_its_readings_flow_again() {
    let mut set = Set::start("killed", &MISSION);
    let status = set.status_when("readings flow", flows);
    let pid = process(&status, "emulator-imu")["pid"].as_u64().expect("a number") as u32;
    kill(pid, Signal::KILL);
    let status =
        set.status_when("it is back", |status| flows(status) && process(status, "emulator-imu")["restarts"] == 1);
    assert_ne!(process(&status, "emulator-imu")["pid"], pid);
    assert_eq!(process(&status, "emulator-ps")["restarts"], 0);
    set.signal(Signal::TERM);
    assert_eq!(set.end(STOP_LIMIT).0, Some(0));
    assert_nothing_left(&set.prefix);
}

#[test]
fn a_process_that_cannot_begin_is_given_up_and_the_run_says_so() {
    // The recorder cannot make its folder there, and says so at every start.
    let mut set = Set::start("hopeless", &["run", "--headless", "--duration", "5", "--out", "/proc/no-folder"]);
    let (code, errors) = set.end(PATIENCE);
    assert_eq!(code, Some(2), "{errors}");
    let last = errors.lines().last().expect("it says so");
    assert!(last.starts_with("ilns run: recorder "), "{errors}");
    assert_nothing_left(&set.prefix);
}

#[test]
fn stopping_takes_less_than_two_seconds_even_with_a_process_that_does_not_listen() {
    let mut set = Set::start("stop", &MISSION);
    let status = set.status_when("readings flow", flows);
    let deaf = process(&status, "emulator-dvl")["pid"].as_u64().expect("a number") as u32;
    kill(deaf, Signal::STOP);
    set.signal(Signal::INT);
    assert_eq!(set.end(STOP_LIMIT).0, Some(0));
    assert!(!lives(deaf));
    assert_nothing_left(&set.prefix);
}

#[test]
fn a_killed_supervisor_takes_its_processes_along_and_the_next_begins_afresh() {
    let mut set = Set::start("orphans", &MISSION);
    let status = set.status_when("readings flow", flows);
    let pids: Vec<u32> = status["processes"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|process| process["pid"].as_u64().expect("a number") as u32)
        .collect();
    set.signal(Signal::KILL);
    set.child.wait().expect("killed");
    let deadline = Instant::now() + PATIENCE;
    while pids.iter().any(|&pid| lives(pid)) {
        assert!(Instant::now() < deadline, "some of {pids:?} outlive their supervisor");
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut next = Set::start("orphans", &MISSION);
    next.status_when("readings flow", flows);
    next.signal(Signal::TERM);
    assert_eq!(next.end(STOP_LIMIT).0, Some(0));
    assert_nothing_left(&next.prefix);
}

#[test]
fn a_supervisor_that_resumes_goes_on_from_the_last_solution_beside_a_stopped_process_of_the_dead_one() {
    const MISSION: [&str; 6] = ["run", "--headless", "--scenario", "stable", "--rate", "4"];
    let solves = |status: &Value| rate(status, "nav/solution") > 1.0;
    adopt_orphans();
    let mut set = Set::start("resumes", &MISSION);
    let status = set.status_when("solutions come", solves);
    let orphan = process(&status, "emulator-dvl")["pid"].as_u64().expect("a number") as u32;
    // It will hear of its parent's death when it goes on, long after the next supervisor has begun.
    kill(orphan, Signal::STOP);
    set.signal(Signal::KILL);
    set.child.wait().expect("killed");
    let resumed = [&MISSION[..], &["--resume", "--log-level", "info"]].concat();
    let mut next = Set::start("resumes", &resumed);
    next.status_when("solutions come again", solves);
    kill(orphan, Signal::CONT);
    let status = next.status_when("the orphan is gone", |status| !lives(orphan) && solves(status));
    // The orphan has taken nothing of the new set along: whoever joins now still finds every channel.
    kill(process(&status, "emulator-ps")["pid"].as_u64().expect("a number") as u32, Signal::KILL);
    next.status_when("a process can join", |status| process(status, "emulator-ps")["restarts"] == 1 && solves(status));
    next.signal(Signal::TERM);
    let (code, errors) = next.end(STOP_LIMIT);
    assert_eq!(code, Some(0), "{errors}");
    assert!(errors.contains("going on where a run under this prefix was killed"), "{errors}");
    assert!(errors.contains("taking up from the last solution"), "{errors}");
    assert_nothing_left(&next.prefix);
}

/// What is kept as it would be had an earlier start of the machine written it, so many seconds ago.
fn as_of_another_boot(kept: &Path, age_s: i64) {
    let checkpoint = read_checkpoint(kept).expect("it is whole").expect("it is there");
    let Clocks { boot, mono, .. } = checkpoint.written;
    let written = Clocks { boot: boot ^ 1, mono, wall: clocks_now().wall - age_s * 1_000_000_000 };
    write_checkpoint(kept, &Checkpoint { written, ..checkpoint }, Durability::Power).expect("it is writable");
}

#[test]
fn after_a_restart_of_the_machine_a_run_begins_from_the_last_place_kept_unless_nothing_tells_its_age() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let keep = folder.path().join("not/there/yet");
    let mission = ["run", "--headless", "--scenario", "stable", "--rate", "4", "--log-level", "info", "--keep"];
    let mission = [&mission[..], &[keep.to_str().expect("temporary paths are text")]].concat();
    let solves = |status: &Value| rate(status, "nav/solution") > 1.0;
    let run = |wanted: &dyn Fn(&Path) -> bool| {
        let mut set = Set::start("reboots", &mission);
        let kept = kept_file(&keep, &set.prefix);
        set.status_when("solutions come and one is kept", |status| solves(status) && wanted(&kept));
        set.signal(Signal::TERM);
        let (code, errors) = set.end(STOP_LIMIT);
        assert_eq!(code, Some(0), "{errors}");
        assert_nothing_left(&set.prefix);
        (kept, errors)
    };
    let (kept, errors) = run(&Path::exists);
    assert!(!errors.contains("started anew"), "{errors}");
    // Another run on the same start of the machine is another mission.
    let is_ours = |kept: &Path| {
        let found = read_checkpoint(kept).expect("it is whole").expect("it is there");
        found.written.boot == clocks_now().boot
    };
    let (_, errors) = run(&is_ours);
    assert!(!errors.contains("started anew"), "{errors}");
    as_of_another_boot(&kept, 20);
    let (_, errors) = run(&is_ours);
    assert!(errors.contains("the machine was started anew: beginning from the last place kept"), "{errors}");
    as_of_another_boot(&kept, -60);
    let (_, errors) = run(&is_ours);
    assert!(errors.contains("the clock was set back, and nothing tells its age"), "{errors}");
    assert!(!errors.contains("beginning from the last place kept"), "{errors}");
}

#[test]
fn another_configuration_is_taken_up_as_a_whole_by_a_set_that_goes_on_or_changes_nothing() {
    let mission = ["run", "--headless", "--scenario", "stable", "--rate", "4", "--log-level", "info"];
    let mut set = Set::start("reloads", &mission);
    let solves = |status: &Value| rate(status, "nav/solution") > 1.0;
    set.status_when("solutions come", solves);
    let reload = |arguments: &[&str]| {
        let output = ilns(&[&["reload", "--prefix", set.prefix.as_str()], arguments].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let cases: [(&[&str], &str); 4] = [
        (&["--set", "dvl.sigma=-1"], "dvl.sigma"),
        (&["--set", "dvl.sgma=1"], "did you mean `dvl.sigma`?"),
        (&["--no-dvl", "--estimator", "ekf"], "`estimator` cannot change under way"),
        (&["--config", "/no/such.toml"], "/no/such.toml"),
    ];
    for (arguments, named) in cases {
        let (code, errors) = reload(arguments);
        assert_eq!((code, errors.lines().count()), (Some(2), 1), "{arguments:?}: {errors}");
        assert!(errors.starts_with("ilns reload: ") && errors.contains(named), "{errors}");
    }
    assert_eq!(reload(&["--no-dvl", "--set", "ps.sigma=0.05"]), (Some(0), String::new()));
    let status = set.status_when("solutions come again", solves);
    let solver = process(&status, "solver")["pid"].as_u64().expect("a number") as u32;
    // Whoever comes in its place goes on under the same.
    kill(solver, Signal::KILL);
    set.status_when("it is back", |status| process(status, "solver")["restarts"] == 1 && solves(status));
    set.signal(Signal::TERM);
    let (code, errors) = set.end(STOP_LIMIT);
    assert_eq!(code, Some(0), "{errors}");
    assert_eq!(errors.matches("another configuration is in force").count(), 2, "{errors}");
    assert!(errors.contains("the configuration is the one that was reloaded"), "{errors}");
    assert!(errors.contains("taking up from the last solution"), "{errors}");
    assert_nothing_left(&set.prefix);
}

#[test]
fn channels_can_be_held_for_processes_that_something_else_starts() {
    let mut bus = Set::start("held", &["bus"]);
    bus.status_when("the bus is up", |status| process(status, "supervisor")["state"] == "running");
    let prefix = bus.prefix.clone();
    let imu = Command::new(ILNS)
        .args(["emulator", "imu", "--prefix", &prefix])
        .stderr(Stdio::null())
        .spawn()
        .expect("the executable was built");
    let mut imu = Set { prefix: format!("{prefix}-none"), child: imu };
    bus.status_when("readings flow", flows);
    imu.signal(Signal::TERM);
    imu.child.wait().expect("told to stop");
    bus.signal(Signal::TERM);
    assert_eq!(bus.end(STOP_LIMIT).0, Some(0));
    assert_nothing_left(&prefix);
}

#[test]
fn a_bus_that_is_killed_and_started_again_gets_its_processes_back() {
    let imu_of = |prefix: &str| {
        let child = Command::new(ILNS)
            .args(["emulator", "imu", "--prefix", prefix, "--log-level", "error"])
            .stderr(Stdio::piped())
            .spawn()
            .expect("the executable was built");
        Set { prefix: format!("{prefix}-none"), child }
    };
    let mut bus = Set::start("heir", &["bus"]);
    bus.status_when("the bus is up", |status| process(status, "supervisor")["state"] == "running");
    let prefix = bus.prefix.clone();
    let mut imu = imu_of(&prefix);
    bus.status_when("readings flow", flows);
    // What a run keeps for those who come after: it is not wiped with the channels.
    let kept = std::env::temp_dir().join(format!("ilns-{prefix}/run/kept"));
    std::fs::create_dir_all(kept.parent().expect("a folder")).expect("writable");
    std::fs::write(&kept, "").expect("writable");
    bus.signal(Signal::KILL);
    bus.child.wait().expect("killed");
    assert!(imu.child.try_wait().expect("our own child").is_none(), "the set outlives the bus");
    let mut heir = Set::start("heir", &["bus"]);
    heir.status_when("the bus is up", |status| process(status, "supervisor")["state"] == "running");
    // Its channels are gone: it says so and ends, for whoever restarts it.
    let (code, errors) = imu.end(PATIENCE);
    assert_eq!(code, Some(2), "{errors}");
    let said = errors.lines().find(|line| line.starts_with("ilns ")).expect("it says why");
    assert!(said.contains(&prefix) && said.contains("start it again"), "{errors}");
    assert!(kept.exists(), "the folder of the run is left alone");
    let mut imu = imu_of(&prefix);
    heir.status_when("readings flow again", flows);
    imu.signal(Signal::TERM);
    imu.child.wait().expect("told to stop");
    heir.signal(Signal::TERM);
    assert_eq!(heir.end(STOP_LIMIT).0, Some(0));
    assert_nothing_left(&prefix);
}
