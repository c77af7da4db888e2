//! The whole window as one batch: Levenberg-Marquardt to convergence, covariances everywhere.
//!
//! The sliding window spares itself what is not felt; here every link is swept in every pass, every state that has moved
//! by a centimetre is linearised anew, and a step is kept only if the robust cost falls (§4.3 of the method). The chain is
//! the same, so a pass over 2200 keyframes is a sweep of 2200 links.
//!
//! ```text
//! C_n = (L_n L_nᵀ)⁻¹,   C_k = L_k⁻ᵀ (I + Y_k C_{k+1} Y_kᵀ) L_k⁻¹
//! ```

use nav_models::state::NavState;
use nav_models::wide;

use crate::interval::{ImuHistory, ImuModel};
use crate::kernels::Block;
use crate::moorings::StatesByPosition;
use crate::node::{Node, lengths};
use crate::rows::DIM;
use crate::window::Window;

/// A step smaller than this everywhere ends the batch: a hundredth of what any sensor resolves.
const DONE_POSITION: f64 = 1e-4;
const DONE_VELOCITY: f64 = 1e-4;
const DONE_ATTITUDE: f64 = 1e-6;
/// A cost that falls by a smaller share than this has stopped falling: kernels creep for long over nothing.
const DONE_COST: f64 = 1e-7;
/// Damping after a first step that failed, and how it changes with failure and success.
const DAMPING_FIRST: f64 = 1e-6;
const DAMPING_RAISE: f64 = 10.0;
const DAMPING_LOWER: f64 = 0.3;
const DAMPING_MAX: f64 = 1e3;

/// What a batch did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BatchReport {
    /// Sweeps over all states.
    pub passes: u32,
    /// The last step was small enough.
    pub converged: bool,
    /// Half the robust sum of squares, prior included, before and after.
    pub cost: [f64; 2],
}

impl Window {
    /// Solves over all keyframes until nothing moves, in at most `max_passes` sweeps.
    pub fn solve_batch(&mut self, max_passes: u32, history: &ImuHistory, imu: &ImuModel) -> BatchReport {
        let mut report = BatchReport::default();
        let (mut damping, mut swept_with) = (0.0, 0.0);
        let mut cost = self.relinearise(false, history, imu);
        report.cost = [cost; 2];
        while report.passes < max_passes {
            report.passes += 1;
            let kept = self.remember();
            swept_with = damping;
            let stepped = self.step_all(damping);
            let step_is_small = stepped.is_some_and(|largest| {
                largest[0] < DONE_POSITION && largest[1] < DONE_VELOCITY && largest[2] < DONE_ATTITUDE
            });
            let new_cost = if stepped.is_some() { self.relinearise(false, history, imu) } else { f64::INFINITY };
            // The negation also refuses a cost that is no number. At the minimum a cost may rise by its own rounding.
            if !(new_cost <= cost * (1.0 + 1e-12) || step_is_small) {
                self.go_back(kept, history, imu);
                damping = if damping == 0.0 { DAMPING_FIRST } else { damping * DAMPING_RAISE };
                if damping > DAMPING_MAX {
                    break;
                }
                continue;
            }
            damping = if damping > DAMPING_FIRST { damping * DAMPING_LOWER } else { 0.0 };
            let fell_by = cost - new_cost;
            cost = new_cost;
            report.cost[1] = cost;
            if step_is_small || fell_by < DONE_COST * cost {
                report.converged = true;
                break;
            }
        }
        if swept_with > 0.0 || !report.converged {
            // Covariances are those of the undamped matrix at the estimate.
            self.step_all(0.0);
        }
        report
    }

    /// Covariance of every keyframe given all measurements, oldest first; `None` where the information does not determine
    /// the newest.
    pub fn covariances(&mut self) -> Option<Vec<Block<DIM>>> {
        if self.considers_moorings() {
            self.sweep_columns();
        }
        let mut covariances = vec![Block::zeros(); self.nodes().len()];
        let mut next: Option<Block<DIM>> = None;
        let mut by_position = StatesByPosition::default();
        for (node, covariance) in self.nodes().iter().zip(&mut covariances).rev() {
            *covariance = wide!(match &next {
                Some(next) => node.link.covariance_before(next),
                None => node.link.covariance(),
            });
            next = Some(*covariance);
            self.cover_moorings(node, &mut by_position, covariance);
        }
        let is_determined = covariances.last()?.iter().all(|x| x.is_finite());
        is_determined.then_some(covariances)
    }

    /// State and covariance of the oldest keyframe given all measurements; `None` where the last solve found no solution. No step
    /// is left undone here, however small: what a solve need not carry to older states is nothing to the newest, not to these.
    pub fn oldest_given_all(&self) -> Option<(NavState, Block<DIM>)> {
        if !self.is_swept() {
            return None;
        }
        let newest = self.nodes().back()?;
        let (mut covariance, mut delta) = wide!((newest.link.covariance(), newest.link.substitute(None)));
        let mut by_position = StatesByPosition::default();
        let mut covered = covariance;
        self.cover_moorings(newest, &mut by_position, &mut covered);
        for node in self.nodes().iter().rev().skip(1) {
            covariance = wide!(node.link.covariance_before(&covariance));
            delta = wide!(node.link.substitute(Some(&delta)));
            covered = covariance;
            self.cover_moorings(node, &mut by_position, &mut covered);
        }
        let covariance = covered;
        let state = self.nodes().front()?.linearised.retract(&delta);
        (state.is_finite() && covariance.iter().all(|x| x.is_finite())).then_some((state, covariance))
    }

    /// Half the robust sum of squares over all measurements and intervals, as far as the linear model tells, where every step was
    /// carried to every state; the prior is left out.
    pub(crate) fn whole_cost(&self) -> f64 {
        let cost = |index: usize, node: &Node| {
            let inertial = self.nodes().get(index + 1).map_or(0.0, |next| wide!(node.interval_cost(next)));
            wide!(node.rows.cost(&node.delta)) + inertial
        };
        self.nodes().iter().enumerate().map(|(index, node)| cost(index, node)).sum()
    }

    /// Sweeps and substitutes over all links; the largest step by position, velocity and attitude. `None` if the matrix
    /// is singular in spite of the damping.
    fn step_all(&mut self, damping: f64) -> Option<[f64; 3]> {
        if !self.sweep_all(damping) {
            return None;
        }
        let mut largest = [0.0_f64; 3];
        self.substitute_all(|delta| {
            for (largest, length) in largest.iter_mut().zip(lengths(delta)) {
                *largest = largest.max(length);
            }
        });
        largest.iter().all(|x| x.is_finite()).then_some(largest)
    }
}
