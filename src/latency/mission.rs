//! The mission that is sailed while latencies are measured: the built-in `stable` one, from just before its estimation
//! starts, with the wanted rate of the IMU, and long enough.

use std::fs;
use std::path::PathBuf;

use ilns_bus::Prefix;
use shared_types::Time;
use toml::{Table, Value};

const STABLE: &str = include_str!("../../deploy/scenarios/stable.toml");

/// Data time at which the run starts: the estimation of `stable` starts at 17 s.
pub(super) const START: Time = Time(16_500_000_000);

/// Beyond what is measured, s: start, warm-up, and a slow machine.
const SPARE: f64 = 120.0;

/// Writes the scenario into the folder of the run.
pub(super) fn write(prefix: &Prefix, rate: f64, duration: f64) -> std::io::Result<PathBuf> {
    let directory = prefix.run_directory();
    fs::create_dir_all(&directory)?;
    let file = directory.join("latency.toml");
    fs::write(&file, text(rate, duration))?;
    Ok(file)
}

fn text(rate: f64, duration: f64) -> String {
    let mut scenario: Table = toml::from_str(STABLE).expect("a test parses every built-in scenario");
    scenario.entry("imu").or_insert_with(|| Value::Table(Table::new()))["rate"] = Value::Float(rate);
    let segments = scenario["segment"].as_array_mut().expect("it has segments");
    let last = segments.last_mut().expect("three of them");
    last["until"] = Value::Float(START.as_seconds() + duration + SPARE);
    scenario.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_scenario_of_the_wanted_rate_and_length() {
        let again: Table = toml::from_str(&text(1000.0, 3600.0)).expect("it is TOML");
        assert_eq!(again["imu"]["rate"].as_float(), Some(1000.0));
        assert_eq!(again["segment"][2]["until"].as_float(), Some(16.5 + 3600.0 + SPARE));
        sim_world::Scenario::parse(&text(1000.0, 1.0), std::path::Path::new("latency.toml")).expect("it can be sailed");
    }
}
