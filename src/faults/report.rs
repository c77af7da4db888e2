//! The matrix: class by class, what was expected and what was found. The table has the shape of `experiments faults`, so that
//! both make one.

use std::collections::BTreeMap;

use serde::Serialize;
use shared_types::Mode;

use super::class::{Class, Expect, MISSING};
use super::figures::Figures;

/// Errors beyond so many sigmas are no noise.
const HAZARD: f64 = 5.0;

/// One inertial period of the mission, ns.
const PERIOD: i64 = 5_000_000;

/// What came of one trial. Times in s.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    /// From the deed to its end until it was recovered.
    pub(super) figures: Figures,
    /// Until INVALID was published, and after a loss of power any estimate, whose mode says what it is worth; `None`: it was not.
    pub(super) declared: Option<f64>,
    /// Until the victim was back; `None`: it was not.
    pub(super) back: Option<f64>,
    /// Whether the expected lines were said.
    pub(super) said: bool,
    /// Largest step while another configuration was taken up, sigmas.
    pub(super) step_at_take: f64,
    /// Whether requests for another configuration were answered as they ought to be.
    pub(super) answered: bool,
    /// Messages that the victim has counted as dropped meanwhile.
    pub(super) counted: u64,
    /// Somebody was given up, or the whole set ended.
    pub(super) collapsed: bool,
}

impl Expect {
    fn name(self) -> String {
        match self {
            Expect::NoGap => "an estimate for every sample (gap, s)".to_owned(),
            Expect::Gap(limit) => format!("gap <= {limit} s"),
            Expect::Declared(limit) => format!("INVALID <= {limit} s"),
            Expect::Flagged(limit) => format!("first estimate <= {limit} s"),
            Expect::Within(limit) => format!("error <= {limit} sigma or clean"),
            Expect::Back(limit) => format!("back <= {limit} s"),
            Expect::Step(limit) => format!("step <= {limit} sigma or clean"),
            Expect::Says(line) => format!("says \"{line}\""),
            Expect::StepAtTake(limit) => format!("step at the change <= {limit} sigma or clean"),
            Expect::Answered => "bad configurations refused and nothing changed, good ones taken up".to_owned(),
            Expect::Counts(least) => format!("at least {least} messages counted as dropped"),
        }
    }

    /// The figure, and whether it is as expected.
    fn judge(self, found: &Found, clean: &Figures) -> (f64, bool) {
        let at_most = |figure: f64, limit: f64| (figure, figure <= limit);
        match self {
            Expect::NoGap => (found.figures.gap as f64 * 1e-9, found.figures.gap <= PERIOD),
            Expect::Gap(limit) => at_most(found.figures.gap as f64 * 1e-9, limit),
            Expect::Declared(limit) | Expect::Flagged(limit) => at_most(found.declared.unwrap_or(f64::INFINITY), limit),
            Expect::Within(limit) => at_most(found.figures.worst, limit.max(clean.worst)),
            Expect::Back(limit) => at_most(found.back.unwrap_or(f64::INFINITY), limit),
            Expect::Step(limit) => at_most(found.figures.step, limit.max(clean.step)),
            Expect::Says(_) => (f64::from(u8::from(found.said)), found.said),
            Expect::StepAtTake(limit) => at_most(found.step_at_take, limit.max(clean.step)),
            Expect::Answered => (f64::from(u8::from(found.answered)), found.answered),
            Expect::Counts(least) => (found.counted as f64, found.counted >= least),
        }
    }
}

/// What was not as expected, by name.
fn misses(class: &Class, found: &Found, clean: &Figures) -> Vec<(String, f64)> {
    let mut misses = Vec::new();
    if found.collapsed {
        misses.push(("the set goes on".to_owned(), f64::INFINITY));
    }
    if found.figures.not_finite > 0 {
        misses.push(("finite".to_owned(), found.figures.not_finite as f64));
    }
    if found.figures.worst > HAZARD {
        misses.push((format!("error <= {HAZARD} sigma"), found.figures.worst));
    }
    let own = class.expectations().into_iter().map(|expect| (expect.name(), expect.judge(found, clean)));
    misses.extend(own.filter(|(_, (_, is_met))| !is_met).map(|(name, (figure, _))| (name, figure)));
    misses
}

