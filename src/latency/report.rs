//! What a measurement found, as one JSON object or as a table.

use std::collections::BTreeMap;

use serde::Serialize;
use shared_types::{Heartbeat, HopLatency, Process};

use super::consumer::Consumed;
use super::page_faults::PageFaults;
use super::reference::{Hop, Measured};
use super::{Conditions, LatencyArgs};

/// A latency distribution in µs.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Distribution {
    p50_us: f64,
    p90_us: f64,
    p99_us: f64,
    p99_9_us: f64,
    p99_99_us: f64,
    max_us: f64,
    count: u64,
}

impl From<HopLatency> for Distribution {
    fn from(brief: HopLatency) -> Distribution {
        let us = |ns: u64| ns as f64 * 1e-3;
        Distribution {
            p50_us: us(brief.p50_ns),
            p90_us: us(brief.p90_ns),
            p99_us: us(brief.p99_ns),
            p99_9_us: us(brief.p99_9_ns),
            p99_99_us: us(brief.p99_99_ns),
            max_us: us(brief.max_ns),
            count: brief.count,
        }
    }
}

/// The bare hops of the same run.
#[derive(Debug, Serialize)]
struct Reference {
    iceoryx2: Distribution,
    unix_socket: Distribution,
    pipe: Distribution,
}

/// What was lost, by where it was.
#[derive(Debug, Serialize)]
struct Losses {
    /// Samples without an estimate at the consumer.
    unanswered: u64,
    /// Samples that the propagator missed.
    imu_at_propagator: u64,
    /// Estimates that the consumer missed.
    estimates_at_consumer: u64,
    /// Samples that the observer missed: without them the figures would not be whole.
    imu_at_observer: u64,
    /// Bare messages, all means together.
    reference: u64,
}

/// What a measurement found.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    rate_hz: u32,
    duration_s: f64,
    load: bool,
    load_average: f64,
    /// Of the propagator and of the receivers of the bare hops.
    wake_up: &'static str,
    /// Of the processes whose loops allocate nothing, within the window.
    page_faults: BTreeMap<&'static str, PageFaults>,
    /// By name. The first two within the window; the rest as each process tells of itself since its start.
    hops: BTreeMap<&'static str, Distribution>,
    end_to_end: Distribution,
    reference: Reference,
    /// Samples and estimates of the set that were lost.
    lost: u64,
    losses: Losses,
}

