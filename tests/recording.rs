//! The recording of a live set: torn by `kill -9`, made whole, and replayed to the same bytes.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::fs;
use std::path::Path;

use harness::{ILNS, PATIENCE, Set, assert_nothing_left, ilns, kill, process};
use rustix::process::Signal;
use serde_json::Value;

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are text")
}

fn run_ilns(arguments: &[&str]) -> String {
    let output = ilns(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

fn info(file: &Path) -> Value {
    serde_json::from_str(&run_ilns(&["recording", "info", "--json", text(file)])).expect("JSON")
}

fn messages(info: &Value, topic: &str) -> u64 {
    let channels = info["channels"].as_array().expect("a list");
    let channel = channels.iter().find(|channel| channel["topic"] == topic).expect("every channel is listed");
    channel["messages"].as_u64().expect("a number")
}

#[test]
fn a_killed_recorder_leaves_a_file_that_is_made_whole_and_the_next_one_replays_to_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let live = folder.path().join("live");
    let arguments = ["run", "--headless", "--scenario", "stable", "--rate", "2", "--out", text(&live)];
    let mut set = Set::start("torn", &arguments);
    let torn = live.join("recording.mcap");
    let recorder = |status: &Value| process(status, "recorder")["pid"].as_u64();
    // Something has been flushed, then the end comes at no chosen moment.
    let before =
        set.status_when("a keyframe is recorded", |_| torn.exists() && messages(&info(&torn), "/nav/diagnostics") > 0);
    kill(recorder(&before).expect("a process number") as u32, Signal::KILL);
    let next = live.join("restart-1/recording.mcap");
    set.status_when("the next recorder records estimates", |status| {
        recorder(status) != recorder(&before) && next.exists() && messages(&info(&next), "/pose") > 20
    });
    set.signal(Signal::TERM);
    let (code, errors) = set.end(PATIENCE);
    assert_eq!(code, Some(0), "{errors}");
    assert_nothing_left(&set.prefix);

    let found = info(&torn);
    assert_eq!(found["whole"], false);
    let whole = folder.path().join("whole.mcap");
    run_ilns(&["recording", "recover", text(&torn), "--out", text(&whole)]);
    let recovered = info(&whole);
    assert_eq!((&recovered["whole"], &recovered["messages"]), (&true.into(), &found["messages"]));
    for topic in
        ["/sensor/imu", "/sensor/lbl", "/sensor/dvl", "/sensor/buoys", "/sim/truth", "/tf", "/scene", "/health"]
    {
        assert!(messages(&recovered, topic) > 0, "{topic}");
    }

    // The second ended in order: its log directory comes out of it to the byte, and replays alike.
    let second = live.join("restart-1");
    let found = info(&next);
    assert_eq!((&found["whole"], &found["dropped"]), (&true.into(), &0.into()));
    let exported = folder.path().join("exported");
    run_ilns(&["recording", "export", text(&next), "--out", text(&exported)]);
    let mut compared = 0;
    for entry in fs::read_dir(&exported).expect("it was written") {
        let name = entry.expect("readable").file_name();
        let same = fs::read(exported.join(&name)).expect("read") == fs::read(second.join(&name)).expect("recorded");
        assert!(same, "{name:?} differs");
        compared += 1;
    }
    assert!(compared >= 6, "{compared} files");
    let [from_log, from_mcap] = ["from-log", "from-mcap"].map(|name| folder.path().join(name));
    run_ilns(&["replay", text(&second), "--out", text(&from_log)]);
    run_ilns(&["replay", text(&exported), "--out", text(&from_mcap)]);
    let estimates = |out: &Path| fs::read(out.join("estimate.csv")).expect("it was written");
    assert!(estimates(&from_log) == estimates(&from_mcap), "the replays differ");
}

#[test]
fn a_file_that_is_no_recording_is_named_in_one_line_with_exit_code_two() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("x.mcap");
    let out = folder.path().join("out");
    for (bytes, expected) in [
        (&b"PK\x03\x04something"[..], "not an MCAP"),
        (b"\x89MCAP9\r\n", "major version"),
        (b"", "nothing was recorded"),
    ] {
        fs::write(&file, bytes).expect("written");
        for arguments in [
            vec!["recording", "info", text(&file)],
            vec!["recording", "recover", text(&file), "--out", text(&out)],
            vec!["recording", "export", text(&file), "--out", text(&out)],
        ] {
            let output = ilns(&arguments);
            let errors = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{ILNS} {arguments:?}");
            assert!(errors.contains(expected) && errors.trim_end().lines().count() == 1, "{errors}");
        }
    }
}
