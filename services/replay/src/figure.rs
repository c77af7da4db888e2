//! Figures of a report: curves with bands, bars with whiskers, plans with buoys. Each is one SVG page of its own.
//!
//! Series are told apart by the colours of Okabe and Ito and, on a black-and-white print, by dashes and hatching. Text is large enough
//! to be read when a page is as narrow as a telephone.

use crate::svg::{Anchor, Area, Scale, Svg};

const WIDTH: f64 = 720.0;
const LEFT: f64 = 78.0;
const RIGHT: f64 = 14.0;
const PANEL_HEIGHT: f64 = 150.0;
const PANEL_GAP: f64 = 16.0;
const LEGEND_LINE: f64 = 20.0;
const TEXT: &str = "font-size=\"14\"";
const FRAME: &str = "fill=\"none\" stroke=\"#444444\"";
const GRID: &str = "stroke=\"#dddddd\"";
const SHADE: &str = "fill=\"#999999\" fill-opacity=\"0.22\"";
/// Blue, vermilion, green, purple, orange, sky, black: dark enough for lines on paper.
const COLOURS: [&str; 7] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
const DASHES: [&str; 7] = ["none", "7 3", "2 3", "9 3 2 3", "none", "5 2", "1 2"];

/// A line of a chart.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    /// In the legend.
    pub name: String,
    /// Left to right.
    pub points: Vec<[f64; 2]>,
    /// x, lower, upper edge of the band around it; empty: none.
    pub band: Vec<[f64; 3]>,
}

/// One pair of axes.
#[derive(Clone, Debug, Default)]
pub struct Panel {
    /// Quantity and unit along the left.
    pub y_label: String,
    /// What is drawn.
    pub curves: Vec<Curve>,
    /// Lowest and highest value shown; `None`: all points, and of the bands what does not make the points small.
    pub y_range: Option<[f64; 2]>,
}

/// Panels one under the other, with one axis to the right.
#[derive(Clone, Debug, Default)]
pub struct CurveFigure {
    /// Heading.
    pub title: String,
    /// Quantity and unit along the bottom.
    pub x_label: String,
    /// From top to bottom.
    pub panels: Vec<Panel>,
    /// Decades instead of steps along both axes.
    pub is_logarithmic: bool,
    /// Stretches of x to shade, such as an outage.
    pub shaded: Vec<[f64; 2]>,
}

/// Bars in groups.
#[derive(Clone, Debug, Default)]
pub struct BarFigure {
    /// Heading.
    pub title: String,
    /// Quantity and unit.
    pub y_label: String,
    /// Under the groups.
    pub groups: Vec<String>,
    /// Name, and mean and spread per group; a group without a figure stays empty.
    pub series: Vec<(String, Vec<Option<[f64; 2]>>)>,
}

/// Tracks from above.
#[derive(Clone, Debug, Default)]
pub struct PlanFigure {
    /// Heading.
    pub title: String,
    /// Name and points (east, north), m; the first is drawn broad and grey, as the truth is.
    pub tracks: Vec<(String, Vec<[f64; 2]>)>,
    /// Number and place (east, north), m.
    pub buoys: Vec<(u32, [f64; 2])>,
}

impl CurveFigure {
    /// As an SVG file.
    pub fn svg(&self) -> String {
        let names = self.names();
        let head = 34.0 + LEGEND_LINE * legend_lines(&names) as f64 + 8.0;
        let height = head + self.panels.len() as f64 * (PANEL_HEIGHT + PANEL_GAP) + 36.0;
        let mut svg = page(&self.title, height);
        legend(&mut svg, &names, &|svg, index, area| {
            let middle = (area.top + area.bottom) / 2.0;
            svg.line([area.left, middle], [area.right, middle], &stroke(index));
        });
        let x = self.x_range();
        for (index, panel) in self.panels.iter().enumerate() {
            let top = head + index as f64 * (PANEL_HEIGHT + PANEL_GAP);
            let area = Area { left: LEFT, top, right: WIDTH - RIGHT, bottom: top + PANEL_HEIGHT };
            self.panel(&mut svg, panel, &names, &area, x, index + 1 == self.panels.len());
        }
        svg.finish(&self.title)
    }