/// Name of a hop, who tells of it, and where it stands in the heartbeat.
type Told = (&'static str, Process, fn(&Heartbeat) -> HopLatency);

/// What processes tell of themselves in their heartbeats.
const TOLD: [Told; 6] = [
    ("imu_to_propagator", Process::Propagator, |beat| beat.hop_in),
    ("arrival_to_estimate", Process::Propagator, |beat| beat.end_to_end),
    ("rebase", Process::Propagator, |beat| beat.work),
    ("sensors_to_preprocessor", Process::Preprocessor, |beat| beat.hop_in),
    ("measurements_to_solver", Process::Solver, |beat| beat.hop_in),
    ("solve", Process::Solver, |beat| beat.work),
];

const IMU_TO_ESTIMATE: &str = "imu_to_estimate";
const ESTIMATE_TO_CONSUMER: &str = "estimate_to_consumer";

impl Report {
    pub(super) fn new(
        args: &LatencyArgs,
        polls: bool,
        conditions: Conditions,
        consumed: &Consumed,
        references: &Measured,
    ) -> Report {
        let mut hops = BTreeMap::from([
            (IMU_TO_ESTIMATE, consumed.imu_to_estimate.brief().into()),
            (ESTIMATE_TO_CONSUMER, consumed.estimate_to_consumer.brief().into()),
        ]);
        for (name, process, hop) in TOLD {
            if let Some(beat) = consumed.beats.get(&process) {
                hops.insert(name, hop(beat).into());
            }
        }
        let of = |hop: &Hop| hop.latency.brief().into();
        let losses = Losses {
            unanswered: consumed.unanswered,
            imu_at_propagator: consumed.lost_at_propagator(),
            estimates_at_consumer: consumed.estimates_lost,
            imu_at_observer: consumed.samples_unseen,
            reference: references.iceoryx2.lost + references.unix_socket.lost + references.pipe.lost,
        };
        Report {
            rate_hz: args.rate,
            duration_s: args.duration,
            load: args.load,
            load_average: conditions.load_average,
            wake_up: if polls { "poll" } else { "event" },
            page_faults: conditions.page_faults,
            hops,
            end_to_end: consumed.end_to_end.brief().into(),
            reference: Reference {
                iceoryx2: of(&references.iceoryx2),
                unix_socket: of(&references.unix_socket),
                pipe: of(&references.pipe),
            },
            // A lost sample or estimate is an unanswered sample, too: whichever account is larger saw more.
            lost: losses.unanswered.max(losses.imu_at_propagator + losses.estimates_at_consumer),
            losses,
        }
    }

    /// For people: hops, then bare hops, with their ratios.
    pub(super) fn table(&self) -> String {
        let mut lines = vec![
            format!(
                "{} Hz, {} s, {} wake-up, {}, load average {:.1}; one-way times in µs",
                self.rate_hz,
                self.duration_s,
                self.wake_up,
                if self.load { "every core kept busy" } else { "no load of its own" },
                self.load_average
            ),
            String::new(),
            format!(
                "{:<28} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
                "hop", "p50", "p90", "p99", "p99.9", "p99.99", "max", "count"
            ),
        ];
        let measured = [IMU_TO_ESTIMATE, ESTIMATE_TO_CONSUMER];
        lines.extend(measured.iter().filter_map(|name| Some(row(name, self.hops.get(name)?))));
        lines.push(row("end to end", &self.end_to_end));
        lines.push(String::new());
        lines.push(row("bare: iceoryx2", &self.reference.iceoryx2));
        lines.push(row("bare: Unix socket", &self.reference.unix_socket));
        lines.push(row("bare: pipe", &self.reference.pipe));
        lines.push(String::new());
        lines.push("as each process tells since its start:".to_owned());
        lines.extend(self.hops.iter().filter(|(name, _)| !measured.contains(name)).map(|(name, hop)| row(name, hop)));
        lines.push(String::new());
        let bare = &self.reference.iceoryx2;
        let ratios =
            |hop: &Distribution| format!("p50 {:.2}, p99 {:.2}", hop.p50_us / bare.p50_us, hop.p99_us / bare.p99_us);
        if let Some(hop) = self.hops.get(IMU_TO_ESTIMATE) {
            lines.push(format!(
                "against the bare iceoryx2 hop: {IMU_TO_ESTIMATE} {}; end to end {}",
                ratios(hop),
                ratios(&self.end_to_end)
            ));
        }
        let losses = &self.losses;
        lines.push(format!(
            "lost: {} (unanswered samples {}, samples at the propagator {}, estimates at the consumer {}); bare messages {}",
            self.lost,
            losses.unanswered,
            losses.imu_at_propagator,
            losses.estimates_at_consumer,
            losses.reference
        ));
        let faults = |(name, faults): (&&str, &PageFaults)| format!("{name} {faults}");
        let faults: Vec<String> = self.page_faults.iter().map(faults).collect();
        lines.push(format!("page faults (minor + major): {}", faults.join(", ")));
        lines.join("\n")
    }
}

fn row(name: &str, hop: &Distribution) -> String {
    let Distribution { p50_us, p90_us, p99_us, p99_9_us, p99_99_us, max_us, count } = hop;
    format!(
        "{name:<28} {p50_us:>9.1} {p90_us:>9.1} {p99_us:>9.1} {p99_9_us:>9.1} {p99_99_us:>9.1} {max_us:>9.1} {count:>9}"
    )
}
