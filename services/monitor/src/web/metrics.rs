//! `/metrics`: the snapshot in Prometheus' text format.

use core::fmt::{Display, Write};

use shared_types::Mode;

use crate::snapshot::{Distribution, Snapshot};

/// The snapshot as metrics. What is not known is left out.
pub(super) fn render(snapshot: &Snapshot) -> String {
    let mut out = Exposition::default();
    let set = [("set", snapshot.prefix.as_str())];

    out.family("ilns_mode", "gauge", "1 for the mode of the newest estimate, 0 for the others.");
    for mode in Mode::ALL {
        out.sample("ilns_mode", &[set[0], ("mode", mode.name())], f64::from(u8::from(snapshot.mode == Some(mode))));
    }
    out.family("ilns_data_time_seconds", "gauge", "Data time of the newest estimate.");
    out.sample("ilns_data_time_seconds", &set, snapshot.t);
    out.family("ilns_estimates_total", "counter", "Estimates that the monitor received.");
    out.sample("ilns_estimates_total", &set, snapshot.estimates.received as f64);
    out.family("ilns_estimates_lost_total", "counter", "Estimates missing by sequence.");
    out.sample("ilns_estimates_lost_total", &set, snapshot.estimates.lost as f64);
    out.family("ilns_estimates_per_second", "gauge", "Estimates per second of data time.");
    out.sample("ilns_estimates_per_second", &set, snapshot.estimates.rate);
    out.family("ilns_estimate_age_seconds", "gauge", "Since the newest estimate was published.");
    out.sample("ilns_estimate_age_seconds", &set, snapshot.estimates.age);

    let axes = ["east", "north", "up"];
    out.family("ilns_position_meters", "gauge", "Estimated position in the local frame.");
    out.family_of(axes, set[0], "ilns_position_meters", snapshot.pose.as_ref().map(|pose| pose.position_enu));
    out.family("ilns_position_sigma_meters", "gauge", "1-sigma of the position.");
    out.family_of(
        axes,
        set[0],
        "ilns_position_sigma_meters",
        snapshot.pose.as_ref().map(|pose| pose.sigma_position_enu),
    );
    out.family("ilns_position_error_meters", "gauge", "Estimate minus truth, where there is a truth.");
    out.family_of(axes, set[0], "ilns_position_error_meters", snapshot.error.as_ref().map(|error| error.position_enu));

    sensors(&mut out, snapshot);
    if let Some(solver) = &snapshot.solver {
        out.family("ilns_solutions_total", "counter", "Solutions since the estimation began.");
        out.sample("ilns_solutions_total", &set, solver.solutions as f64);
        out.family("ilns_solution_age_seconds", "gauge", "Data time since the newest keyframe.");
        out.sample("ilns_solution_age_seconds", &set, solver.age);
        out.family("ilns_window_keyframes", "gauge", "Keyframes in the window.");
        out.sample("ilns_window_keyframes", &set, f64::from(solver.window));
    }
    out.family("ilns_latency_seconds", "summary", "Latency by process and hop since the process began.");
    for hop in &snapshot.hops {
        let labels = [set[0], ("process", hop.process.name()), ("hop", hop.what)];
        quantiles(&mut out, "ilns_latency_seconds", &labels, &hop.distribution);
    }
    processes(&mut out, snapshot);
    out.0
}

fn sensors(out: &mut Exposition, snapshot: &Snapshot) {
    let prefix = snapshot.prefix.as_str();
    let labels = |sensor: &'static str| [("set", prefix), ("sensor", sensor)];
    out.family("ilns_sensor_rate_hertz", "gauge", "Readings per second of data time.");
    for row in &snapshot.sensors {
        out.sample("ilns_sensor_rate_hertz", &labels(row.sensor.name()), row.rate);
    }
    out.family("ilns_sensor_age_seconds", "gauge", "Data time since the newest reading.");
    for row in &snapshot.sensors {
        out.sample("ilns_sensor_age_seconds", &labels(row.sensor.name()), row.age);
    }
    out.family("ilns_sensor_received_total", "counter", "Readings received.");
    for row in &snapshot.sensors {
        out.sample("ilns_sensor_received_total", &labels(row.sensor.name()), row.received as f64);
    }
    out.family("ilns_sensor_used_total", "counter", "Readings that became factors.");
    for row in &snapshot.sensors {
        out.sample("ilns_sensor_used_total", &labels(row.sensor.name()), row.used as f64);
    }
    out.family("ilns_sensor_lost_total", "counter", "Readings missing by sequence.");
    for row in &snapshot.sensors {
        out.sample("ilns_sensor_lost_total", &labels(row.sensor.name()), row.lost as f64);
    }
    out.family("ilns_sensor_rejected_total", "counter", "Readings refused, by reason.");
    for row in &snapshot.sensors {
        for (reason, count) in &row.rejected {
            let labels = [("set", prefix), ("sensor", row.sensor.name()), ("reason", *reason)];
            out.sample("ilns_sensor_rejected_total", &labels, *count as f64);
        }
    }
    out.family("ilns_sensor_time_offset_seconds", "gauge", "How much too late the stamps are found to be.");
    for row in &snapshot.sensors {
        out.sample("ilns_sensor_time_offset_seconds", &labels(row.sensor.name()), row.time_offset);
    }
    out.family(
        "ilns_sensor_calibration",
        "gauge",
        "What a sensor is found to be miscalibrated by, in the unit of its label.",
    );
    for row in &snapshot.sensors {
        if let Some(found) = &row.calibration {
            let labels = [
                ("set", prefix),
                ("sensor", row.sensor.name()),
                ("calibration", found.name.as_str()),
                ("unit", found.unit.as_str()),
            ];
            out.sample("ilns_sensor_calibration", &labels, found.value);
        }
    }
}

