//! What the picture shows: the plan of the trajectory and the errors beside their three sigmas.
//!
//! Colours are those of Okabe and Ito, told apart by the colour-blind and, by width and dashes, on a black-and-white print.

use shared_types::Mode;

use crate::plot::{ErrorSample, Picture, TrackPoint};
use crate::svg::{Anchor, Area, Scale, Svg};

const WIDTH: f64 = 900.0;
const MARGIN: f64 = 70.0;
const PLAN_HEIGHT: f64 = 620.0;
const STRIP_HEIGHT: f64 = 150.0;
const STRIP_GAP: f64 = 18.0;
const HEAD: f64 = 64.0;

const TRUTH: &str = "stroke=\"#999999\" stroke-width=\"5\"";
const ESTIMATE: &str = "stroke=\"#0072B2\" stroke-width=\"1.6\"";
const DEAD_RECKONING: &str = "stroke=\"#D55E00\" stroke-width=\"2.6\" stroke-dasharray=\"7 3\"";
const OUTAGE_SHADE: &str = "fill=\"#D55E00\" fill-opacity=\"0.13\"";
const SIGMA_BAND: &str = "fill=\"#56B4E9\" fill-opacity=\"0.35\"";
const FRAME: &str = "fill=\"none\" stroke=\"#444444\"";
const GRID: &str = "stroke=\"#dddddd\"";
const BUOY: &str = "fill=\"#E69F00\" stroke=\"#222222\"";

/// Draws everything that `picture` holds.
pub(crate) fn draw(picture: &Picture) -> String {
    let strips = if picture.errors.is_empty() { 0.0 } else { 3.0 * (STRIP_HEIGHT + STRIP_GAP) + 70.0 };
    let mut svg = Svg::new(WIDTH, HEAD + PLAN_HEIGHT + 60.0 + strips);
    svg.text([MARGIN, 26.0], Anchor::Start, "font-size=\"17\" font-weight=\"bold\"", &picture.title);
    legend(&mut svg, picture);
    plan(&mut svg, picture);
    if !picture.errors.is_empty() {
        error_strips(&mut svg, picture, HEAD + PLAN_HEIGHT + 80.0);
    }
    svg.finish(&picture.title)
}

fn legend(svg: &mut Svg, picture: &Picture) {
    let mut x = MARGIN;
    let mut entry = |svg: &mut Svg, style: &str, label: &str| {
        svg.line([x, 46.0], [x + 30.0, 46.0], style);
        svg.text([x + 36.0, 50.0], Anchor::Start, "", label);
        x += 60.0 + 7.0 * label.len() as f64;
    };
    if !picture.truth.is_empty() {
        entry(svg, TRUTH, "truth");
    }
    entry(svg, ESTIMATE, "estimate");
    if !outages(&picture.track).is_empty() {
        entry(svg, DEAD_RECKONING, "dead reckoning");
    }
    if !picture.buoys.is_empty() {
        svg.polygon(triangle([x + 8.0, 46.0]), BUOY);
        svg.text([x + 20.0, 50.0], Anchor::Start, "", "buoy");
        x += 70.0;
    }
    svg.circle([x + 8.0, 46.0], 4.5, "fill=\"#ffffff\" stroke=\"#222222\" stroke-width=\"1.5\"");
    svg.text([x + 18.0, 50.0], Anchor::Start, "", "start");
    svg.circle([x + 68.0, 46.0], 4.5, "fill=\"#222222\"");
    svg.text([x + 78.0, 50.0], Anchor::Start, "", "end");
}

