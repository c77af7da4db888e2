//! `ilns latency` from outside: what it says adds up.

#[expect(dead_code, reason = "another test file uses the other parts")]
mod harness;

use harness::{assert_nothing_left, ilns};
use serde_json::Value;

const PERCENTILES: [&str; 6] = ["p50_us", "p90_us", "p99_us", "p99_9_us", "p99_99_us", "max_us"];

fn percentiles(hop: &Value) -> Vec<f64> {
    PERCENTILES.iter().map(|name| hop[name].as_f64().unwrap_or_else(|| panic!("{name} in {hop}"))).collect()
}

#[test]
fn every_sample_of_the_window_is_measured_once_beside_bare_hops_of_the_same_rate() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let trace = folder.path().join("trace.json");
    let prefix = format!("s{}-latency", std::process::id());
    let file = trace.to_str().expect("temporary paths are text");
    let output = ilns(&["latency", "--rate", "250", "--duration", "2", "--json", "--prefix", &prefix, "--trace", file]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    assert_nothing_left(&prefix);
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");

    // Stamps are taken when a sample is sent, not when it is due: one may fall to either side of the window.
    let samples = report["end_to_end"]["count"].as_u64().expect("a number");
    let lost = report["losses"]["unanswered"].as_u64().expect("a number");
    assert!((495..=505).contains(&(samples + lost)), "{report}");
    assert_eq!(report["hops"]["imu_to_estimate"]["count"], samples);
    assert_eq!(report["lost"].as_u64().map(|lost| lost < samples), Some(true), "{report}");
    let hops = [&report["hops"]["imu_to_estimate"], &report["end_to_end"]];
    let references = ["iceoryx2", "unix_socket", "pipe"].map(|means| &report["reference"][means]);
    for hop in hops.into_iter().chain(references) {
        let values = percentiles(hop);
        assert!(values.is_sorted() && values[0] > 0.0, "{hop}");
        assert!(hop["count"].as_u64().is_some_and(|count| count > 450), "{hop}");
    }
    // The consumer has what the propagator has published, and later.
    assert!(percentiles(hops[1])[0] > percentiles(hops[0])[0], "{report}");

    let trace: Value = serde_json::from_slice(&std::fs::read(&trace).expect("it was written")).expect("it is JSON");
    let events = trace["traceEvents"].as_array().expect("a list");
    let named = |name: &str| events.iter().filter(|event| event["name"] == name).count() as u64;
    assert_eq!([named("read"), named("imu to estimate"), named("estimate to consumer")], [samples; 3]);
    assert!(events.iter().filter(|event| event["ph"] == "X").all(|event| event["dur"].as_f64() >= Some(0.0)));
}

#[test]
fn a_measurement_that_cannot_be_made_is_one_line_and_code_2() {
    let cases: [(&[&str], &str); 2] = [
        (&["latency", "--prefix", "a/b"], "a/b"),
        (&["latency", "--duration", "0.5", "--trace", "/no/such/folder/trace.json"], "trace.json"),
    ];
    for (arguments, named) in cases {
        let output = ilns(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
        assert_eq!(errors.lines().count(), 1, "{arguments:?}: {errors}");
        assert!(errors.starts_with("ilns latency: ") && errors.contains(named), "{errors}");
    }
}
