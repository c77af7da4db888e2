//! The one SVG writer: shapes on a page, and axes with round numbers. Self-contained, no script, fonts of the viewer.

use std::fmt::Write;

/// A page under construction. Coordinates in pixels, y downwards.
#[derive(Debug)]
pub(crate) struct Svg {
    body: String,
    width: f64,
    height: f64,
}

/// Where a text is anchored.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

impl Svg {
    pub(crate) fn new(width: f64, height: f64) -> Svg {
        Svg { body: String::new(), width, height }
    }

    /// The whole file.
    pub(crate) fn finish(self, title: &str) -> String {
        let (width, height) = (self.width, self.height);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"Helvetica, Arial, sans-serif\" font-size=\"13\" fill=\"#222222\">\n<title>{}</title>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{}</svg>\n",
            escape(title),
            self.body
        )
    }

    /// An open line; `style` is SVG attributes.
    pub(crate) fn polyline(&mut self, points: impl IntoIterator<Item = [f64; 2]>, style: &str) {
        self.body += "<polyline fill=\"none\" stroke-linejoin=\"round\" ";
        self.points(points, style);
    }

    /// A filled shape.
    pub(crate) fn polygon(&mut self, points: impl IntoIterator<Item = [f64; 2]>, style: &str) {
        self.body += "<polygon ";
        self.points(points, style);
    }

    fn points(&mut self, points: impl IntoIterator<Item = [f64; 2]>, style: &str) {
        self.body += style;
        self.body += " points=\"";
        for [x, y] in points {
            self.push(format_args!("{x:.1},{y:.1} "));
        }
        self.body += "\"/>\n";
    }

    pub(crate) fn line(&mut self, from: [f64; 2], to: [f64; 2], style: &str) {
        let ([x1, y1], [x2, y2]) = (from, to);
        self.push(format_args!("<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" {style}/>\n"));
    }

    pub(crate) fn circle(&mut self, [x, y]: [f64; 2], radius: f64, style: &str) {
        self.push(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" {style}/>\n"));
    }

    pub(crate) fn rect(&mut self, area: &Area, style: &str) {
        let Area { left, top, right, bottom } = *area;
        let (width, height) = (right - left, bottom - top);
        self.push(format_args!(
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" {style}/>\n"
        ));
    }

    pub(crate) fn text(&mut self, [x, y]: [f64; 2], anchor: Anchor, style: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let text = escape(text);
        self.push(format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" {style}>{text}</text>\n"));
    }

    /// What `draw` draws is cut off at `area`; `name` is unique on the page.
    pub(crate) fn clipped(&mut self, area: &Area, name: &str, draw: impl FnOnce(&mut Svg)) {
        self.push(format_args!("<clipPath id=\"{name}\">"));
        self.rect(area, "");
        self.push(format_args!("</clipPath><g clip-path=\"url(#{name})\">\n"));
        draw(self);
        self.body += "</g>\n";
    }

    /// Defines a fill of stripes for `fill="url(#name)"`: full for the first, then slanting one way and the other, ever wider.
    pub(crate) fn hatching(&mut self, name: &str, colour: &str, index: usize) {
        let (angle, step) = (if index % 2 == 1 { 45 } else { -45 }, 4 + 2 * (index / 2));
        let opacity = if index == 0 { 0.85 } else { 0.25 };
        self.push(format_args!(
            "<pattern id=\"{name}\" width=\"{step}\" height=\"{step}\" patternUnits=\"userSpaceOnUse\" \
             patternTransform=\"rotate({angle})\"><rect width=\"{step}\" height=\"{step}\" fill=\"{colour}\" \
             fill-opacity=\"{opacity}\"/><rect width=\"2\" height=\"{step}\" fill=\"{colour}\"/></pattern>\n"
        ));
    }

    fn push(&mut self, text: std::fmt::Arguments<'_>) {
        self.body.write_fmt(text).expect("a String takes everything");
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// A rectangle on the page.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Area {
    pub(crate) left: f64,
    pub(crate) top: f64,
    pub(crate) right: f64,
    pub(crate) bottom: f64,
}

impl Area {
    pub(crate) fn width(&self) -> f64 {
        self.right - self.left
    }

    pub(crate) fn height(&self) -> f64 {
        self.bottom - self.top
    }
}

/// Values from `low` to `high`, laid from pixel `from` to pixel `to`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) from: f64,
    pub(crate) to: f64,
}

impl Scale {
    pub(crate) fn pixel(&self, value: f64) -> f64 {
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }

    /// Round numbers within, some `count` of them, each with the decimals that its step needs.
    pub(crate) fn ticks(&self, count: usize) -> Vec<(f64, String)> {
        let step = round_step((self.high - self.low) / count as f64);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|k| k as f64 * step).map(|value| (value, format!("{value:.decimals$}"))).collect()
    }
}

/// The least of 1, 2, 5, 10, 20, ... (and their tenths) that is at least `least`.
fn round_step(least: f64) -> f64 {
    let decade = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * decade)
        .find(|step| *step >= least * 0.999_999)
        .unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        let scale = Scale { low: -0.31, high: 0.42, from: 0.0, to: 100.0 };
        let labels: Vec<String> = scale.ticks(4).into_iter().map(|(_, label)| label).collect();
        assert_eq!(labels, ["-0.2", "0.0", "0.2", "0.4"]);
        let scale = Scale { low: 0.0, high: 2217.0, from: 0.0, to: 100.0 };
        assert_eq!(scale.ticks(5).last().map(|(_, label)| label.clone()), Some("2000".to_owned()));
    }

    #[test]
    fn an_upward_axis_may_run_down_the_page() {
        let scale = Scale { low: 0.0, high: 10.0, from: 200.0, to: 100.0 };
        assert_eq!((scale.pixel(0.0), scale.pixel(10.0), scale.pixel(5.0)), (200.0, 100.0, 150.0));
    }

    #[test]
    fn names_cannot_break_the_page() {
        assert!(Svg::new(1.0, 1.0).finish("a<b & c").contains("<title>a&lt;b &amp; c</title>"));
    }
}
