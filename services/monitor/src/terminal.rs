//! The view for a terminal, redrawn as a whole: 80 × 24 shows what matters, a larger one the processes and what happened, a
//! wide one the map, strip charts and the window beside them.

mod drawing;
mod map;
mod panel;
mod strips;
mod text;
mod trail;

use std::net::SocketAddr;

use shared_types::Mode;

use crate::numbers::{UNKNOWN, fixed, instant, microseconds, milliseconds};
use crate::snapshot::{CalibrationFound, Event, ProcessRow, SensorRow, Snapshot, TruthError, status_word};
pub(crate) use map::Sight;
use text::{Line, Tone};
pub(crate) use trail::Trail;

/// From this height on there is room for more than what matters.
const TALL: usize = 30;

/// From this width on the drawings stand beside the tables ...
const WIDE: usize = 140;

/// ... which take so much of it.
const TABLES: usize = 98;

/// An error beyond so many sigmas deserves a look.
const SUSPICIOUS: f64 = 3.0;

/// Widths of the pose: its labels, and its columns left (m) and right (deg).
const LABEL: usize = 11;
const LEFT: usize = 11;
const RIGHT: usize = 12;

/// The whole picture as `height` lines at most of `width` characters at most, joined by line feeds.
pub(crate) fn picture(
    snapshot: &Snapshot,
    trail: &Trail,
    sight: &Sight,
    (width, height): (usize, usize),
    colours: bool,
) -> String {
    let is_wide = width >= WIDE && height >= TALL;
    if sight.shows_help {
        return text_of(&help(), width, height, colours);
    }
    if sight.shows_map && !is_wide {
        return panel::rows(snapshot, trail, sight, (width, height), colours).join("\n");
    }
    let tables = tables(snapshot, height, sight.page);
    if !is_wide {
        return text_of(&tables, width, height, colours);
    }
    let drawings = panel::rows(snapshot, trail, sight, (width - TABLES - 1, height), colours);
    let beside = |(row, drawing): (usize, String)| {
        let table = tables.get(row).map_or_else(String::new, |line| line.render(TABLES, colours));
        let blank = TABLES + 1 - tables.get(row).map_or(0, |line| line.width().min(TABLES));
        format!("{table}{:blank$}{drawing}", "")
    };
    drawings.into_iter().enumerate().map(beside).map(|line| line.trim_end().to_owned()).collect::<Vec<_>>().join("\n")
}

/// The snapshot as `height` lines at most of `width` characters at most, joined by line feeds: the tables alone.
pub(crate) fn render(snapshot: &Snapshot, width: usize, height: usize, colours: bool) -> String {
    text_of(&tables(snapshot, height, None), width, height, colours)
}

fn text_of(lines: &[Line], width: usize, height: usize, colours: bool) -> String {
    lines.iter().take(height).map(|line| line.render(width, colours)).collect::<Vec<String>>().join("\n")
}

/// What the keys do.
fn help() -> Vec<Line> {
    [
        "q       end (with `ilns run`: the whole set)",
        "space   stand still, or go on",
        "r       forget the track, and see everything again",
        "+ -     zoom the map",
        "f       the map follows the vehicle",
        "m       the map instead of the tables (side by side from 140 columns on)",
        "? h     these lines",
        "",
        "The same and more in a browser: `ilns run`, or `ilns monitor --web`.",
    ]
    .map(|line| Line::plain(line.to_owned()))
    .to_vec()
}