    /// Each name once, in the order of its first appearance: one name has one colour in all panels.
    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for curve in self.panels.iter().flat_map(|panel| &panel.curves) {
            if !names.contains(&curve.name) {
                names.push(curve.name.clone());
            }
        }
        names
    }

    fn x_range(&self) -> [f64; 2] {
        let points = self.panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| &curve.points);
        let [low, high] = extent(points.map(|point| point[0]));
        if self.is_logarithmic { widened_by_factor([low, high], 1.15) } else { widened([low, high]) }
    }

    fn panel(&self, svg: &mut Svg, panel: &Panel, names: &[String], area: &Area, x: [f64; 2], is_last: bool) {
        let y = panel.y_range.unwrap_or_else(|| panel.y_extent(self.is_logarithmic));
        let axes = Axes::new(area, x, y, self.is_logarithmic);
        axes.grid(svg, area, is_last.then_some(self.x_label.as_str()), &panel.y_label);
        svg.clipped(area, &clip_name(&format!("{}{}{}", self.title, panel.y_label, area.top)), |svg| {
            for [from, to] in &self.shaded {
                let (left, right) = (axes.x(*from), axes.x(*to));
                svg.rect(&Area { left, right, ..*area }, SHADE);
            }
            for curve in &panel.curves {
                let index = names.iter().position(|name| *name == curve.name).unwrap_or(0);
                let above = curve.band.iter().map(|&[x, _, high]| [x, high]);
                let below = curve.band.iter().rev().map(|&[x, low, _]| [x, low]);
                if !curve.band.is_empty() {
                    let style = format!("fill=\"{}\" fill-opacity=\"0.18\"", COLOURS[index % COLOURS.len()]);
                    svg.polygon(above.chain(below).map(|[x, y]| [axes.x(x), axes.y(y)]), &style);
                }
            }
            for curve in &panel.curves {
                let index = names.iter().position(|name| *name == curve.name).unwrap_or(0);
                svg.polyline(curve.points.iter().map(|&[x, y]| [axes.x(x), axes.y(y)]), &stroke(index));
                if curve.points.len() <= 20 {
                    let fill = format!("fill=\"{}\"", COLOURS[index % COLOURS.len()]);
                    curve.points.iter().for_each(|&[x, y]| svg.circle([axes.x(x), axes.y(y)], 3.2, &fill));
                }
            }
        });
        svg.rect(area, FRAME);
    }
}

impl Panel {
    /// All points, and of the bands what leaves the points half of the height.
    fn y_extent(&self, is_logarithmic: bool) -> [f64; 2] {
        let [low, high] = extent(self.curves.iter().flat_map(|curve| &curve.points).map(|point| point[1]));
        if is_logarithmic {
            return widened_by_factor([low, high], 1.5);
        }
        let [mut band_low, mut band_high] =
            extent(self.curves.iter().flat_map(|curve| &curve.band).flat_map(|band| [band[1], band[2]]));
        if band_low > band_high {
            (band_low, band_high) = (low, high);
        }
        let reach = 0.5 * (high - low).max(1e-9);
        widened([low.min(band_low.max(low - reach)), high.max(band_high.min(high + reach))])
    }
}

