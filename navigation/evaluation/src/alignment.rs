//! Absolute trajectory error after the best rigid motion (no scale), as `evo_ape tum --align` has it, by running sums.
//!
//! ```text
//! H = Σ (p̂ − mean p̂)(p − mean p)ᵀ = U D Vᵀ
//! min over R, t of Σ |R p̂ + t − p|² = Σ|p̂ − mean p̂|² + Σ|p − mean p|² − 2 (d₁ + d₂ ± d₃)
//! ```
//!
//! with the minus sign where det(U)·det(V) < 0, which keeps R a rotation. Umeyama 1991, eq. (33). The sums grow about running means:
//! squares of kilometres would otherwise swallow centimetres.

use nalgebra::{Matrix3, Vector3};

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Alignment {
    pairs: u64,
    mean_estimate: Vector3<f64>,
    mean_truth: Vector3<f64>,
    squares_estimate: f64,
    squares_truth: f64,
    cross: Matrix3<f64>,
}

impl Alignment {
    pub(crate) fn add(&mut self, estimate: &Vector3<f64>, truth: &Vector3<f64>) {
        self.pairs += 1;
        let share = 1.0 / self.pairs as f64;
        let (from_estimate, from_truth) = (estimate - self.mean_estimate, truth - self.mean_truth);
        self.mean_estimate += from_estimate * share;
        self.mean_truth += from_truth * share;
        let (estimate_now, truth_now) = (estimate - self.mean_estimate, truth - self.mean_truth);
        self.squares_estimate += from_estimate.dot(&estimate_now);
        self.squares_truth += from_truth.dot(&truth_now);
        self.cross += from_estimate * truth_now.transpose();
    }

    /// RMS distance after alignment, m.
    pub(crate) fn rms(&self) -> Option<f64> {
        if self.pairs == 0 {
            return None;
        }
        let svd = self.cross.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let mut kept = svd.singular_values.sum();
        if u.determinant() * v_t.determinant() < 0.0 {
            kept -= 2.0 * svd.singular_values.min();
        }
        let squares = self.squares_estimate + self.squares_truth - 2.0 * kept;
        // Rounding may leave a perfect match slightly below nothing.
        Some((squares.max(0.0) / self.pairs as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    /// A tilted figure of eight, m.
    fn path(index: u32) -> Vector3<f64> {
        let phase = f64::from(index) * 0.01;
        Vector3::new(300.0 * phase.sin(), 120.0 * (2.0 * phase).sin(), -20.0 + 5.0 * (3.0 * phase).cos())
    }

    #[test]
    fn a_turned_and_shifted_path_fits_perfectly() {
        let turn = UnitQuaternion::from_euler_angles(0.1, -0.2, 2.5);
        let mut alignment = Alignment::default();
        for index in 0..1000 {
            alignment.add(&(turn * path(index) + Vector3::new(4000.0, -7000.0, 30.0)), &path(index));
        }
        let rms = alignment.rms().expect("there are pairs");
        assert!(rms < 1e-4, "{rms}");
    }

    #[test]
    fn what_no_motion_can_mend_remains() {
        let mut alignment = Alignment::default();
        for index in 0..1000 {
            let zigzag = if index % 2 == 0 { 0.3 } else { -0.3 };
            alignment.add(&(path(index) + Vector3::new(0.0, 0.0, zigzag)), &path(index));
        }
        let rms = alignment.rms().expect("there are pairs");
        assert!((rms - 0.3).abs() < 1e-4, "{rms}");
    }

    #[test]
    fn a_mirrored_path_is_not_turned_into_its_image() {
        let mut alignment = Alignment::default();
        for index in 0..1000 {
            let mut mirrored = path(index);
            mirrored.y = -mirrored.y;
            alignment.add(&mirrored, &path(index));
        }
        // The figure of eight is its own image up to the height, whose 5 m remain.
        let rms = alignment.rms().expect("there are pairs");
        assert!(rms > 1.0, "{rms}");
    }
}
