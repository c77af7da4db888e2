//! Strip charts of the position's error within its three sigmas, and the window as one column per keyframe.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Context, Line};
use shared_types::{AIDING, Sensor};

use super::trail::Trail;
use crate::history::Sample;
use crate::numbers::fixed;

/// Time that a strip shows, s.
const SPAN: f64 = 120.0;

const AXES: [&str; 3] = ["east", "north", "up"];

/// Draws one axis into `area`; the first row says how large it is.
pub(super) fn draw(trail: &Trail, axis: usize, area: Rect, buffer: &mut Buffer) {
    if area.height < 2 || area.width < 2 {
        return;
    }
    let chart = Rect { y: area.y + 1, height: area.height - 1, ..area };
    let Some(newest) = trail.newest().back() else { return };
    let begin = newest.t - SPAN;
    let shown: Vec<&Sample> = trail.newest().iter().filter(|sample| sample.t >= begin).collect();
    let band = reach(shown.iter().map(|sample| 3.0 * sample.sigma_enu[axis]));
    let largest = band.max(reach(shown.iter().map(|sample| sample.error_enu[axis].abs()))).max(1e-3);
    let error = if newest.error_enu[axis].is_finite() {
        format!("error {} m, ", fixed(newest.error_enu[axis], 3))
    } else {
        String::new()
    };
    let title = format!(
        "{:<5} {error}3 sigma {} m; {SPAN} s, ± {} m",
        AXES[axis],
        fixed(3.0 * newest.sigma_enu[axis], 3),
        fixed(largest, 3),
    );
    buffer.set_stringn(area.x, area.y, title, usize::from(area.width), Style::default().fg(Color::DarkGray));
    Canvas::default()
        .marker(Marker::Braille)
        .x_bounds([begin, newest.t])
        .y_bounds([-largest, largest])
        .paint(|context| {
            line(context, &shown, Color::Blue, |sample| 3.0 * sample.sigma_enu[axis]);
            line(context, &shown, Color::Blue, |sample| -3.0 * sample.sigma_enu[axis]);
            context.layer();
            line(context, &shown, Color::Reset, |sample| sample.error_enu[axis]);
        })
        .render(chart, buffer);
}

/// How far a strip reaches: the first seconds of a run, or the last before a fix, must not flatten the rest, so that a tenth of
/// what is shown may lie outside. 0 where there is nothing.
fn reach(values: impl Iterator<Item = f64>) -> f64 {
    const INSIDE: f64 = 0.9;
    /// Room above.
    const MARGIN: f64 = 1.2;
    let mut values: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count => MARGIN * values[((count - 1) as f64 * INSIDE).ceil() as usize],
    }
}

fn line(context: &mut Context<'_>, shown: &[&Sample], colour: Color, value: impl Fn(&Sample) -> f64) {
    for pair in shown.windows(2) {
        let [from, to] = [value(pair[0]), value(pair[1])];
        if from.is_finite() && to.is_finite() {
            context.draw(&Line::new(pair[0].t, from, pair[1].t, to, colour));
        }
    }
}

/// Rows of the window's strip with its title.
pub(super) const WINDOW_ROWS: u16 = AIDING.len() as u16 + 1;

/// Draws the window: a column per keyframe, newest on the right, a row per sensor.
pub(super) fn window(trail: &Trail, area: Rect, buffer: &mut Buffer) {
    const LABEL: u16 = 6;
    let Some(newest) = trail.keyframes().back() else { return };
    let faint = Style::default().fg(Color::DarkGray);
    let title = format!("window of {} keyframes: █ used  ▒ some refused  × all refused", newest.window);
    buffer.set_stringn(area.x, area.y, title, usize::from(area.width), faint);
    let room = usize::from(area.width.saturating_sub(LABEL));
    let columns = room.min(newest.window as usize).min(trail.keyframes().len());
    let shown = trail.keyframes().iter().skip(trail.keyframes().len() - columns);
    for (row, sensor) in AIDING.into_iter().enumerate().take(usize::from(area.height.saturating_sub(1))) {
        let y = area.y + 1 + row as u16;
        buffer.set_stringn(area.x, y, sensor.name(), usize::from(area.width), faint);
        for (column, keyframe) in shown.clone().enumerate() {
            let of_sensor = || keyframe.factors.iter().filter(|factor| factor.sensor == sensor);
            let refused = of_sensor().filter(|factor| factor.refused.is_some()).count();
            let (mark, colour) = match (of_sensor().count(), refused) {
                (0, _) => ("·", Color::DarkGray),
                (_, 0) => ("█", of_sensor_colour(sensor)),
                (all, refused) if all == refused => ("×", Color::Red),
                _ => ("▒", Color::Red),
            };
            buffer.set_string(area.x + LABEL + column as u16, y, mark, Style::default().fg(colour));
        }
    }
}

fn of_sensor_colour(sensor: Sensor) -> Color {
    match sensor {
        Sensor::Lbl => Color::Blue,
        Sensor::Gnss => Color::Magenta,
        Sensor::Dvl => Color::Green,
        Sensor::Mcp => Color::Yellow,
        _ => Color::Cyan,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_peak_does_not_flatten_a_strip_and_what_lasts_is_in_sight() {
        let mut values = vec![0.1; 95];
        values.extend([50.0; 5]);
        assert!((reach(values.iter().copied()) - 0.12).abs() < 1e-12);
        values.extend([50.0; 20]);
        assert!((reach(values.iter().copied()) - 60.0).abs() < 1e-12);
        assert_eq!(reach([f64::NAN].into_iter()), 0.0);
        assert!((reach([2.0].into_iter()) - 2.4).abs() < 1e-12);
    }
}