impl BarFigure {
    /// As an SVG file.
    pub fn svg(&self) -> String {
        let names: Vec<String> = self.series.iter().map(|(name, _)| name.clone()).collect();
        let head = 34.0 + LEGEND_LINE * legend_lines(&names) as f64 + 8.0;
        let mut svg = page(&self.title, head + 260.0 + 52.0);
        for (index, colour) in COLOURS.iter().enumerate() {
            svg.hatching(&hatch_name(&self.title, index), colour, index);
        }
        let fill = |index: usize| {
            let colour = COLOURS[index % COLOURS.len()];
            format!("fill=\"url(#{})\" stroke=\"{colour}\"", hatch_name(&self.title, index % COLOURS.len()))
        };
        legend(&mut svg, &names, &|svg, index, area| svg.rect(area, &fill(index)));
        let area = Area { left: LEFT, top: head, right: WIDTH - RIGHT, bottom: head + 260.0 };
        let bars = || self.series.iter().flat_map(|(_, bars)| bars.iter().flatten());
        let [_, high] = extent(bars().map(|[mean, spread]| mean + spread));
        let axes = Axes::new(&area, [0.0, self.groups.len().max(1) as f64], [0.0, 1.08 * high.max(1e-9)], false);
        axes.grid_of_y(&mut svg, &area, &self.y_label);
        let width = 0.8 / self.series.len().max(1) as f64;
        for (index, (_, bars)) in self.series.iter().enumerate() {
            for (group, [mean, spread]) in bars.iter().enumerate().filter_map(|(group, bar)| Some((group, (*bar)?))) {
                let left = group as f64 + 0.1 + width * index as f64;
                let (from, to) = (axes.x(left + 0.06 * width), axes.x(left + 0.94 * width));
                svg.rect(&Area { left: from, top: axes.y(mean), right: to, bottom: area.bottom }, &fill(index));
                let middle = (from + to) / 2.0;
                let ends = [axes.y((mean - spread).max(0.0)), axes.y(mean + spread)];
                svg.line([middle, ends[0]], [middle, ends[1]], "stroke=\"#222222\" stroke-width=\"1.4\"");
            }
        }
        for (group, name) in self.groups.iter().enumerate() {
            svg.text([axes.x(group as f64 + 0.5), area.bottom + 20.0], Anchor::Middle, TEXT, name);
        }
        svg.rect(&area, FRAME);
        svg.finish(&self.title)
    }
}

impl PlanFigure {
    /// As an SVG file.
    pub fn svg(&self) -> String {
        let names: Vec<String> = self.tracks.iter().map(|(name, _)| name.clone()).collect();
        let head = 34.0 + LEGEND_LINE * legend_lines(&names) as f64 + 8.0;
        let size = WIDTH - LEFT - RIGHT;
        let mut svg = page(&self.title, head + 0.8 * size + 52.0);
        let style = |index: usize| match index {
            0 => "stroke=\"#999999\" stroke-width=\"5\"".to_owned(),
            index => stroke(index - 1),
        };
        legend(&mut svg, &names, &|svg, index, area| {
            let middle = (area.top + area.bottom) / 2.0;
            svg.line([area.left, middle], [area.right, middle], &style(index));
        });
        let area = Area { left: LEFT, top: head, right: WIDTH - RIGHT, bottom: head + 0.8 * size };
        let points = || self.tracks.iter().flat_map(|(_, points)| points).chain(self.buoys.iter().map(|(_, at)| at));
        let around_nothing = |[low, high]: [f64; 2]| if low > high { [-1.0, 1.0] } else { [low, high] };
        let [east, north] = [0, 1].map(|axis| around_nothing(extent(points().map(|point| point[axis]))));
        // One metre is as long to the east as to the north.
        let per_pixel = ((east[1] - east[0]) / area.width()).max((north[1] - north[0]) / area.height()).max(1e-3);
        let around = |[low, high]: [f64; 2], pixels: f64| {
            let (middle, half) = ((low + high) / 2.0, 0.55 * per_pixel * pixels);
            [middle - half, middle + half]
        };
        let axes = Axes::new(&area, around(east, area.width()), around(north, area.height()), false);
        axes.grid(&mut svg, &area, Some("east, m"), "north, m");
        for (index, (_, points)) in self.tracks.iter().enumerate() {
            svg.polyline(points.iter().map(|&[x, y]| [axes.x(x), axes.y(y)]), &style(index));
        }
        for (number, [x, y]) in &self.buoys {
            let (x, y) = (axes.x(*x), axes.y(*y));
            let corners = [[x - 7.0, y + 6.0], [x + 7.0, y + 6.0], [x, y - 7.0]];
            svg.polygon(corners, "fill=\"#E69F00\" stroke=\"#222222\"");
            svg.text([x + 11.0, y + 5.0], Anchor::Start, TEXT, &format!("buoy {number}"));
        }
        svg.rect(&area, FRAME);
        svg.finish(&self.title)
    }
}

