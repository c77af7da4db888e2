//! The story of this process: look at every channel ten times a second, fold, draw now and then.

use std::io::ErrorKind;

use ilns_bus::{Bus, Prefix};
use ilns_runtime::{HeartbeatBuilder, ProcessArgs, Shutdown, monotonic_now};
use rustix::event::{Timespec, poll};
use rustix::process::{Pid, Signal, kill_process};
use shared_types::{Process, ProcessState, channel};
use tracing::warn;

use crate::detail::News;
use crate::error::MonitorError;
use crate::foxglove::{Foxglove, FoxgloveArgs};
use crate::model::Model;
use crate::ports::Inputs;
use crate::screen::{Screen, json, print};
use crate::snapshot::Snapshot;
use crate::terminal;
use crate::web::{Look, Page, WebArgs, listen};

/// Between two looks at the channels, ns. The estimates' queue holds a second at ten times their usual rate.
const LOOK: i64 = 100_000_000;

/// How long `--once` listens, ns: two heartbeats of everybody, and a bit.
const LISTEN: i64 = 1_300_000_000;

/// Between two tries to serve the page, ns: a dead predecessor's port is free in a moment.
const RETRY: i64 = 1_000_000_000;

/// Wide enough for every reason of refusal.
const WIDE: usize = 160;

/// How to show it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum View {
    /// In place when standard output is a terminal, else one line per second.
    #[default]
    Auto,
    /// In place, whatever standard output is.
    Terminal,
    /// One line per second.
    Lines,
    /// Nothing is shown.
    None,
}

/// What the monitor is told.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub process: ProcessArgs,
    /// How to show it: in place on a terminal, as one line per second, or not at all.
    #[arg(long, value_enum, default_value_t = View::Auto, value_name = "VIEW")]
    pub view: View,
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub web: WebArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub foxglove: FoxgloveArgs,
    /// Listen for a second, print what is known, and end.
    #[arg(long)]
    pub once: bool,
    /// Print JSON objects, one a line: one per second, or a single one with --once.
    #[arg(long)]
    pub json: bool,
}

/// Runs the monitor until SIGTERM or SIGINT.
///
/// # Errors
/// [`MonitorError`] when it cannot begin or nobody takes its output.
pub fn run(args: &Args) -> Result<(), MonitorError> {
    run_until(args, &args.process.begin()?)
}

/// Runs the monitor until `shutdown` is requested, or, with `--once`, for a second.
///
/// # Errors
/// [`MonitorError`] when it cannot begin or nobody takes its output.
pub fn run_until(args: &Args, shutdown: &Shutdown) -> Result<(), MonitorError> {
    args.process.real_time(Process::Monitor)?.enter();
    let prefix = Prefix::new(&args.process.prefix)?;
    let bus = Bus::join(&prefix, Process::Monitor, args.process.epoch)?;
    let mut inputs = Inputs::open(&bus)?;
    let mut model = Model::new(prefix.name());
    if args.once {
        return look_once(args, shutdown, &mut inputs, &mut model);
    }
    let mut window = Window::open(args, &model.snapshot())?;
    let mut live = open_foxglove(args, prefix.name())?;
    let mut health = bus.publisher(&channel::HEALTH)?;
    let mut heartbeat = HeartbeatBuilder::new(Process::Monitor, args.process.epoch);
    heartbeat.state = ProcessState::Running;
    let mut screen = Screen::open(args.view, args.json)?;

    while !shutdown.requested() {
        let begun = monotonic_now();
        heartbeat.handled += inputs.drain(&mut model, &mut live);
        model.settle(begun);
        let snapshot = model.snapshot();
        let news = model.take_news();
        screen.remember(&snapshot, &news);
        screen.tell_page(window.page.as_ref().map(Page::address));
        if screen.obey() {
            end(args, shutdown);
        }
        if screen.is_due(begun)
            && let Err(error) = screen.show(&snapshot, begun)
        {
            screen.give_up();
            if args.process.supervisor.is_none() {
                return if error.kind() == ErrorKind::BrokenPipe { Ok(()) } else { Err(error.into()) };
            }
            warn!(%error, "standard output takes nothing more; the monitor goes on without a view");
        }
        window.show(snapshot, news, begun);
        heartbeat.work.record(monotonic_now() - begun);
        if begun >= heartbeat.next_beat() && bus.check_owner().is_err() {
            break;
        }
        if let Some(beat) = heartbeat.beat(begun) {
            health.publish(beat);
        }
        rest();
    }
    screen.close(&model.snapshot());
    heartbeat.state = ProcessState::Stopping;
    health.publish(heartbeat.build());
    Ok(bus.check_owner()?)
}

