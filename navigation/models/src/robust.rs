//! Robust weights and chi-square gates (§4.2 of the method).
//!
//! Weights multiply whole blocks: r and J by √w (iteratively reweighted least squares). The IMU factor and the prior are
//! never weighted.

use shared_types::Kernel;

/// 99.9 % quantiles of χ² for 1 to 3 degrees of freedom.
const CHI2_999: [f64; 3] = [10.828, 13.816, 16.266];
/// 95 % quantiles of χ² for 1 to 3 degrees of freedom.
const CHI2_95: [f64; 3] = [3.841, 5.991, 7.815];

/// Largest squared normalised innovation that a gate of 99.9 % lets through. `rows` is 1 to 3.
pub fn gate_threshold(rows: usize) -> f64 {
    CHI2_999[rows - 1]
}

/// 99.9 % quantile of χ² for any number of degrees of freedom: beyond the table after Wilson and Hilferty, which lies at
/// most 1.5 % high there.
pub fn chi2_999(freedom: usize) -> f64 {
    if let Some(&tabled) = freedom.checked_sub(1).and_then(|index| CHI2_999.get(index)) {
        return tabled;
    }
    /// 99.9 % quantile of the normal distribution.
    const Z: f64 = 3.0902;
    let spread = 2.0 / (9.0 * freedom as f64);
    freedom as f64 * (1.0 - spread + Z * spread.sqrt()).powi(3)
}

/// Running share of improbable innovations of one sensor, which narrows an adaptive kernel.
///
/// e ← 0.98 e + 0.02 [s > χ² 95 %]; above 0.12 the sensor is plainly not what its sigma says. Two and a half times the
/// share expected of a healthy sensor, over some fifty readings.
#[derive(Clone, Copy, Debug)]
pub struct ImprobableShare {
    share: f64,
}

impl Default for ImprobableShare {
    fn default() -> Self {
        ImprobableShare { share: 0.05 }
    }
}

impl ImprobableShare {
    const MEMORY: f64 = 0.98;
    const SUSPICIOUS: f64 = 0.12;

    /// Takes in a squared normalised innovation with `rows` degrees of freedom; says whether it is improbable.
    pub fn observe(&mut self, nis: f64, rows: usize) -> bool {
        let exceeds = nis > CHI2_95[rows - 1];
        self.share = Self::MEMORY * self.share + if exceeds { 1.0 - Self::MEMORY } else { 0.0 };
        exceeds
    }

    /// Whether the sensor is not what its sigma says.
    pub fn is_suspicious(&self) -> bool {
        self.share > Self::SUSPICIOUS
    }
}

/// The kernel in force: an adaptive one made definite, narrow while its sensor is to blame.
pub fn settle(kernel: Kernel, is_to_blame: bool) -> Kernel {
    /// Width while it is.
    const NARROW: f64 = 1.0;
    match kernel {
        Kernel::AdaptiveCauchy(_) if is_to_blame => Kernel::Cauchy(NARROW),
        Kernel::AdaptiveCauchy(width) => Kernel::Cauchy(width),
        definite => definite,
    }
}

/// Weight of a block whose squared whitened norm is `s`.
pub fn weight(kernel: Kernel, s: f64) -> f64 {
    match kernel {
        Kernel::None => 1.0,
        Kernel::Huber(k) => {
            if s <= k * k {
                1.0
            } else {
                k / s.sqrt()
            }
        }
        Kernel::Cauchy(c) | Kernel::AdaptiveCauchy(c) => 1.0 / (1.0 + s / (c * c)),
    }
}

