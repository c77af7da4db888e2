//! `faults`: class by seed, with the expectations of the catalogue.

use crate::faults::catalogue::{CASES, Case, elsewhere};
use crate::faults::expect::{Expect, FaultTime};
use crate::faults::run::{FaultRun, Outcome, Setting, Trace};
use crate::parallel::in_parallel;
use crate::trial::TrialError;
use sim_faults::FaultSpec;

/// What to run.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Seeds per class, N from the first on.
    #[arg(long, default_value_t = 4)]
    pub seeds: u64,
    /// The first seed: others than those that something was chosen on.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub first: u64,
    /// Only this class of the catalogue, such as F12, or the faults with this text in them.
    #[arg(long, value_name = "TEXT")]
    pub only: Option<String>,
    /// Any configuration key, for every run.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub sets: Vec<String>,
}

/// Errors beyond so many sigmas are no noise: an honest run of 300 s comes there once in 10⁴.
const HAZARD: f64 = 5.0;
/// Share of the samples that may lie beyond three sigmas.
const OUTSIDE: f64 = 0.003;
/// Share of the truth rows of a clean run that must meet an estimate; the longest gaps of the IMU here take a thirtieth.
const PUBLISHED: f64 = 0.9;
/// s: errors nearer to each other are one draw, not two; from this comes how far a share scatters.
const CORRELATION: f64 = 10.0;

impl Case {
    pub(crate) fn specs(&self) -> Vec<FaultSpec> {
        self.faults
            .iter()
            .map(|text| text.parse().expect("the cases of the house parse; a test reads them all"))
            .collect()
    }
}

/// From the first beginning to the last end; without faults the whole of the mission.
pub fn time_of(specs: &[FaultSpec]) -> FaultTime {
    if specs.is_empty() {
        return FaultTime { from: f64::MIN, to: f64::INFINITY };
    }
    let seconds = |t: Option<shared_types::Time>, open: f64| t.map_or(open, shared_types::Time::as_seconds);
    FaultTime {
        from: specs.iter().map(|spec| seconds(spec.span().from, 0.0)).fold(f64::INFINITY, f64::min),
        to: specs.iter().map(|spec| seconds(spec.span().to, f64::INFINITY)).fold(0.0, f64::max),
    }
}

/// Runs of `seeds` without faults, in their order.
pub fn clean_runs(seeds: impl Iterator<Item = u64>, sets: &[String]) -> Result<Vec<Trace>, TrialError> {
    clean_runs_in(Setting::AsItIs, seeds, sets)
}

fn clean_runs_in(
    setting: Setting,
    seeds: impl Iterator<Item = u64>,
    sets: &[String],
) -> Result<Vec<Trace>, TrialError> {
    let runs: Vec<FaultRun> =
        seeds.map(|seed| FaultRun { setting, faults: Vec::new(), sets: sets.to_vec(), seed }).collect();
    in_parallel(&runs, |run| run.run()?.map_err(TrialError::Panicked))
}

/// One line of the matrix.
struct Line {
    passed: u64,
    /// What was not met: figure's name, seeds, worst found.
    misses: Vec<(String, u64, f64)>,
    worst: f64,
    outside: (usize, usize),
    ratios: Vec<f64>,
    /// s, one for each seed; infinite where it did not come back. Empty for a fault without end.
    recoveries: Vec<f64>,
}

impl Line {
    fn new(case: &Case, outcomes: &[Outcome], clean: &[Trace]) -> Line {
        let time = time_of(&case.specs());
        let mut line = Line {
            passed: 0,
            misses: Vec::new(),
            worst: 0.0,
            outside: (0, 0),
            ratios: Vec::new(),
            recoveries: Vec::new(),
        };
        for (outcome, clean) in outcomes.iter().zip(clean) {
            let misses = match outcome {
                Ok(trace) => line.judge(case, trace, clean, time),
                Err(panic) => vec![(format!("panic: {panic}"), f64::INFINITY)],
            };
            line.passed += u64::from(misses.is_empty());
            for (what, found) in misses {
                match line.misses.iter_mut().find(|(known, ..)| *known == what) {
                    Some((_, seeds, worst)) => {
                        *seeds += 1;
                        *worst = if what.contains(">=") || what.contains("counted") {
                            worst.min(found)
                        } else {
                            worst.max(found)
                        };
                    }
                    None => line.misses.push((what, 1, found)),
                }
            }
        }
        line
    }