fn open_foxglove(args: &Args, set: &str) -> Result<Foxglove, MonitorError> {
    let is_alone = args.process.supervisor.is_none();
    match Foxglove::open(&args.foxglove, set) {
        // Navigation has begun: the other views are better than none.
        Err(error) if !is_alone => {
            warn!(%error, "Foxglove is not served");
            Ok(Foxglove::default())
        }
        opened => {
            let opened = opened?;
            if let Some(address) = opened.address().filter(|_| is_alone) {
                eprintln!("ilns monitor: Foxglove at ws://{address}");
            }
            Ok(opened)
        }
    }
}

/// As Ctrl-C would: the whole set, where this process belongs to one that was started from this terminal.
fn end(args: &Args, shutdown: &Shutdown) {
    let supervisor = args.process.supervisor.and_then(|pid| i32::try_from(pid).ok()).and_then(Pid::from_raw);
    match supervisor {
        // It stops this process, too. If it is gone, so is this process.
        Some(supervisor) => drop(kill_process(supervisor, Signal::INT)),
        None => shutdown.request(),
    }
}

/// The page, or the wish for one.
struct Window<'a> {
    args: &'a Args,
    page: Option<Page>,
    /// When to try again, monotonic ns.
    retry_at: i64,
    has_complained: bool,
}

impl Window<'_> {
    fn open<'a>(args: &'a Args, snapshot: &Snapshot) -> Result<Window<'a>, MonitorError> {
        let mut window = Window { args, page: None, retry_at: i64::MIN, has_complained: false };
        match window.try_open(snapshot) {
            // Navigation has begun: a page that is late is better than none.
            Err(error) if args.process.supervisor.is_some() => window.complain(&error, monotonic_now()),
            opened => opened?,
        }
        Ok(window)
    }

    fn try_open(&mut self, snapshot: &Snapshot) -> Result<(), MonitorError> {
        if let Some(address) = self.args.web.web {
            let (listener, token) = listen(address, self.args.web.web_token.as_deref())?;
            let page = Page::open(listener, token, snapshot.clone())?;
            if self.args.process.supervisor.is_none() {
                eprintln!("ilns monitor: page at http://{}", page.address());
            }
            self.page = Some(page);
        }
        Ok(())
    }

    fn complain(&mut self, error: &MonitorError, now: i64) {
        if !self.has_complained {
            warn!(%error, "no page yet; trying again every second");
        }
        (self.has_complained, self.retry_at) = (true, now + RETRY);
    }

    fn show(&mut self, snapshot: Snapshot, news: News, now: i64) {
        if self.page.is_none()
            && self.has_complained
            && now >= self.retry_at
            && let Err(error) = self.try_open(&snapshot)
        {
            self.complain(&error, now);
        }
        if let Some(page) = &mut self.page {
            page.show(Look { snapshot, news });
        }
    }
}

/// Sleeps until the next look or a signal. One wake-up a look: this process need not end sooner than that.
fn rest() {
    // Interrupted or not, the next look is due.
    let _ = poll(&mut [], Some(&Timespec { tv_sec: 0, tv_nsec: LOOK }));
}

/// A guest's look: it says nothing on the bus.
fn look_once(args: &Args, shutdown: &Shutdown, inputs: &mut Inputs, model: &mut Model) -> Result<(), MonitorError> {
    let end = monotonic_now() + LISTEN;
    while monotonic_now() < end && !shutdown.requested() {
        rest();
        inputs.drain(model, &mut Foxglove::default());
        model.settle(monotonic_now());
    }
    let snapshot = model.snapshot();
    let text = if args.json { json(&snapshot)? } else { terminal::render(&snapshot, WIDE, usize::MAX, false) };
    match print(&text) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        printed => Ok(printed?),
    }
}
