//! Measurements between two keyframes as one factor with the samples of that interval (§3.8 of the method).
//!
//! A reading at t_j is reached from keyframe k through the samples up to t_j, and the same samples are in the IMU factor: the
//! errors of both are correlated, ξ_kj being a part of ξ_ke. Stacked, all readings of the interval over r_imu, their covariance is
//!
//! ```text
//! r_j  carries  n_j − Q_j ξ_kj       Cov(r_j, r_j') = Q_j P_kj Φ15_{j→j'}ᵀ Q_j'ᵀ    (+ R_z if j = j')
//! r_imu carries +ξ_ke                Cov(r_imu, r_j) = −Φ15_{j→e} P_kj Q_jᵀ
//! ```
//!
//! It is never formed. Its Cholesky factor, readings first in their order and r_imu last, is a filter on ξ, which is carried as an
//! affine function X (1; δ_k) of the step of keyframe k, and by how much M its covariance has shrunk:
//!
//! ```text
//! k        X = 0,  M = 0
//! j → j'   X ← Φ15 X,  M ← Φ15 M Φ15ᵀ                                   covariance of ξ_kj:  P = P_kj − M
//! j        S = R_z/w + Q P Qᵀ = L Lᵀ,  [r J]~ = L⁻¹([r J] + Q X)         rows on x_k alone
//!          X ← X − P Qᵀ L⁻ᵀ [r J]~,  M ← M + P Qᵀ S⁻¹ Q P
//! e        r_imu − X (1; δ_k) with covariance P_ke − M                    the interval's rows on (x_k, x_{k+1})
//! ```
//!
//! So the factor costs as much as its readings, and the chain stays block-tridiagonal. It equals states inserted at every t_j
//! and eliminated again.
//!
//! **Robust weights** w scale R_z of their reading, and only that: the samples are not less true for a reading that is. They
//! follow from the reading's own squared norm under R_z + Q P_kj Qᵀ, as they do everywhere else.
//!
//! What is not in here, and is tied to keyframe k as ever: readings at a keyframe, which owe nothing to samples; readings outside
//! the interval; ranges off the keyframes that share an offset. Time offsets are not estimated in this form
//! (the columns of `columns.rs` know nothing of the interval): stamps are taken as they are given.

use nalgebra::SMatrix;
use nav_models::anchor::Anchor;
use nav_models::preintegration::{Increment, Preintegration};
use nav_models::row::inverse_root;
use nav_models::state::NavState;
use nav_models::world::WorldModel;
use shared_types::{Kernel, Time};

use crate::factor::{Factor, MeasuredRows};
use crate::interval::{ImuHistory, ImuModel};
use crate::kernels::{Block, BlockVector};
use crate::robust::{Losses, credited_weight};
use crate::rows::DIM;

/// A weight below this leaves its reading out.
const WEIGHT_MIN: f64 = 1e-12;

/// The measurements of one interval, in order of time.
#[derive(Clone, Debug, Default)]
pub struct Between {
    readings: Vec<Reading>,
    /// Some have come since the prefixes were made.
    is_stale: bool,
}

#[derive(Clone, Debug)]
struct Reading {
    factor: Factor,
    /// From the keyframe to it; `None` before [`Between::prepare`].
    prefix: Option<Preintegration>,
    /// Its rows under R_z + Q P_kj Qᵀ, for its weight; `None` while it says nothing.
    rows: Option<MeasuredRows>,
    weight: f64,
}

/// What the measurements of an interval say of its keyframe, and of the error of its increment.
#[derive(Clone, Debug)]
pub struct Known {
    /// Σ JᵀS⁻¹J on the earlier keyframe.
    pub information: Block<DIM>,
    /// −Σ JᵀS⁻¹r.
    pub right: BlockVector<DIM>,
    /// ½ Σ rᵀS⁻¹r.
    pub cost: f64,
    /// X at the end: ξ_ke as seen, and its Jacobian on the earlier keyframe.
    pub error: SMatrix<f64, DIM, { 1 + DIM }>,
    /// L⁻¹ with P_ke − M = LLᵀ; `None` if rounding has made it singular.
    pub whitener: Option<Block<DIM>>,
}

