//! The sliding window: a chain of keyframes, solved by work only where something changed.
//!
//! §4.3 of the method. The unknown of a keyframe is its *total* step δ from its own linearisation point, so right sides
//! stay valid when the point does not move. Per keyframe: drop the oldest (its stored factors are the prior of the next),
//! append the new one, sweep from the oldest changed link, substitute back while the change is felt, linearise anew what
//! has moved too far, repeat if anything was.
//!
//! **FEJ**: the keyframe that carries a marginal prior keeps its linearisation point in all its factors, so that directions
//! which no sensor observes gain no information. Before the first marginalisation the oldest is an ordinary state. A prior
//! is carried to a new point only when its keyframe has moved so far (5° of attitude) that its curvature costs more.

mod beside;

use std::collections::VecDeque;

use nav_geometry::so3;
use nav_models::preintegration::Preintegration;
use nav_models::state::{ATTITUDE, NavState};
use nav_models::transport::transport;
use nav_models::wide;
use nav_models::world::WorldModel;
use shared_types::{FgoConfig, Time};

use crate::chain::Marginal;
use crate::columns::ColumnPrior;
use crate::factor::{Factor, MeasuredRows};
use crate::interval::{ImuHistory, ImuModel};
use crate::kernels::{Block, BlockVector, NotPositiveDefinite, cholesky, inverse_from_cholesky, solve_lower};
use crate::moorings::{MooringColumns, StatesByPosition};
use crate::node::{Node, lengths};
use crate::recovery::Loosening;
use crate::rows::{DIM, Row};

/// Weights that differ by less are left alone (§4.3: 0.03 costs three times the work for the same error).
const WEIGHT_TOLERANCE: f64 = 0.1;
/// The same in a batch, which ends at the minimum itself.
const BATCH_WEIGHT_TOLERANCE: f64 = 1e-3;
/// A prior's keyframe that has moved further is re-anchored in spite of FEJ.
const PRIOR_ATTITUDE: f64 = 0.087;
const PRIOR_POSITION: f64 = 10.0;
const PRIOR_VELOCITY: f64 = 1.0;
/// Keyframes for which room is made beforehand; only a batch has more.
const WINDOW_RESERVED: usize = 512;
/// Damping tried in turn when the information does not determine a state.
const DAMPINGS: [f64; 5] = [0.0, 1e-9, 1e-7, 1e-5, 1e-3];

/// What a solve did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SolveReport {
    /// Passes over the chain.
    pub passes: u32,
    /// States linearised.
    pub linearised: u32,
    /// Links swept.
    pub swept: u32,
    /// The last pass moved nothing far.
    pub converged: bool,
    /// The matrix had to be damped, or gave no step at all.
    pub damped: bool,
}

/// The window.
#[derive(Clone, Debug)]
pub struct Window {
    config: FgoConfig,
    world: WorldModel,
    /// Boxed: a keyframe is some 40 kB, and a ring that wraps around would move them all to lie in one piece.
    nodes: VecDeque<Box<Node>>,
    spare: Vec<Box<Node>>,
    prior: Marginal<DIM>,
    column_prior: ColumnPrior,
    mooring_prior: MooringColumns,
    /// 1-sigma of each axis of a moored buoy's position, m.
    mooring_sigma: f64,
    /// Whether the prior holds marginalised states, whose linearisation cannot be repeated.
    prior_is_marginal: bool,
    /// Whether measurements between keyframes are one factor with their interval.
    is_joint: bool,
    /// First link whose blocks changed since the last sweep.
    dirty: usize,
    /// First link that was swept since the columns of the systematic errors were.
    columns_behind: usize,
    /// First keyframe that moved or was measured since its cost was summed.
    uncounted: usize,
    /// Half the robust sum of squares of each keyframe's measurements when last summed. Beside the keyframes: a sum over all
    /// of them would fetch each from far memory.
    costs: VecDeque<f64>,
}

