//! The keyboard of the terminal: single keys, without waiting for a line.
//!
//! Ctrl-C stays what it is. The terminal is asked for only while this process is in its foreground: a background job that
//! touched it would be stopped by the kernel.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::getpgrp;
use rustix::stdio::stdin;
use rustix::termios::{LocalModes, OptionalActions, isatty, tcgetattr, tcgetpgrp, tcsetattr};

/// What a key asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wish {
    /// End.
    Quit,
    /// Stand still, or go on.
    Pause,
    /// Forget the past.
    Reset,
    /// See more closely.
    ZoomIn,
    /// See more.
    ZoomOut,
    /// Keep the vehicle in the middle, or not.
    Follow,
    /// Map or tables.
    Map,
    /// What the keys do, or not.
    Help,
}

impl Wish {
    fn of(byte: u8) -> Option<Wish> {
        Some(match byte {
            b'q' | b'Q' => Wish::Quit,
            b' ' | b'p' => Wish::Pause,
            b'r' => Wish::Reset,
            b'+' | b'=' => Wish::ZoomIn,
            b'-' => Wish::ZoomOut,
            b'f' => Wish::Follow,
            b'm' => Wish::Map,
            b'?' | b'h' => Wish::Help,
            _ => return None,
        })
    }
}

/// The keyboard, taken and to be given back.
#[derive(Debug)]
pub(crate) struct Keyboard;

impl Keyboard {
    /// Takes it, if there is one and it is ours.
    pub(crate) fn take() -> Option<Keyboard> {
        (isatty(stdin()) && is_in_foreground() && set_lines(false)).then_some(Keyboard)
    }

    /// What was asked for since the last call.
    pub(crate) fn wishes(&self) -> Vec<Wish> {
        let mut bytes = [0; 64];
        if !is_in_foreground() || !is_waiting() {
            return Vec::new();
        }
        let count = rustix::io::read(stdin(), &mut bytes).unwrap_or(0);
        wishes(&bytes[..count])
    }
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        if is_in_foreground() {
            set_lines(true);
        }
    }
}

/// An escape sequence is a key that means nothing here; it ends what was typed at once.
fn wishes(bytes: &[u8]) -> Vec<Wish> {
    bytes.iter().take_while(|&&byte| byte != b'\x1b').filter_map(|&byte| Wish::of(byte)).collect()
}

fn is_in_foreground() -> bool {
    tcgetpgrp(stdin()).is_ok_and(|group| group == getpgrp())
}

fn is_waiting() -> bool {
    let input = stdin();
    let mut ports = [PollFd::new(&input, PollFlags::IN)];
    poll(&mut ports, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_ok_and(|ready| ready > 0)
}

/// Whether keys come as lines that are shown while they are typed. Given back, they always do: a predecessor that was killed
/// may have left the terminal as it was of use to it.
fn set_lines(on: bool) -> bool {
    let Ok(mut attributes) = tcgetattr(stdin()) else { return false };
    attributes.local_modes.set(LocalModes::ICANON | LocalModes::ECHO, on);
    tcsetattr(stdin(), OptionalActions::Now, &attributes).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_wishes_and_what_means_nothing_is_passed_over() {
        assert_eq!(wishes(b"q +x-"), [Wish::Quit, Wish::Pause, Wish::ZoomIn, Wish::ZoomOut]);
        assert_eq!(wishes(b"f\x1b[Aq"), [Wish::Follow], "an arrow is not a q");
    }
}