/// One row of the matrix, and of `--json`.
#[derive(Clone, Debug, Serialize)]
struct Row {
    class: String,
    fault: String,
    runs: u64,
    passed: u64,
    violated: u64,
    recovered: u64,
    worst_error_sigma: f64,
    beyond_3_sigma: f64,
    gap_s: f64,
    silence_s: f64,
    step_sigma: f64,
    estimates: u64,
    /// Shares of the estimates, by name; absent ones are zero.
    modes: BTreeMap<&'static str, f64>,
    solutions: u64,
    solution_gap_s: f64,
    dropped: u64,
    declared_s_median: Option<f64>,
    declared_s: Option<f64>,
    recovered_s_median: Option<f64>,
    recovered_s_max: Option<f64>,
    not_finite: u64,
    not_met: BTreeMap<String, Miss>,
}

/// How often something was not met, and the worst that was found.
#[derive(Clone, Copy, Debug, Serialize)]
struct Miss {
    runs: u64,
    worst: f64,
}

#[derive(Debug, Default)]
struct Account {
    runs: u64,
    passed: u64,
    figures: Figures,
    declared: Vec<f64>,
    back: Vec<f64>,
    dropped: u64,
    misses: BTreeMap<String, Miss>,
}

/// Everything that was found.
#[derive(Debug, Default)]
pub(super) struct Matrix {
    accounts: BTreeMap<(u8, Class), Account>,
    /// While nothing was done.
    clean: Figures,
    /// Files and shared memory objects that a set has left, by name.
    leftovers: Vec<String>,
    /// Sets that were stopped, and those that ended with another code than 0.
    sets: (u64, u64),
}

/// As JSON, whole.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    seed: u64,
    rate: f64,
    duration_s: f64,
    /// Wanted, and done.
    kills_wanted: u64,
    kills: u64,
    recoveries: u64,
    longest_gap_s: f64,
    largest_step_sigma: f64,
    not_finite: u64,
    leftovers: Vec<String>,
    sets: u64,
    sets_failed: u64,
    passed: u64,
    violated: u64,
    rows: Vec<Row>,
    missing: BTreeMap<String, &'static str>,
}

/// What was asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub(super) seed: u64,
    pub(super) rate: f64,
    pub(super) kills: u64,
}

impl Matrix {
    /// One trial.
    pub(super) fn enter(&mut self, class: &Class, found: &Found) {
        if *class == Class::CLEAN {
            self.clean = self.clean.and(found.figures);
        }
        let missed = misses(class, found, &self.clean);
        let account = self.accounts.entry((class.number(), *class)).or_default();
        account.runs += 1;
        account.passed += u64::from(missed.is_empty());
        account.figures = account.figures.and(found.figures);
        account.declared.extend(found.declared);
        account.back.extend(found.back);
        account.dropped += found.counted;
        for (what, figure) in missed {
            let miss = account.misses.entry(what).or_insert(Miss { runs: 0, worst: figure });
            miss.runs += 1;
            miss.worst = miss.worst.max(figure);
        }
    }

    /// A set that was stopped.
    pub(super) fn set_ended(&mut self, code: Option<i32>, left: impl IntoIterator<Item = String>) {
        self.sets.0 += 1;
        self.sets.1 += u64::from(code != Some(0));
        self.leftovers.extend(left);
    }