/// `page` is where a browser finds the same.
fn tables(snapshot: &Snapshot, height: usize, page: Option<SocketAddr>) -> Vec<Line> {
    let at = |line: Line| match page {
        Some(address) => line.then(Tone::Plain, format!("   http://{address}")),
        None => line,
    };
    let mut lines = vec![title(snapshot), Line::default()];
    lines.extend(pose_table(snapshot));
    lines.push(place(snapshot));
    lines.push(Line::default());
    lines.extend(sensor_table(&snapshot.sensors));
    lines.push(Line::default());
    lines.push(solver(snapshot));
    if height >= TALL {
        lines.push(keyframe(snapshot));
    }
    lines.push(estimates(snapshot));
    let room = height.saturating_sub(lines.len());
    // A blank line, the heading, and two events at least.
    if room >= snapshot.processes.len() + 4 {
        lines[0] = at(core::mem::take(&mut lines[0]));
        lines.push(Line::default());
        lines.extend(process_table(&snapshot.processes));
        lines.push(Line::default());
    } else {
        lines.push(at(process_summary(&snapshot.processes)));
    }
    let room = height.saturating_sub(lines.len());
    let newest = snapshot.events.len().saturating_sub(room);
    lines.extend(snapshot.events[newest..].iter().map(event));
    lines.truncate(height);
    lines
}

fn title(snapshot: &Snapshot) -> Line {
    let (mode, tone) = match snapshot.mode {
        Some(mode @ Mode::Ok) => (mode.name(), Tone::Good),
        Some(mode @ (Mode::Initialising | Mode::Degraded)) => (mode.name(), Tone::Warning),
        Some(mode) => (mode.name(), Tone::Bad),
        None => ("NO ESTIMATE", Tone::Bad),
    };
    let buoys = snapshot.buoys.len();
    Line::plain(format!("ilns {}   ", snapshot.prefix)).then(tone, format!("{mode:<14}")).then(
        Tone::Plain,
        format!("   t {} s   {} x real time   {buoys} buoys", instant(snapshot.t, 3), fixed(snapshot.speed, 2)),
    )
}

/// A row of the pose: three numbers of position or velocity, three of attitude.
fn pose_row(label: &str, left: Option<[f64; 3]>, right: Option<[f64; 3]>, decimals: usize) -> Line {
    let mut line = Line::plain(format!("{label:<LABEL$}"));
    for (values, width) in [(left, LEFT), (right, RIGHT)] {
        for index in 0..3 {
            let value = values.map(|values| values[index]);
            line = line.then(Tone::Plain, format!("{:>width$}", fixed(value, decimals)));
        }
    }
    line
}

fn pose_table(snapshot: &Snapshot) -> Vec<Line> {
    let (pose, error) = (snapshot.pose.as_ref(), snapshot.error.as_ref());
    let heading = format!(
        "{:<LABEL$}{:>LEFT$}{:>LEFT$}{:>LEFT$}{:>RIGHT$}{:>RIGHT$}{:>RIGHT$}",
        "", "east m", "north m", "up m", "roll deg", "pitch deg", "heading deg"
    );
    let position = pose.map(|pose| pose.position_enu);
    let velocity = pose.map(|pose| pose.velocity_enu);
    let mut lines = vec![
        Line::plain(heading),
        pose_row("estimate", position, pose.map(|pose| pose.roll_pitch_heading_deg), 3),
        pose_row(
            "1-sigma",
            pose.map(|pose| pose.sigma_position_enu),
            pose.map(|pose| pose.sigma_roll_pitch_heading_deg),
            3,
        ),
        pose_row("error", error.map(|error| error.position_enu), error.map(|error| error.roll_pitch_heading_deg), 3),
    ];
    lines.push(error_in_sigmas(error));
    let rms = error.map(|error| error.rms_position_enu);
    lines.push(three("rms error", rms, ""));
    lines.push(three("velocity", velocity, &format!(" m/s, speed {} m/s", fixed(pose.map(|pose| pose.speed), 3))));
    lines
}

/// A row with numbers on its left side only.
fn three(label: &str, values: Option<[f64; 3]>, then: &str) -> Line {
    let numbers = (0..3).map(|index| format!("{:>LEFT$}", fixed(values.map(|values| values[index]), 3)));
    Line::plain(format!("{label:<LABEL$}{}{then}", numbers.collect::<String>()))
}

