//! The way of a log line to standard error: a bounded queue and a thread of its own, so that whoever logs is never held up.
//!
//! ```text
//! event --> formatted line --> queue (1024 lines) --> thread --> standard error
//! ```
//!
//! A terminal that was stopped (Ctrl-S) or a pipe whose reader sleeps takes nothing more once a few kilobytes wait. Written
//! directly, the next line would then stop the process that says it. Here it is lost, counted, and the count told as soon
//! as lines are taken again.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, bounded};
use tracing::{Level, Metadata};
use tracing_subscriber::fmt::MakeWriter;

/// Lines that wait at most: some seconds of `debug` from a process that solves.
const CAPACITY: usize = 1024;

/// How long an ending process waits for its last lines to be taken; the supervisor gives it 2 s for everything.
const FLUSH_LIMIT: Duration = Duration::from_millis(200);

/// Stack of the thread, bytes. Processes lock their memory, and the usual 2 MiB would be locked too.
const STACK: usize = 128 * 1024;

enum Job {
    Line(Vec<u8>),
    /// Everything before it has been written.
    Flush(Sender<()>),
}

/// Where formatted lines go.
#[derive(Clone)]
pub(crate) struct LogQueue {
    jobs: Sender<Job>,
    lost: Arc<AtomicU64>,
    with_priorities: bool,
}

impl LogQueue {
    /// Starts the thread that writes into `sink`. `with_priorities` puts the priority of `sd-daemon(3)` in front of each
    /// line; `tell` is called on that thread with how many lines were lost since it was last called.
    pub(crate) fn start(
        sink: impl Write + Send + 'static,
        with_priorities: bool,
        tell: impl Fn(u64) + Send + 'static,
    ) -> std::io::Result<LogQueue> {
        let (jobs, waiting) = bounded(CAPACITY);
        let lost = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&lost);
        let write = move || write_lines(&waiting, sink, &counted, &tell);
        thread::Builder::new().name("log".to_owned()).stack_size(STACK).spawn(write)?;
        Ok(LogQueue { jobs, lost, with_priorities })
    }

    /// Waits until what was said so far has been written, or until standard error has taken nothing for too long.
    pub(crate) fn flush(&self) {
        self.flush_within(FLUSH_LIMIT);
    }

    /// `limit` holds for a place in the queue and again for the writing. False if it was not enough.
    fn flush_within(&self, limit: Duration) -> bool {
        let (done, is_done) = bounded(1);
        self.jobs.send_timeout(Job::Flush(done), limit).is_ok() && is_done.recv_timeout(limit).is_ok()
    }

    fn line(&self, priority: &str, text: &[u8]) {
        let line = [priority.as_bytes(), text].concat();
        if self.jobs.try_send(Job::Line(line)).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

fn write_lines(waiting: &Receiver<Job>, mut sink: impl Write, lost: &AtomicU64, tell: &impl Fn(u64)) {
    for job in waiting {
        match job {
            // A standard error that is closed has nobody who could be told.
            Job::Line(line) => drop(sink.write_all(&line)),
            Job::Flush(done) => drop(done.try_send(())),
        }
        let lost = lost.swap(0, Ordering::Relaxed);
        if lost > 0 {
            tell(lost);
        }
    }
}

impl<'a> MakeWriter<'a> for LogQueue {
    type Writer = LogLine<'a>;

    fn make_writer(&'a self) -> LogLine<'a> {
        LogLine { queue: self, priority: "" }
    }

    fn make_writer_for(&'a self, event: &Metadata<'_>) -> LogLine<'a> {
        LogLine { queue: self, priority: if self.with_priorities { priority(*event.level()) } else { "" } }
    }
}

/// `sd-daemon(3)`: the journal takes it off the line and keeps it as the line's priority.
fn priority(level: Level) -> &'static str {
    match level {
        Level::ERROR => "<3>",
        Level::WARN => "<4>",
        Level::INFO => "<6>",
        Level::DEBUG | Level::TRACE => "<7>",
    }
}

/// One line. The formatter writes it whole, in one call.
pub(crate) struct LogLine<'a> {
    queue: &'a LogQueue,
    priority: &'static str,
}

impl Write for LogLine<'_> {
    fn write(&mut self, text: &[u8]) -> std::io::Result<usize> {
        self.queue.line(self.priority, text);
        Ok(text.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crossbeam::channel::unbounded;

    use super::*;

    /// A sink that takes a line only when it is let, and passes it on.
    struct Gate {
        lets: Receiver<()>,
        taken: Sender<String>,
    }

    impl Write for Gate {
        fn write(&mut self, text: &[u8]) -> std::io::Result<usize> {
            // Once the test has dropped its end, everything passes.
            let _ = self.lets.recv();
            let _ = self.taken.send(String::from_utf8_lossy(text).into_owned());
            Ok(text.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_terminal_that_takes_nothing_holds_nobody_up_and_the_loss_is_told() {
        let (open, lets) = bounded::<()>(0);
        let (taken, lines) = unbounded();
        let (told, losses) = unbounded();
        let queue =
            LogQueue::start(Gate { lets, taken }, false, move |lost| told.send(lost).expect("the test listens"))
                .expect("a thread");
        let said = 3 * CAPACITY;
        // If a line could wait for the sink, this loop would never end.
        for number in 0..said {
            queue.line("", number.to_string().as_bytes());
        }
        assert!(!queue.flush_within(Duration::from_millis(1)), "an end does not wait for it either");
        // The sink takes lines again; without the queue the thread ends with the last of them.
        drop(open);
        drop(queue);
        let written: Vec<usize> = lines.iter().map(|line| line.parse().expect("a number")).collect();
        let lost: u64 = losses.iter().sum();
        assert_eq!(written.len() as u64 + lost, said as u64, "{} written, {lost} lost", written.len());
        assert!(written.is_sorted(), "in order");
        // The line that the thread holds in its hands leaves room for one more, whenever it took it.
        assert!(
            written.len() <= CAPACITY + 1 && written[..CAPACITY].iter().copied().eq(0..CAPACITY),
            "the oldest are kept"
        );
    }

    #[test]
    fn what_was_said_is_written_when_a_flush_returns() {
        let (taken, lines) = unbounded();
        let (_, lets) = bounded(0);
        let queue = LogQueue::start(Gate { lets, taken }, true, |_| {}).expect("a thread");
        queue.line(priority(Level::WARN), b"a\n");
        queue.line("", b"b\n");
        assert!(queue.flush_within(Duration::from_secs(30)));
        assert_eq!(lines.try_iter().collect::<Vec<_>>(), ["<4>a\n", "b\n"]);
    }
}
