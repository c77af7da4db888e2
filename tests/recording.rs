//! The recording of a live set: torn by `kill -9`, made whole, and replayed to the same bytes.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::fs;
use std::path::Path;

use harness::{ILNS, PATIENCE, Set, assert_nothing_left, ilns, kill, process};
use ilns_recording::mcap::McapWriter;
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
    let future = written_by_a_later_version(folder.path());
    for (bytes, expected) in [
        (&b"PK\x03\x04something"[..], "not an MCAP"),
        (b"\x89MCAP9\r\n", "major version"),
        (b"", "nothing was recorded"),
        (&future, "a later version of this program"),
    ] {
        fs::write(&file, bytes).expect("written");
        for arguments in [
            vec!["recording", "info", text(&file)],
            vec!["recording", "recover", text(&file), "--out", text(&out)],
            vec!["recording", "export", text(&file), "--out", text(&out)],
            vec!["view", text(&file), "--export", text(&out)],
        ] {
            let output = ilns(&arguments);
            let errors = String::from_utf8_lossy(&output.stderr);
            // Whatever the messages mean: what is in a file can be listed, and a torn one be made whole.
            if bytes == future && ["info", "recover"].contains(&arguments[1]) {
                assert!(output.status.success(), "{errors}");
                let _ = fs::remove_file(&out);
                continue;
            }
            assert_eq!(output.status.code(), Some(2), "{ILNS} {arguments:?}");
            assert!(!out.exists(), "{arguments:?} leaves nothing behind");
            assert!(errors.contains(expected) && errors.trim_end().lines().count() == 1, "{errors}");
        }
    }
}

/// An MCAP whose record of the format names one to come.
fn written_by_a_later_version(folder: &Path) -> Vec<u8> {
    let file = folder.join("later.mcap");
    McapWriter::create(&file, "").and_then(McapWriter::finish).expect("written");
    let mut bytes = fs::read(&file).expect("read");
    // Metadata: a string of six letters and its value of one digit, each behind its length.
    let entry = b"format\x01\0\0\0";
    let at = bytes.windows(entry.len()).position(|window| window == entry).expect("it names its format");
    bytes[at + entry.len()] = b'9';
    bytes
}

/// The run that a page of one file holds, without what the processor's clock says.
fn run_of(page: &Path) -> Value {
    let page = fs::read_to_string(page).expect("it was written");
    let (_, run) = page.split_once("<script type=\"application/json\" id=\"run\">").expect("it holds a run");
    let (run, _) = run.split_once("</script>").expect("it ends");
    let mut run: Value = serde_json::from_str(run).expect("JSON");
    forget_solve_times(&mut run);
    run
}

fn forget_solve_times(value: &mut Value) {
    match value {
        Value::Object(entries) => {
            entries.retain(|key, _| !["solve", "solves", "histograms"].contains(&key.as_str()));
            entries.values_mut().for_each(forget_solve_times);
        }
        Value::Array(items) => items.iter_mut().for_each(forget_solve_times),
        _ => {}
    }
}

#[test]
fn the_page_of_an_mcap_is_that_of_its_log_directory_and_a_torn_one_ends_where_it_is_torn() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let live = folder.path().join("live");
    let arguments = ["run", "--headless", "--scenario", "stable", "--preset", "realistic", "--rate", "4"];
    let mut set = Set::start("page", &[&arguments[..], &["--duration", "40", "--out", text(&live)]].concat());
    let (code, errors) = set.end(2 * PATIENCE);
    assert_eq!(code, Some(0), "{errors}");
    assert_nothing_left(&set.prefix);

    let view = |run: &Path| {
        let page = run.with_extension("html");
        let output = ilns(&["view", text(run), "--title", "a run", "--export", text(&page)]);
        let errors = String::from_utf8(output.stderr).expect("text");
        assert!(output.status.success(), "{}: {errors}", run.display());
        (run_of(&page), errors)
    };
    let recording = live.join("recording.mcap");
    let ((of_log, _), (of_mcap, errors)) = (view(&live), view(&recording));
    let last =
        |run: &Value| run["track"]["t"].as_array().expect("a column").last().and_then(Value::as_f64).expect("a time");
    assert!(last(&of_log) > 35.0 && of_log["keyframes"].as_array().is_some_and(|list| list.len() > 15));
    for part in ["kind", "title", "track", "keyframes", "fixes", "nis", "solutions", "states", "now"] {
        assert!(of_log[part] == of_mcap[part], "{part} differs");
    }
    assert_eq!(errors, "", "a whole one is not spoken of");

    let bytes = fs::read(&recording).expect("read");
    let torn = folder.path().join("torn.mcap");
    fs::write(&torn, &bytes[..bytes.len() * 7 / 10]).expect("written");
    let (of_torn, errors) = view(&torn);
    assert!(errors.contains("torn.mcap: read up to byte") && errors.trim_end().lines().count() == 1, "{errors}");
    assert!((20.0..35.0).contains(&last(&of_torn)), "{} s", last(&of_torn));
    // What is there of it is what was there of the whole.
    let of_whole: Vec<&Value> = of_mcap["keyframes"].as_array().expect("a list").iter().collect();
    let of_torn: Vec<&Value> = of_torn["keyframes"].as_array().expect("a list").iter().collect();
    assert!(of_torn.len() > 5 && of_whole.starts_with(&of_torn[..of_torn.len() - 2]), "{} keyframes", of_torn.len());

    let one_line = |arguments: &[&str], expected: &str| {
        let output = ilns(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(errors.contains(expected) && errors.trim_end().lines().count() == 1, "{errors}");
    };
    // Within the schemas, before any channel.
    fs::write(&torn, &bytes[..8_000]).expect("written");
    one_line(&["view", text(&torn)], "no log is without an IMU");
    one_line(&["view", text(&recording), text(&live)], "one run at a time");
    one_line(&["view", text(&recording), "--log", text(&live)], "has its log in itself");
}
