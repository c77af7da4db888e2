//! How every command ends.

use std::error::Error;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

use crate::logging::{flush_logging, is_journal};

/// Exit code of everything that went wrong.
pub const FAILURE: u8 = 2;

/// The error and its causes on one line. A cause that its effect has already told is not told twice.
pub fn one_line(error: &dyn Error) -> String {
    let mut line = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        if !line.ends_with(&text) {
            line = format!("{line}: {text}");
        }
        cause = error.source();
    }
    legible(&line)
}

/// Longest line, in characters: a damaged file may hold a key as long as itself.
const LONGEST: usize = 1_000;

/// Without what would move a terminal's cursor, and with its middle left out where it is too long: place and mend stand at its
/// ends.
fn legible(line: &str) -> String {
    let mut characters: Vec<char> = Vec::with_capacity(line.len());
    for character in line.chars() {
        match character {
            '\n' => characters.push(' '),
            control if control.is_control() => characters.extend(control.escape_default()),
            other => characters.push(other),
        }
    }
    if characters.len() > LONGEST {
        let (from, to) = (LONGEST * 2 / 3, characters.len() - LONGEST / 4);
        characters.splice(from..to, " [...] ".chars());
    }
    characters.into_iter().collect()
}

/// Writes what a command was asked for to standard output. A reader who has seen enough (`| head`) is no error.
///
/// # Errors
/// When standard output takes nothing for another reason, such as a full disk.
pub fn answer(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}

/// Exit code of the command `name`; a failure is first told on standard error, in one line.
pub fn exit_with(name: &str, result: Result<(), impl Into<Box<dyn Error>>>) -> ExitCode {
    flush_logging();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // The journal takes the priority off the line, as with the lines of `logging`.
            let priority = if is_journal() { "<3>" } else { "" };
            eprintln!("{priority}ilns {name}: {}", one_line(&*error.into()));
            ExitCode::from(FAILURE)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::RuntimeError;

    #[test]
    fn the_whole_chain_of_causes_stands_on_one_line() {
        let source = std::io::Error::new(std::io::ErrorKind::NotFound, "no such\nfile");
        let error = RuntimeError::ConfigFile { path: "a.toml".into(), source };
        assert_eq!(one_line(&error), "cannot read the configuration a.toml (--config FILE names it): no such file");
    }
    #[test]
    fn a_line_moves_no_cursor_and_keeps_both_ends_where_it_is_too_long() {
        assert_eq!(legible("unknown key `\u{1b}[2J\r`"), "unknown key `\\u{1b}[2J\\r`");
        let long = format!("file:4:1: unknown key `{}`; did you mean `lbl`?", "\u{fc}".repeat(10_000));
        let line = legible(&long);
        assert!(line.starts_with("file:4:1: unknown") && line.ends_with("did you mean `lbl`?"), "{line}");
        assert!(line.contains(" [...] ") && line.chars().count() < 1_000, "{line}");
    }
}
