//! From cells in memory to lines of a terminal.

use ratatui::buffer::Buffer;
use ratatui::style::Color;

/// Each row of `buffer` without blanks at its end; with colours as a terminal wants them.
pub(super) fn rows(buffer: &Buffer, colours: bool) -> Vec<String> {
    let (width, height) = (buffer.area.width, buffer.area.height);
    let row = |y: u16| {
        let mut line = String::new();
        let mut colour = Color::Reset;
        let cells = (0..width).map(|x| &buffer[(x, y)]);
        let used =
            cells.clone().collect::<Vec<_>>().iter().rposition(|cell| cell.symbol() != " ").map_or(0, |last| last + 1);
        for cell in cells.take(used) {
            if colours && cell.fg != colour {
                colour = cell.fg;
                line.push_str(sequence(colour));
            }
            line.push_str(cell.symbol());
        }
        if colour != Color::Reset {
            line.push_str(sequence(Color::Reset));
        }
        line
    };
    (0..height).map(row).collect()
}

/// The sixteen colours that every terminal has.
fn sequence(colour: Color) -> &'static str {
    match colour {
        Color::Red => "\x1b[31m",
        Color::Green => "\x1b[32m",
        Color::Yellow => "\x1b[33m",
        Color::Blue => "\x1b[34m",
        Color::Magenta => "\x1b[35m",
        Color::Cyan => "\x1b[36m",
        Color::DarkGray => "\x1b[90m",
        _ => "\x1b[39m",
    }
}
