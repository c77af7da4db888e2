//! The live set: recorded, repeated from its recording, and killed piece by piece.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::path::Path;
use std::time::Duration;

use harness::{PATIENCE, Set, assert_nothing_left, assert_repeated, channel_rate, ilns, kill, process};
use ilns_recording::read_estimates;
use rustix::process::Signal;
use serde_json::Value;
use shared_types::{Mode, Time};

/// One IMU period at 200 Hz.
const PERIOD: i64 = 5_000_000;

fn run_ilns(arguments: &[&str]) {
    let output = ilns(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are text")
}

/// Times of all estimates that were published, INITIALISING ones left out.
fn estimate_times(file: &Path) -> Vec<Time> {
    read_estimates(file).expect("it was written").map(|row| row.expect("a whole row").t).collect()
}

#[test]
fn a_live_run_is_reproduced_by_a_replay_of_its_recording() {
    assert_reproduced("repeat", "fgo");
}

#[test]
fn a_live_run_of_a_filter_is_reproduced_by_a_replay_of_its_recording() {
    assert_reproduced("filter", "ekf");
}

fn assert_reproduced(prefix: &str, estimator: &str) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (live, again) = (folder.path().join("live"), folder.path().join("again"));
    let arguments = [
        "run",
        "--headless",
        "--scenario",
        "stable",
        "--preset",
        "realistic",
        "--seed",
        "3",
        "--rate",
        "2",
        "--duration",
        "45",
        "--estimator",
        estimator,
        "--set",
        "fgo.fixed_lag=true",
        "--set",
        "fgo.window=10",
        "--out",
        text(&live),
    ];
    let mut set = Set::start(prefix, &arguments);
    let (code, errors) = set.end(2 * PATIENCE);
    assert_eq!(code, Some(0), "{errors}");
    assert_nothing_left(&set.prefix);

    // Every sample from the start of the estimation on has its estimate. On a machine that lets the driver wait for 20 ms there
    // is one more in between, without a sample.
    let mut times = estimate_times(&live.join("estimate.csv"));
    times.retain(|t| t.0 % PERIOD == 0);
    assert!(times.len() > 5500, "{} estimates in some 28 s", times.len());
    for pair in times.windows(2) {
        assert_eq!((pair[1] - pair[0]).0, PERIOD, "after {}", pair[0]);
    }

    let follow = live.join("estimate.csv");
    let arguments = ["replay", text(&live), "--estimator", estimator, "--out", text(&again), "--follow", text(&follow)];
    run_ilns(&arguments);
    let compared = assert_repeated(&follow, &again.join("estimate.csv"));
    assert!(compared + 200 >= times.len(), "{compared} of {} estimates compared", times.len());

    // Its MCAP alone is enough: the log directory comes out of it, and when each correction reached the estimates.
    let [exported, from_mcap] = ["exported", "from-mcap"].map(|name| folder.path().join(name));
    let recording = live.join("recording.mcap");
    run_ilns(&["recording", "export", text(&recording), "--out", text(&exported)]);
    let followed = ["--estimator", estimator, "--out", text(&from_mcap), "--follow", text(&recording)];
    run_ilns(&[&["replay", text(&exported)], &followed[..]].concat());
    let estimates = |out: &Path| std::fs::read(out.join("estimate.csv")).expect("it was written");
    assert!(
        estimates(&again) == estimates(&from_mcap),
        "the replay of the MCAP differs from that of the log directory"
    );
    if estimator == "fgo" {
        let lagged = |out: &Path| std::fs::read_to_string(out.join("estimate_lagged.csv")).expect("it was written");
        assert_lagged_is_reproduced(&lagged(&live), &lagged(&again));
    }
}

/// The estimates of a window ago: what was recorded stands in the replay, in one piece.
fn assert_lagged_is_reproduced(recorded: &str, repeated: &str) {
    let rows = |text: &str| -> Vec<String> { text.lines().skip(1).map(str::to_owned).collect() };
    let (recorded, repeated) = (rows(recorded), rows(repeated));
    assert!(recorded.len() > 3, "{} rows", recorded.len());
    let first = repeated.iter().position(|row| *row == recorded[0]).expect("the first that was recorded");
    let common = recorded.len().min(repeated.len() - first);
    assert_eq!(recorded[..common], repeated[first..first + common]);
    assert!(common + 1 >= recorded.len(), "{common} of {}", recorded.len());
}