impl Window {
    /// An empty window.
    pub fn new(config: FgoConfig, world: WorldModel) -> Window {
        Window {
            config,
            world,
            nodes: VecDeque::with_capacity((config.window + 2).min(WINDOW_RESERVED)),
            spare: Vec::with_capacity(2),
            prior: Marginal { information: Block::zeros(), right: BlockVector::zeros() },
            column_prior: ColumnPrior::default(),
            mooring_prior: MooringColumns::default(),
            mooring_sigma: 0.0,
            prior_is_marginal: false,
            is_joint: false,
            dirty: 0,
            columns_behind: 0,
            uncounted: 0,
            costs: VecDeque::with_capacity((config.window + 2).min(WINDOW_RESERVED)),
        }
    }

    /// The world that its factors live in.
    pub fn world(&self) -> &WorldModel {
        &self.world
    }

    /// Keyframes, oldest first.
    pub fn nodes(&self) -> &VecDeque<Box<Node>> {
        &self.nodes
    }

    /// Begins anew with one keyframe and its covariance.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`]: the covariance is not one; the window is left as it was.
    pub fn start(&mut self, t: Time, state: &NavState, covariance: &Block<DIM>) -> Result<(), NotPositiveDefinite> {
        let information = inverse_from_cholesky(&cholesky(covariance)?);
        while let Some(node) = self.nodes.pop_front() {
            self.spare.push(node);
        }
        self.costs.clear();
        self.prior = Marginal { information, right: BlockVector::zeros() };
        self.prior_is_marginal = false;
        self.column_prior = ColumnPrior::default();
        self.mooring_prior.clear();
        self.push_node(t, state);
        self.dirty = 0;
        self.uncounted = 0;
        Ok(())
    }

    /// All of it, with an empty one left in its place.
    #[must_use]
    pub fn take(&mut self) -> Window {
        let mut empty = Window { is_joint: self.is_joint, ..Window::new(self.config, self.world) };
        empty.consider_moorings(self.mooring_sigma);
        core::mem::replace(self, empty)
    }

    fn push_node(&mut self, t: Time, state: &NavState) {
        let mut node = match self.spare.pop() {
            Some(mut node) => {
                node.renew(t, state);
                node
            }
            None => Box::new(Node::new(t, state)),
        };
        // Only a batch has more, which may ask for memory, and would ask for much.
        if self.considers_moorings() && self.nodes.len() < WINDOW_RESERVED {
            node.moorings.reserve();
        }
        self.nodes.push_back(node);
        self.costs.push_back(0.0);
    }

    /// Makes measurements between keyframes one factor with their interval, and moves linearisation points as a batch does:
    /// what the joint form gains is smaller than what points far from the estimate cost.
    pub fn join_intervals(&mut self) {
        self.is_joint = true;
    }

    /// Whether every link is factorised as it stands, and the columns with it.
    pub fn is_swept(&self) -> bool {
        self.dirty >= self.nodes.len() && (!self.considers_moorings() || self.columns_behind >= self.nodes.len())
    }

    /// Index of the keyframe at exactly `t`.
    pub fn index_at(&self, t: Time) -> Option<usize> {
        // Nearly always one of the newest two.
        let index = self.nodes.iter().rposition(|node| node.t <= t)?;
        (self.nodes[index].t == t).then_some(index)
    }

    /// Marginalises the oldest keyframe if the window is full.
    pub fn make_room(&mut self) {
        if self.nodes.len() <= self.config.window {
            return;
        }
        let Some(oldest) = self.nodes.pop_front() else { return };
        self.costs.pop_front();
        if let Some(next) = self.nodes.front() {
            let dt = next.t - oldest.t;
            self.column_prior = wide!({
                let own = oldest.rows.assemble_slopes();
                oldest.columns.marginal(&oldest.link, dt, &own, &self.column_prior)
            });
            wide!(self.mooring_prior.take_marginal(&oldest.moorings, &oldest.link, dt));
        }
        let Marginal { information, right } = wide!(oldest.link.marginal());
        self.prior =
            Marginal { information: oldest.interval.far.0 + information, right: oldest.interval.far.1 + right };
        self.prior_is_marginal = true;
        self.dirty = self.dirty.saturating_sub(1);
        self.columns_behind = self.columns_behind.saturating_sub(1);
        self.uncounted = self.uncounted.saturating_sub(1);
        self.spare.push(oldest);
    }

