//! `ilns faults`: does to a running set what goes wrong with processes, disks and load, and says what its estimates made of it.
//!
//! The set is `ilns run` in a scratch folder and under a prefix of its own; what happens to it is seen by a plain consumer of
//! `nav/estimate`. Faults of sensors, data and stamps are the business of `experiments faults`, in replay; both tables have one
//! shape. Numbers F1 to F40 are those of the fault catalogue.

use std::fs;
use std::path::PathBuf;

use ilns_bus::Prefix;
use ilns_runtime::{LogFormat, Shutdown, answer, monotonic_now, start_logging};
use rand_pcg::Pcg64;
use shared_types::Process;
use tracing::info;

use crate::Outcome;

mod bench;
mod class;
mod consumer;
mod figures;
mod live_set;
mod mission;
mod report;

use bench::{Bench, BenchError};
use class::{Class, Deed, LIVE, MISSING, besides_kills};
use report::{Asked, Matrix};

/// What the bench is told.
#[derive(Debug, clap::Args)]
pub struct FaultsArgs {
    /// Over the bus: a whole set of processes, killed, stopped, slowed down and starved. (Faults of sensors and stamps are
    /// injected into replays by `cargo run --release -p experiments -- faults`.)
    #[arg(long, required = true)]
    live: bool,
    /// How often processes are killed (kill -9), at random times, their starts included; one in fifty is the supervisor. After
    /// each kill the set has to come back by itself.
    #[arg(long, value_name = "N", default_value_t = 100)]
    kills: u64,
    /// Kill only; without it, processes are also stopped and slowed down, checkpoints spoilt, disks filled and cores kept busy.
    #[arg(long)]
    kills_only: bool,
    /// Only these classes of the catalogue, such as F1 or F31; without it, all. Kills are then shared among the victims of these
    /// classes. May be given several times.
    #[arg(long = "class", value_name = "CLASS", value_parser = number, conflicts_with = "kills_only")]
    classes: Vec<u8>,
    /// Of the random times and victims.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Seconds after which nothing more is begun, whatever is still to do; the table says how much was done.
    #[arg(long, value_name = "S", default_value_t = 3_600.0, value_parser = seconds)]
    duration: f64,
    /// Seconds of data time per second. What is expected holds at 1.
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = rate)]
    rate: f64,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// Write the table into this file, too.
    #[arg(long, value_name = "FILE.md")]
    out: Option<PathBuf>,
    /// Name of the set; without it, one that no other run has.
    #[arg(long, value_name = "NAME")]
    prefix: Option<String>,
    /// Least severity that is logged: error, warn, info, debug or trace. `info` tells of each trial.
    #[arg(long, value_name = "LEVEL", default_value = "warn")]
    log_level: String,
}

/// One in so many kills is that of the supervisor.
const SUPERVISOR: u32 = 50;

/// A table that cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("--out {}: it cannot be written", .0.display())]
struct OutError(PathBuf, #[source] std::io::Error);

fn seconds(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "expected a number of seconds".to_owned())?;
    if (1.0..=1e6).contains(&number) { Ok(number) } else { Err("expected 1 to 1000000 seconds".to_owned()) }
}

