//! Keyframes: each report joined with the solution that it belongs to, which comes on another channel.

use std::collections::VecDeque;

use shared_types::{FactorReport, KeyframeReport, RejectReason, Sensor, Solution, SolutionStatus, Time};

use crate::detail::{Factor, KeyframeDetail};

/// Solutions and reports that wait for each other, at most: a look of a run at many times real time.
const WAITING: usize = 64;

/// Joins reports with solutions.
#[derive(Clone, Debug, Default)]
pub(super) struct Keyframes {
    solutions: VecDeque<Solved>,
    /// With the number of looks that it has waited.
    reports: VecDeque<(KeyframeReport, u32)>,
}

/// What a keyframe takes from its solution.
#[derive(Clone, Debug)]
struct Solved {
    id: u64,
    solve_ns: u64,
    status: u32,
    time_offsets: Vec<[f64; 2]>,
}

impl Keyframes {
    /// Takes in a solution.
    pub(super) fn solution(&mut self, solution: &Solution) {
        // The channel repeats its last message to late joiners.
        if self.solutions.back().is_some_and(|last| last.id == solution.id) {
            return;
        }
        if self.solutions.len() == WAITING {
            self.solutions.pop_front();
        }
        let offsets = solution.time_offset.iter().zip(&solution.time_offset_sigma);
        self.solutions.push_back(Solved {
            id: solution.id,
            solve_ns: solution.solve_ns,
            status: solution.status,
            time_offsets: offsets.map(|(&offset, &sigma)| [offset, sigma]).collect(),
        });
    }

    /// Takes in a report.
    pub(super) fn report(&mut self, report: &KeyframeReport) {
        if self.reports.len() == WAITING {
            self.reports.pop_front();
        }
        self.reports.push_back((*report, 0));
    }

    /// The keyframes that are whole, or whose solution did not come within a look.
    pub(super) fn settle(&mut self, whole: &mut Vec<KeyframeDetail>) {
        while let Some((report, looks)) = self.reports.front_mut() {
            let solved = self.solutions.iter().find(|solved| solved.id == report.solution);
            if solved.is_none() && *looks == 0 {
                *looks = 1;
                return;
            }
            whole.push(detail(report, solved));
            self.reports.pop_front();
        }
    }
}

fn detail(report: &KeyframeReport, solved: Option<&Solved>) -> KeyframeDetail {
    let factors = &report.factors[..report.factors.len().min(report.factor_count as usize)];
    KeyframeDetail {
        t: Time(report.t_keyframe).as_seconds(),
        solution: report.solution,
        iterations: report.iterations,
        window: report.keyframes,
        cost: report.cost,
        solve: solved.filter(|solved| solved.solve_ns > 0).map(|solved| solved.solve_ns as f64 * 1e-9),
        status: solved.and_then(|solved| SolutionStatus::from_index(solved.status)),
        time_offsets: solved.map_or_else(Vec::new, |solved| solved.time_offsets.clone()),
        left_out: report.factors_left_out,
        factors: factors.iter().filter_map(factor).collect(),
    }
}

/// `None` for a sensor that is none.
fn factor(report: &FactorReport) -> Option<Factor> {
    let sensor = Sensor::from_index(report.sensor)?;
    let rows = (report.rows as usize).min(report.whitened.len());
    Some(Factor {
        sensor,
        t: Time(report.t_valid).as_seconds(),
        rows: report.rows,
        buoy: (sensor == Sensor::Lbl).then_some(report.buoy),
        refused: refusal(report.refused),
        whitened: report.whitened[..rows].to_vec(),
        nis: report.nis,
        weight: report.weight,
        gate: (report.gate != [0.0; 2]).then_some(report.gate),
    })
}

/// The reason behind a [`FactorReport::refused`].
pub(super) fn refusal(refused: u32) -> Option<&'static str> {
    let index = refused.checked_sub(1)?;
    Some(RejectReason::from_index(index).map_or("unknown", RejectReason::name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{report_at, solution_at};

    #[test]
    fn a_report_waits_one_look_for_its_solution() {
        let mut keyframes = Keyframes::default();
        let mut whole = Vec::new();
        keyframes.report(&report_at(3.0));
        keyframes.settle(&mut whole);
        assert!(whole.is_empty());
        keyframes.solution(&solution_at(3.0));
        keyframes.settle(&mut whole);
        assert_eq!((whole.len(), whole[0].solve), (1, Some(123_456e-9)));
        keyframes.report(&KeyframeReport { solution: 999, ..report_at(4.0) });
        keyframes.settle(&mut whole);
        keyframes.settle(&mut whole);
        assert_eq!((whole.len(), whole[1].solve), (2, None), "its solution never came");
    }

    #[test]
    fn factors_name_their_sensor_their_rows_and_why_they_were_refused() {
        let mut keyframes = Keyframes::default();
        let mut report = report_at(3.0);
        report.factors[0] = FactorReport {
            sensor: Sensor::Lbl as u32,
            rows: 1,
            buoy: 4,
            whitened: [-1.5, 0.0, 0.0],
            nis: 2.25,
            weight: 0.5,
            t_valid: 2_900_000_000,
            refused: 0,
            gate: [-4.0, 5.0],
        };
        report.factors[1] = FactorReport { sensor: 99, ..FactorReport::default() };
        report.factor_count = 6;
        keyframes.solution(&solution_at(3.0));
        keyframes.report(&report);
        let mut whole = Vec::new();
        keyframes.settle(&mut whole);
        let factors = &whole[0].factors;
        assert_eq!(factors.len(), 5, "a sensor that is none is left out");
        assert_eq!((factors[0].sensor, factors[0].buoy, factors[0].t), (Sensor::Lbl, Some(4), 2.9));
        assert_eq!(factors[0].whitened, [-1.5]);
        assert_eq!(factors[4].refused, Some("gated"));
    }
}