impl Between {
    /// Forgets all; keeps the memory.
    pub fn clear(&mut self) {
        self.readings.clear();
        self.is_stale = false;
    }

    /// Takes in a measurement with its rows at the keyframe's linearisation point, weights set.
    pub fn push(&mut self, factor: &Factor, rows: &MeasuredRows) {
        let slot = self.readings.partition_point(|earlier| earlier.factor.t <= factor.t);
        let weight = rows.as_slice().first().map_or(1.0, |row| row.weight);
        self.readings.insert(slot, Reading { factor: *factor, prefix: None, rows: Some(*rows), weight });
        self.is_stale = true;
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.readings.is_empty()
    }

    /// The measurements.
    pub fn factors(&self) -> impl Iterator<Item = &Factor> {
        self.readings.iter().map(|reading| &reading.factor)
    }

    /// Integrates up to every measurement at the biases of `whole`, if some have come or those have changed. Returns whether.
    /// A stretch whose samples are no longer held keeps what it has.
    pub fn prepare(&mut self, t_keyframe: Time, whole: &Increment, history: &ImuHistory, imu: &ImuModel) -> bool {
        let is_at_other_biases =
            |prefix: &Preintegration| prefix.accel_bias != whole.accel_bias || prefix.gyro_bias != whole.gyro_bias;
        self.is_stale |= self.readings.iter().any(|reading| reading.prefix.as_ref().is_some_and(is_at_other_biases));
        if !core::mem::take(&mut self.is_stale) {
            return false;
        }
        let ends = self.readings.iter_mut().map(|reading| (reading.factor.t, reading));
        let biases = (&whole.accel_bias, &whole.gyro_bias);
        // What the history does not reach keeps its prefix.
        let _ = history.prefixes(t_keyframe, ends, biases, imu, |reading, prefix| {
            reading.factor.increment = Some(prefix.increment);
            reading.prefix = Some(*prefix);
        });
        true
    }

    /// Evaluates every measurement anew, for its weight.
    pub fn linearise(&mut self, from: &Anchor, world: &WorldModel) {
        for reading in &mut self.readings {
            reading.rows = reading.factor.rows(from, world).ok();
        }
    }

    /// Takes robust weights from the residuals after a step δ, where they differ by more than `tolerance`. Returns whether any
    /// did.
    pub fn refresh_weights(&mut self, delta: &BlockVector<DIM>, tolerance: f64) -> bool {
        let mut changed = false;
        for reading in self.readings.iter_mut().filter(|reading| reading.factor.kernel != Kernel::None) {
            let Some(s) = reading.squared_norm(delta) else { continue };
            let new = credited_weight(reading.factor.kernel, reading.factor.components(), s);
            if (new - reading.weight).abs() > tolerance {
                reading.weight = new;
                changed = true;
            }
        }
        changed
    }

    /// Half the robust sum of squares after a step δ of the keyframe before.
    pub fn cost(&self, delta: &BlockVector<DIM>) -> f64 {
        let mut losses = Losses::default();
        for reading in &self.readings {
            if let Some(s) = reading.squared_norm(delta) {
                losses.add(reading.factor.kernel, reading.factor.components(), s);
            }
        }
        0.5 * losses.sum()
    }

    /// How much half the robust sum of squares after a step δ lies above the weighted one, which the interval's normal
    /// equations hold: ½ Σ (ρ(s) − w s).
    pub fn robust_surplus(&self, delta: &BlockVector<DIM>) -> f64 {
        let (mut losses, mut weighted) = (Losses::default(), 0.0);
        for reading in self.readings.iter().filter(|reading| reading.factor.kernel != Kernel::None) {
            if let Some(s) = reading.squared_norm(delta) {
                losses.add(reading.factor.kernel, reading.factor.components(), s);
                weighted += reading.weight * s;
            }
        }
        0.5 * (losses.sum() - weighted)
    }