fn plan(svg: &mut Svg, picture: &Picture) {
    let area = Area { left: MARGIN, top: HEAD, right: WIDTH - 20.0, bottom: HEAD + PLAN_HEIGHT };
    let (east, north) = equal_axes(picture, &area);
    let at = |[e, n]: [f64; 2]| [east.pixel(e), north.pixel(n)];

    for (value, label) in east.ticks(8) {
        let x = east.pixel(value);
        svg.line([x, area.top], [x, area.bottom], GRID);
        svg.text([x, area.bottom + 18.0], Anchor::Middle, "", &label);
    }
    for (value, label) in north.ticks(6) {
        let y = north.pixel(value);
        svg.line([area.left, y], [area.right, y], GRID);
        svg.text([area.left - 6.0, y + 4.0], Anchor::End, "", &label);
    }
    svg.rect(&area, FRAME);
    svg.text([(area.left + area.right) / 2.0, area.bottom + 38.0], Anchor::Middle, "", "east, m");
    upright(svg, [18.0, (area.top + area.bottom) / 2.0], "north, m");

    svg.polyline(picture.truth.iter().map(|&p| at(p)), TRUTH);
    svg.polyline(picture.track.iter().map(|p| at(p.position_en)), ESTIMATE);
    for outage in outages(&picture.track) {
        svg.polyline(outage.iter().map(|p| at(p.position_en)), DEAD_RECKONING);
    }
    for (number, position_en) in &picture.buoys {
        let [x, y] = at(*position_en);
        svg.polygon(triangle([x, y]), BUOY);
        svg.text([x + 10.0, y + 4.0], Anchor::Start, "font-size=\"11\"", &number.to_string());
    }
    if let (Some(first), Some(last)) = (picture.track.first(), picture.track.last()) {
        svg.circle(at(first.position_en), 4.5, "fill=\"#ffffff\" stroke=\"#222222\" stroke-width=\"1.5\"");
        svg.circle(at(last.position_en), 4.5, "fill=\"#222222\"");
    }
}