fn error_in_sigmas(error: Option<&TruthError>) -> Line {
    let mut line = Line::plain(format!("{:<LABEL$}", "error/sigma"));
    let sides = error.map(|error| [error.position_in_sigmas, error.roll_pitch_heading_in_sigmas]);
    for (side, width) in [LEFT, RIGHT].into_iter().enumerate() {
        for index in 0..3 {
            let value = sides.map(|sides| sides[side][index]);
            let tone = Tone::warning_if(value.is_some_and(|value| value.abs() > SUSPICIOUS));
            line = line.then(tone, format!("{:>width$}", fixed(value, 1)));
        }
    }
    line
}

fn place(snapshot: &Snapshot) -> Line {
    let pose = snapshot.pose.as_ref();
    let mut line = Line::plain(format!(
        "lat {}  lon {} deg  h {} m",
        fixed(pose.map(|pose| pose.lat_deg), 7),
        fixed(pose.map(|pose| pose.lon_deg), 7),
        fixed(pose.map(|pose| pose.height), 2),
    ));
    if let Some(error) = &snapshot.error {
        let tone = Tone::warning_if(error.horizontal_in_sigmas > SUSPICIOUS);
        let sigmas = fixed(error.horizontal_in_sigmas, 1);
        line = line
            .then(Tone::Plain, "  off ".to_owned())
            .then(tone, format!("{} m, {sigmas} sigma", fixed(error.horizontal, 3)));
    }
    line
}

fn sensor_table(sensors: &[SensorRow]) -> Vec<Line> {
    let heading = format!(
        "{:<6}{:>7}{:>7}{:>7}{:>7}{:>7}{:>9}{:>5}{:>9}  {}",
        "sensor", "per s", "age s", "used s", "innov", "gate", "received", "lost", "rejected", "why"
    );
    let mut lines = vec![Line::plain(heading)];
    lines.extend(sensors.iter().map(sensor_row));
    lines
}

fn sensor_row(row: &SensorRow) -> Line {
    let mut reasons: Vec<(&str, u64)> = row.rejected.iter().map(|(&reason, &count)| (reason, count)).collect();
    reasons.sort_by_key(|&(reason, count)| (!SensorRow::is_blamed(reason), core::cmp::Reverse(count)));
    let mut reasons: Vec<String> = reasons.into_iter().map(|(reason, count)| format!("{reason} {count}")).collect();
    if let Some((offset, sigma)) = row.time_offset.zip(row.time_offset_sigma) {
        reasons.insert(0, format!("stamps {} ms late (1-sigma {})", fixed(offset * 1e3, 1), fixed(sigma * 1e3, 1)));
    }
    if let Some(CalibrationFound { name, value, sigma, unit }) = &row.calibration {
        reasons.insert(0, format!("{name} {value:+.3} {unit} (1-sigma {sigma:.3})"));
    }
    let silent = Tone::warning_if(row.is_silent);
    Line::plain(format!("{:<6}", row.sensor))
        .then(silent, format!("{:>7}{:>7}", fixed(row.rate, 1), fixed(row.age, 1)))
        .then(Tone::Plain, format!("{:>7}", fixed(row.used_age, 1)))
        .then(
            Tone::warning_if(row.innovation.is_some_and(|sigmas| sigmas > SUSPICIOUS)),
            format!("{:>7}", fixed(row.innovation, 2)),
        )
        .then(Tone::Plain, format!("{:>7}{:>9}", gate(row), row.received))
        .then(Tone::warning_if(row.lost > 0), format!("{:>5}", row.lost))
        .then(Tone::Plain, format!("{:>9}  {}", share(row), reasons.join(", ")))
        .trimmed()
}

/// What the gate lets through: up to so many sigmas, for ranges from too long to too short.
fn gate(row: &SensorRow) -> String {
    match (row.is_gated, row.gate) {
        (Some(false), _) => "off".to_owned(),
        (_, Some([low, high])) if low < 0.0 => format!("{low:.0}..{high:.0}"),
        (_, Some([_, high])) => fixed(high, 1),
        _ => UNKNOWN.to_owned(),
    }
}

/// Refused readings of those received.
fn share(row: &SensorRow) -> String {
    match row.received {
        0 => UNKNOWN.to_owned(),
        received => format!("{} %", fixed(100.0 * row.rejected_total() as f64 / received as f64, 1)),
    }
}