    fn judge(&mut self, case: &Case, trace: &Trace, clean: &Trace, time: FaultTime) -> Vec<(String, f64)> {
        let mut misses = Vec::new();
        let settled = case.expect.iter().filter_map(|expect| match expect {
            Expect::Settled(s) => Some(clean.began() + s),
            _ => None,
        });
        let counted = trace.since(settled.fold(f64::MIN, f64::max));
        let (worst, _) = counted.worst();
        let (out, all) = counted.outside();
        self.worst = self.worst.max(worst);
        self.outside = (self.outside.0 + out, self.outside.1 + all);
        self.ratios.push(counted.rms_since(f64::MIN)[0] / clean.since(counted.began()).rms_since(f64::MIN)[0]);
        if time.to.is_finite() {
            self.recoveries.push(trace.recovery(clean, time.to).unwrap_or(f64::INFINITY));
        }
        if trace.not_finite > 0 {
            misses.push(("finite".to_owned(), trace.not_finite as f64));
        }
        // A start that the fault puts off is no gap.
        let share = trace.rows.len() as f64 / clean.since(trace.began()).rows.len() as f64;
        if share.is_nan() || share < PUBLISHED {
            misses.push((format!("estimates >= {:.0} % of clean", 100.0 * PUBLISHED), share));
        }
        if worst.is_nan() || worst > HAZARD {
            misses.push((format!("error <= {HAZARD} sigma"), worst));
        }
        let own = case.expect.iter().filter_map(|expect| expect.miss(trace, clean, time));
        misses.extend(own.map(|miss| (miss.what, miss.found)));
        misses
    }

    /// Share beyond three sigmas, and whether it is more than chance makes of 0.3 %.
    fn containment(&self) -> (f64, bool) {
        let (out, all) = self.outside;
        let share = out as f64 / all.max(1) as f64;
        let draws = all as f64 / (CORRELATION * 10.0);
        (share, share <= OUTSIDE + 3.0 * (OUTSIDE / draws.max(1.0)).sqrt())
    }
}

