//! One keyframe of the window: its linearisation point, the sensors tied to it, and the IMU interval to the next.

use nalgebra::Vector3;
use nav_models::anchor::Anchor;
use nav_models::inertial::{ImuFactor, ImuWeight, NotPositiveDefinite};
use nav_models::preintegration::Preintegration;
use nav_models::state::{ATTITUDE, NavState, POSITION, VELOCITY};
use nav_models::wide;
use nav_models::world::WorldModel;
use shared_types::{Duration, Time};

use crate::chain::Link;
use crate::columns::Columns;
use crate::factor::Factor;
use crate::interval::{ImuHistory, ImuModel};
use crate::joint::Between;
use crate::kernels::{Block, BlockVector, add_gram_transposed, add_product_transposed, add_times_transposed, dot};
use crate::moorings::MooringColumns;
use crate::recovery::Loosening;
use crate::rows::{DIM, Rows};
use crate::systematic::{STAMPS, sensor_of};

/// A state further than this from its linearisation point is linearised anew (§4.3): the ranges' curvature over 0.3 m
/// and the attitude's over 2 mrad stay below a tenth of a millimetre.
const REANCHOR_POSITION: f64 = 0.3;
const REANCHOR_VELOCITY: f64 = 0.3;
const REANCHOR_ATTITUDE: f64 = 2e-3;

/// In a batch, which sweeps everything in any case, a state is linearised anew much earlier: the ranges' curvature over
/// 1 cm and the attitude's over 0.1 mrad are a ten-thousandth of their sigmas.
const BATCH_POSITION: f64 = 1e-2;
const BATCH_VELOCITY: f64 = 1e-2;
const BATCH_ATTITUDE: f64 = 1e-4;

/// Where no residual changed by more, in sigmas, a cost stands to a tenth.
const COUNTED: f64 = 0.1;

/// What has gathered since older states last heard of it need not be carried to them while it is smaller (§4.3).
const CARRY_POSITION: f64 = 1.5e-3;
const CARRY_VELOCITY: f64 = 1.5e-3;
const CARRY_ATTITUDE: f64 = 2.5e-5;

/// One keyframe.
#[derive(Clone, Debug)]
pub struct Node {
    /// Data time.
    pub t: Time,
    /// Where its factors are linearised.
    pub linearised: NavState,
    /// Total step from there.
    pub delta: BlockVector<DIM>,
    /// `linearised ⊞ delta`.
    pub state: NavState,
    /// Measurements tied to it.
    pub factors: Vec<Factor>,
    /// Their rows.
    pub rows: Rows,
    /// Normal equations of the rows at their weights.
    pub sensors: (Block<DIM>, BlockVector<DIM>),
    /// IMU interval to the next keyframe; nothing for the newest.
    pub interval: Interval,
    /// Measurements that are one factor with that interval.
    pub between: Between,
    /// Its place in the chain.
    pub link: Link<DIM>,
    /// The columns of the systematic errors beside it.
    pub columns: Columns,
    /// Those of the positions of moored buoys.
    pub moorings: MooringColumns,
    /// The step that older states were last told of.
    carried: BlockVector<DIM>,
    /// The step at which its weights were last taken; `None` where measurements have come since.
    weighted_at: Option<BlockVector<DIM>>,
    /// The step at which the cost of its measurements was last summed, as zero while there were none; `None` where what is summed has
    /// changed since.
    counted_at: Option<BlockVector<DIM>>,
}

/// The IMU factor between a keyframe and the next, at their linearisation points.
#[derive(Clone, Debug)]
pub struct Interval {
    /// `None` while this is the newest keyframe.
    closed: Option<Closed>,
    /// Part on the keyframe itself.
    pub near: (Block<DIM>, BlockVector<DIM>),
    /// Part on the next.
    pub far: (Block<DIM>, BlockVector<DIM>),
    /// Coupling, transposed: rows of the next keyframe.
    pub coupling_transposed: Block<DIM>,
    /// Half the squared whitened residual at the linearisation points.
    pub cost: f64,
}

#[derive(Clone, Debug)]
struct Closed {
    factor: ImuFactor,
    weight: ImuWeight,
    loosening: Option<Loosening>,
}

impl Default for Interval {
    fn default() -> Self {
        Interval {
            closed: None,
            near: (Block::zeros(), BlockVector::zeros()),
            far: (Block::zeros(), BlockVector::zeros()),
            coupling_transposed: Block::zeros(),
            cost: 0.0,
        }
    }
}