/// One metre is as long to the east as to the north, and everything is in view.
fn equal_axes(picture: &Picture, area: &Area) -> (Scale, Scale) {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let track = picture.track.iter().map(|p| p.position_en);
    let buoys = picture.buoys.iter().map(|&(_, position_en)| position_en);
    for point in track.chain(buoys).chain(picture.truth.iter().copied()) {
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    // 5 % of air on each side; a vehicle that stood still gets a metre.
    let per_pixel = ((high[0] - low[0]) / area.width()).max((high[1] - low[1]) / area.height()).max(1.0 / area.width());
    let half = [0.55 * per_pixel * area.width(), 0.55 * per_pixel * area.height()];
    let middle = [(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0];
    (
        Scale { low: middle[0] - half[0], high: middle[0] + half[0], from: area.left, to: area.right },
        Scale { low: middle[1] - half[1], high: middle[1] + half[1], from: area.bottom, to: area.top },
    )
}

/// Stretches of dead reckoning, each with the point after it, so that the line closes.
fn outages(track: &[TrackPoint]) -> Vec<&[TrackPoint]> {
    let mut found = Vec::new();
    let mut start = None;
    for (index, point) in track.iter().enumerate() {
        match (start, point.mode == Mode::DeadReckoning as u32) {
            (None, true) => start = Some(index),
            (Some(from), false) => {
                found.push(&track[from..=index]);
                start = None;
            }
            _ => {}
        }
    }
    found.extend(start.map(|from| &track[from..]));
    found
}

fn error_strips(svg: &mut Svg, picture: &Picture, top: f64) {
    let errors = &picture.errors;
    svg.text(
        [MARGIN, top],
        Anchor::Start,
        "font-weight=\"bold\"",
        "position error (line) within 3 sigma (band), estimate minus truth",
    );
    let t_end = errors.last().map_or(1.0, |sample| sample.t.max(1e-3));
    let t_start = errors.first().map_or(0.0, |sample| sample.t.min(t_end - 1e-3));
    for (axis, name) in ["east", "north", "up"].into_iter().enumerate() {
        let strip_top = top + 14.0 + axis as f64 * (STRIP_HEIGHT + STRIP_GAP);
        let area = Area { left: MARGIN, top: strip_top, right: WIDTH - 20.0, bottom: strip_top + STRIP_HEIGHT };
        let time = Scale { low: t_start, high: t_end, from: area.left, to: area.right };
        strip(svg, picture, axis, name, &area, time);
        if axis == 2 {
            for (value, label) in time.ticks(8) {
                svg.text([time.pixel(value), area.bottom + 18.0], Anchor::Middle, "", &label);
            }
            let middle = (area.left + area.right) / 2.0;
            svg.text([middle, area.bottom + 38.0], Anchor::Middle, "", "time since the first estimate, s");
        }
    }
}

fn strip(svg: &mut Svg, picture: &Picture, axis: usize, name: &str, area: &Area, time: Scale) {
    let errors = &picture.errors;
    let reach = reach(errors, axis);
    let metres = Scale { low: -reach, high: reach, from: area.bottom, to: area.top };
    svg.clipped(area, &format!("strip-{name}"), |svg| {
        for outage in outages(&picture.track) {
            let (left, right) = (time.pixel(outage[0].t), time.pixel(outage[outage.len() - 1].t));
            svg.rect(&Area { left, right, ..*area }, OUTAGE_SHADE);
        }
        let above = errors.iter().map(|sample| (sample, 3.0));
        let below = errors.iter().rev().map(|sample| (sample, -3.0));
        let band =
            above.chain(below).map(|(sample, k)| [time.pixel(sample.t), metres.pixel(k * sample.sigma_enu[axis])]);
        svg.polygon(band, SIGMA_BAND);
        let line = errors.iter().map(|sample| [time.pixel(sample.t), metres.pixel(sample.error_enu[axis])]);
        svg.polyline(line, "stroke=\"#0072B2\" stroke-width=\"1.2\"");
    });
    for (value, label) in metres.ticks(4) {
        let y = metres.pixel(value);
        svg.line([area.left, y], [area.right, y], GRID);
        svg.text([area.left - 6.0, y + 4.0], Anchor::End, "", &label);
    }
    svg.rect(area, FRAME);
    upright(svg, [18.0, (area.top + area.bottom) / 2.0], &format!("{name}, m"));
}

/// Half the height of a strip, m: every error is in view, and three sigmas but for the widest twentieth of them.
fn reach(errors: &[ErrorSample], axis: usize) -> f64 {
    let mut sigmas: Vec<f64> = errors.iter().map(|sample| sample.sigma_enu[axis]).collect();
    sigmas.sort_by(f64::total_cmp);
    let usual = sigmas.get(sigmas.len() * 19 / 20).copied().unwrap_or(0.0);
    let largest = errors.iter().map(|sample| sample.error_enu[axis].abs()).fold(0.0, f64::max);
    1.1 * largest.max(3.0 * usual).max(1e-6)
}

fn triangle([x, y]: [f64; 2]) -> [[f64; 2]; 3] {
    [[x - 6.0, y + 5.0], [x + 6.0, y + 5.0], [x, y - 6.0]]
}

fn upright(svg: &mut Svg, [x, y]: [f64; 2], text: &str) {
    svg.text([x, y], Anchor::Middle, &format!("transform=\"rotate(-90 {x:.1} {y:.1})\""), text);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(t: f64, mode: Mode) -> TrackPoint {
        TrackPoint { t, position_en: [t, 2.0 * t], mode: mode as u32 }
    }

    #[test]
    fn an_outage_is_a_stretch_of_dead_reckoning_and_the_point_after_it() {
        let modes = [Mode::Ok, Mode::DeadReckoning, Mode::DeadReckoning, Mode::Ok, Mode::DeadReckoning];
        let track: Vec<TrackPoint> = modes.iter().enumerate().map(|(i, &mode)| point(i as f64, mode)).collect();
        let found: Vec<(f64, f64)> = outages(&track).iter().map(|o| (o[0].t, o[o.len() - 1].t)).collect();
        assert_eq!(found, [(1.0, 3.0), (4.0, 4.0)]);
    }

    #[test]
    fn a_metre_is_equally_long_on_both_axes_and_all_is_in_view() {
        let picture = Picture { track: vec![point(0.0, Mode::Ok), point(500.0, Mode::Ok)], ..Picture::default() };
        let area = Area { left: 0.0, top: 0.0, right: 800.0, bottom: 600.0 };
        let (east, north) = equal_axes(&picture, &area);
        let (per_east, per_north) = (east.pixel(1.0) - east.pixel(0.0), north.pixel(0.0) - north.pixel(1.0));
        assert!((per_east - per_north).abs() < 1e-12, "{per_east} {per_north}");
        assert!(north.pixel(1000.0) > 0.0 && north.pixel(0.0) < 600.0 && north.pixel(1000.0) < north.pixel(0.0));
    }

    #[test]
    fn a_vehicle_that_stood_still_is_drawn() {
        let picture = Picture { track: vec![point(0.0, Mode::Ok); 3], ..Picture::default() };
        assert!(!draw(&picture).contains("NaN"));
    }
}