fn number(text: &str) -> Result<u8, String> {
    let digits = text.strip_prefix(['F', 'f']).unwrap_or(text);
    let number: u8 = digits.parse().map_err(|_| "expected a class of the fault catalogue, F1 to F40".to_owned())?;
    match MISSING.iter().find(|(missing, _)| *missing == number) {
        Some((_, why)) => Err((*why).to_owned()),
        None if LIVE.contains(&number) => Ok(number),
        None => {
            Err(format!("F{number} is not done to processes; `experiments faults` does those of sensors and stamps"))
        }
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if (0.1..=10.0).contains(&number) { Ok(number) } else { Err("expected 0.1 to 10".to_owned()) }
}

/// Runs the trials and prints the matrix.
pub fn run(args: &FaultsArgs) -> Outcome {
    start_logging(&args.log_level, LogFormat::Auto)?;
    let shutdown = Shutdown::on_signals()?;
    let prefix = match &args.prefix {
        Some(name) => Prefix::new(name)?,
        None => Prefix::new(&format!("faults-{}", std::process::id()))?,
    };
    // A path that cannot be written is told before the trials, not after them.
    let refused = |error: std::io::Error| OutError(args.out.clone().unwrap_or_default(), error);
    let out = args.out.as_deref().map(fs::File::create).transpose().map_err(refused)?;
    let scratch = live_set::scratch(&prefix)?;
    let mut matrix = Matrix::default();
    let begun = monotonic_now();
    let kills = trials(args, &prefix, &scratch, &shutdown, &mut matrix);
    // The log of a set that went wrong is what its user needs next; it is named in the error.
    let (kills, wanted) = match kills {
        Ok(kills) => kills,
        Err(error) => return Err(format!("{error} (its folder is {})", scratch.display()).into()),
    };
    fs::remove_dir_all(&scratch)?;
    let asked = Asked { seed: args.seed, rate: args.rate, kills: wanted };
    let report = matrix.report(&asked, kills, (monotonic_now() - begun) as f64 * 1e-9);
    if let Some(mut file) = out {
        let (version, kills, seed) = (env!("CARGO_PKG_VERSION"), args.kills, args.seed);
        let head = format!("# `ilns faults --live`\n\nVersion {version}, `--kills {kills} --seed {seed}`.\n\n");
        std::io::Write::write_all(&mut file, format!("{head}{}\n", report.markdown()).as_bytes()).map_err(refused)?;
    }
    answer(&if args.json { serde_json::to_string(&report)? } else { report.markdown() })?;
    Ok(())
}

/// Returns how many kills were done, and how many there were to do.
fn trials(
    args: &FaultsArgs,
    prefix: &Prefix,
    scratch: &std::path::Path,
    shutdown: &Shutdown,
    matrix: &mut Matrix,
) -> Result<(u64, u64), BenchError> {
    // Any odd increment gives a sequence; this one is the generator's own.
    let draws = Pcg64::new(u128::from(args.seed), 0x0a02_bdbf_7bb3_c0a7_ac28_fa16_a64a_bf96);
    let mut bench = Bench::start(prefix, scratch, args.rate, draws, shutdown.clone())?;
    let mut victims = bench.victims();
    victims.push(Process::Supervisor);
    let limit = monotonic_now() + (args.duration * 1e9) as i64;
    match bench.carry_out(&Class::CLEAN) {
        Err(BenchError::Stopped) => {}
        found => matrix.enter(&Class::CLEAN, &found?),
    }
    let is_wanted = |class: &Class| args.classes.is_empty() || args.classes.contains(&class.number());
    let mut others = if args.kills_only { Vec::new() } else { besides_kills(&victims) };
    others.retain(is_wanted);
    others.reverse();
    victims.retain(|&victim| is_wanted(&Class { victim, deed: Deed::Kill }));
    let wanted_kills = if victims.is_empty() { 0 } else { args.kills };
    // Its death stands for a whole new set, which takes as long as twenty others.
    let has_supervisor = victims.pop_if(|victim| *victim == Process::Supervisor).is_some();
    let mut kills = 0;
    while monotonic_now() < limit && !shutdown.requested() {
        // The others are spread among the kills: what is left after the last kill follows at the end.
        let is_turn = kills >= wanted_kills || u64::from(bench.below(8)) == 0;
        let class = match others.pop_if(|_| is_turn) {
            Some(class) => class,
            None if kills < wanted_kills => {
                let is_supervisor = has_supervisor && (bench.below(SUPERVISOR) == 0 || victims.is_empty());
                let others = victims.len() as u32;
                let victim = if is_supervisor { Process::Supervisor } else { victims[bench.below(others) as usize] };
                let twice = wanted_kills - kills >= 2 && bench.below(4) == 0;
                Class { victim, deed: if twice { Deed::KillTwice } else { Deed::Kill } }
            }
            None => break,
        };
        let found = match bench.make_ready(&class, matrix).and_then(|()| bench.carry_out(&class)) {
            Err(BenchError::Stopped) => break,
            other => other?,
        };
        info!(fault = %class, back_s = found.back, step_at_take = found.step_at_take, figures = ?found.figures, "done");
        kills += class.kills();
        matrix.enter(&class, &found);
        if bench.is_spent() {
            match bench.begin_anew(matrix) {
                Err(BenchError::Stopped) => break,
                other => other?,
            }
        }
    }
    bench.end(matrix)?;
    Ok((kills, wanted_kills))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_and_rates_out_of_their_range_are_refused() {
        assert_eq!((seconds("1"), rate("10")), (Ok(1.0), Ok(10.0)));
        for bad in ["0", "nan", "inf", "-1", "x", "1e7"] {
            assert!(seconds(bad).is_err() && rate(&format!("{bad}0")).is_err(), "{bad}");
        }
    }
}