impl Interval {
    /// Takes a closed interval's preintegration, loosened where its samples cannot be trusted.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when its covariance is singular, as that of no time at all.
    pub fn close(
        &mut self,
        mut preintegration: Preintegration,
        loosening: Option<Loosening>,
    ) -> Result<(), NotPositiveDefinite> {
        if let Some(loosening) = &loosening {
            loosening.apply(&mut preintegration);
        }
        let factor = ImuFactor::new(preintegration);
        self.closed = Some(Closed { weight: factor.weight()?, factor, loosening });
        Ok(())
    }

    /// What the samples add up to; `None` while this is the newest keyframe.
    pub fn increment(&self) -> Option<&Preintegration> {
        self.closed.as_ref().map(|closed| &closed.factor.preintegration)
    }

    /// Whether these biases are too far from those of the preintegration for its first-order correction.
    pub fn needs_reintegration(&self, state: &NavState) -> bool {
        self.closed
            .as_ref()
            .is_some_and(|closed| closed.factor.preintegration.needs_reintegration(&state.accel_bias, &state.gyro_bias))
    }

    /// Linearises between two keyframes, with the measurements that are one factor with it. Does nothing on an open
    /// interval.
    pub fn linearise(&mut self, near: &NavState, far: &NavState, between: &Between, world: &WorldModel) {
        let Some(Closed { factor, weight, .. }) = self.closed.as_ref() else { return };
        let (mut at_linearised, mut jacobians) = factor.residual_and_jacobians(near, far, world);
        let mut whitener = &weight.whitener;
        let known = wide!(between.eliminate(near, &factor.preintegration, world));
        if let Some(known) = &known {
            at_linearised -= known.error.fixed_columns::<1>(0);
            jacobians.from -= known.error.fixed_columns::<DIM>(1);
            // Without it the interval keeps its own covariance, which is the larger one.
            whitener = known.whitener.as_ref().unwrap_or(whitener);
        }
        let Interval { near, far, coupling_transposed, cost, closed: _ } = self;
        wide!({
            // Whitened and transposed: (W J)ᵀ = Jᵀ Wᵀ, one column per row of W J.
            let mut near_transposed = Block::zeros();
            let mut far_transposed = Block::zeros();
            add_product_transposed(&mut near_transposed, &jacobians.from.transpose(), whitener, 1.0);
            add_product_transposed(&mut far_transposed, &jacobians.to.transpose(), whitener, 1.0);
            let mut residual = BlockVector::zeros();
            add_times_transposed(&mut residual, whitener, &at_linearised, 1.0);
            *near = (Block::zeros(), BlockVector::zeros());
            *far = (Block::zeros(), BlockVector::zeros());
            *coupling_transposed = Block::zeros();
            add_gram_transposed(&mut near.0, &near_transposed, 1.0);
            add_gram_transposed(&mut far.0, &far_transposed, 1.0);
            add_product_transposed(coupling_transposed, &far_transposed, &near_transposed, 1.0);
            add_times_transposed(&mut near.1, &near_transposed, &residual, -1.0);
            add_times_transposed(&mut far.1, &far_transposed, &residual, -1.0);
            *cost = 0.5 * dot(&residual, &residual);
        });
        if let Some(known) = known {
            self.near.0 += known.information;
            self.near.1 += known.right;
            self.cost += known.cost;
        }
    }
}

impl Node {
    /// A keyframe without measurements at a predicted state.
    pub fn new(t: Time, state: &NavState) -> Node {
        Node {
            t,
            linearised: *state,
            delta: BlockVector::zeros(),
            state: *state,
            factors: Vec::with_capacity(64),
            rows: Rows::default(),
            sensors: (Block::zeros(), BlockVector::zeros()),
            interval: Interval::default(),
            between: Between::default(),
            link: Link::default(),
            columns: Columns::default(),
            moorings: MooringColumns::default(),
            carried: BlockVector::zeros(),
            weighted_at: None,
            counted_at: Some(BlockVector::zeros()),
        }
    }