    /// Appends a keyframe at a predicted state behind a closed interval.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`]: the interval's covariance is singular; nothing was appended.
    pub fn append(
        &mut self,
        t: Time,
        state: &NavState,
        interval: Preintegration,
        loosening: Option<Loosening>,
    ) -> Result<(), NotPositiveDefinite> {
        let last = self.nodes.len() - 1;
        self.nodes[last].interval.close(interval, loosening).map_err(|_| NotPositiveDefinite { row: 0 })?;
        self.push_node(t, state);
        self.linearise_interval(last);
        self.uncounted = self.uncounted.min(last);
        Ok(())
    }

    /// Ties a measurement, or the ranges of one epoch that share an offset, to a keyframe. `rows` are those of `factors`
    /// at that keyframe's linearisation point, weights set.
    pub fn tie(&mut self, index: usize, factors: &[Factor], rows: &[Row]) {
        let Some(first) = factors.first() else { return };
        let node = &mut self.nodes[index];
        let before = node.rows.groups();
        node.rows.push(first.place(), first.group(), rows);
        node.factors.extend_from_slice(factors);
        node.has_grown();
        // What was summed of the others still stands.
        self.costs[index] += wide!(node.rows.cost_from(before, &node.delta));
        self.dirty = self.dirty.min(index);
        self.uncounted = self.uncounted.min(index);
    }

    /// Ties a measurement that is one factor with the interval after its keyframe; `false`, and nothing is done, where this
    /// window or this measurement has no such factor. To be followed by [`Window::join`].
    pub fn tie_jointly(&mut self, index: usize, factor: &Factor, rows: &MeasuredRows) -> bool {
        let is_between =
            self.nodes.get(index + 1).is_some_and(|next| self.nodes[index].t < factor.t && factor.t < next.t);
        // The columns beside the chain know nothing of what is in an interval's factor.
        if !self.is_joint || !is_between || factor.shares_offset() || factor.mooring.is_some() {
            return false;
        }
        self.nodes[index].between.push(factor, rows);
        true
    }

    /// Builds the factor of every interval anew into which [`Window::tie_jointly`] has put a measurement.
    pub fn join(&mut self, history: &ImuHistory, imu: &ImuModel) {
        if !self.is_joint {
            return;
        }
        for index in 0..self.nodes.len() {
            if self.nodes[index].join(history, imu) {
                self.linearise_interval(index);
                self.uncounted = self.uncounted.min(index);
            }
        }
    }

    fn linearise_interval(&mut self, index: usize) {
        if index + 1 >= self.nodes.len() {
            return;
        }
        let far = self.nodes[index + 1].linearised;
        let node = &mut self.nodes[index];
        let Node { linearised: near, interval, between, .. } = &mut **node;
        interval.linearise(near, &far, between, &self.world);
        self.dirty = self.dirty.min(index);
    }