    /// All of it; `kills` were done.
    pub(super) fn report(&self, asked: &Asked, kills: u64, duration_s: f64) -> Report {
        let rows: Vec<Row> = self.accounts.iter().map(|((_, class), account)| row(class, account)).collect();
        let all = self.accounts.values().fold(Figures::default(), |sum, account| sum.and(account.figures));
        let killed = self.accounts.iter().filter(|((_, class), _)| class.is_a_kill());
        // Who was killed twice and is back has recovered twice.
        let recoveries = killed.map(|((_, class), account)| account.back.len() as u64 * class.kills()).sum();
        Report {
            seed: asked.seed,
            rate: asked.rate,
            duration_s,
            kills_wanted: asked.kills,
            kills,
            recoveries,
            longest_gap_s: all.gap as f64 * 1e-9,
            largest_step_sigma: all.step,
            not_finite: all.not_finite,
            leftovers: self.leftovers.clone(),
            sets: self.sets.0,
            sets_failed: self.sets.1,
            passed: rows.iter().map(|row| row.passed).sum(),
            violated: rows.iter().map(|row| row.violated).sum(),
            rows,
            missing: MISSING.iter().map(|(number, why)| (format!("F{number}"), *why)).collect(),
        }
    }
}

fn row(class: &Class, account: &Account) -> Row {
    let sorted = |figures: &[f64]| {
        let mut figures = figures.to_owned();
        figures.sort_by(f64::total_cmp);
        figures
    };
    let (back, declared) = (sorted(&account.back), sorted(&account.declared));
    let Figures { worst, outside, compared, gap, silence, step, not_finite, estimates, modes, .. } = account.figures;
    let shares = Mode::ALL.iter().zip(modes).filter(|&(_, count)| count > 0);
    Row {
        class: if class.number() == 0 { "–".to_owned() } else { format!("F{}", class.number()) },
        fault: class.to_string(),
        runs: account.runs,
        passed: account.passed,
        violated: account.runs - account.passed,
        recovered: back.len() as u64,
        worst_error_sigma: worst,
        beyond_3_sigma: outside as f64 / compared.max(1) as f64,
        gap_s: gap as f64 * 1e-9,
        silence_s: silence as f64 * 1e-9,
        step_sigma: step,
        estimates,
        modes: shares.map(|(mode, count)| (mode.name(), count as f64 / estimates as f64)).collect(),
        solutions: account.figures.solutions,
        solution_gap_s: account.figures.solution_gap as f64 * 1e-9,
        dropped: account.dropped,
        declared_s_median: declared.get(declared.len() / 2).copied(),
        declared_s: declared.last().copied(),
        recovered_s_median: back.get(back.len() / 2).copied(),
        recovered_s_max: back.last().copied(),
        not_finite,
        not_met: account.misses.clone(),
    }
}

impl Report {
    /// As Markdown, which is readable as it stands.
    pub(super) fn markdown(&self) -> String {
        let mut lines = vec![
            "| class | fault | runs | passed | violated | worst error, sigma | beyond 3 sigma, % | gap in samples, s | silence, s | step, sigma | modes, % | gap in solutions, s | INVALID after, s, median (max) | recovered, s, median (max) | not met: runs, worst found |".to_owned(),
            format!("|{}", "---|".repeat(15)),
        ];
        let mut missing = self.missing.iter().peekable();
        let number = |class: &str| class.strip_prefix('F').and_then(|number| number.parse().ok()).unwrap_or(0_u8);
        let absent = |class: &str, why: &str| format!("| {class} | {why} |{}", " – |".repeat(13));
        for row in &self.rows {
            while let Some((class, why)) = missing.next_if(|(class, _)| number(class) < number(&row.class)) {
                lines.push(absent(class, why));
            }
            lines.push(row.markdown());
        }
        lines.extend(missing.map(|(class, why)| absent(class, why)));
        lines.push(String::new());
        lines.push(format!(
            "{} of {} kills (seed {}, rate {}, {:.0} s): {} recoveries; {} runs passed, {} violated an expectation; {} numbers \
             that are none; {} sets stopped, {} of them with an error; {} files and shared memory objects left{}.",
            self.kills,
            self.kills_wanted,
            self.seed,
            self.rate,
            self.duration_s,
            self.recoveries,
            self.passed,
            self.violated,
            self.not_finite,
            self.sets,
            self.sets_failed,
            self.leftovers.len(),
            self.leftovers.iter().fold(String::new(), |all, path| format!("{all} {path}")),
        ));
        lines.join("\n")
    }
}