fn solver(snapshot: &Snapshot) -> Line {
    let Some(solver) = &snapshot.solver else {
        return Line::plain("solve      no solution yet".to_owned());
    };
    let status = solver.status.map_or(UNKNOWN, status_word);
    Line::plain(format!(
        "solve ms   {}, p50 {}, p99 {}   {} iterations   window {}   ",
        milliseconds(solver.solve),
        milliseconds(solver.solves.map(|solves| solves.p50)),
        milliseconds(solver.solves.map(|solves| solves.p99)),
        solver.iterations,
        solver.window,
    ))
    .then(Tone::warning_if(solver.status != Some(shared_types::SolutionStatus::Converged)), status.to_owned())
}

fn keyframe(snapshot: &Snapshot) -> Line {
    let age = fixed(snapshot.solver.as_ref().and_then(|solver| solver.age), 1);
    let solutions = snapshot.solver.as_ref().map_or(0, |solver| solver.solutions);
    let factors = match &snapshot.keyframe {
        Some(keyframe) => format!(
            "   {} factors used, {} refused, NIS/row {}",
            keyframe.used,
            keyframe.refused,
            fixed(keyframe.nis_per_row, 2)
        ),
        None => String::new(),
    };
    Line::plain(format!("keyframe   number {solutions}, {age} s ago{factors}"))
}

fn estimates(snapshot: &Snapshot) -> Line {
    /// Ten samples of a slow IMU, s.
    const LATE: f64 = 0.5;
    let stream = &snapshot.estimates;
    let latency = snapshot.end_to_end;
    let late = stream.age.is_some_and(|age| age > LATE);
    Line::plain("estimates  ".to_owned())
        .then(
            Tone::warning_if(late),
            match stream.age.filter(|_| late) {
                Some(age) => format!("none for {} s", fixed(age, 1)),
                None => format!("{} per s", fixed(stream.rate, 1)),
            },
        )
        .then(Tone::warning_if(stream.lost > 0), format!("   {} lost", stream.lost))
        .then(
            Tone::Plain,
            format!(
                "   from IMU p50 {}, p99 {}, max {} us",
                microseconds(latency.map(|latency| latency.p50)),
                microseconds(latency.map(|latency| latency.p99)),
                microseconds(latency.map(|latency| latency.max)),
            ),
        )
}

fn process_summary(processes: &[ProcessRow]) -> Line {
    let ill: Vec<String> = processes
        .iter()
        .filter(|process| !process.is_well())
        .map(|process| format!("{} {}", process.name, state(process)))
        .collect();
    let line = Line::plain(format!("processes  {} well", processes.len() - ill.len()));
    if ill.is_empty() { line } else { line.then(Tone::Bad, format!("   {}", ill.join(", "))) }
}

fn process_table(processes: &[ProcessRow]) -> Vec<Line> {
    let heading = format!(
        "{:<16}{:>8}  {:<12}{:>8}{:>8}{:>10}{:>9}",
        "process", "pid", "state", "restarts", "cpu %", "memory MB", "dropped"
    );
    let mut lines = vec![Line::plain(heading)];
    lines.extend(processes.iter().map(|process| {
        let tone = if process.is_well() { Tone::Plain } else { Tone::Bad };
        let megabytes = process.resident_bytes.map(|bytes| bytes as f64 / 1e6);
        Line::plain(format!("{:<16}{:>8}  ", process.name, process.pid))
            .then(tone, format!("{:<12}", state(process)))
            .then(Tone::warning_if(process.restarts > 0), format!("{:>8}", process.restarts))
            .then(Tone::Plain, format!("{:>8}{:>10}", fixed(process.cpu_percent, 1), fixed(megabytes, 1)))
            .then(Tone::warning_if(process.dropped > 0), format!("{:>9}", process.dropped))
    }));
    lines
}

/// Where it stands; a process that should speak and does not is silent, whatever it said last.
fn state(process: &ProcessRow) -> &'static str {
    use shared_types::ProcessState::{Finished, Running};
    match process.state {
        Some(Running | Finished) if !process.is_well() => "silent",
        Some(state) => state.name(),
        None => "unknown",
    }
}

