//! Sums over one component of the error.

/// Errors beyond so many sigmas are outside.
const CONTAINMENT: f64 = 3.0;

/// One component, as it adds up. NaN errors (the truth does not report the quantity) are left out.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Axis {
    errors: u64,
    sum_of_squares: f64,
    max: f64,
    sigmas: u64,
    normalised: f64,
    inside: u64,
}

impl Axis {
    /// One error and its 1-sigma; a sigma that is not positive says nothing and is left out.
    pub(crate) fn add(&mut self, error: f64, sigma: f64) {
        if !error.is_finite() {
            return;
        }
        self.errors += 1;
        self.sum_of_squares += error * error;
        self.max = self.max.max(error.abs());
        if sigma.is_finite() && sigma > 0.0 {
            self.sigmas += 1;
            self.normalised += (error / sigma).powi(2);
            self.inside += u64::from(error.abs() <= CONTAINMENT * sigma);
        }
    }

    pub(crate) fn rms(&self) -> Option<f64> {
        mean(self.sum_of_squares, self.errors).map(f64::sqrt)
    }

    pub(crate) fn max(&self) -> Option<f64> {
        (self.errors > 0).then_some(self.max)
    }

    /// Mean of (error/sigma)²; 1 for an honest sigma.
    pub(crate) fn nees(&self) -> Option<f64> {
        mean(self.normalised, self.sigmas)
    }

    /// Share of errors within three sigmas; 0.9973 for an honest Gaussian.
    pub(crate) fn inside(&self) -> Option<f64> {
        mean(self.inside as f64, self.sigmas)
    }
}

fn mean(sum: f64, count: u64) -> Option<f64> {
    (count > 0).then(|| sum / count as f64)
}

/// `f` of three axes, if all have it.
pub(crate) fn of_three(axes: &[Axis], f: impl Fn(&Axis) -> Option<f64>) -> Option<[f64; 3]> {
    Some([f(&axes[0])?, f(&axes[1])?, f(&axes[2])?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rms_max_and_nees_of_two_errors() {
        let mut axis = Axis::default();
        axis.add(3.0, 1.5);
        axis.add(-4.0, 1.0);
        assert_eq!(axis.rms(), Some(12.5_f64.sqrt()));
        assert_eq!(axis.max(), Some(4.0));
        assert_eq!(axis.nees(), Some(10.0));
        assert_eq!(axis.inside(), Some(0.5));
    }

    #[test]
    fn what_is_not_reported_has_no_figure() {
        let mut axis = Axis::default();
        axis.add(f64::NAN, 1.0);
        assert_eq!((axis.rms(), axis.nees()), (None, None));
        axis.add(1.0, f64::NAN);
        axis.add(1.0, 0.0);
        assert_eq!((axis.rms(), axis.nees(), axis.inside()), (Some(1.0), None, None));
    }
}