    /// What they say of keyframe k at `linearised`, and of the error of the increment `whole` from it. `None` if there are none.
    #[inline(always)]
    pub fn eliminate(&self, linearised: &NavState, whole: &Preintegration, world: &WorldModel) -> Option<Known> {
        let mut known = Known {
            information: Block::zeros(),
            right: BlockVector::zeros(),
            cost: 0.0,
            error: SMatrix::zeros(),
            whitener: None,
        };
        if self.readings.is_empty() {
            return None;
        }
        let from = Anchor::new(linearised, world);
        let mut shrunk = Block::<DIM>::zeros();
        let mut last: Option<&Increment> = None;
        for reading in &self.readings {
            let (Some(prefix), Some(_)) = (&reading.prefix, &reading.rows) else { continue };
            if reading.weight < WEIGHT_MIN {
                continue;
            }
            if let Some(last) = last {
                carry(&Increment::error_carry(last, prefix), &mut known.error, &mut shrunk);
            }
            last = Some(&prefix.increment);
            let parts = reading.factor.parts(&from, &prefix.increment, world);
            let seen = (prefix.covariance() - shrunk) * parts.noise_rows.transpose();
            let covariance = parts.covariance / reading.weight + parts.noise_rows * seen;
            let Some(whitening) = inverse_root(&((covariance + covariance.transpose()) * 0.5)) else { continue };
            let white = whitening * (parts.rows + parts.noise_rows * known.error);
            let gain = seen * whitening.transpose();
            known.error -= gain * white;
            shrunk += gain * gain.transpose();
            let (residual, jacobian) = (white.fixed_columns::<1>(0), white.fixed_columns::<DIM>(1));
            known.information += jacobian.transpose() * jacobian;
            known.right -= jacobian.transpose() * residual;
            known.cost += 0.5 * residual.norm_squared();
        }
        carry(&Increment::error_carry(last?, whole), &mut known.error, &mut shrunk);
        known.whitener = inverse_root(&(whole.covariance() - shrunk));
        Some(known)
    }
}

impl Reading {
    /// s of its kernel after a step δ.
    fn squared_norm(&self, delta: &BlockVector<DIM>) -> Option<f64> {
        Some(self.rows.as_ref()?.as_slice().iter().map(|row| row.after(delta).powi(2)).sum())
    }
}