    /// Solves until nothing moves far, in at most `max_passes`.
    pub fn solve(&mut self, max_passes: usize, history: &ImuHistory, imu: &ImuModel) -> SolveReport {
        let mut report = SolveReport::default();
        for index in self.dirty..self.nodes.len() {
            self.nodes[index].assemble_sensors();
        }
        let max_passes = max_passes.max(1);
        for pass in 1..=max_passes {
            report.passes += 1;
            let first_changed = self.dirty;
            if !self.sweep(&mut report) {
                report.damped = true;
                return report;
            }
            let oldest_touched = self.substitute(first_changed);
            self.uncounted = self.uncounted.min(oldest_touched);
            // The last pass moves no linearisation point: a link changed but not swept would spoil the prior when its
            // neighbour is marginalised.
            if pass == max_passes {
                report.converged = !(oldest_touched..self.nodes.len()).any(|k| self.may_move(k) && self.is_far(k));
                break;
            }
            if !self.renew_from(oldest_touched, history, imu, &mut report) {
                report.converged = true;
                break;
            }
        }
        report
    }

    /// Factorises from the oldest changed link on; `false` when even damping does not help.
    fn sweep(&mut self, report: &mut SolveReport) -> bool {
        for index in self.dirty..self.nodes.len() {
            self.gather(index);
        }
        for (attempt, &damping) in DAMPINGS.iter().enumerate() {
            if self.factorise(damping, report).is_ok() {
                report.damped |= attempt > 0;
                self.dirty = self.nodes.len();
                return true;
            }
        }
        false
    }

    fn factorise(&mut self, damping: f64, report: &mut SolveReport) -> Result<(), NotPositiveDefinite> {
        self.columns_behind = self.columns_behind.min(self.dirty);
        let nodes = self.nodes.make_contiguous();
        for index in self.dirty..nodes.len() {
            let (before, rest) = nodes.split_at_mut(index);
            wide!(rest[0].link.sweep(before.last().map(|node| &node.link), damping))?;
            report.swept += 1;
        }
        Ok(())
    }

    /// Collects the blocks of one link from its factors.
    fn gather(&mut self, index: usize) {
        let (before, rest) = self.nodes.make_contiguous().split_at_mut(index);
        let (of_past, pull_of_past) = match before.last() {
            Some(before) => (&before.interval.far.0, &before.interval.far.1),
            None => (&self.prior.information, &self.prior.right),
        };
        let Node { link, sensors, interval, .. } = &mut *rest[0];
        // Added up in its place: a block is two kilobytes.
        for (column, sum) in link.diagonal.data.0.iter_mut().enumerate() {
            let at = |block: &Block<DIM>, row: usize| block.data.0[column][row];
            for (row, sum) in sum.iter_mut().enumerate() {
                *sum = at(of_past, row) + at(&sensors.0, row) + at(&interval.near.0, row);
            }
        }
        link.right = pull_of_past + sensors.1 + interval.near.1;
        link.next_transposed.copy_from(&interval.coupling_transposed);
    }

    /// Back substitution, at least down to the first changed link and from there until the change is no longer felt.
    /// Returns the oldest state touched.
    fn substitute(&mut self, first_changed: usize) -> usize {
        let mut next: Option<BlockVector<DIM>> = None;
        for index in (0..self.nodes.len()).rev() {
            let node = &mut self.nodes[index];
            let delta = wide!(node.link.substitute(next.as_ref()));
            node.take_step(delta);
            if index <= first_changed && !node.is_felt() {
                return index;
            }
            node.mark_carried();
            next = Some(delta);
        }
        0
    }

    /// Linearises anew what has moved too far and refreshes weights, from `first` on. Returns whether anything changed.
    fn renew_from(&mut self, first: usize, history: &ImuHistory, imu: &ImuModel, report: &mut SolveReport) -> bool {
        let mut changed = false;
        for index in first..self.nodes.len() {
            if self.may_move(index) && self.is_far(index) {
                self.reanchor(index, history, imu);
                report.linearised += 1;
                changed = true;
            } else {
                let node = &mut self.nodes[index];
                if node.refresh_weights(WEIGHT_TOLERANCE, &mut self.costs[index]) {
                    node.assemble_sensors();
                    self.dirty = self.dirty.min(index);
                    self.reweigh_interval(index);
                    changed = true;
                }
            }
        }
        changed
    }