fn processes(out: &mut Exposition, snapshot: &Snapshot) {
    let labels = |process: &'static str| [("set", snapshot.prefix.as_str()), ("process", process)];
    out.family("ilns_process_up", "gauge", "1 if the process is in its loop and heard of lately.");
    for row in &snapshot.processes {
        out.sample("ilns_process_up", &labels(row.name.name()), f64::from(u8::from(row.is_well())));
    }
    out.family("ilns_process_restarts_total", "counter", "How often the process was restarted.");
    for row in &snapshot.processes {
        out.sample("ilns_process_restarts_total", &labels(row.name.name()), f64::from(row.restarts));
    }
    out.family("ilns_process_cpu_ratio", "gauge", "Share of one core.");
    for row in &snapshot.processes {
        out.sample("ilns_process_cpu_ratio", &labels(row.name.name()), row.cpu_percent.map(|percent| percent / 100.0));
    }
    out.family("ilns_process_resident_bytes", "gauge", "Resident memory.");
    for row in &snapshot.processes {
        out.sample(
            "ilns_process_resident_bytes",
            &labels(row.name.name()),
            row.resident_bytes.map(|bytes| bytes as f64),
        );
    }
    out.family("ilns_process_dropped_total", "counter", "Messages that the process published and no queue took.");
    for row in &snapshot.processes {
        out.sample("ilns_process_dropped_total", &labels(row.name.name()), row.dropped as f64);
    }
}

fn quantiles(out: &mut Exposition, name: &str, labels: &[(&str, &str)], of: &Distribution) {
    for (quantile, value) in [("0.5", of.p50), ("0.99", of.p99), ("1", of.max)] {
        out.sample(name, &[labels, &[("quantile", quantile)]].concat(), value);
    }
    out.sample(&format!("{name}_count"), labels, of.count as f64);
}

/// Lines of the format.
#[derive(Default)]
struct Exposition(String);

impl Exposition {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        let _ = writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    fn family_of(&mut self, axes: [&str; 3], set: (&str, &str), name: &str, values: Option<[f64; 3]>) {
        for (axis, value) in axes.into_iter().zip(values.into_iter().flatten()) {
            self.sample(name, &[set, ("axis", axis)], value);
        }
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: impl Into<Option<f64>>) {
        let Some(value) = value.into().filter(|value| value.is_finite()) else { return };
        let _ = write!(self.0, "{name}{{");
        for (index, (label, text)) in labels.iter().enumerate() {
            let _ = write!(self.0, "{}{label}=\"{}\"", if index == 0 { "" } else { "," }, Escaped(text));
        }
        let _ = writeln!(self.0, "}} {value}");
    }
}

/// A label's value.
struct Escaped<'a>(&'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        for character in self.0.chars() {
            match character {
                '\\' => f.write_str("\\\\")?,
                '"' => f.write_str("\\\"")?,
                '\n' => f.write_str("\\n")?,
                other => f.write_char(other)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{mission_in_an_outage, mission_under_way, poisoned};

    /// Name, labels and value of a line, as the format's grammar has them.
    fn is_sample(line: &str) -> bool {
        let Some((head, value)) = line.rsplit_once(' ') else { return false };
        let Some((name, labels)) = head.split_once('{') else { return false };
        let is_name = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_lowercase() || b == b'_');
        let is_label = |pair: &str| {
            pair.split_once('=').is_some_and(|(label, text)| {
                is_name(label) && text.len() >= 2 && text.starts_with('"') && text.ends_with('"')
            })
        };
        is_name(name)
            && labels.strip_suffix('}').is_some_and(|l| l.split(',').all(is_label))
            && value.parse::<f64>().is_ok()
    }

    #[test]
    fn every_line_is_one_of_the_format_and_every_family_is_told_once() {
        for model in [mission_under_way(), mission_in_an_outage(), poisoned()] {
            let text = render(&model.snapshot());
            let mut families = std::collections::BTreeSet::new();
            for line in text.lines() {
                if let Some(rest) = line.strip_prefix("# TYPE ") {
                    assert!(families.insert(rest.to_owned()), "{rest}");
                } else if !line.starts_with("# HELP ") {
                    assert!(is_sample(line), "{line}");
                }
            }
            assert!(!text.contains("NaN") && !text.contains("inf"), "what is no number is left out");
        }
    }

    #[test]
    fn rates_rejections_latency_mode_and_restarts_are_there() {
        let text = render(&mission_in_an_outage().snapshot());
        for line in [
            "ilns_mode{set=\"main\",mode=\"DEAD_RECKONING\"} 1",
            "ilns_sensor_rate_hertz{set=\"main\",sensor=\"imu\"} 200",
            "ilns_sensor_rejected_total{set=\"main\",sensor=\"lbl\",reason=\"gated\"} 9",
            "ilns_latency_seconds{set=\"main\",process=\"propagator\",hop=\"end_to_end\",quantile=\"0.99\"} 0.00012",
            "ilns_process_up{set=\"main\",process=\"solver\"} 0",
            "ilns_process_restarts_total{set=\"main\",process=\"solver\"} 0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in\n{text}");
        }
    }

    #[test]
    fn a_label_is_escaped() {
        assert_eq!(Escaped("a\"b\\c\nd").to_string(), "a\\\"b\\\\c\\nd");
    }
}