    /// Makes a used node new; keeps its memory.
    pub fn renew(&mut self, t: Time, state: &NavState) {
        self.t = t;
        self.linearised = *state;
        self.delta = BlockVector::zeros();
        self.state = *state;
        self.factors.clear();
        self.between.clear();
        self.rows.clear();
        self.sensors = (Block::zeros(), BlockVector::zeros());
        self.interval.closed = None;
        self.interval.near = (Block::zeros(), BlockVector::zeros());
        self.interval.far = (Block::zeros(), BlockVector::zeros());
        self.interval.coupling_transposed = Block::zeros();
        self.interval.cost = 0.0;
        self.moorings.clear();
        self.carried = BlockVector::zeros();
        self.weighted_at = None;
        self.counted_at = Some(BlockVector::zeros());
    }

    /// To be said where measurements were added.
    pub fn has_grown(&mut self) {
        self.weighted_at = None;
    }

    /// To be said where measurements were linearised anew.
    fn has_changed(&mut self) {
        self.weighted_at = None;
        self.counted_at = None;
    }

    /// Whether the cost no longer stands.
    pub fn is_uncounted(&self) -> bool {
        !self.counted_at.is_some_and(|at| self.between.is_empty() && self.rows.most_felt(&(self.delta - at)) < COUNTED)
    }

    /// The cost at the present step: half the robust sum of squares.
    pub fn count(&mut self) -> f64 {
        self.counted_at = Some(self.delta);
        wide!(self.rows.cost(&self.delta)) + self.between.cost(&self.delta)
    }

    /// Evaluates every sensor anew at the linearisation point, weights at the present estimate. Returns their cost.
    pub fn linearise_sensors(&mut self, world: &WorldModel) -> f64 {
        self.rows.clear();
        let from = Anchor::new(&self.linearised, world);
        let mut index = 0;
        while index < self.factors.len() {
            index += Factor::push_rows(&self.factors[index..], &from, world, &mut self.rows);
        }
        self.between.linearise(&from, world);
        self.has_changed();
        let mut cost = 0.0;
        self.refresh_weights(0.0, &mut cost);
        self.assemble_sensors();
        cost
    }

    /// Sums the rows at their weights.
    pub fn assemble_sensors(&mut self) {
        self.sensors = (Block::zeros(), BlockVector::zeros());
        let Node { rows, sensors: (information, right), .. } = self;
        wide!(rows.assemble(information, right));
    }

    /// Takes robust weights from the residuals at the present estimate where they differ by more than `tolerance`. Returns
    /// whether any changed, and tells the cost where it had to be summed for that.
    pub fn refresh_weights(&mut self, tolerance: f64, cost: &mut f64) -> bool {
        if let Some(weighted_at) = &self.weighted_at
            && self.between.is_empty()
            && self.rows.most_felt(&(self.delta - weighted_at)) < tolerance
        {
            // A Cauchy weight of scale c changes by at most 0.65 κ/c per sigma of its residual, and by twice that where the mean of a group
            // moves against it: about one for the scales in use. Narrower kernels follow at the next larger step.
            return false;
        }
        self.weighted_at = Some(self.delta);
        self.counted_at = Some(self.delta);
        let Node { rows, between, delta, .. } = self;
        let (has_changed, of_rows) = wide!(rows.refresh_weights(delta, tolerance));
        let has_changed = has_changed | between.refresh_weights(delta, tolerance);
        *cost = of_rows + between.cost(delta);
        has_changed
    }

    /// Integrates anew up to the measurements that are one factor with the interval, where some have come or the
    /// interval's biases have changed. Returns whether there were any.
    pub fn join(&mut self, history: &ImuHistory, imu: &ImuModel) -> bool {
        let Some(closed) = &self.interval.closed else { return false };
        self.between.prepare(self.t, &closed.factor.preintegration, history, imu)
    }

    /// Takes a new total step.
    pub fn take_step(&mut self, delta: BlockVector<DIM>) {
        self.delta = delta;
        self.state = self.linearised.retract(&delta);
    }

    /// Whether older states would feel what has changed here since they were told.
    pub fn is_felt(&self) -> bool {
        let [position, velocity, attitude] = lengths(&(self.delta - self.carried));
        !(position < CARRY_POSITION && velocity < CARRY_VELOCITY && attitude < CARRY_ATTITUDE)
    }

    /// To be said where the present step is carried to older states.
    pub fn mark_carried(&mut self) {
        self.carried = self.delta;
    }