/// X ← Φ15 X, M ← Φ15 M Φ15ᵀ.
#[inline(always)]
fn carry(phi: &Block<DIM>, error: &mut SMatrix<f64, DIM, { 1 + DIM }>, shrunk: &mut Block<DIM>) {
    *error = phi * *error;
    *shrunk = phi * *shrunk * phi.transpose();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::Interval;
    use nalgebra::{DMatrix, UnitQuaternion, Vector3};
    use nav_geometry::Geodetic;
    use nav_models::anchored::Pose;
    use nav_models::anchored::{Anchored, SensorModel};
    use nav_models::inertial::ImuFactor;
    use nav_models::preintegration::ImuPoint;
    use nav_models::sensors::{DvlModel, McpModel, Model, PsModel};
    use nav_models::transport::transport;
    use shared_types::Config;

    fn config() -> Config {
        let mut config = Config::default();
        // Good sensors and a poor instrument: what the samples add to a reading matters.
        config.vehicle.imu.gyro_noise_density = 2.9e-3;
        config.vehicle.imu.accel_noise_density = 1e-1;
        config.vehicle.imu.gyro_bias_random_walk = 1e-4;
        config.vehicle.imu.accel_bias_random_walk = 1e-3;
        config.vehicle.dvl.sigma = 0.01;
        config
    }

    fn imu(config: &Config) -> ImuModel {
        ImuModel { noise: config.vehicle.imu.clone(), gate: config.navigator.imu }
    }

    fn first() -> NavState {
        let mut state = NavState::identity();
        state.position_enu = Vector3::new(120.0, -340.0, -55.0);
        state.velocity_enu = Vector3::new(1.5, -0.7, 0.2);
        state.q_enu_body = UnitQuaternion::from_euler_angles(0.1, -0.05, 0.8);
        state
    }

    /// A turning second at 100 Hz.
    fn history() -> ImuHistory {
        let mut history = ImuHistory::with_capacity(128);
        for step in 0..=100 {
            let s = f64::from(step) * 0.01;
            let point = ImuPoint {
                gyro_body: Vector3::new(0.1 + 0.1 * s, -0.2, 0.3),
                accel_body: Vector3::new(0.5 - s, 0.2, 9.8 + (9.0 * s).sin()),
            };
            assert!(history.push(Time(i64::from(step) * 10_000_000), point));
        }
        history
    }

    fn readings(config: &Config, history: &ImuHistory) -> Vec<(Time, Model)> {
        let vehicle = &config.vehicle;
        let at = |s: f64| Time::from_seconds(s);
        let gyro = |s: f64| history.at(at(s)).expect("a sample").gyro_body;
        let dvl = |s: f64| DvlModel::new([1.4, 0.1, -0.1], gyro(s), &vehicle.dvl, &vehicle.imu, 0.01);
        vec![
            (at(0.213), Model::Dvl(dvl(0.213))),
            (at(0.4), Model::Ps(PsModel::new(54.0, vehicle))),
            (at(0.613), Model::Dvl(dvl(0.613))),
            (at(0.75), Model::Mcp(McpModel::new(0.8, &vehicle.mcp))),
        ]
    }

    fn between(kernel: Kernel, world: &WorldModel, config: &Config) -> (Between, Preintegration) {
        let (history, imu) = (history(), imu(config));
        let zero = Vector3::zeros();
        let whole = history.integrate(Time(0), Time::from_seconds(1.0), &zero, &zero, &imu).expect("samples");
        let mut between = Between::default();
        // The last comes late.
        for (t, model) in readings(config, &history).into_iter().rev() {
            let prefix = history.integrate(Time(0), t, &zero, &zero, &imu).expect("samples");
            let mut factor = Factor::new(t, model, Some(prefix.increment), kernel);
            let piece = nav_models::preintegration::Piece::Forward(&prefix);
            let mut rows = MeasuredRows::default();
            factor.whiten(&Anchor::new(&first(), world), Some(&piece), None, world, &mut rows).expect("regular");
            between.push(&factor, &rows);
        }
        assert!(between.prepare(Time(0), &whole, &history, &imu));
        assert!(!between.prepare(Time(0), &whole, &history, &imu), "nothing has changed");
        (between, whole)
    }

    fn world(config: &Config) -> WorldModel {
        WorldModel::new(Geodetic::from_degrees(36.38, 127.36, 0.0), config)
    }

    fn add<const ROWS: usize>(
        dense: &mut DMatrix<f64>,
        at: usize,
        model: &impl SensorModel<ROWS>,
        state: &NavState,
        world: &WorldModel,
    ) {
        let Anchored { jacobian, covariance, .. } = Anchored::at_keyframe(model, &Pose::from(state), world);
        let information = jacobian.transpose() * covariance.try_inverse().expect("regular") * jacobian;
        let mut block = dense.view_mut((at, at), (DIM, DIM));
        block += information;
    }

    /// States at both keyframes and at every reading; the readings' states eliminated.
    fn inserted(config: &Config, world: &WorldModel) -> DMatrix<f64> {
        let (history, imu) = (history(), imu(config));
        let zero = Vector3::zeros();
        let readings = readings(config, &history);
        let mut times = vec![Time(0)];
        times.extend(readings.iter().map(|(t, _)| *t));
        times.push(Time::from_seconds(1.0));
        let prefixes: Vec<Preintegration> =
            times.iter().map(|&t| history.integrate(Time(0), t, &zero, &zero, &imu).expect("samples")).collect();
        let states: Vec<NavState> = prefixes.iter().map(|prefix| transport(&first(), prefix, world)).collect();
        let last = times.len() - 1;
        // The order: keyframes first.
        let place = |index: usize| {
            DIM * if index == 0 {
                0
            } else if index == last {
                1
            } else {
                1 + index
            }
        };
        let mut dense = DMatrix::<f64>::zeros(DIM * times.len(), DIM * times.len());
        for index in 0..last {
            let piece = if index == 0 {
                prefixes[1]
            } else {
                Preintegration::piece_from_prefixes(&prefixes[index], &prefixes[index + 1])
            };
            let factor = ImuFactor::new(piece);
            let whitener = factor.weight().expect("regular").whitener;
            let jacobians = factor.jacobians(&states[index], &states[index + 1], world);
            let (near, far) = (whitener * jacobians.from, whitener * jacobians.to);
            let (a, b) = (place(index), place(index + 1));
            for (row, column, block) in [
                (a, a, near.transpose() * near),
                (b, b, far.transpose() * far),
                (a, b, near.transpose() * far),
                (b, a, far.transpose() * near),
            ] {
                let mut part = dense.view_mut((row, column), (DIM, DIM));
                part += block;
            }
        }
        for (index, (_, model)) in readings.iter().enumerate() {
            let (at, state) = (place(index + 1), &states[index + 1]);
            match model {
                Model::Dvl(model) => add(&mut dense, at, model, state, world),
                Model::Mcp(model) => add(&mut dense, at, model, state, world),
                Model::Ps(model) => add(&mut dense, at, model, state, world),
                _ => unreachable!("not among the readings"),
            }
        }
        let scale = DMatrix::from_diagonal(&dense.diagonal().map(|x| 1.0 / x.sqrt()));
        let scaled = &scale * &dense * &scale;
        let n = 2 * DIM;
        let inner = scaled.view((n, n), (dense.nrows() - n, dense.nrows() - n)).into_owned();
        let cross = scaled.view((n, 0), (dense.nrows() - n, n)).into_owned();
        let schur = scaled.view((0, 0), (n, n)) - cross.transpose() * inner.cholesky().expect("regular").solve(&cross);
        let back = DMatrix::from_diagonal(&dense.diagonal().rows(0, n).map(f64::sqrt));
        &back * schur * &back
    }

    fn joint(config: &Config, world: &WorldModel, sign: f64) -> DMatrix<f64> {
        let (between, whole) = between(Kernel::None, world, config);
        let far = transport(&first(), &whole, world);
        let mut dense = DMatrix::zeros(2 * DIM, 2 * DIM);
        if sign < 0.0 {
            // The samples once for the readings and once more for the interval.
            let mut apart = Interval::default();
            apart.close(whole, None).expect("regular");
            apart.linearise(&first(), &far, &Between::default(), world);
            let known = between.eliminate(&first(), &whole, world).expect("readings");
            apart.near.0 += known.information;
            put(&mut dense, &apart);
            return dense;
        }
        let mut interval = Interval::default();
        interval.close(whole, None).expect("regular");
        interval.linearise(&first(), &far, &between, world);
        put(&mut dense, &interval);
        dense
    }

    fn put(dense: &mut DMatrix<f64>, interval: &Interval) {
        dense.view_mut((0, 0), (DIM, DIM)).copy_from(&interval.near.0);
        dense.view_mut((DIM, DIM), (DIM, DIM)).copy_from(&interval.far.0);
        dense.view_mut((DIM, 0), (DIM, DIM)).copy_from(&interval.coupling_transposed);
        dense.view_mut((0, DIM), (DIM, DIM)).copy_from(&interval.coupling_transposed.transpose());
    }

    /// Largest difference by the diagonal of the second.
    fn apart(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
        let mut largest = 0.0_f64;
        for row in 0..b.nrows() {
            for column in 0..b.ncols() {
                let scale = (b[(row, row)] * b[(column, column)]).sqrt();
                largest = largest.max((a[(row, column)] - b[(row, column)]).abs() / scale);
            }
        }
        largest
    }

    /// The stacked system under the whole covariance of the method, formed and inverted.
    fn stacked(config: &Config, world: &WorldModel) -> DMatrix<f64> {
        let (between, whole) = between(Kernel::None, world, config);
        let jacobians = ImuFactor::new(whole).jacobians(&first(), &transport(&first(), &whole, world), world);
        let count = between.readings.len();
        let size = DIM + 3 * count;
        let (mut covariance, mut jacobian) = (DMatrix::zeros(size, size), DMatrix::zeros(size, 2 * DIM));
        covariance.view_mut((0, 0), (DIM, DIM)).copy_from(&whole.covariance());
        jacobian.view_mut((0, 0), (DIM, DIM)).copy_from(&jacobians.from);
        jacobian.view_mut((0, DIM), (DIM, DIM)).copy_from(&jacobians.to);
        for (j, reading) in between.readings.iter().enumerate() {
            let prefix = reading.prefix.expect("prepared");
            let parts = reading.factor.parts(&Anchor::new(&first(), world), &prefix, world);
            let at = DIM + 3 * j;
            jacobian.view_mut((at, 0), (3, DIM)).copy_from(&parts.rows.fixed_columns::<DIM>(1));
            let seen = prefix.covariance() * parts.noise_rows.transpose();
            let with_increment = -(Increment::error_carry(&prefix, &whole) * seen);
            covariance.view_mut((0, at), (DIM, 3)).copy_from(&with_increment);
            covariance.view_mut((at, 0), (3, DIM)).copy_from(&with_increment.transpose());
            covariance.view_mut((at, at), (3, 3)).copy_from(&(parts.covariance + parts.noise_rows * seen));
            for (later, other) in between.readings.iter().enumerate().skip(j + 1) {
                let end = other.prefix.expect("prepared");
                let rows = other.factor.parts(&Anchor::new(&first(), world), &end, world).noise_rows;
                let shared = rows * Increment::error_carry(&prefix, &end) * seen;
                covariance.view_mut((DIM + 3 * later, at), (3, 3)).copy_from(&shared);
                covariance.view_mut((at, DIM + 3 * later), (3, 3)).copy_from(&shared.transpose());
            }
        }
        let scale = DMatrix::from_diagonal(&covariance.diagonal().map(|x| 1.0 / x.sqrt()));
        let white = (&scale * covariance * &scale).cholesky().expect("positive definite");
        let jacobian = scale * jacobian;
        jacobian.transpose() * white.solve(&jacobian)
    }

    #[test]
    fn the_filter_equals_the_stacked_system_under_its_whole_covariance() {
        let config = config();
        let world = world(&config);
        let off = apart(&joint(&config, &world, 1.0), &stacked(&config, &world));
        assert!(off < 1e-9, "{off:e}");
    }

    #[test]
    fn the_joint_factor_equals_states_inserted_at_the_readings_and_eliminated() {
        let config = config();
        let world = world(&config);
        let expected = inserted(&config, &world);
        let off = apart(&joint(&config, &world, 1.0), &expected);
        assert!(off < 1e-7, "{off:e}");
        let independent = apart(&joint(&config, &world, -1.0), &expected);
        assert!(independent > 1e-3, "the test could not fail: {independent:e}");
    }

    #[test]
    fn jacobians_of_what_is_known_agree_with_differences() {
        let config = config();
        let world = world(&config);
        let (between, _) = between(Kernel::None, &world, &config);
        for reading in &between.readings {
            let increment = reading.factor.increment.expect("between keyframes");
            let parts = reading.factor.parts(&Anchor::new(&first(), &world), &increment, &world);
            for coordinate in 0..DIM {
                let mut step = BlockVector::<DIM>::zeros();
                step[coordinate] = 1e-4;
                let [above, below] = [step, -step].map(|step| {
                    reading
                        .factor
                        .parts(&Anchor::new(&first().retract(&step), &world), &increment, &world)
                        .rows
                        .column(0)
                        .into_owned()
                });
                let slope = (above - below) / 2e-4;
                let off = (slope - parts.rows.column(1 + coordinate)).amax();
                // The pressure's Jacobian takes up for the frame's, off by 5e-5 here.
                assert!(off < 5e-5, "{:?} by {coordinate}: {off:e}", reading.factor.sensor());
            }
        }
    }

    #[test]
    fn a_reading_that_lost_its_weight_leaves_the_interval_as_it_is_without() {
        let config = config();
        let world = world(&config);
        let (mut between, whole) = between(Kernel::Cauchy(2.0), &world, &config);
        between.readings.iter_mut().for_each(|reading| reading.weight = 1e-11);
        let far = transport(&first(), &whole, &world);
        let [mut with, mut without] = [Interval::default(), Interval::default()];
        with.close(whole, None).expect("regular");
        without.close(whole, None).expect("regular");
        with.linearise(&first(), &far, &between, &world);
        without.linearise(&first(), &far, &Between::default(), &world);
        assert!((with.far.0 - without.far.0).amax() < 1e-6 * without.far.0.amax());
        assert!((with.near.0 - without.near.0).amax() < 1e-6 * without.near.0.amax());
    }
}
