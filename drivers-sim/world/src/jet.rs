//! A number and its first three time derivatives: the profiles of a trajectory are differentiated by arithmetic, not by
//! hand.
//!
//! ```text
//! (fg)'' = f''g + 2f'g' + fg''      (sin f)'' = f'' cos f − f'² sin f      and so on to the third order
//! ```

use std::ops::{Add, Mul, Neg};

/// `[f, f', f'', f''']` at one instant, SI units per power of a second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Jet(pub(crate) [f64; 4]);

impl Jet {
    /// A number that does not change.
    pub(crate) fn constant(value: f64) -> Jet {
        Jet([value, 0.0, 0.0, 0.0])
    }

    /// The number itself.
    pub(crate) fn value(&self) -> f64 {
        self.0[0]
    }

    /// Its first derivative.
    pub(crate) fn rate(&self) -> f64 {
        self.0[1]
    }

    /// Sine and cosine of the angle `self`, rad.
    pub(crate) fn sin_cos(self) -> (Jet, Jet) {
        let [angle, d1, d2, d3] = self.0;
        let (s, c) = angle.sin_cos();
        let sine = Jet([s, c * d1, c * d2 - s * d1 * d1, c * (d3 - d1 * d1 * d1) - 3.0 * s * d1 * d2]);
        let cosine = Jet([c, -s * d1, -s * d2 - c * d1 * d1, -s * (d3 - d1 * d1 * d1) - 3.0 * c * d1 * d2]);
        (sine, cosine)
    }

    /// Multiplied by a constant.
    pub(crate) fn scaled(self, factor: f64) -> Jet {
        Jet(self.0.map(|term| term * factor))
    }
}

impl Add for Jet {
    type Output = Jet;
    fn add(self, other: Jet) -> Jet {
        let mut sum = self.0;
        sum.iter_mut().zip(other.0).for_each(|(a, b)| *a += b);
        Jet(sum)
    }
}

impl Neg for Jet {
    type Output = Jet;
    fn neg(self) -> Jet {
        self.scaled(-1.0)
    }
}

impl Mul for Jet {
    type Output = Jet;
    fn mul(self, other: Jet) -> Jet {
        let (f, g) = (self.0, other.0);
        Jet([
            f[0] * g[0],
            f[1] * g[0] + f[0] * g[1],
            f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2],
            f[3] * g[0] + 3.0 * (f[2] * g[1] + f[1] * g[2]) + f[0] * g[3],
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0.3 + 0.7 t − 0.2 t² + 0.05 t³, and its derivatives.
    fn cubic(t: f64) -> Jet {
        Jet([0.3 + t * (0.7 + t * (-0.2 + t * 0.05)), 0.7 + t * (-0.4 + t * 0.15), -0.4 + t * 0.3, 0.3])
    }

    #[test]
    fn each_derivative_is_the_central_difference_of_the_one_before() {
        let step = 1e-5;
        let products: [fn(f64) -> Jet; 3] = [
            |t| cubic(t).sin_cos().0,
            |t| cubic(t).sin_cos().1,
            |t| cubic(t).sin_cos().0 * cubic(2.0 * t + 0.1).scaled(1.5).chain(2.0) + Jet::constant(3.0),
        ];
        for function in products {
            let (before, here, after) = (function(1.1 - step), function(1.1), function(1.1 + step));
            for order in 1..4 {
                let difference = (after.0[order - 1] - before.0[order - 1]) / (2.0 * step);
                assert!((difference - here.0[order]).abs() < 1e-8, "order {order}: {difference} {}", here.0[order]);
            }
        }
    }

    impl Jet {
        /// f(k t + c) from f's derivatives at the inner value.
        fn chain(self, k: f64) -> Jet {
            let [value, d1, d2, d3] = self.0;
            Jet([value, k * d1, k * k * d2, k * k * k * d3])
        }
    }
}