/// By how much the information of a block of 2 or 3 `components` exceeds its mean weight times that of its covariance, while
/// its readings are what their sigmas say: the weights of good readings are below one (0.7 on average for a velocity under
/// Cauchy 2.385), but little is lost by them (7 %). With r of `components` standard normal variables and s = rᵀr,
///
/// ```text
/// κ = A² / (B E[w]),   A = E[w + 2 w' s / components],   B = E[w² s] / components
/// ```
///
/// is the ratio of the M-estimator's asymptotic information A²/B to what reweighted least squares believe. Weights and losses
/// bear it, so that the covariance is honest on good readings and no sensor counts for less than it is worth beside others.
/// For Cauchy a rational function of 1/c, within half a percent from c = 1.5 on; a narrower one is for readings that are not
/// what their sigmas say, and gets no such credit. Nor has a reading of one component: a range is what echoes spoil, and the
/// tenth that it would gain (κ = 1.10 at c = 2) is kept for those that are weighted down and not out.
#[inline(always)]
pub fn credit(kernel: Kernel, components: usize) -> f64 {
    /// Width from which on readings are taken at their word.
    const WIDE: f64 = 1.5;
    /// Of 1/c and 1/c² in the denominator, for 2 and 3 components.
    const FITTED: [[f64; 2]; 2] = [[0.92, 1.56], [0.98, 0.72]];
    match kernel {
        Kernel::Cauchy(c) | Kernel::AdaptiveCauchy(c) if c >= WIDE && components > 1 => {
            let [first, second] = FITTED[components.min(3) - 2];
            let v = 1.0 / c;
            1.0 + components as f64 * v * v / (1.0 + v * (first + v * second))
        }
        _ => 1.0,
    }
}

/// Weight of a block with the [`credit`] of its kernel: what its rows bear.
#[inline(always)]
pub fn credited_weight(kernel: Kernel, components: usize, s: f64) -> f64 {
    credit(kernel, components) * weight(kernel, s)
}

/// Contribution of such a block to twice the cost: the function whose derivative is [`credited_weight`].
pub fn loss(kernel: Kernel, components: usize, s: f64) -> f64 {
    credit(kernel, components) * uncredited_loss(kernel, s)
}

/// ρ(s), whose derivative is [`weight`].
fn uncredited_loss(kernel: Kernel, s: f64) -> f64 {
    match kernel {
        Kernel::None => s,
        Kernel::Huber(k) => {
            if s <= k * k {
                s
            } else {
                2.0 * k * s.sqrt() - k * k
            }
        }
        Kernel::Cauchy(c) | Kernel::AdaptiveCauchy(c) => c * c * (s / (c * c)).ln_1p(),
    }
}

/// Kernels whose arguments wait for their logarithm side by side; a run has about as many.
const KERNELS: usize = 4;

/// A sum of [`loss`]es. Those of one Cauchy kernel, κ c² ln(1 + s/c²), share a logarithm: their arguments are multiplied.
#[derive(Clone, Copy, Debug)]
pub struct Losses {
    sum: f64,
    products: [Product; KERNELS],
    kernels: usize,
}

#[derive(Clone, Copy, Debug)]
struct Product {
    /// c².
    square: f64,
    /// κ.
    credit: f64,
    value: f64,
}

impl Product {
    const NONE: Product = Product { square: 1.0, credit: 1.0, value: 1.0 };

    fn loss(&self) -> f64 {
        self.credit * self.square * self.value.ln()
    }
}

impl Default for Losses {
    fn default() -> Self {
        Losses { sum: 0.0, products: [Product::NONE; KERNELS], kernels: 0 }
    }
}

impl Losses {
    /// Beyond this the logarithm is taken, far from what a product could overflow by.
    const PRODUCT_MAX: f64 = 1e100;

    /// Adds the loss of a block whose squared whitened norm is `s`.
    #[inline(always)]
    pub fn add(&mut self, kernel: Kernel, components: usize, s: f64) {
        match kernel {
            Kernel::Cauchy(c) | Kernel::AdaptiveCauchy(c) => {
                let (square, credit) = (c * c, credit(kernel, components));
                let is_same = |other: &Product| square == other.square && credit == other.credit;
                let at = match self.products[..self.kernels].iter().position(is_same) {
                    Some(at) => at,
                    None if self.kernels < KERNELS => {
                        self.kernels += 1;
                        self.kernels - 1
                    }
                    None => {
                        self.sum += self.products[0].loss();
                        0
                    }
                };
                let product = &mut self.products[at];
                if !is_same(product) {
                    *product = Product { square, credit, value: 1.0 };
                }
                // An argument that is no number, or infinite, ends in the sum.
                if product.value >= Self::PRODUCT_MAX || product.value.is_nan() {
                    self.sum += product.loss();
                    product.value = 1.0;
                }
                product.value *= 1.0 + s / square;
            }
            _ => self.sum += loss(kernel, components, s),
        }
    }