    /// Whether it is too far from its linearisation point, or its biases from those of its interval.
    pub fn is_far(&self) -> bool {
        let [position, velocity, attitude] = lengths(&self.delta);
        position > REANCHOR_POSITION
            || velocity > REANCHOR_VELOCITY
            || attitude > REANCHOR_ATTITUDE
            || self.interval.needs_reintegration(&self.state)
    }

    /// The same for a batch.
    pub fn has_left_its_point(&self) -> bool {
        let [position, velocity, attitude] = lengths(&self.delta);
        // The negation is for a step that is no number.
        !(position < BATCH_POSITION && velocity < BATCH_VELOCITY && attitude < BATCH_ATTITUDE)
            || self.interval.needs_reintegration(&self.state)
    }

    /// Preintegrates anew what the biases have left: the interval to `t_next` and the increments of the measurements.
    /// Samples that are no longer held leave an increment as it was.
    pub fn reintegrate(&mut self, t_next: Option<Time>, history: &ImuHistory, imu: &ImuModel) {
        let (accel_bias, gyro_bias) = (self.state.accel_bias, self.state.gyro_bias);
        if let Some(t_next) = t_next
            && self.interval.needs_reintegration(&self.state)
            && let Some(anew) = history.integrate(self.t, t_next, &accel_bias, &gyro_bias, imu)
        {
            // The covariance of the same samples was positive definite before; if rounding says otherwise, keep that.
            let before = self.interval.closed.clone();
            let loosening = before.as_ref().and_then(|closed| closed.loosening);
            if self.interval.close(anew, loosening).is_err() {
                self.interval.closed = before;
            }
        }
        self.join(history, imu);
        for factor in &mut self.factors {
            if let Some(increment) = &factor.increment
                && increment.needs_reintegration(&accel_bias, &gyro_bias)
                && let Some(anew) = history.integrate(self.t, factor.t, &accel_bias, &gyro_bias, imu)
            {
                factor.increment = Some(anew.increment);
            }
        }
    }

    /// Takes a systematic error of `by` of its unit out of the measurements that have it. Those whose stamps are moved beyond
    /// the samples keep their place. Returns the cost of all.
    pub fn correct(&mut self, error: usize, by: f64, history: &ImuHistory, imu: &ImuModel, world: &WorldModel) -> f64 {
        let (accel_bias, gyro_bias) = (self.linearised.accel_bias, self.linearised.gyro_bias);
        let sensor = sensor_of(error);
        for factor in self.factors.iter_mut().filter(|factor| factor.place() == sensor) {
            if error >= STAMPS {
                factor.model.correct(by);
                continue;
            }
            let t = factor.t - Duration::from_seconds(by);
            if let (Some(piece), Some(point)) =
                (history.integrate(self.t, t, &accel_bias, &gyro_bias, imu), history.at(t))
            {
                factor.move_to(t, piece.increment, &point);
            }
        }
        self.linearise_sensors(world)
    }

    /// ½‖r + J δ‖² of the interval to the next keyframe, from its normal equations.
    #[inline(always)]
    pub fn interval_cost(&self, next: &Node) -> f64 {
        let interval = &self.interval;
        // ½δᵀAδ − gᵀδ as ½δᵀ(Aδ − 2g), and A is symmetric; the coupling is held transposed.
        let (mut near_slope, mut far_slope) = (interval.near.1 * -2.0, interval.far.1 * -2.0);
        add_times_transposed(&mut near_slope, &interval.near.0, &self.delta, 1.0);
        add_times_transposed(&mut far_slope, &interval.far.0, &next.delta, 1.0);
        add_times_transposed(&mut far_slope, &interval.coupling_transposed, &self.delta, 2.0);
        let twice = dot(&near_slope, &self.delta) + dot(&far_slope, &next.delta);
        (interval.cost + 0.5 * twice).max(0.0) + self.between.robust_surplus(&self.delta)
    }

    /// Moves the linearisation point to the present estimate; returns the step that was taken.
    pub fn reanchor(&mut self) -> BlockVector<DIM> {
        let step = self.delta;
        self.linearised = self.state;
        self.delta = BlockVector::zeros();
        self.carried -= step;
        step
    }
}

/// Lengths of the position, velocity and attitude parts.
pub fn lengths(delta: &BlockVector<DIM>) -> [f64; 3] {
    [POSITION, VELOCITY, ATTITUDE].map(|at| Vector3::new(delta[at], delta[at + 1], delta[at + 2]).norm())
}