    fn is_far(&self, index: usize) -> bool {
        let node = &self.nodes[index];
        if self.is_joint { node.has_left_its_point() } else { node.is_far() }
    }

    /// Takes changed weights of measurements into the factor of their interval.
    fn reweigh_interval(&mut self, index: usize) {
        if !self.nodes[index].between.is_empty() {
            self.linearise_interval(index);
        }
    }

    /// Whether this state's linearisation point may follow its estimate.
    fn may_move(&self, index: usize) -> bool {
        if index > 0 || !self.prior_is_marginal || !self.config.fej {
            return true;
        }
        let [position, velocity, attitude] = lengths(&self.nodes[0].delta);
        attitude > PRIOR_ATTITUDE || position > PRIOR_POSITION || velocity > PRIOR_VELOCITY
    }

    fn reanchor(&mut self, index: usize, history: &ImuHistory, imu: &ImuModel) {
        let t_next = self.nodes.get(index + 1).map(|next| next.t);
        self.nodes[index].reintegrate(t_next, history, imu);
        let step = self.nodes[index].reanchor();
        if index == 0 {
            self.carry_prior(&step);
        }
        let world = self.world;
        self.costs[index] = self.nodes[index].linearise_sensors(&world);
        self.linearise_interval(index);
        if index > 0 {
            self.linearise_interval(index - 1);
        }
        self.dirty = self.dirty.min(index);
    }

