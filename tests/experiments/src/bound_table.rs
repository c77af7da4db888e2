//! The estimator beside the bound: how much of the accuracy that there is does it reach?

use nav_geometry::Geodetic;
use sim_world::{Preset, World};

use crate::bound::{Bound, bound};
use crate::parallel::in_parallel;
use crate::trial::{Trial, TrialError};

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per row, 1 to N.
    #[arg(long, default_value_t = 10)]
    pub seeds: u64,
    /// Only this scenario.
    #[arg(long)]
    pub scenario: Option<String>,
    /// Only rows whose sensors contain this text.
    #[arg(long)]
    pub sensors: Option<String>,
    /// Seconds of data time to run instead of the whole mission.
    #[arg(long)]
    pub until: Option<f64>,
    /// Moves the scenarios to this latitude and longitude, degrees.
    #[arg(long, value_name = "LAT,LON", value_delimiter = ',', num_args = 2, allow_negative_numbers = true)]
    pub at: Option<Vec<f64>>,
    /// Any configuration key, for every row.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
    /// Leaves the smoother out.
    #[arg(long)]
    pub causal: bool,
}

const SCENARIOS: [&str; 4] = ["mission", "stable", "outage", "survey"];
/// Name in the table, configuration, the only buoy to be heard.
const SENSORS: [(&str, &[&str], Option<u32>); 4] = [
    ("LBL raw + PS", &["dvl.enabled=false", "mcp.enabled=false", "gnss.enabled=false"], None),
    (
        "LBL differences + PS",
        &["dvl.enabled=false", "mcp.enabled=false", "gnss.enabled=false", "lbl.common_offset_sigma=inf"],
        None,
    ),
    ("all sensors", &[], None),
    ("one buoy + DVL + MCP + PS", &["gnss.enabled=false"], Some(1)),
];
/// The bound is averaged over instants so far apart, s: those of the truth that the score is made of.
const COUNT_EVERY: f64 = 0.1;
/// Long after any mission, s.
const NEVER: f64 = 1e6;

/// Runs every row and prints the table.
///
/// # Errors
/// [`TrialError`] of the first trial that cannot be run.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    println!(
        "| {:<8} | {:<25} | {:^23} | {:^23} | {:^20} | {:^17} | {:^20} |",
        "scenario", "sensors", "bound E/N/U [m]", "RMS E/N/U [m]", "ratio, horizontal", "NEES E/N/U", "in 3 sigma [%]"
    );
    println!("|{:-<10}|{:-<27}|{:-<25}|{:-<25}|{:-<22}|{:-<19}|{:-<22}|", "", "", "", "", "", "", "");
    for scenario in SCENARIOS.iter().filter(|name| args.scenario.as_deref().is_none_or(|only| only == **name)) {
        for (sensors, sets, only_buoy) in
            SENSORS.iter().filter(|(name, ..)| args.sensors.as_deref().is_none_or(|t| name.contains(t)))
        {
            row(scenario, sensors, sets, *only_buoy, args)?;
        }
    }
    Ok(())
}

fn row(
    scenario: &'static str,
    sensors: &str,
    sets: &[&str],
    only_buoy: Option<u32>,
    args: &Args,
) -> Result<(), TrialError> {
    let trial = |seed: u64| Trial {
        sets: sets.iter().map(|set| (*set).to_owned()).chain(args.sets.iter().cloned()).collect(),
        until: args.until,
        only_buoy,
        moved_to: args.at.as_deref().map(|at| [at[0], at[1]]),
        ..Trial::new(scenario, Preset::Realistic, seed)
    };
    let first = trial(1);
    let place = first.place()?;
    let config = first.config(&World::new(&place, Preset::Realistic, 1)?)?;
    let [lat_deg, lon_deg, height] = place.origin_deg;
    let exact = World::new(&place, Preset::None, 1)?;
    let origin = Geodetic::from_degrees(lat_deg, lon_deg, height);
    let until = args.until.unwrap_or(NEVER);
    let bound = bound(&exact, &config, origin, COUNT_EVERY, until, |reading| first.hears(reading))
        .ok_or(TrialError::NoEstimate { scenario, seed: 0 })?;

    let trials: Vec<Trial> = (1..=args.seeds).map(trial).collect();
    let causal = in_parallel(&trials, |trial| trial.run(&[]).map(|outcome| outcome.score))?;
    print_line(scenario, sensors, &bound.causal_enu, &causal);
    if !args.causal {
        let smoothed = in_parallel(&trials, |trial| trial.smooth().map(|batch| batch.score))?;
        let Bound { smoothed_enu, .. } = bound;
        print_line(scenario, &format!("{sensors}, smoothed"), &smoothed_enu, &smoothed);
    }
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
fn print_line(scenario: &str, sensors: &str, bound: &[f64; 3], scores: &[nav_evaluation::Score]) {
    let count = scores.len() as f64;
    let mean = |value: &dyn Fn(&nav_evaluation::Score) -> f64| scores.iter().map(value).sum::<f64>() / count;
    let rms = [0, 1, 2].map(|axis| mean(&|score| score.rms_enu[axis].powi(2)).sqrt());
    let nees = [0, 1, 2].map(|axis| mean(&|score| score.nees_enu.map_or(f64::NAN, |nees| nees[axis])));
    let share = [0, 1, 2].map(|axis| 100.0 * mean(&|s| s.three_sigma_share_enu.map_or(f64::NAN, |share| share[axis])));
    // The square of the ratio is a mean over seeds: its spread gives that of the ratio.
    let horizontal = bound[0].hypot(bound[1]);
    let squares: Vec<f64> = scores.iter().map(|score| (score.rms_horizontal / horizontal).powi(2)).collect();
    let square = squares.iter().sum::<f64>() / count;
    let spread = squares.iter().map(|s| (s - square).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let ratio = square.sqrt();
    let error = (spread / count).sqrt() / (2.0 * ratio);
    println!(
        "| {scenario:<8} | {sensors:<25} | {:>7.4} {:>7.4} {:>7.4} | {:>7.4} {:>7.4} {:>7.4} | {ratio:>9.3} ± {error:<8.3} | {:>5.2} {:>5.2} {:>5.2} | {:>6.2} {:>6.2} {:>6.2} |",
        bound[0], bound[1], bound[2], rms[0], rms[1], rms[2], nees[0], nees[1], nees[2], share[0], share[1], share[2]
    );
}
