//! Whoever watches changes nothing: a live set under a crowd of browsers and a monitor that dies, is recorded, and its recording
//! repeats every estimate.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;

use harness::{PATIENCE, Set, assert_nothing_left, assert_repeated, channel_rate, ilns, kill, page_of, process};
use rustix::process::Signal;
use serde_json::Value;

/// Opens the stream of events and reads its first line; the rest is left unread, as by a browser that sleeps.
fn listener(address: &str) -> Option<TcpStream> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).ok()?;
    stream.write_all(b"GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n").ok()?;
    let mut line = String::new();
    BufReader::new(stream.try_clone().ok()?).read_line(&mut line).ok()?;
    line.starts_with("HTTP/1.1 200").then_some(stream)
}

fn monitor(status: &Value) -> (u32, u64) {
    let row = process(status, "monitor");
    (row["pid"].as_u64().expect("a number") as u32, row["restarts"].as_u64().expect("a number"))
}

#[test]
fn a_hundred_browsers_and_a_monitor_killed_stopped_and_restarted_change_no_estimate() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (live, again) = (folder.path().join("live"), folder.path().join("again"));
    let text = |path: &std::path::Path| path.to_str().expect("temporary paths are text").to_owned();
    let (out, replayed) = (text(&live), text(&again));
    let arguments = ["run", "--web", "127.0.0.1:0", "--scenario", "stable", "--preset", "realistic", "--seed", "5"];
    let mut set = Set::start("watched", &[&arguments[..], &["--rate", "2", "--out", &out]].concat());
    let url = page_of(&mut set.child);
    let address = url.strip_prefix("http://").expect("an address");
    let navigates =
        |status: &Value| channel_rate(status, "nav/solution") > 0.5 && process(status, "monitor")["state"] == "running";
    let mut crowd: Vec<TcpStream> = Vec::new();
    for killed in 0..3_u64 {
        let status =
            set.status_when("it navigates under a monitor", |status| navigates(status) && monitor(status).1 >= killed);
        crowd.clear();
        crowd.extend((0..100).map_while(|_| listener(address)));
        assert_eq!(crowd.len(), 100, "everybody is listened to, after {killed} deaths");
        let (pid, _) = monitor(&status);
        // A stopped one holds its queues; navigation goes on past it.
        kill(pid, Signal::STOP);
        set.status_when("it navigates beside a stopped monitor", |status| {
            channel_rate(status, "nav/solution") > 0.5 && channel_rate(status, "nav/estimate") > 150.0
        });
        kill(pid, if killed < 2 { Signal::KILL } else { Signal::CONT });
    }
    let after = set.status_when("it navigates in the end", navigates);
    for name in ["solver", "propagator", "preprocessor", "recorder", "emulator-imu", "emulator-lbl"] {
        assert_eq!(process(&after, name)["restarts"], 0, "{name} was not disturbed");
    }
    set.signal(Signal::TERM);
    assert_eq!(set.child_code(PATIENCE), Some(0));
    assert_nothing_left(&set.prefix);

    let follow = text(&live.join("estimate.csv"));
    let output = ilns(&["replay", &out, "--out", &replayed, "--follow", &follow]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let compared = assert_repeated(&live.join("estimate.csv"), &again.join("estimate.csv"));
    assert!(compared > 3000, "{compared} estimates compared");
    // The IMU's every step has its estimate: none was late beyond the queue, whoever looked on.
    let rows = ilns_recording::read_estimates(live.join("estimate.csv")).expect("written");
    let times: Vec<_> = rows.map(|row| row.expect("whole").t).filter(|t| t.0 % 5_000_000 == 0).collect();
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0]).0 == 5_000_000), "a gap between estimates");
}
