//! Log lines: to standard error, for people, as JSON, or as JSON for systemd's journal.
//!
//! Levels: `error` = data lost or the process ends; `warn` = it goes on, but not as asked; `info` = rare, for the person at
//! the terminal; `debug` = one line per keyframe; `trace` = per sample. A line that the filter leaves out is not formatted;
//! one that it lets through goes by way of `log_queue`, and never holds up whoever says it.

use std::io::IsTerminal;
use std::os::fd::AsFd;
use std::sync::OnceLock;

use rustix::fs::fstat;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::layer;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use crate::error::RuntimeError;
use crate::log_queue::LogQueue;

/// The shape of log lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// JSON into systemd's journal, text into everything else.
    #[default]
    Auto,
    /// For people, coloured on a terminal.
    Text,
    /// One object per line: `timestamp`, `level`, `message`, `target` and the fields of the line.
    Json,
}

impl LogFormat {
    /// As the option says it.
    pub fn name(self) -> &'static str {
        match self {
            LogFormat::Auto => "auto",
            LogFormat::Text => "text",
            LogFormat::Json => "json",
        }
    }
}

/// This process's way to standard error, once it logs.
static QUEUE: OnceLock<LogQueue> = OnceLock::new();

/// Starts logging what `filter` (`info`, or `warn,ilns_solver=debug`) lets through. A second call changes nothing.
///
/// # Errors
/// [`RuntimeError::LogLevel`]; [`RuntimeError::LogThread`].
pub fn start_logging(filter: &str, format: LogFormat) -> Result<(), RuntimeError> {
    let filter = parse_filter(filter)?;
    if QUEUE.get().is_some() {
        return Ok(());
    }
    let journal = is_journal();
    let json = format == LogFormat::Json || (format == LogFormat::Auto && journal);
    let tell = |lines| tracing::error!(lines, "log lines are lost: standard error did not take them in time");
    let queue = LogQueue::start(std::io::stderr(), journal, tell).map_err(RuntimeError::LogThread)?;
    let lines = layer().with_ansi(std::io::stderr().is_terminal()).with_writer(queue.clone());
    let lines = if json { lines.json().flatten_event(true).boxed() } else { lines.boxed() };
    let started = tracing_subscriber::registry().with(lines).with(filter).try_init();
    // An error says that this process logs already, which is what was wanted.
    if started.is_ok() && QUEUE.set(queue).is_ok() {
        flush_before_panics();
    }
    Ok(())
}

/// Waits until the lines said so far are written, or standard error has taken nothing for too long.
pub(crate) fn flush_logging() {
    if let Some(queue) = QUEUE.get() {
        queue.flush();
    }
}

/// What was said before a panic stands before it.
fn flush_before_panics() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        flush_logging();
        report(panic);
    }));
}

/// `EnvFilter` would do the same, and compile an engine for regular expressions to do it.
fn parse_filter(text: &str) -> Result<Targets, RuntimeError> {
    // To `Targets` a word that is no level is a target, and a misspelt level would silence everything else.
    let is_level = |word: &str| !word.is_empty() && word.parse::<LevelFilter>().is_ok();
    let directives: Vec<&str> = text.split(',').map(str::trim).collect();
    let is_sound = directives.iter().all(|directive| directive.contains('=') || is_level(directive));
    let filter = is_sound.then(|| directives.join(",").parse().ok()).flatten();
    filter.ok_or_else(|| RuntimeError::LogLevel { text: text.to_owned() })
}

/// Whether standard error leads to systemd's journal. The variable alone does not say so: whatever a service starts
/// inherits it, a shell with its own terminal too.
pub(crate) fn is_journal() -> bool {
    let stream = std::env::var("JOURNAL_STREAM").ok();
    stream.is_some_and(|stream| names_the_file(&stream, std::io::stderr()))
}

/// Whether `stream`, DEVICE:INODE, is `file`.
fn names_the_file(stream: &str, file: impl AsFd) -> bool {
    fstat(file).is_ok_and(|stat| stream == format!("{}:{}", stat.st_dev, stat.st_ino))
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::os::unix::fs::MetadataExt;

    use clap::ValueEnum;

    use super::*;

    #[test]
    fn a_misspelt_level_is_refused_in_one_line() {
        for text in ["wran", "warn,infoo", "", "warn,", "ilns_solver=loud"] {
            let error = parse_filter(text).expect_err(text).to_string();
            assert!(error.contains("expected error, warn, info, debug or trace") && !error.contains('\n'), "{error}");
        }
        for text in ["warn", "INFO", "off", "warn, debug", "warn,ilns_solver=debug", "ilns_solver=debug"] {
            assert!(parse_filter(text).is_ok(), "{text}");
        }
    }

    #[test]
    fn the_journal_is_known_by_device_and_inode() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let create = |name: &str| File::create(folder.path().join(name)).expect("it is writable");
        let (file, other) = (create("stream"), create("other"));
        let found = file.metadata().expect("it exists");
        let stream = format!("{}:{}", found.dev(), found.ino());
        assert!(names_the_file(&stream, &file));
        assert!(!names_the_file(&stream, &other));
        assert!(!names_the_file("", &file));
    }

    #[test]
    fn a_format_is_told_to_a_child_as_it_is_read() {
        for format in LogFormat::value_variants() {
            assert_eq!(LogFormat::from_str(format.name(), false), Ok(*format));
        }
    }
}
