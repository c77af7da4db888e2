//! One line per second, for logs and pipes.

use shared_types::Sensor;

use crate::numbers::{UNKNOWN, fixed, instant, microseconds, milliseconds};
use crate::snapshot::{SensorRow, Snapshot};

/// The snapshot on one line, without its end. `err` is horizontal, its sigmas the Mahalanobis distance.
pub(crate) fn render(snapshot: &Snapshot) -> String {
    let mut words =
        vec![format!("t={} s {}", instant(snapshot.t, 1), snapshot.mode.map_or(UNKNOWN, |mode| mode.name()))];
    words.push(position(snapshot));
    if let Some(error) = &snapshot.error {
        words.push(format!(
            "err={} m ({}σ) errU={} m ({}σ)",
            fixed(error.horizontal, 3),
            fixed(error.horizontal_in_sigmas, 1),
            fixed(error.position_enu[2], 3),
            fixed(error.position_in_sigmas[2], 1),
        ));
    }
    words.extend(snapshot.sensors.iter().filter(|row| row.received > 0 && row.sensor != Sensor::Buoys).map(sensor));
    let solve = snapshot.solver.as_ref().and_then(|solver| solver.solve);
    words.push(format!("solve {} ms", milliseconds(solve)));
    let end_to_end = snapshot.end_to_end;
    words.push(format!(
        "e2e p50 {} us p99 {} us",
        microseconds(end_to_end.map(|latency| latency.p50)),
        microseconds(end_to_end.map(|latency| latency.p99)),
    ));
    if snapshot.estimates.lost > 0 {
        words.push(format!("{} estimates lost", snapshot.estimates.lost));
    }
    words.extend(
        snapshot
            .processes
            .iter()
            .filter(|process| !process.is_well())
            .map(|process| format!("{} {}", process.name, process.state.map_or("unknown", |state| state.name()))),
    );
    words.join(" ")
}

fn position(snapshot: &Snapshot) -> String {
    let [[east, north, up], [sigma_east, sigma_north, sigma_up]] = match &snapshot.pose {
        Some(pose) => [pose.position_enu, pose.sigma_position_enu].map(|enu| enu.map(|x| fixed(x, 3))),
        None => [0, 1].map(|_| [0, 1, 2].map(|_| UNKNOWN.to_owned())),
    };
    format!("E={east} N={north} U={up} m sE={sigma_east} sN={sigma_north} sU={sigma_up} m")
}

fn sensor(row: &SensorRow) -> String {
    let lost = if row.lost > 0 { format!(" {} lost", row.lost) } else { String::new() };
    let (rate, age, rejected) = (fixed(row.rate, 1), fixed(row.age, 1), row.rejected_total());
    format!("{} {rate} Hz {age} s {rejected} rej{lost}", row.sensor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Model;
    use crate::testing::{assert_golden, mission_in_an_outage, mission_under_way};

    #[test]
    fn a_mission_under_way_is_told_on_one_line() {
        assert_golden("line_under_way.txt", &render(&mission_under_way().snapshot()));
    }

    #[test]
    fn what_went_wrong_is_on_the_line() {
        let line = render(&mission_in_an_outage().snapshot());
        assert_golden("line_outage.txt", &line);
        assert!(line.contains("DEAD_RECKONING") && line.contains("solver restarting"), "{line}");
    }

    #[test]
    fn before_anything_is_known_every_number_is_a_dash() {
        let line = render(&Model::new("main").snapshot());
        assert_eq!(line, "t=- s - E=- N=- U=- m sE=- sN=- sU=- m solve - ms e2e p50 - us p99 - us");
    }
}
