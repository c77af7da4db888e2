//! Where a sensor that knows the position has seen the vehicle of late, beside the state.
//!
//! One range that is two sigmas off says nothing; twenty of them that are so towards the same place say that the state is elsewhere,
//! while each passes its gate. The horizontal shift d that fits the innovations of late best, with weights that fade by f per epoch, is
//! held against what their own noise and the state's covariance explain:
//!
//! ```text
//! N ← f N + Σ w JᵀJ    b ← f b − Σ w Jᵀe    d = N⁻¹ b    V = N⁻¹ Σf²ᵏ/Σfᵏ + p I    D² = dᵀ V⁻¹ d
//! ```
//!
//! J and e, in sigmas of the sensor, are a row's Jacobian on the position and its innovation, w a Huber weight; p is the state's variance
//! per axis, as the rows see it. Under a state that is right D² has two degrees of freedom.

use nalgebra::{Matrix2, Vector2};

use crate::innovation::Innovation;
use crate::row::Row;
use crate::state::POSITION;

/// f: a memory of five epochs.
const FADES: f64 = 0.8;
/// D² that chance exceeds in one epoch of four hundred …
const PROBABLE: f64 = 12.0;
/// … and one that it does not in a mission.
const POSSIBLE: f64 = 18.0;
/// The directions of the rows tell a place where the smaller eigenvalue of N is this share of the larger one: of one buoy they do not.
const TELLS_A_PLACE: f64 = 0.05;
/// Stamps that are wrong by so much, s, put a vehicle elsewhere along its way: no reason to believe the state less.
const LATE_AT_MOST: f64 = 0.3;
/// Mean square, in sigmas, of what a shift leaves of the innovations that it explains.
const EXPLAINED: f64 = 2.0;
/// A shift that is smaller is nobody's business, m.
const SMALLEST: f64 = 0.1;
/// An innovation of more sigmas counts for so many: a wild range says less, but a state that is wrong is no reason to hear nothing.
const WILD: f64 = 3.0;

/// The innovations of a sensor of late.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pull {
    information: Matrix2<f64>,
    right: Vector2<f64>,
    /// Σ fᵏ and Σ f²ᵏ.
    epochs: [f64; 2],
    /// Σ J P Jᵀ and Σ |J|².
    variance: f64,
    norms: f64,
    /// Σ w J s, s per s of a late stamp.
    by_lateness: Vector2<f64>,
    /// Σ w e² and Σ w.
    squares: f64,
    weights: f64,
}

impl Pull {
    /// Takes in what the readings of one epoch, or a fix, say together; `Pull`s of their own.
    pub fn take_in(&mut self, epochs: impl IntoIterator<Item = Pull>) {
        self.information *= FADES;
        self.right *= FADES;
        self.variance *= FADES;
        self.norms *= FADES;
        self.by_lateness *= FADES;
        self.squares *= FADES;
        self.weights *= FADES;
        self.epochs = [1.0 + FADES * self.epochs[0], 1.0 + FADES * FADES * self.epochs[1]];
        for epoch in epochs {
            self.information += epoch.information;
            self.right += epoch.right;
            self.variance += epoch.variance;
            self.norms += epoch.norms;
            self.by_lateness += epoch.by_lateness;
            self.squares += epoch.squares;
            self.weights += epoch.weights;
        }
    }

    /// Adds a reading of the same epoch.
    pub fn observe(&mut self, rows: &[Row], innovation: &Innovation) {
        let share = innovation.state_share.max(0.0) / rows.len().max(1) as f64;
        let to_sigmas = (1.0 + share).sqrt();
        for (row, whitened) in rows.iter().zip(innovation.whitened) {
            let weight = WILD / whitened.abs().max(WILD);
            let jacobian = row.jacobian.fixed_rows::<2>(POSITION).into_owned();
            let weighted = jacobian * weight;
            let in_sigmas = whitened * to_sigmas;
            let right = weighted * in_sigmas;
            let norm = weighted.dot(&jacobian);
            if (norm + share + right.norm_squared() + row.slopes[0]).is_finite() {
                self.information += weighted * jacobian.transpose();
                self.right -= right;
                self.variance += weight * share;
                self.norms += norm;
                self.by_lateness += weighted * row.slopes[0];
                self.squares += weight * in_sigmas * in_sigmas;
                self.weights += weight;
            }
        }
    }