/// Kills a process by -9 and waits until another one runs in its place.
fn kill_and_wait(set: &mut Set, name: &str) {
    let is_well = |status: &Value, restarts: u64| {
        let row = process(status, name);
        row["state"] == "running" && row["restarts"].as_u64().is_some_and(|count| count >= restarts)
    };
    let before = set.status_when(&format!("{name} runs"), |status| is_well(status, 0));
    let row = process(&before, name);
    let (pid, restarts) = (row["pid"].as_u64().expect("a number"), row["restarts"].as_u64().expect("a number"));
    kill(pid as u32, Signal::KILL);
    let after = set.status_when(&format!("{name} is back"), |status| {
        is_well(status, restarts + 1) && process(status, name)["pid"].as_u64() != Some(pid)
    });
    assert_eq!(process(&after, "supervisor")["state"], "running");
}

#[test]
fn estimates_do_not_stop_when_processes_behind_the_fast_path_are_killed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let live = folder.path().join("live");
    let arguments =
        ["run", "--headless", "--scenario", "stable", "--preset", "realistic", "--rate", "2", "--out", text(&live)];
    let mut set = Set::start("kills", &arguments);
    set.status_when("solutions come", |status| channel_rate(status, "nav/solution") > 0.5);
    for name in ["solver", "preprocessor", "emulator-dvl", "emulator-lbl", "solver"] {
        kill_and_wait(&mut set, name);
        set.status_when(&format!("solutions come after {name} was killed"), |status| {
            channel_rate(status, "nav/solution") > 0.5
        });
    }
    set.signal(Signal::TERM);
    let (code, errors) = set.end(PATIENCE);
    assert_eq!(code, Some(0), "{errors}");
    assert_nothing_left(&set.prefix);

    let rows: Vec<_> =
        read_estimates(live.join("estimate.csv")).expect("written").map(|row| row.expect("whole")).collect();
    let mut longest = 0;
    let mut worst_step = 0.0_f64;
    for pair in rows.windows(2) {
        longest = longest.max((pair[1].t - pair[0].t).0);
        let moved = |axis: usize| {
            let dt = (pair[1].t - pair[0].t).as_seconds();
            pair[1].position_enu[axis] - pair[0].position_enu[axis] - pair[0].velocity_enu[axis] * dt
        };
        for axis in 0..3 {
            worst_step = worst_step.max(moved(axis).abs() / pair[0].sigma_position_enu[axis]);
        }
    }
    assert_eq!(longest, PERIOD, "the longest gap between estimates, ns");
    assert!(worst_step < 3.0, "a step of {worst_step} sigmas");
    // A restarted solver counts on from the solution that it took up.
    let solutions: Vec<u64> = rows.iter().filter_map(|row| row.solution).collect();
    assert!(solutions.windows(2).all(|pair| pair[0] <= pair[1]), "the numbers of the solutions run forward");
    let last = rows.last().expect("there are rows");
    assert!(last.mode.is_some_and(|mode| mode != Mode::Initialising as u32), "{last:?}");
}

#[test]
fn a_killed_propagator_or_imu_driver_is_back_in_a_moment() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let live = folder.path().join("live");
    let arguments =
        ["run", "--headless", "--scenario", "stable", "--preset", "realistic", "--rate", "2", "--out", text(&live)];
    let mut set = Set::start("fast", &arguments);
    set.status_when("solutions come", |status| channel_rate(status, "nav/solution") > 0.5);
    for name in ["propagator", "emulator-imu"] {
        kill_and_wait(&mut set, name);
        set.status_when(&format!("estimates come after {name} was killed"), |status| {
            channel_rate(status, "nav/estimate") > 150.0
        });
    }
    set.signal(Signal::TERM);
    let (code, errors) = set.end(PATIENCE);
    assert_eq!(code, Some(0), "{errors}");
    assert_nothing_left(&set.prefix);
    let times = estimate_times(&live.join("estimate.csv"));
    let longest = times.windows(2).map(|pair| (pair[1] - pair[0]).as_seconds()).fold(0.0, f64::max);
    // Data time runs at twice the clock's: 2 s are one second of a machine that also starts a process.
    assert!(longest < 2.0 * Duration::from_secs(1).as_secs_f64(), "{longest} s without an estimate");
}
