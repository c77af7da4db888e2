//! Standard output: a terminal that is drawn in place, or lines.

use std::io::{IsTerminal, Write, stdout};
use std::net::SocketAddr;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::termios::tcgetwinsize;

use crate::detail::News;
use crate::keys::{Keyboard, Wish};
use crate::lines;
use crate::run::View;
use crate::snapshot::Snapshot;
use crate::terminal::{self, Sight, Trail};

const MILLISECOND: i64 = 1_000_000;

/// Between two pictures, ns.
const PICTURE: i64 = 200 * MILLISECOND;

/// Between two lines, ns.
const LINE: i64 = 1_000 * MILLISECOND;

/// Where a size cannot be asked for.
const USUAL_SIZE: (usize, usize) = (80, 24);

/// Alternate screen on, cursor hidden.
const ENTER: &str = "\x1b[?1049h\x1b[?25l";

/// Colour off, cursor shown, alternate screen off.
const LEAVE: &str = "\x1b[m\x1b[?25h\x1b[?1049l";

/// What is drawn on.
#[derive(Debug)]
pub(crate) struct Screen {
    kind: Kind,
    colours: bool,
    /// Monotonic ns.
    next: i64,
    keyboard: Option<Keyboard>,
    sight: Sight,
    trail: Trail,
    /// The picture stands still, as the user wished.
    is_paused: bool,
}

/// A step of the zoom.
const ZOOM: f64 = 1.5;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Terminal,
    Lines,
    Json,
    Nothing,
}

impl Screen {
    /// Opens what was asked for; a terminal keeps what stood on it for later.
    pub(crate) fn open(view: View, json: bool) -> std::io::Result<Screen> {
        let is_terminal = stdout().is_terminal();
        // A terminal that cannot move its cursor says so.
        let can_move = std::env::var_os("TERM").is_none_or(|name| name != "dumb");
        let kind = match view {
            View::None => Kind::Nothing,
            _ if json => Kind::Json,
            View::Terminal => Kind::Terminal,
            View::Auto if is_terminal && can_move => Kind::Terminal,
            View::Auto | View::Lines => Kind::Lines,
        };
        let mut keyboard = None;
        if kind == Kind::Terminal {
            write(ENTER)?;
            keyboard = Keyboard::take().filter(|_| is_terminal);
        }
        Ok(Screen {
            kind,
            colours: is_terminal && !no_colour(),
            next: i64::MIN,
            keyboard,
            sight: Sight::default(),
            trail: Trail::new(),
            is_paused: false,
        })
    }

    /// Takes in a look, for what is drawn of the past.
    pub(crate) fn remember(&mut self, snapshot: &Snapshot, news: &News) {
        if self.kind == Kind::Terminal {
            self.trail.fold(snapshot, news);
        }
    }

    /// Says where the page is.
    pub(crate) fn tell_page(&mut self, page: Option<SocketAddr>) {
        self.sight.page = page;
    }

    /// Does what the keys ask for; true if the user wishes to end.
    pub(crate) fn obey(&mut self) -> bool {
        let wishes = self.keyboard.as_ref().map_or_else(Vec::new, Keyboard::wishes);
        for wish in &wishes {
            match wish {
                Wish::Quit => {}
                Wish::Pause => self.is_paused = !self.is_paused,
                Wish::Reset => {
                    (self.trail, self.sight) = (Trail::new(), Sight { page: self.sight.page, ..Sight::default() })
                }
                Wish::ZoomIn => self.sight.zoom *= ZOOM,
                Wish::ZoomOut => self.sight.zoom /= ZOOM,
                Wish::Follow => self.sight.follows = !self.sight.follows,
                Wish::Map => self.sight.shows_map = !self.sight.shows_map,
                Wish::Help => self.sight.shows_help = !self.sight.shows_help,
            }
        }
        if !wishes.is_empty() {
            self.next = i64::MIN;
        }
        wishes.contains(&Wish::Quit)
    }

    /// Whether something is to be drawn at the monotonic time `now`, ns.
    pub(crate) fn is_due(&self, now: i64) -> bool {
        // A key is answered once also while the picture stands still.
        self.kind != Kind::Nothing && now >= self.next && (!self.is_paused || self.next == i64::MIN)
    }

    /// Draws. A terminal that is halted (Ctrl-S) or a reader that does not read must not halt this process: it is then
    /// left out.
    pub(crate) fn show(&mut self, snapshot: &Snapshot, now: i64) -> std::io::Result<()> {
        self.next = now + if self.kind == Kind::Terminal { PICTURE } else { LINE };
        if !is_writable() {
            return Ok(());
        }
        match self.kind {
            Kind::Terminal => {
                let text = terminal::picture(snapshot, &self.trail, &self.sight, size(), self.colours);
                write(&picture(&text))
            }
            Kind::Lines => write(&(lines::render(snapshot) + "\n")),
            Kind::Json => write(&(json(snapshot)? + "\n")),
            Kind::Nothing => Ok(()),
        }
    }

    /// Draws nothing from now on.
    pub(crate) fn give_up(&mut self) {
        self.kind = Kind::Nothing;
    }

    /// Gives the terminal back, with the last state as a line.
    pub(crate) fn close(mut self, snapshot: &Snapshot) {
        if self.leave() {
            // Whoever does not listen any more does not want it.
            let _ = write(&(lines::render(snapshot) + "\n"));
        }
    }

    /// True if there was something to give back.
    fn leave(&mut self) -> bool {
        let was_terminal = self.kind == Kind::Terminal;
        self.keyboard = None;
        self.kind = Kind::Nothing;
        was_terminal && is_writable() && write(LEAVE).is_ok()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.leave();
    }
}

/// The snapshot as one JSON object on one line.
pub(crate) fn json(snapshot: &Snapshot) -> std::io::Result<String> {
    Ok(serde_json::to_string(snapshot)?)
}

/// The whole picture as one write: lines over the old ones, each cleared to its end, and what is below. The terminal is
/// asked to show it at once (mode 2026), and the cursor goes home, so that a stray log line does not scroll.
fn picture(text: &str) -> String {
    let text = text.replace('\n', "\x1b[K\r\n");
    format!("\x1b[?2026h\x1b[H{text}\x1b[K\x1b[J\x1b[H\x1b[?2026l")
}

fn write(text: &str) -> std::io::Result<()> {
    let mut out = stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}

/// Prints what was asked for once.
pub(crate) fn print(text: &str) -> std::io::Result<()> {
    write(&format!("{text}\n"))
}

fn is_writable() -> bool {
    let out = stdout();
    let mut ports = [PollFd::new(&out, PollFlags::OUT)];
    // Where it cannot be asked, writing will tell.
    poll(&mut ports, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).map_or(true, |ready| ready > 0)
}

fn size() -> (usize, usize) {
    tcgetwinsize(stdout())
        .ok()
        .map(|size| (usize::from(size.ws_col), usize::from(size.ws_row)))
        .filter(|&(width, height)| width > 0 && height > 0)
        .unwrap_or(USUAL_SIZE)
}

/// <https://no-color.org>: set and not empty.
fn no_colour() -> bool {
    std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_overwrites_the_old_one_without_clearing_it_first() {
        let picture = picture("a\nb");
        assert_eq!(picture, "\x1b[?2026h\x1b[Ha\x1b[K\r\nb\x1b[K\x1b[J\x1b[H\x1b[?2026l");
    }
}