/// Two scales, of numbers or of their logarithms.
struct Axes {
    x: Scale,
    y: Scale,
    is_logarithmic: bool,
}

impl Axes {
    fn new(area: &Area, x: [f64; 2], y: [f64; 2], is_logarithmic: bool) -> Axes {
        let of = |value: f64| if is_logarithmic { value.max(1e-12).log10() } else { value };
        Axes {
            x: Scale { low: of(x[0]), high: of(x[1]), from: area.left, to: area.right },
            y: Scale { low: of(y[0]), high: of(y[1]), from: area.bottom, to: area.top },
            is_logarithmic,
        }
    }

    fn of(&self, value: f64) -> f64 {
        if self.is_logarithmic { value.max(1e-12).log10() } else { value }
    }

    fn x(&self, value: f64) -> f64 {
        self.x.pixel(self.of(value))
    }

    fn y(&self, value: f64) -> f64 {
        self.y.pixel(self.of(value))
    }

    fn ticks(&self, scale: &Scale, count: usize) -> Vec<(f64, String)> {
        if !self.is_logarithmic {
            return scale.ticks(count);
        }
        let (low, high) = (10_f64.powf(scale.low), 10_f64.powf(scale.high));
        let decades = scale.low.floor() as i32..=scale.high.ceil() as i32;
        let all = decades.flat_map(|decade| [1.0, 2.0, 5.0].map(|step| step * 10_f64.powi(decade)));
        all.filter(|value| (low..=high).contains(value)).map(|value| (value.log10(), format!("{value}"))).collect()
    }

    fn grid(&self, svg: &mut Svg, area: &Area, x_label: Option<&str>, y_label: &str) {
        for (value, label) in self.ticks(&self.x, 6) {
            let x = self.x.pixel(value);
            svg.line([x, area.top], [x, area.bottom], GRID);
            if x_label.is_some() {
                svg.text([x, area.bottom + 18.0], Anchor::Middle, TEXT, &label);
            }
        }
        if let Some(label) = x_label {
            svg.text([(area.left + area.right) / 2.0, area.bottom + 38.0], Anchor::Middle, TEXT, label);
        }
        self.grid_of_y(svg, area, y_label);
    }

    fn grid_of_y(&self, svg: &mut Svg, area: &Area, label: &str) {
        for (value, label) in self.ticks(&self.y, 4) {
            let y = self.y.pixel(value);
            svg.line([area.left, y], [area.right, y], GRID);
            svg.text([area.left - 6.0, y + 5.0], Anchor::End, TEXT, &label);
        }
        let (x, y) = (16.0, (area.top + area.bottom) / 2.0);
        svg.text([x, y], Anchor::Middle, &format!("{TEXT} transform=\"rotate(-90 {x:.1} {y:.1})\""), label);
    }
}

fn page(title: &str, height: f64) -> Svg {
    let mut svg = Svg::new(WIDTH, height);
    svg.text([LEFT, 22.0], Anchor::Start, "font-size=\"16\" font-weight=\"bold\"", title);
    svg
}

fn stroke(index: usize) -> String {
    let (colour, dashes) = (COLOURS[index % COLOURS.len()], DASHES[index % DASHES.len()]);
    format!("stroke=\"{colour}\" stroke-width=\"1.7\" stroke-dasharray=\"{dashes}\"")
}

/// Where the entries of a legend begin: line and x.
fn legend_places(names: &[String]) -> Vec<(usize, f64)> {
    let (mut line, mut x) = (0, LEFT);
    let mut places = Vec::new();
    for name in names {
        let width = 56.0 + 7.6 * name.chars().count() as f64;
        if x + width > WIDTH && x > LEFT {
            (line, x) = (line + 1, LEFT);
        }
        places.push((line, x));
        x += width;
    }
    places
}

