//! The command line of `ilns replay`, and the configuration that it asks for.

use std::path::PathBuf;

use clap::Args;
use ilns_runtime::NavigatorArgs;
use shared_types::{Config, ConfigText, Duration};
use sim_faults::FaultSpec;

use crate::error::ReplayError;

/// Replays a log directory through the whole navigator, as fast as the processor allows.
///
/// Writes estimate.csv, estimate.tum and summary.json into OUT; with a truth.csv in the log, the summary holds the score.
#[derive(Args, Clone, Debug)]
pub struct ReplayArgs {
    /// The log: a folder with imu.csv, further sensors, and optionally sensors.toml and truth.csv.
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// Folder for the results; made where there is none, results of an earlier run in it are replaced.
    #[arg(long, value_name = "OUT", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "a doc comment here would become the help text of the whole group")]
    pub navigator: NavigatorArgs,
    /// Corrections reach the published estimate so much data time later, as they do live. Milliseconds.
    #[arg(long, value_name = "MS", value_parser = parse_latency)]
    pub solve_latency: Option<Duration>,
    /// Takes each correction at the estimate at which a live run took it: the estimate.csv or recording.mcap of that run.
    /// Given once for each MCAP of a recording of several, in their order.
    #[arg(long, value_name = "FILE", conflicts_with = "solve_latency")]
    pub follow: Vec<PathBuf>,
    /// A fault to inject into the readings of the log, such as dvl.false_lock@600..660 or lbl.multipath=0.2 (drivers-sim/
    /// faults/README.md lists them). May be given several times; the span is seconds on the clock of the log.
    #[arg(long = "fault", value_name = "SPEC")]
    pub faults: Vec<FaultSpec>,
    /// What the faults draw.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub fault_seed: u64,
}

/// `40` or `40ms`.
fn parse_latency(text: &str) -> Result<Duration, String> {
    let number = text.strip_suffix("ms").unwrap_or(text).trim();
    match number.parse::<f64>() {
        // A minute is beyond any use and far below what nanoseconds hold.
        Ok(ms) if (0.0..=60_000.0).contains(&ms) => Ok(Duration::from_seconds(ms * 1e-3)),
        _ => Err("expected milliseconds from 0 to 60000, such as 40".to_owned()),
    }
}

impl ReplayArgs {
    /// The effective configuration: `sensors.toml` of the log, `--config`, the flags, `--set`; later ones win.
    ///
    /// # Errors
    /// A file that cannot be read, or a key or value that is refused.
    pub fn load_config(&self, log_config: Option<&ConfigText>) -> Result<Config, ReplayError> {
        Ok(self.navigator.load_config(log_config.map(std::slice::from_ref).unwrap_or_default())?)
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use shared_types::Sensor;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        args: ReplayArgs,
    }

    fn parse(line: &str) -> Result<ReplayArgs, clap::Error> {
        Command::try_parse_from(["replay"].into_iter().chain(line.split_whitespace())).map(|command| command.args)
    }

    #[test]
    fn flags_reach_the_configuration_and_set_has_the_last_word() {
        let args = parse("log --out out --window 30 --no-dvl --no-mcp --set mcp.enabled=true").expect("valid");
        let sensors =
            ConfigText { file: "sensors.toml".into(), text: "[fgo]\nwindow = 7\n[lbl]\nsigma = 0.5\n".into() };
        let config = args.load_config(Some(&sensors)).expect("valid");
        assert_eq!((config.navigator.fgo.window, config.vehicle.lbl.sigma), (30, 0.5));
        assert!(!config.navigator.is_enabled(Sensor::Dvl) && config.navigator.is_enabled(Sensor::Mcp));
    }

    #[test]
    fn an_output_folder_is_asked_for_unless_only_the_configuration_is() {
        assert!(parse("log").is_err());
        assert!(parse("log --print-config").is_ok());
    }

    #[test]
    fn a_fault_that_is_none_is_named_with_its_mend() {
        let faults = parse("log --out out --fault dvl.stuck@1..2 --fault lbl.multipath=0.1").expect("valid").faults;
        assert_eq!(faults.len(), 2);
        let error = parse("log --out out --fault dvl.stick@1..2").expect_err("no such class").to_string();
        assert!(error.contains("dvl has no class \"stick\"; it has blackout"), "{error}");
    }

    #[test]
    fn a_latency_is_milliseconds() {
        let latency = |text: &str| parse(&format!("log --out out --solve-latency {text}")).map(|a| a.solve_latency);
        assert_eq!(latency("40").expect("valid"), Some(Duration(40_000_000)));
        assert_eq!(latency("40ms").expect("valid"), Some(Duration(40_000_000)));
        assert!(latency("soon").is_err() && latency("nan").is_err());
    }

    #[test]
    fn a_refused_value_names_its_key() {
        let error = parse("log --out out --window 1").expect("clap does not know").load_config(None);
        let message = error.expect_err("a window of one").to_string();
        assert!(message.contains("fgo.window"), "{message}");
    }
}
