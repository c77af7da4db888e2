//! A driver of one's own in the place of an emulator: `examples/driver.rs` beside a running set.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use std::process::{Command, Stdio};

use harness::{STOP_LIMIT, Set, assert_nothing_left, process};
use rustix::process::Signal;
use serde_json::Value;

#[test]
fn an_external_driver_takes_the_place_of_its_emulator() {
    // Examples are built with the tests, unless one asks for this test alone.
    let here = std::env::current_exe().expect("this test");
    let driver = here.ancestors().nth(2).expect("target/release").join("examples/driver");
    if !driver.exists() {
        eprintln!("skipped: {} is not built (`cargo build --release --example driver` builds it)", driver.display());
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("processes.toml");
    std::fs::write(&file, "[emulator-ps]\nexternal = true\n").expect("writable");
    let processes = file.to_str().expect("temporary paths are text");
    let mut set = Set::start("hil", &["run", "--headless", "--scenario", "stable", "--processes", processes]);
    let rate = |status: &Value, name: &str| {
        let rows = status["channels"].as_array().expect("a list");
        rows.iter().find(|row| row["name"] == name).and_then(|row| row["rate"].as_f64()).expect("in the table")
    };
    let status = set.status_when("the others flow", |status| rate(status, "sensor/dvl") > 1.0);
    assert!(process(&status, "emulator-ps").is_null(), "nobody plays its part yet: {status}");
    assert_eq!(rate(&status, "sensor/ps"), 0.0);
    let mut driver =
        Command::new(driver).arg(&set.prefix).stderr(Stdio::null()).spawn().expect("it was built with the tests");
    let status = set.status_when("the driver's readings flow", |status| rate(status, "sensor/ps") > 5.0);
    assert_eq!(process(&status, "emulator-ps")["pid"], driver.id());
    harness::kill(driver.id(), Signal::TERM);
    assert!(driver.wait().expect("our own child").success());
    set.signal(Signal::TERM);
    assert_eq!(set.end(STOP_LIMIT).0, Some(0));
    assert_nothing_left(&set.prefix);
}