/// Runs the matrix and prints it as Markdown.
///
/// # Errors
/// [`TrialError`] of a setting, or of the clean runs.
#[expect(clippy::print_stdout, reason = "the table is the product of this command")]
pub fn run(args: &Args) -> Result<(), TrialError> {
    let is_class =
        |number: u8| args.only.as_deref().is_none_or(|only| only.eq_ignore_ascii_case(&format!("F{number}")));
    let is_named =
        |case: &Case| args.only.as_deref().is_some_and(|only| case.faults.iter().any(|fault| fault.contains(only)));
    let cases: Vec<&Case> = CASES.iter().filter(|case| is_class(case.number) || is_named(case)).collect();
    let seeds = || args.first..args.first + args.seeds;
    let mut references: Vec<(Setting, Vec<Trace>)> = Vec::new();
    for case in &cases {
        let setting = case.setting.reference();
        if references.iter().all(|(known, _)| *known != setting) {
            references.push((setting, clean_runs_in(setting, seeds(), &args.sets)?));
        }
    }
    let clean_of = |case: &Case| {
        let of_setting = references.iter().find(|(setting, _)| *setting == case.setting.reference());
        of_setting.map_or(&[][..], |(_, clean)| clean)
    };
    let runs: Vec<FaultRun> = cases
        .iter()
        .flat_map(|case| {
            seeds().map(|seed| FaultRun { setting: case.setting, faults: case.specs(), sets: args.sets.clone(), seed })
        })
        .collect();
    let outcomes = in_parallel(&runs, FaultRun::run)?;
    println!(
        "| class | fault | seeds | passed | violated | worst error, sigma | beyond 3 sigma, % | RMS / clean, mean (max) | recovered, s, median (max) | not met: seeds, worst found |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let per_case = args.seeds as usize;
    let mut totals = (0, 0);
    for number in 1..=40 {
        for (index, case) in cases.iter().enumerate().filter(|(_, case)| case.number == number) {
            let line = Line::new(case, &outcomes[index * per_case..(index + 1) * per_case], clean_of(case));
            totals = (totals.0 + line.passed, totals.1 + args.seeds - line.passed);
            println!("{}", row(case, &line, args.seeds));
        }
        if let Some(place) = elsewhere(number).filter(|_| is_class(number)) {
            println!("| F{number} | {place} | – | – | – | – | – | – | – | – |");
        }
    }
    println!("\n{} runs passed, {} violated an expectation.", totals.0, totals.1);
    Ok(())
}

fn row(case: &Case, line: &Line, seeds: u64) -> String {
    let (share, is_honest) = line.containment();
    let mut misses: Vec<String> =
        line.misses.iter().map(|(what, seeds, found)| format!("{what}: {seeds}, {}", number(*found))).collect();
    if !is_honest {
        misses.push(format!("beyond 3 sigma <= 0.3 %: all, {:.1} %", 100.0 * share));
    }
    let ratio = line.ratios.iter().sum::<f64>() / line.ratios.len().max(1) as f64;
    let mut recoveries = line.recoveries.clone();
    recoveries.sort_by(f64::total_cmp);
    let recovered = match recoveries.last() {
        Some(max) => format!("{} ({})", number(recoveries[recoveries.len() / 2]), number(*max)),
        None => "–".to_owned(),
    };
    let faults = case.faults.iter().map(|fault| format!("`{fault}`"));
    let what: Vec<String> = case.setting.name().into_iter().chain(faults).collect();
    format!(
        "| F{} | {} | {seeds} | {} | {} | {} | {:.2}{} | {} ({}) | {recovered} | {} |",
        case.number,
        what.join(" "),
        line.passed,
        seeds - line.passed,
        number(line.worst),
        100.0 * share,
        if is_honest { "" } else { " !" },
        number(ratio),
        number(line.ratios.iter().copied().fold(0.0, f64::max)),
        if misses.is_empty() { "–".to_owned() } else { misses.join("; ") },
    )
}

/// Three digits, and a word for what never came.
pub fn number(value: f64) -> String {
    match value {
        value if value.is_infinite() => "never".to_owned(),
        value if value.abs() >= 100.0 => format!("{value:.0}"),
        value if value.abs() >= 10.0 => format!("{value:.1}"),
        value => format!("{value:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_parses_and_every_number_has_its_place() {
        for case in CASES {
            assert_eq!(case.specs().len(), case.faults.len());
        }
        for number in 1..=40 {
            let has_case = CASES.iter().any(|case| case.number == number);
            assert!(has_case != elsewhere(number).is_some(), "F{number}");
        }
    }

    /// Seeds beside those that anything was chosen on.
    const OTHER_SEEDS: [u64; 2] = [101, 102];

    fn assert_met(faults: &[&str]) {
        for seed in OTHER_SEEDS {
            let run = |faults| {
                FaultRun { setting: Setting::AsItIs, faults, sets: Vec::new(), seed }
                    .run()
                    .expect("it runs")
                    .expect("no panic")
            };
            let clean = run(Vec::new());
            for fault in faults {
                let case = CASES.iter().find(|case| case.faults == [*fault]).expect("a case of the catalogue");
                let mut line = Line::new(case, &[], &[]);
                let misses = line.judge(case, &run(case.specs()), &clean, time_of(&case.specs()));
                assert!(misses.is_empty(), "{fault}, seed {seed}: {misses:?}");
            }
        }
    }

    #[test]
    fn an_imu_that_freezes_leaps_or_is_turned_round_is_declared_and_misleads_nobody() {
        assert_met(&[
            "imu.stuck@120..180",
            "imu.sign@120..180",
            "imu.axes@120..180",
            "imu.rail=8.7,78@150..151",
            "imu.shock=0.05,30@130..135",
        ]);
    }

    #[test]
    fn a_pressure_sensor_that_freezes_is_refused_until_it_varies_again() {
        assert_met(&["ps.stuck@195..225"]);
    }

    #[test]
    fn an_imu_whose_clock_leaps_for_half_a_second_is_bridged() {
        assert_met(&["imu.stamp=1@150..150.5"]);
    }

    #[test]
    fn fixes_that_ranges_contradict_are_refused() {
        assert_met(&["gnss.jump=50@265..", "gnss.drag=5@260..", "gnss.drag=0.2@260.."]);
    }

    #[test]
    fn depths_that_leap_or_feel_waves_are_refused_and_velocities_hold_the_height() {
        assert_met(&["ps.bias=0.3@120..", "ps.swell=0.5,8@245.."]);
    }

    #[test]
    fn the_outcome_does_not_depend_on_company_or_order() {
        let run = FaultRun {
            setting: Setting::AsItIs,
            faults: vec!["lbl.multipath=0.3".parse().expect("a fault")],
            sets: vec!["fgo.window=5".to_owned()],
            seed: 1,
        };
        let rms = |outcome: Outcome| outcome.expect("no panic").rms_since(0.0);
        let alone = rms(run.run().expect("it runs"));
        for together in in_parallel(&[run.clone(), run.clone(), run], FaultRun::run).expect("they run") {
            assert_eq!(rms(together), alone);
        }
    }
}
