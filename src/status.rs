//! `ilns status`: listens to a running set for a second and says what it heard.

use std::collections::BTreeMap;

use ilns_bus::{Bus, BusError, Prefix, Subscriber};
use ilns_runtime::{DEFAULT_PREFIX, LogFormat, Shutdown, answer, monotonic_now, start_logging};
use serde::Serialize;
use shared_types::{
    Channel, ChannelVisitor, Heartbeat, Message, Process, ProcessState, SENSORS, channel, visit_channels,
};

use crate::Outcome;

/// What `status` is told.
#[derive(Debug, clap::Args)]
pub struct StatusArgs {
    /// Name of the set.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PREFIX)]
    prefix: String,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// Two heartbeats and a bit, ns.
const LISTEN: i64 = 1_200_000_000;

/// Between two looks at the queues, ns: the fastest channel fills its own in seconds.
const LOOK: i64 = 20_000_000;

#[derive(Debug, Serialize)]
struct Status {
    prefix: String,
    processes: Vec<ProcessRow>,
    channels: Vec<ChannelRow>,
}

#[derive(Clone, Debug, Serialize)]
struct ProcessRow {
    name: &'static str,
    pid: u32,
    state: &'static str,
    restarts: u32,
    cpu_s: f64,
    resident_bytes: u64,
    dropped: u64,
}

#[derive(Debug, Serialize)]
struct ChannelRow {
    name: &'static str,
    /// Messages per second.
    rate: f64,
    /// Missed by any reader that says so, or by this one.
    lost: u64,
    /// Since the newest was published; `null` when nothing was heard.
    age_s: Option<f64>,
}

/// Listens, and prints.
pub fn run(args: &StatusArgs) -> Outcome {
    start_logging("error", LogFormat::Auto)?;
    let shutdown = Shutdown::on_signals()?;
    let bus = Bus::join(&Prefix::new(&args.prefix)?, Process::Monitor, 0)?;
    let status = listen(&bus, &shutdown)?;
    answer(&if args.json { serde_json::to_string(&status)? } else { table(&status) })?;
    Ok(())
}

fn listen(bus: &Bus, shutdown: &Shutdown) -> Result<Status, BusError> {
    let mut taps = Taps { bus, taps: Vec::new() };
    visit_channels(&mut taps)?;
    let mut taps = taps.taps;
    let mut health = bus.subscriber(&channel::HEALTH)?;
    let mut heard = Heard::default();
    let begun = monotonic_now();
    let mut next_look = begun;
    while monotonic_now() < begun + LISTEN && shutdown.sleep_until(next_look) {
        next_look += LOOK;
        taps.iter_mut().for_each(|tap| tap.look(begun));
        while let Some(beat) = health.receive() {
            heard.enter(&beat);
        }
    }
    let seconds = (monotonic_now() - begun) as f64 * 1e-9;
    let mut channels: Vec<ChannelRow> = taps.iter().map(|tap| tap.row(seconds)).collect();
    for row in &mut channels {
        row.lost = row.lost.max(heard.lost_on(row.name));
    }
    Ok(Status { prefix: bus.prefix().name().to_owned(), processes: heard.rows(), channels })
}

/// Heartbeats by process.
#[derive(Debug, Default)]
struct Heard {
    own_words: BTreeMap<Process, Heartbeat>,
    /// Of the supervisor, who alone can speak for the dead.
    words_of_supervisor: BTreeMap<Process, Heartbeat>,
}

impl Heard {
    fn enter(&mut self, beat: &Heartbeat) {
        let Some(process) = Process::from_index(beat.process) else { return };
        let own = u32::from(beat.header.source) == beat.process;
        let words = if own { &mut self.own_words } else { &mut self.words_of_supervisor };
        words.insert(process, *beat);
    }

    fn rows(&self) -> Vec<ProcessRow> {
        let row = |process: Process| {
            let own = self.own_words.get(&process);
            let word = self.words_of_supervisor.get(&process).or(own)?;
            let state = ProcessState::from_index(word.state).map_or("unknown", ProcessState::name);
            Some(ProcessRow {
                name: process.name(),
                pid: word.pid,
                state,
                restarts: word.restarts,
                cpu_s: own.map_or(0.0, |beat| beat.cpu_ns as f64 * 1e-9),
                resident_bytes: own.map_or(0, |beat| beat.resident_bytes),
                dropped: own.map_or(0, |beat| beat.dropped),
            })
        };
        Process::ALL.into_iter().filter_map(row).collect()
    }

    /// Readings of a sensor channel that some process misses.
    fn lost_on(&self, channel: &str) -> u64 {
        let sensor = SENSORS.iter().find(|sensor| channel.strip_prefix("sensor/") == Some(sensor.name()));
        let lost = |beat: &Heartbeat| sensor.map_or(0, |sensor| beat.sensors[sensor.index()].lost);
        self.own_words.values().map(lost).max().unwrap_or(0)
    }
}

/// An additional reader of some channel.
trait Tap {
    fn look(&mut self, begun: i64);
    fn row(&self, seconds: f64) -> ChannelRow;
}

struct TapOf<T: Message> {
    subscriber: Subscriber<T>,
    fresh: u64,
    newest: Option<i64>,
}

impl<T: Message> Tap for TapOf<T> {
    fn look(&mut self, begun: i64) {
        while let Some(message) = self.subscriber.receive() {
            let t_published = message.header().t_published;
            self.fresh += u64::from(t_published >= begun);
            self.newest = self.newest.max(Some(t_published));
        }
    }

    fn row(&self, seconds: f64) -> ChannelRow {
        ChannelRow {
            name: self.subscriber.channel(),
            rate: self.fresh as f64 / seconds,
            lost: self.subscriber.lost(),
            age_s: self.newest.map(|newest| (monotonic_now() - newest) as f64 * 1e-9),
        }
    }
}

struct Taps<'a> {
    bus: &'a Bus,
    taps: Vec<Box<dyn Tap>>,
}

impl ChannelVisitor for Taps<'_> {
    type Error = BusError;

    fn visit<T: Message>(&mut self, channel: &Channel<T>) -> Result<(), BusError> {
        // The newest of a latched channel tells its age.
        let subscriber = self.bus.subscriber_since(channel, 1)?;
        self.taps.push(Box::new(TapOf { subscriber, fresh: 0, newest: None }));
        Ok(())
    }
}

fn table(status: &Status) -> String {
    let mut lines =
        vec![format!("{:<16} {:>8} {:<11} {:>8} {:>9} {:>8}", "process", "pid", "state", "restarts", "cpu s", "MB")];
    lines.extend(status.processes.iter().map(|row| {
        let megabytes = row.resident_bytes as f64 / 1e6;
        let ProcessRow { name, pid, state, restarts, cpu_s, .. } = row;
        format!("{name:<16} {pid:>8} {state:<11} {restarts:>8} {cpu_s:>9.2} {megabytes:>8.1}")
    }));
    lines.push(String::new());
    lines.push(format!("{:<18} {:>9} {:>8} {:>9}", "channel", "per s", "lost", "age s"));
    lines.extend(status.channels.iter().map(|row| {
        let age = row.age_s.map_or("-".to_owned(), |age| format!("{age:.2}"));
        format!("{:<18} {:>9.1} {:>8} {age:>9}", row.name, row.rate, row.lost)
    }));
    lines.join("\n")
}