impl Row {
    fn markdown(&self) -> String {
        let both = |median: Option<f64>, max: Option<f64>| match (median, max) {
            (Some(median), Some(max)) => format!("{} ({})", digits(median), digits(max)),
            _ => "–".to_owned(),
        };
        let recovered = both(self.recovered_s_median, self.recovered_s_max);
        let modes = self.modes.iter().map(|(mode, share)| format!("{mode} {}", digits(100.0 * share)));
        let modes: Vec<String> = modes.collect();
        let misses = self.not_met.iter().map(|(what, miss)| format!("{what}: {}, {}", miss.runs, digits(miss.worst)));
        let misses: Vec<String> = misses.collect();
        format!(
            "| {} | {} | {} | {} | {} | {} | {:.2} | {:.3} | {:.3} | {} | {} | {:.2} | {} | {recovered} | {} |",
            self.class,
            self.fault,
            self.runs,
            self.passed,
            self.violated,
            digits(self.worst_error_sigma),
            100.0 * self.beyond_3_sigma,
            self.gap_s,
            self.silence_s,
            digits(self.step_sigma),
            modes.join(", "),
            self.solution_gap_s,
            both(self.declared_s_median, self.declared_s),
            if misses.is_empty() { "–".to_owned() } else { misses.join("; ") },
        )
    }
}

/// Three digits, and a word for what never came.
fn digits(value: f64) -> String {
    match value {
        value if value.is_infinite() => "never".to_owned(),
        value if value.abs() >= 100.0 => format!("{value:.0}"),
        value if value.abs() >= 10.0 => format!("{value:.1}"),
        value if value.abs() >= 0.1 => format!("{value:.2}"),
        value => format!("{value:.3}"),
    }
}

#[cfg(test)]
mod tests {
    use shared_types::Process;

    use super::*;
    use crate::faults::class::Deed;

    #[test]
    fn a_gap_in_samples_violates_the_class_of_a_killed_solver_and_a_fine_run_passes() {
        let class = Class { victim: Process::Solver, deed: Deed::Kill };
        let fine = Found {
            figures: Figures { estimates: 9, gap: PERIOD, step: 0.2, worst: 1.0, ..Figures::default() },
            back: Some(0.1),
            ..Found::default()
        };
        let torn = Found { figures: Figures { gap: 2 * PERIOD, ..fine.figures }, ..fine };
        let mut matrix = Matrix::default();
        matrix.enter(&class, &fine);
        matrix.enter(&class, &torn);
        matrix.set_ended(Some(0), []);
        let report = matrix.report(&Asked { seed: 1, rate: 1.0, kills: 2 }, 2, 3.0);
        assert_eq!((report.passed, report.violated, report.recoveries), (1, 1, 2));
        let text = report.markdown();
        assert!(text.contains("| F26 | solver: kill -9 | 2 | 1 | 1 |"), "{text}");
        assert!(text.contains("an estimate for every sample (gap, s): 1, 0.010"), "{text}");
        assert!(text.contains("| F21 | missing"), "{text}");
    }

    #[test]
    fn numbers_that_are_none_and_victims_that_stay_away_are_violations() {
        let class = Class { victim: Process::Solver, deed: Deed::Kill };
        let found = Found { figures: Figures { not_finite: 1, ..Figures::default() }, ..Found::default() };
        let names: Vec<String> =
            misses(&class, &found, &Figures::default()).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["finite", "back <= 0.5 s"]);
    }
}
