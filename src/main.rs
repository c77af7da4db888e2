//! `ilns`: one executable, the table of its subcommands.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use ilns_replay::{ConvertArgs, PlotArgs, ReplayArgs, ScoreArgs, SmoothArgs};
use ilns_runtime::exit_with;
use sim_emulators::simulate::SimulateArgs;

mod child;
mod faults;
mod hold;
mod latency;
mod legacy;
mod plan;
mod processes;
mod recording;
mod reload;
mod restarts;
mod run;
mod status;
mod supervisor;
mod view;

use processes::ProcessCommand;

/// What a command returns: any error, told by `exit_with`.
type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Navigates an autonomous underwater vehicle: a sliding-window factor graph fuses inertial data with acoustic ranges,
/// satellite fixes, Doppler velocities, headings and depths.
///
/// `ilns run` starts everything on a built-in mission.
#[derive(Parser)]
#[command(name = "ilns", version, disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run the whole set of processes on a simulated mission or a recorded log, until it ends or Ctrl-C is pressed.
    Run(run::RunArgs),
    /// Run a log directory through the whole navigator in one thread, as fast as the machine can.
    Replay(ReplayArgs),
    /// Smooth a log directory as one batch: every estimate with what came after it too.
    Smooth(SmoothArgs),
    /// Write a simulated mission into a log directory, as fast as the machine can, with the truth.
    Simulate(SimulateArgs),
    /// Hold estimates against the truth: errors, spread and how honest the sigmas are.
    Score(ScoreArgs),
    /// Turn a public data set into a log directory.
    Convert(ConvertArgs),
    /// Draw a trajectory into an SVG file.
    Plot(PlotArgs),
    /// Measure how long a sample takes to an estimate and to a consumer, beside bare hops in the same run.
    Latency(latency::LatencyArgs),
    /// Do to a running set what goes wrong at sea: kill, stop, starve its processes, and say what its estimates made of it.
    Faults(faults::FaultsArgs),
    /// Send the bare messages that `latency` measures beside its own.
    #[command(name = latency::SENDER, hide = true)]
    ReferenceSender(latency::SenderArgs),
    /// Show a finished run in a browser, with a time slider, or write it into one HTML file.
    View(view::ViewArgs),
    /// Look at an MCAP recording, make a torn one whole, or write its log directory.
    Recording(recording::RecordingArgs),
    /// Show the processes and channels of a running set.
    Status(status::StatusArgs),
    /// Give a running set another configuration of its aiding sensors, whole or not at all, without a restart. `--config FILE` is a whole one, as
    /// at the start; without it, `--set` and the others change the one in force.
    Reload(reload::ReloadArgs),
    /// Hold the channels of a set whose processes something else starts, such as systemd. Must be started first.
    Bus(hold::BusArgs),
    #[command(flatten)]
    Process(ProcessCommand),
}

fn main() -> ExitCode {
    match Cli::parse().command {
        Command::Run(args) => exit_with("run", run::run(&args)),
        Command::Replay(args) => exit_with("replay", ilns_replay::replay::run(&args)),
        Command::Smooth(args) => exit_with("smooth", ilns_replay::smooth::run(&args)),
        Command::Simulate(args) => exit_with("simulate", sim_emulators::simulate::run(&args)),
        Command::Score(args) => exit_with("score", ilns_replay::score::run(&args)),
        Command::Convert(args) => exit_with("convert", ilns_replay::convert::run(&args)),
        Command::Plot(args) => exit_with("plot", ilns_replay::plot::run(&args)),
        Command::Latency(args) => exit_with("latency", latency::run(&args)),
        Command::Faults(args) => exit_with("faults", faults::run(&args)),
        Command::ReferenceSender(args) => exit_with(latency::SENDER, latency::send_references(&args)),
        Command::View(args) => exit_with("view", view::run(&args)),
        Command::Recording(args) => exit_with("recording", recording::run(&args)),
        Command::Status(args) => exit_with("status", status::run(&args)),
        Command::Reload(args) => exit_with("reload", reload::run(&args)),
        Command::Bus(args) => exit_with("bus", hold::run(&args)),
        Command::Process(command) => exit_with(command.name(), command.run()),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn an_emulator_may_be_spelled_in_one_word_or_two() {
        for spelling in [&["ilns", "emulator-imu"][..], &["ilns", "emulator", "imu"]] {
            let cli = Cli::try_parse_from([spelling, &["--epoch", "3"]].concat()).expect("both are fine");
            assert!(matches!(cli.command, Command::Process(command) if command.name() == "emulator-imu"));
        }
        assert!(Cli::try_parse_from(["ilns", "emulator", "sonar"]).is_err());
    }
}