    /// Whether it is seen where the state has it, or the directions do not tell.
    pub fn agrees(&self) -> bool {
        self.fit().is_none_or(|(shift, square)| square < PROBABLE || shift.norm() < SMALLEST)
    }

    /// |d| in m, where it explains the innovations and no chance does; nor late stamps, unless these are `on_time`.
    pub fn shift(&self, on_time: bool) -> Option<f64> {
        let (shift, square) = self.fit()?;
        // Both eigenvalues from trace and determinant.
        let half = self.information.trace() / 2.0;
        let apart = (half * half - self.information.determinant()).max(0.0).sqrt();
        let tells_a_place = half - apart > TELLS_A_PLACE * (half + apart);
        let is_explained = self.squares - shift.dot(&self.right) <= EXPLAINED * self.weights;
        let square = if on_time { square } else { self.square_beside_lateness()? };
        let is_far = square > POSSIBLE && shift.norm() >= SMALLEST;
        (is_far && tells_a_place && is_explained).then(|| shift.norm())
    }

    /// The least D² that stamps within [`LATE_AT_MOST`] leave.
    fn square_beside_lateness(&self) -> Option<f64> {
        let noise = self.information.try_inverse()?;
        let weight = self.variance_of_shift(&noise).try_inverse()?;
        let (shift, per_second) = (noise * self.right, noise * self.by_lateness);
        let whole = per_second.dot(&(weight * per_second));
        let best = if whole > 0.0 { -per_second.dot(&(weight * shift)) / whole } else { 0.0 };
        let left = shift + per_second * best.clamp(-LATE_AT_MOST, LATE_AT_MOST);
        Some(left.dot(&(weight * left)))
    }

    /// V.
    fn variance_of_shift(&self, noise: &Matrix2<f64>) -> Matrix2<f64> {
        noise * (self.epochs[1] / self.epochs[0]) + Matrix2::identity() * (self.variance / self.norms)
    }