fn event(event: &Event) -> Line {
    let tone = Tone::warning_if(event.kind.is_bad());
    Line::plain(format!("t {:>10} s   ", instant(event.t, 1))).then(tone, event.kind.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Model;
    use crate::testing::{assert_golden, mission_in_an_outage, mission_under_way, poisoned};

    #[test]
    fn a_mission_under_way_fits_80_by_24() {
        let text = render(&mission_under_way().snapshot(), 80, 24, false);
        assert_golden("terminal_80x24.txt", &text);
    }

    #[test]
    fn an_outage_on_a_large_terminal_shows_processes_and_events() {
        let text = render(&mission_in_an_outage().snapshot(), 100, 48, false);
        assert_golden("terminal_100x48.txt", &text);
    }

    #[test]
    fn nothing_is_larger_than_the_terminal() {
        for model in [Model::new("main"), mission_under_way(), mission_in_an_outage()] {
            for (width, height) in [(80, 24), (40, 10), (1, 1), (200, 100), (80, 37), (0, 0)] {
                let text = render(&model.snapshot(), width, height, false);
                assert!(text.lines().count() <= height, "{width} x {height}:\n{text}");
                assert!(text.lines().all(|line| line.chars().count() <= width), "{width} x {height}:\n{text}");
            }
        }
    }

    #[test]
    fn what_matters_is_whole_at_80_columns() {
        let whole = render(&mission_under_way().snapshot(), 500, 24, false);
        let narrow = render(&mission_under_way().snapshot(), 80, 24, false);
        assert_eq!(whole, narrow);
        assert_eq!(narrow.lines().count(), 24);
    }

    #[test]
    fn long_numbers_and_words_fit_80_columns() {
        let mut snapshot = mission_under_way().snapshot();
        let pose = snapshot.pose.as_mut().expect("navigating");
        (pose.lat_deg, pose.lon_deg, pose.height) = (-36.380_337_9, -127.360_260_8, -1_052.25);
        pose.position_enu = [-98_765.432, 98_765.432, -1_052.25];
        let error = snapshot.error.as_mut().expect("a truth");
        (error.horizontal, error.horizontal_in_sigmas) = (123.456, 12.3);
        let solver = snapshot.solver.as_mut().expect("a solution");
        (solver.iterations, solver.window) = (10, 500);
        solver.status = Some(shared_types::SolutionStatus::NotConverged);
        snapshot.t = Some(1_746_099_142.369_8);
        snapshot.mode = Some(Mode::DeadReckoning);
        assert_eq!(render(&snapshot, 500, 24, false), render(&snapshot, 80, 24, false));
    }

    #[test]
    fn nothing_that_is_no_number_reaches_the_screen() {
        let text = render(&poisoned().snapshot(), 120, 60, false).to_lowercase();
        assert!(!text.contains("nan") && !text.contains("inf"), "{text}");
    }

    #[test]
    fn colours_change_no_letter_and_are_for_mode_and_warnings_only() {
        let snapshot = mission_in_an_outage().snapshot();
        let (plain, painted) = (render(&snapshot, 100, 48, false), render(&snapshot, 100, 48, true));
        assert!(!plain.contains('\x1b'));
        assert!(painted.contains("\x1b[31mDEAD_RECKONING"), "{painted}");
        let mut bare = String::new();
        let mut rest = painted.as_str();
        while let Some((before, after)) = rest.split_once('\x1b') {
            bare.push_str(before);
            rest = after.split_once('m').expect("every sequence here ends with m").1;
        }
        bare.push_str(rest);
        assert_eq!(bare, plain);
        let well = render(&mission_under_way().snapshot(), 80, 24, true);
        let painted = ["\x1b[31m", "\x1b[32m", "\x1b[33m"].map(|colour| well.matches(colour).count());
        assert_eq!(painted, [0, 1, 0], "only the mode is painted when all is well:\n{well}");
    }
}
