//! The map: track in the colour of its mode, truth, buoys, fixes, the vehicle and its 95 % ellipse, in Braille dots.

use std::net::SocketAddr;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Span;
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Context, Line, Points};
use shared_types::Mode;

use super::trail::Trail;
use crate::numbers::fixed;
use crate::snapshot::{Pose, Snapshot};

/// 95 % of the chi-square distribution of two degrees of freedom.
const ELLIPSE: f64 = 5.991;

/// Dots of a cell.
const DOTS: [f64; 2] = [2.0, 4.0];

/// How the user looks at it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sight {
    /// How much closer than everything.
    pub(crate) zoom: f64,
    /// The vehicle stays in the middle.
    pub(crate) follows: bool,
    /// The map takes the place of the tables.
    pub(crate) shows_map: bool,
    /// What the keys do stands there instead.
    pub(crate) shows_help: bool,
    /// Where a browser finds the same.
    pub(crate) page: Option<SocketAddr>,
}

impl Default for Sight {
    fn default() -> Sight {
        Sight { zoom: 1.0, follows: false, shows_map: false, shows_help: false, page: None }
    }
}

/// The colour of a mode.
fn of_mode(mode: i32) -> Color {
    match mode {
        mode if mode == Mode::Ok as i32 => Color::Green,
        mode if mode == Mode::Degraded as i32 => Color::Yellow,
        mode if mode == Mode::DeadReckoning as i32 => Color::Red,
        mode if mode == Mode::Invalid as i32 => Color::Magenta,
        _ => Color::DarkGray,
    }
}

/// Middle (east, north) and metres per dot.
struct Frame {
    middle: [f64; 2],
    per_dot: f64,
}

impl Frame {
    fn of(snapshot: &Snapshot, trail: &Trail, sight: &Sight, area: Rect) -> Frame {
        let track = trail.track().iter().map(|sample| [sample.position_enu[0], sample.position_enu[1]]);
        let buoys = snapshot.buoys.iter().filter_map(|buoy| buoy.position_enu).map(|enu| [enu[0], enu[1]]);
        let here = snapshot.pose.as_ref().map(|pose| [pose.position_enu[0], pose.position_enu[1]]);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in track.chain(buoys).chain(here).filter(|point| point.iter().all(|x| x.is_finite())) {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if low[0] > high[0] {
            (low, high) = ([-10.0; 2], [10.0; 2]);
        }
        let dots = [f64::from(area.width) * DOTS[0], f64::from(area.height) * DOTS[1]];
        // A little room at the edge, and never closer than a hand's breadth a dot.
        let per_dot = (0..2).map(|axis| (high[axis] - low[axis]) * 1.08 / dots[axis].max(1.0)).fold(0.1, f64::max);
        let middle = match here.filter(|point| sight.follows && point.iter().all(|x| x.is_finite())) {
            Some(here) => here,
            None => core::array::from_fn(|axis| f64::midpoint(low[axis], high[axis])),
        };
        Frame { middle, per_dot: per_dot / sight.zoom }
    }

    fn bounds(&self, axis: usize, cells: u16) -> [f64; 2] {
        let half = f64::from(cells) * DOTS[axis] * self.per_dot / 2.0;
        [self.middle[axis] - half, self.middle[axis] + half]
    }
}

/// Draws it into `area`; the first row says how large it is.
pub(super) fn draw(snapshot: &Snapshot, trail: &Trail, sight: &Sight, area: Rect, buffer: &mut Buffer) {
    if area.height < 2 || area.width < 2 {
        return;
    }
    let chart = Rect { y: area.y + 1, height: area.height - 1, ..area };
    let frame = Frame::of(snapshot, trail, sight, chart);
    let across = fixed(frame.per_dot * f64::from(chart.width) * DOTS[0], 0);
    let way = if sight.follows { ", following" } else { "" };
    let title = format!("map {across} m across{way}   ▲ buoy  ◆ vehicle  ellipse 95 %");
    buffer.set_stringn(area.x, area.y, title, usize::from(area.width), Style::default().fg(Color::DarkGray));
    Canvas::default()
        .marker(Marker::Braille)
        .x_bounds(frame.bounds(0, chart.width))
        .y_bounds(frame.bounds(1, chart.height))
        .paint(|context| paint(context, snapshot, trail))
        .render(chart, buffer);
}

fn paint(context: &mut Context<'_>, snapshot: &Snapshot, trail: &Trail) {
    let track = trail.track();
    context.draw(&Points::new(&trail.fixes(false), Color::Cyan));
    context.draw(&Points::new(&trail.fixes(true), Color::Red));
    for pair in track.windows(2) {
        let [from, to] = [&pair[0], &pair[1]].map(|sample| [sample.position_enu[0], sample.position_enu[1]]);
        if from.iter().chain(&to).all(|x| x.is_finite()) {
            context.draw(&Line::new(from[0], from[1], to[0], to[1], of_mode(pair[1].mode)));
        }
    }
    if let Some(pose) = &snapshot.pose {
        for [from, to] in ellipse(pose) {
            context.draw(&Line::new(from[0], from[1], to[0], to[1], Color::Yellow));
        }
    }
    context.layer();
    for buoy in &snapshot.buoys {
        if let Some([east, north, _]) = buoy.position_enu {
            context.print(east, north, Span::styled(format!("▲{}", buoy.buoy), Style::default().fg(Color::Yellow)));
        }
    }
    if let Some(pose) = snapshot.pose.as_ref().filter(|pose| pose.position_enu.iter().all(|x| x.is_finite())) {
        let colour = of_mode(snapshot.mode.map_or(-1, |mode| mode as i32));
        let mark = Span::styled("◆", Style::default().fg(colour));
        context.print(pose.position_enu[0], pose.position_enu[1], mark);
    }
}

/// The 95 % ellipse in pieces; none where the covariance is none.
fn ellipse(pose: &Pose) -> Vec<[[f64; 2]; 2]> {
    const PIECES: usize = 48;
    let [ee, en, nn] = pose.covariance_horizontal;
    // Cholesky's factor turns a circle into the ellipse.
    let (a, c) = (ee.sqrt(), en / ee.sqrt());
    let d = (nn - c * c).sqrt();
    let point = |piece: usize| {
        let (sine, cosine) = (piece as f64 / PIECES as f64 * core::f64::consts::TAU).sin_cos();
        let radius = ELLIPSE.sqrt();
        [pose.position_enu[0] + radius * a * cosine, pose.position_enu[1] + radius * (c * cosine + d * sine)]
    };
    let pieces = (0..PIECES).map(|piece| [point(piece), point(piece + 1)]);
    pieces.filter(|piece| piece.iter().flatten().all(|x| x.is_finite())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{mission_under_way, poisoned};

    #[test]
    fn the_ellipse_has_the_covariance_s_axes_and_is_none_for_none() {
        let mut pose = mission_under_way().snapshot().pose.expect("navigating");
        pose.covariance_horizontal = [4.0, 0.0, 1.0];
        let reach = |axis: usize, pose: &Pose| {
            let far = |piece: &[[f64; 2]; 2]| (piece[0][axis] - pose.position_enu[axis]).abs();
            ellipse(pose).iter().map(far).fold(0.0, f64::max)
        };
        assert!((reach(0, &pose) - 2.0 * ELLIPSE.sqrt()).abs() < 1e-9);
        assert!((reach(1, &pose) - ELLIPSE.sqrt()).abs() < 1e-9);
        let none = poisoned().snapshot().pose.expect("a pose without numbers");
        assert!(ellipse(&none).is_empty());
    }
}