    /// What was added.
    pub fn sum(&self) -> f64 {
        self.products[..self.kernels].iter().fold(self.sum, |sum, product| sum + product.loss())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_is_the_derivative_of_the_loss() {
        for kernel in [Kernel::None, Kernel::Huber(1.345), Kernel::Cauchy(2.0)] {
            for s in [0.1, 1.0, 3.0, 50.0] {
                for components in 1..=3 {
                    let at = |s| loss(kernel, components, s);
                    let numeric = (at(s + 1e-5) - at(s - 1e-5)) / 2e-5;
                    assert!((numeric - credited_weight(kernel, components, s)).abs() < 1e-8, "{kernel:?} at {s}");
                }
            }
        }
    }

    /// Over the density of the norm of `components` standard normal variables.
    #[test]
    fn the_credit_makes_the_believed_information_that_of_the_estimator() {
        for components in 2..=3_usize {
            for c in [1.5, 2.0, 2.385, 3.0, 5.0, 10.0] {
                let kernel = Kernel::Cauchy(c);
                let [mut all, mut mean, mut slope, mut square] = [0.0; 4];
                for step in 1..6000 {
                    let r = f64::from(step) * 2e-3;
                    let s = r * r;
                    let density = r.powi(components as i32 - 1) * (-0.5 * s).exp();
                    let w = weight(kernel, s);
                    let by_s = -w * w / (c * c);
                    all += density;
                    mean += density * w;
                    slope += density * (w + 2.0 * by_s * s / components as f64);
                    square += density * w * w * s / components as f64;
                }
                let expected = (slope / all).powi(2) / (square / all) / (mean / all);
                let ours = credit(kernel, components);
                assert!((ours / expected - 1.0).abs() < 5e-3, "{components} of {c}: {ours} {expected}");
            }
        }
        assert_eq!(credit(settle(Kernel::AdaptiveCauchy(2.385), true), 3), 1.0);
        assert_eq!([1, 2, 3].map(|components| credit(Kernel::None, components)), [1.0; 3]);
        assert_eq!(credit(Kernel::Cauchy(2.0), 1), 1.0);
    }

    #[test]
    fn losses_added_together_are_their_sum() {
        let kernels =
            [Kernel::Cauchy(2.0), Kernel::Cauchy(2.0), Kernel::Cauchy(2.385), Kernel::None, Kernel::Huber(1.3)];
        let (mut losses, mut expected) = (Losses::default(), 0.0);
        for k in 0..2000 {
            let (kernel, s) = (kernels[k % 5], 10f64.powi(k as i32 % 9 - 2));
            let components = k / 7 % 3 + 1;
            losses.add(kernel, components, s);
            expected += loss(kernel, components, s);
        }
        assert!((losses.sum() - expected).abs() < 1e-11 * expected);
        losses.add(Kernel::Cauchy(2.0), 1, f64::NAN);
        assert!(losses.sum().is_nan());
    }

    #[test]
    fn the_quantile_for_any_freedom_agrees_with_published_tables() {
        for (freedom, tabled) in [(1, 10.828), (3, 16.266), (4, 18.467), (10, 29.588), (30, 59.703)] {
            let ours = chi2_999(freedom);
            assert!((ours / tabled - 1.0).abs() < 0.015, "{freedom}: {ours} {tabled}");
        }
    }

    #[test]
    fn a_sensor_with_a_tenth_of_outliers_more_than_expected_narrows_its_kernel() {
        let mut share = ImprobableShare::default();
        let kernel = Kernel::AdaptiveCauchy(2.385);
        assert_eq!(settle(kernel, share.is_suspicious()), Kernel::Cauchy(2.385));
        for index in 0..200 {
            share.observe(if index % 4 == 0 { 100.0 } else { 1.0 }, 3);
        }
        assert_eq!(settle(kernel, share.is_suspicious()), Kernel::Cauchy(1.0));
        for _ in 0..200 {
            share.observe(1.0, 3);
        }
        assert_eq!(settle(kernel, share.is_suspicious()), Kernel::Cauchy(2.385));
    }
}