    /// Expresses the prior at the oldest state's new linearisation point: Λ ← MᵀΛM, η ← Mᵀ(η − Λ d) with
    /// M = diag(I, I, J_r⁻¹(d_θ), I, I).
    fn carry_prior(&mut self, step: &BlockVector<DIM>) {
        let mut carry = Block::<DIM>::identity();
        let turn = step.fixed_rows::<3>(ATTITUDE).into_owned();
        carry.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE).copy_from(&so3::right_jacobian_inverse(&turn));
        let Marginal { information, right } = &self.prior;
        let moved = right - information * step;
        self.prior =
            Marginal { information: carry.transpose() * information * carry, right: carry.transpose() * moved };
        self.column_prior.carry(step, &carry);
        self.mooring_prior.carry(&carry);
    }

    /// Brings everything to the estimate: states that are too far from their linearisation points (all of them if
    /// `is_everything`) are linearised anew, weights follow the residuals. Half the robust sum of squares, prior included.
    pub fn relinearise(&mut self, is_everything: bool, history: &ImuHistory, imu: &ImuModel) -> f64 {
        let mut before_moved = false;
        for index in 0..self.nodes.len() {
            let moved = is_everything || self.nodes[index].has_left_its_point();
            if moved {
                let t_next = self.nodes.get(index + 1).map(|next| next.t);
                let Window { nodes, world, costs, .. } = self;
                nodes[index].reintegrate(t_next, history, imu);
                let step = nodes[index].reanchor();
                costs[index] = nodes[index].linearise_sensors(world);
                if index == 0 {
                    self.carry_prior(&step);
                }
            } else if self.nodes[index].refresh_weights(BATCH_WEIGHT_TOLERANCE, &mut self.costs[index]) {
                self.nodes[index].assemble_sensors();
                self.reweigh_interval(index);
            }
            if index > 0 && (moved || before_moved) {
                self.linearise_interval(index - 1);
            }
            before_moved = moved;
        }
        self.dirty = 0;
        self.uncounted = 0;
        self.whole_cost() + self.prior_cost()
    }

    /// Half the squared norm of the prior at the estimate: ½‖L⁻¹η − Lᵀδ‖², Λ = LLᵀ.
    fn prior_cost(&self) -> f64 {
        let (Some(oldest), Ok(factor)) = (self.nodes.front(), cholesky(&self.prior.information)) else { return 0.0 };
        let mut whitened = self.prior.right;
        solve_lower(&factor, &mut whitened);
        0.5 * (whitened - factor.transpose() * oldest.delta).norm_squared()
    }

    /// Linearisation points and steps of all keyframes, and the prior, to come back to.
    pub fn remember(&self) -> (Vec<(NavState, BlockVector<DIM>)>, Marginal<DIM>) {
        (self.nodes.iter().map(|node| (node.linearised, node.delta)).collect(), self.prior.clone())
    }

    /// Goes back to what was remembered, linearised anew.
    pub fn go_back(
        &mut self,
        (points, prior): (Vec<(NavState, BlockVector<DIM>)>, Marginal<DIM>),
        history: &ImuHistory,
        imu: &ImuModel,
    ) {
        for (node, (point, delta)) in self.nodes.iter_mut().zip(points) {
            node.linearised = point;
            node.delta = delta;
            node.state = point.retract(&delta);
        }
        self.prior = prior;
        self.relinearise(true, history, imu);
    }

    /// Puts the oldest keyframe to `first` with nothing before it but `covariance`, and carries the others from there through
    /// the samples; the next solve is over the whole window.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`]: the covariance is not one; the window is left as it was.
    pub fn begin_at(
        &mut self,
        first: &NavState,
        covariance: &Block<DIM>,
        history: &ImuHistory,
        imu: &ImuModel,
    ) -> Result<(), NotPositiveDefinite> {
        let information = inverse_from_cholesky(&cholesky(covariance)?);
        self.prior = Marginal { information, right: BlockVector::zeros() };
        self.prior_is_marginal = false;
        self.column_prior = ColumnPrior::default();
        self.mooring_prior.clear();
        let mut state = *first;
        for node in &mut self.nodes {
            node.linearised = state;
            node.delta = BlockVector::zeros();
            node.state = state;
            if let Some(increment) = node.interval.increment() {
                state = transport(&state, increment, &self.world);
            }
        }
        self.relinearise(true, history, imu);
        Ok(())
    }

    /// Factorises every link; `false` where the matrix is singular.
    pub fn sweep_all(&mut self, damping: f64) -> bool {
        self.dirty = 0;
        for index in 0..self.nodes.len() {
            self.gather(index);
        }
        let is_regular = self.factorise(damping, &mut SolveReport::default()).is_ok();
        self.dirty = self.nodes.len();
        is_regular
    }

    /// Takes the step of every link, newest first, and shows how far it goes from the last one.
    pub fn substitute_all(&mut self, mut show: impl FnMut(&BlockVector<DIM>)) {
        let mut next: Option<BlockVector<DIM>> = None;
        for node in self.nodes.iter_mut().rev() {
            let delta = wide!(node.link.substitute(next.as_ref()));
            let change = delta - node.delta;
            node.take_step(delta);
            node.mark_carried();
            show(&change);
            next = Some(delta);
        }
    }

    /// Covariance of the newest keyframe, moored buoys covered. `None` before the first solve.
    pub fn newest_covariance(&mut self) -> Option<Block<DIM>> {
        if self.considers_moorings() {
            self.sweep_columns();
        }
        let newest = self.nodes.back()?;
        let mut covariance = wide!(newest.link.covariance());
        self.cover_moorings(newest, &mut StatesByPosition::default(), &mut covariance);
        covariance.iter().all(|x| x.is_finite()).then_some(covariance)
    }

    /// Half the robust sum of squares over all measurements in the window at the present estimate: about half of what they count.
    /// Intervals are left out: a step that was not carried on to older states, small as it is, is large in the sigmas of an interval.
    /// Only what changed visibly since the last call is summed anew.
    pub fn measurement_cost(&mut self) -> f64 {
        for (node, cost) in self.nodes.range_mut(self.uncounted..).zip(self.costs.range_mut(self.uncounted..)) {
            if node.is_uncounted() {
                *cost = node.count();
            }
        }
        self.uncounted = self.nodes.len();
        self.costs.iter().sum()
    }
}
