//! The drawings under one another: map, errors, window, latencies.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};

use super::drawing;
use super::map::{self, Sight};
use super::strips::{self, WINDOW_ROWS};
use super::trail::Trail;
use crate::numbers::microseconds;
use crate::snapshot::Snapshot;

/// Rows of a strip with its title.
const STRIP: u16 = 4;

/// Rows that the map has at least, before anything else is drawn.
const MAP: u16 = 12;

/// The drawings as rows of `width` characters at most, exactly `height` of them.
pub(super) fn rows(
    snapshot: &Snapshot,
    trail: &Trail,
    sight: &Sight,
    (width, height): (usize, usize),
    colours: bool,
) -> Vec<String> {
    let cells = |length: usize| u16::try_from(length).unwrap_or(u16::MAX).min(500);
    let area = Rect::new(0, 0, cells(width), cells(height));
    let mut buffer = Buffer::empty(area);
    // From the bottom: what is worth least is left out first.
    let mut room = area.height;
    let mut take = |rows: u16, keep: u16| {
        let fits = room >= rows + keep;
        room -= if fits { rows } else { 0 };
        fits.then_some(Rect { y: room, height: rows, ..area })
    };
    let hops = snapshot.hops.len() as u16;
    let strips: Vec<Option<Rect>> = (0..3).rev().map(|_| take(STRIP, MAP)).collect();
    let window = take(WINDOW_ROWS, MAP);
    let latencies = if hops > 0 { take(hops + 1, MAP) } else { None };
    for (axis, strip) in strips.into_iter().rev().enumerate() {
        if let Some(strip) = strip {
            strips::draw(trail, axis, strip, &mut buffer);
        }
    }
    if let Some(window) = window {
        strips::window(trail, window, &mut buffer);
    }
    if let Some(area) = latencies {
        table(snapshot, area, &mut buffer);
    }
    map::draw(snapshot, trail, sight, Rect { height: room, ..area }, &mut buffer);
    drawing::rows(&buffer, colours)
}

/// Latency of each hop.
fn table(snapshot: &Snapshot, area: Rect, buffer: &mut Buffer) {
    let line = |first: &str, [p50, p99, max]: [String; 3]| format!("{first:<24}{p50:>10}{p99:>10}{max:>10}");
    let faint = Style::default().fg(Color::DarkGray);
    let head = line("latency, us", ["p50", "p99", "max"].map(str::to_owned));
    buffer.set_stringn(area.x, area.y, head, usize::from(area.width), faint);
    for (row, hop) in snapshot.hops.iter().enumerate() {
        let what = format!("{} {}", hop.process, hop.what.replace('_', " "));
        let times = [hop.distribution.p50, hop.distribution.p99, hop.distribution.max].map(microseconds);
        buffer.set_stringn(
            area.x,
            area.y + 1 + row as u16,
            line(&what, times),
            usize::from(area.width),
            Style::default(),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::picture;
    use super::*;
    use crate::Model;
    use crate::detail::News;
    use crate::testing::{assert_golden, keyframe_at, mission_in_an_outage, mission_under_way, poisoned};

    /// A vehicle on its way east, and a window of keyframes.
    fn trail(model: &Model) -> Trail {
        let mut trail = Trail::new();
        let mut snapshot = model.snapshot();
        for index in 0..600 {
            let t = 60.0 + f64::from(index) * 0.1;
            snapshot.t = Some(t);
            if let Some(pose) = &mut snapshot.pose {
                pose.position_enu = [t - 100.0, 37.5 + 20.0 * (t / 20.0).sin(), -52.25];
            }
            let keyframes = if index % 10 == 0 { vec![keyframe_at(t)] } else { Vec::new() };
            trail.fold(&snapshot, &News { keyframes, fixes: Vec::new() });
        }
        trail
    }

    #[test]
    fn a_wide_terminal_has_map_strips_and_window_beside_the_tables() {
        let model = mission_under_way();
        let text = picture(&model.snapshot(), &trail(&model), &Sight::default(), (160, 50), false);
        assert_golden("terminal_160x50.txt", &text);
    }

    #[test]
    fn on_a_small_terminal_the_map_takes_the_place_of_the_tables() {
        let model = mission_under_way();
        let sight = Sight { shows_map: true, follows: true, zoom: 4.0, ..Sight::default() };
        let text = picture(&model.snapshot(), &trail(&model), &sight, (80, 24), false);
        assert_golden("terminal_map_80x24.txt", &text);
        let tables = picture(&model.snapshot(), &trail(&model), &Sight::default(), (80, 24), false);
        assert!(tables.contains("sensor") && !tables.contains("m across"));
        let page = Sight { page: Some("127.0.0.1:8088".parse().expect("an address")), ..Sight::default() };
        for size in [(80, 24), (160, 50)] {
            let text = picture(&model.snapshot(), &trail(&model), &page, size, false);
            assert!(text.contains(" http://127.0.0.1:8088"), "{text}");
        }
    }

    #[test]
    fn nothing_is_larger_than_the_terminal_whatever_is_known() {
        for model in [Model::new("main"), mission_under_way(), mission_in_an_outage(), poisoned()] {
            for size in [(80, 24), (40, 10), (1, 1), (200, 100), (140, 30), (0, 0), (160, 31)] {
                for shows_map in [false, true] {
                    let sight = Sight { shows_map, ..Sight::default() };
                    let text = picture(&model.snapshot(), &trail(&model), &sight, size, false);
                    assert!(text.lines().count() <= size.1, "{size:?}:\n{text}");
                    assert!(text.lines().all(|line| line.chars().count() <= size.0), "{size:?}:\n{text}");
                    let lower = text.to_lowercase();
                    assert!(!lower.contains("nan") && !lower.contains(" inf"), "{text}");
                }
            }
        }
    }

    #[test]
    fn help_says_what_the_keys_do() {
        let model = mission_under_way();
        let sight = Sight { shows_help: true, ..Sight::default() };
        let text = picture(&model.snapshot(), &trail(&model), &sight, (80, 24), false);
        assert!(text.contains("zoom the map") && text.contains("`ilns monitor --web`"));
    }
}