fn legend_lines(names: &[String]) -> usize {
    legend_places(names).last().map_or(0, |(line, _)| line + 1)
}

fn legend(svg: &mut Svg, names: &[String], mark: &dyn Fn(&mut Svg, usize, &Area)) {
    for (index, (name, (line, x))) in names.iter().zip(legend_places(names)).enumerate() {
        let top = 34.0 + LEGEND_LINE * line as f64;
        mark(svg, index, &Area { left: x, top, right: x + 28.0, bottom: top + 12.0 });
        svg.text([x + 34.0, top + 11.0], Anchor::Start, TEXT, name);
    }
}

fn extent(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let finite = values.filter(|value| value.is_finite());
    finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}

/// A range with some width, whatever came.
fn widened([low, high]: [f64; 2]) -> [f64; 2] {
    if low > high {
        return [0.0, 1.0];
    }
    let air = (0.04 * (high - low)).max(1e-9 * high.abs().max(1.0));
    [low - air, high + air]
}

/// The same on an axis of decades.
fn widened_by_factor([low, high]: [f64; 2], factor: f64) -> [f64; 2] {
    if low > high || low <= 0.0 { [1.0, 10.0] } else { [low / factor, high * factor] }
}

/// Names of clips and patterns are unique on a page that holds many figures.
fn clip_name(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}

fn hatch_name(title: &str, index: usize) -> String {
    format!("hatch-{}-{index}", clip_name(title))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(name: &str, points: Vec<[f64; 2]>) -> Curve {
        Curve { name: name.to_owned(), points, band: Vec::new() }
    }

    #[test]
    fn one_name_has_one_colour_in_every_panel_and_one_place_in_the_legend() {
        let points = || vec![[0.0, 1.0], [10.0, 2.0]];
        let panel = |curves: Vec<Curve>| Panel { y_label: "m".to_owned(), curves, y_range: None };
        let figure = CurveFigure {
            title: "Errors".to_owned(),
            x_label: "t, s".to_owned(),
            panels: vec![
                panel(vec![curve("ekf", points()), curve("fgo", points())]),
                panel(vec![curve("fgo", points())]),
            ],
            ..CurveFigure::default()
        };
        let svg = figure.svg();
        assert_eq!(svg.matches(">fgo</text>").count(), 1);
        // Legend and two panels; marks on short curves are circles of the same colour.
        assert_eq!(svg.matches("stroke=\"#D55E00\"").count(), 3, "{svg}");
    }

    #[test]
    fn figures_of_nothing_of_one_point_and_of_numbers_that_are_none_are_drawn() {
        let empty = CurveFigure { panels: vec![Panel::default()], ..CurveFigure::default() }.svg();
        let odd = CurveFigure {
            panels: vec![Panel { curves: vec![curve("a", vec![[1.0, 5.0]])], ..Panel::default() }],
            is_logarithmic: true,
            ..CurveFigure::default()
        };
        let none = CurveFigure { panels: vec![Panel::default()], is_logarithmic: true, ..CurveFigure::default() };
        let bars = BarFigure {
            groups: vec!["one".to_owned(), "two".to_owned()],
            series: vec![("x".to_owned(), vec![Some([1.0, 0.2]), None])],
            ..BarFigure::default()
        };
        for svg in [empty, none.svg(), odd.svg(), bars.svg(), BarFigure::default().svg(), PlanFigure::default().svg()] {
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn a_wide_band_does_not_make_the_error_small() {
        let curve = Curve { points: vec![[0.0, -1.0], [1.0, 1.0]], band: vec![[0.0, -50.0, 50.0]], ..Curve::default() };
        let [low, high] = Panel { curves: vec![curve], ..Panel::default() }.y_extent(false);
        assert!(high - low < 5.0, "{low} {high}");
    }
}