    /// d and D².
    fn fit(&self) -> Option<(Vector2<f64>, f64)> {
        let noise = self.information.try_inverse()?;
        let shift = noise * self.right;
        Some((shift, shift.dot(&(self.variance_of_shift(&noise).try_inverse()? * shift))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{Block, BlockVector};
    use crate::state::ERROR_DIM;

    const SIGMA: f64 = 0.3;

    /// Epochs of four ranges all round the vehicle, which is `off` of the state; `noise` of one range in m.
    fn heard(epochs: usize, off: Vector2<f64>, state_sigma: f64, noise: impl FnMut() -> f64) -> Pull {
        heard_under_way(epochs, off, Vector2::zeros(), state_sigma, noise)
    }

    /// The same of a vehicle under way, m/s, whose stamps may be late.
    fn heard_under_way(
        epochs: usize,
        off: Vector2<f64>,
        velocity: Vector2<f64>,
        state_sigma: f64,
        mut noise: impl FnMut() -> f64,
    ) -> Pull {
        let covariance = Block::<ERROR_DIM>::identity() * (state_sigma * state_sigma);
        let mut pull = Pull::default();
        for _ in 0..epochs {
            let mut epoch = Pull::default();
            for bearing in [0.3_f64, 1.9, 3.6, 5.1] {
                let towards = Vector2::new(bearing.sin(), bearing.cos());
                let mut jacobian = BlockVector::<ERROR_DIM>::zeros();
                jacobian.fixed_rows_mut::<2>(POSITION).copy_from(&(towards / SIGMA));
                let residual = (noise() - towards.dot(&off)) / SIGMA;
                let slopes = [-towards.dot(&velocity) / SIGMA, 0.0];
                let row = Row { jacobian, residual, inverse_sigma: 1.0 / SIGMA, weight: 1.0, slopes, mooring: None };
                let innovation = Innovation::of(&[row], &BlockVector::zeros(), &covariance);
                epoch.observe(&[row], &innovation);
            }
            pull.take_in([epoch]);
        }
        pull
    }

    #[test]
    fn ranges_that_each_pass_tell_together_where_the_vehicle_is() {
        let off = Vector2::new(0.4, -0.3);
        assert!(heard(1, off, 0.05, || 0.0).agrees(), "of one epoch it may be chance");
        assert!(!heard(10, off, 0.05, || 0.0).agrees(), "of ten it is not");
        let (shift, _) = heard(10, off, 0.05, || 0.0).fit().expect("all round");
        assert!((shift - off).norm() < 1e-9, "{shift}");
        assert_eq!(heard(10, off, 0.05, || 0.0).shift(false), Some(shift.norm()));
        assert_eq!(heard(1, off, 0.05, || 0.0).shift(false), None);
        assert!(heard(10, off, 0.5, || 0.0).agrees(), "the state does not claim to be elsewhere");
        assert!(heard(10, off * 0.1, 0.01, || 0.0).agrees(), "that is too little");
        assert!(!heard(2, off * 10.0, 0.05, || 0.0).agrees(), "wild as each range is");
    }

    #[test]
    fn what_late_stamps_would_explain_is_no_shift_unless_these_are_on_time() {
        let velocity = Vector2::new(1.5, 2.0);
        let across = Vector2::new(-velocity.y, velocity.x);
        let told = |off: Vector2<f64>, on_time: bool| {
            heard_under_way(10, off, velocity, 0.05, || 0.0).shift(on_time).is_some()
        };
        assert!(!told(0.25 * velocity, false) && !told(-0.25 * velocity, false));
        assert!(told(0.25 * velocity, true));
        assert!(told(0.25 * across, false), "beside the way");
        assert!(told(0.6 * velocity, false), "no stamp is so late");
    }

    #[test]
    fn a_shift_that_leaves_the_innovations_unexplained_is_none() {
        let mut sign = -1.0;
        let mut scattered = || {
            sign = -sign;
            0.8 * sign
        };
        let off = Vector2::new(0.4, -0.3);
        assert!(heard(10, off, 0.05, || 0.0).shift(false).is_some());
        assert!(heard(10, off, 0.05, &mut scattered).shift(false).is_none());
    }

    #[test]
    fn noise_is_no_shift() {
        let mut seed = 1_u64;
        let mut uniform = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut noise = || SIGMA * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0);
        let heard: Vec<Pull> = (0..2000).map(|_| heard(10, Vector2::zeros(), 0.0, &mut noise)).collect();
        let disagree = heard.iter().filter(|pull| !pull.agrees()).count();
        assert!(disagree < 20, "{disagree}: five are expected");
        let impossible = heard.iter().filter(|pull| pull.shift(false).is_some()).count();
        assert!(impossible < 4, "{impossible}: one in four such runs is expected");
    }

    #[test]
    fn one_direction_tells_no_place() {
        let mut pull = Pull::default();
        let mut jacobian = BlockVector::<ERROR_DIM>::zeros();
        jacobian[POSITION] = 1.0 / SIGMA;
        let row = Row {
            jacobian,
            residual: 9.0,
            inverse_sigma: 1.0 / SIGMA,
            weight: 1.0,
            slopes: Default::default(),
            mooring: None,
        };
        let innovation = Innovation::of(&[row], &BlockVector::zeros(), &Block::<ERROR_DIM>::zeros());
        pull.observe(&[row], &innovation);
        assert!(pull.fit().is_none() && pull.agrees());
    }
}
