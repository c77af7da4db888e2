//! The ranges of one epoch and the offset that they share: raw, differenced, or in between (§3.2 of the method).
//!
//! An epoch's ranges `r = h − z` have the covariance `Σ + σ_d² 11ᵀ`, d ~ N(0, σ_d²) the common offset (clock, turn-around).
//!
//! ```text
//! W = Σ⁻¹ − Σ⁻¹1 1ᵀΣ⁻¹/(σ_d⁻² + 1ᵀΣ⁻¹1)                                 the information matrix
//! d̂ = Σ wᵢrᵢ/(σ_d⁻² + Σwᵢ),   rows √wᵢ(rᵢ − d̂),  and d̂/σ_d for finite σ_d      (wᵢ = 1/Σᵢᵢ)
//! ```
//!
//! σ_d = 0 are raw ranges. σ_d → ∞ is identical to the paper's differences against **any** reference buoy with the
//! covariance that a shared reference gives them (σ²(I + 11ᵀ); the paper's diagonal one loses up to 22 % and may claim more
//! than it has). In this form no reference buoy has to survive, a robust weight acts on one range alone, and a single
//! range degrades gracefully to no information.

use nalgebra::SMatrix;

use crate::state::ERROR_DIM;

/// The common offset of an epoch, eliminated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommonOffset {
    /// σ_d, m: 0, finite or infinite.
    sigma: f64,
    /// 1/(σ_d⁻² + Σwᵢ), m²; 0 for raw ranges: the variance of the offset given the ranges' predictions.
    variance: f64,
}

impl CommonOffset {
    /// For ranges with these weights (1/m²; robust weights multiplied in) and the 1-sigma of the offset (m).
    pub fn new(weights: impl IntoIterator<Item = f64>, sigma: f64) -> CommonOffset {
        let total: f64 = weights.into_iter().sum();
        // Infinite sigma: 1/∞ = 0. Nothing known about the offset and no range: it stays where it is.
        let information = if sigma > 0.0 { 1.0 / (sigma * sigma) + total } else { f64::INFINITY };
        CommonOffset { sigma, variance: if information > 0.0 { 1.0 / information } else { 0.0 } }
    }

    /// 1/(σ_d⁻² + Σwᵢ), m².
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// d̂ of a column: residuals give the offset itself, a column of the Jacobian its derivative.
    pub fn estimate(&self, weighted: impl IntoIterator<Item = (f64, f64)>) -> f64 {
        self.variance * weighted.into_iter().map(|(weight, value)| weight * value).sum::<f64>()
    }

    /// 1/σ_d, the factor of the additional row; `None` where there is no such row (raw ranges or differences).
    pub fn row_weight(&self) -> Option<f64> {
        (self.sigma > 0.0 && self.sigma.is_finite()).then(|| 1.0 / self.sigma)
    }
}

/// One range of an epoch as a row on its keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LblRow {
    /// Predicted minus measured, m.
    pub residual: f64,
    /// With respect to the 15 error coordinates.
    pub jacobian: SMatrix<f64, 1, ERROR_DIM>,
    /// wᵢ: robust weight over variance, 1/m².
    pub weight: f64,
}

/// Whitens the rows of an epoch tied to one keyframe, in place (residual and Jacobian multiplied by the root of the weight,
/// the common offset taken out, weight set to 1), and returns the additional row of the offset where there is one.
///
/// Cost, gradient and normal matrix of what results equal those of the full covariance.
pub fn whiten_epoch(rows: &mut [LblRow], sigma: f64) -> Option<LblRow> {
    let offset = CommonOffset::new(rows.iter().map(|row| row.weight), sigma);
    let residual = offset.estimate(rows.iter().map(|row| (row.weight, row.residual)));
    let mut jacobian = SMatrix::<f64, 1, ERROR_DIM>::zeros();
    for row in rows.iter() {
        jacobian += row.jacobian * (row.weight * offset.variance);
    }
    for row in rows.iter_mut() {
        let root = row.weight.sqrt();
        row.residual = (row.residual - residual) * root;
        row.jacobian = (row.jacobian - jacobian) * root;
        row.weight = 1.0;
    }
    let scale = offset.row_weight()?;
    Some(LblRow { residual: residual * scale, jacobian: jacobian * scale, weight: 1.0 })
}

/// Median of the values (which are reordered); `None` if there is none. The first guess of the offset, before any weight.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => None,
        n if n % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchored::{Anchored, SensorModel};
    use crate::sensors::LblModel;
    use crate::testing::{golden_from, world};
    use approx::assert_relative_eq;
    use nalgebra::{Matrix3, SVector, Vector3};
    use shared_types::Lbl;

    const SIGMAS: [f64; 4] = [0.3, 0.3, 0.4, 0.5];

    /// The epoch of §8.6.
    fn golden_rows() -> Vec<LblRow> {
        let buoys = [[0.0, -500.0, 0.0], [-400.0, 0.0, 0.0], [-200.0, 1000.0, 0.0], [200.0, 500.0, 0.0]];
        let predicted = [207.676756955, 623.920414903, 1378.7060191, 845.38940042];
        let mut rows = Vec::new();
        for (index, range) in [207.6, 625.9, 1377.7, 845.8].into_iter().enumerate() {
            let lbl =
                Lbl { sigma: SIGMAS[index], lever_arm_body: [0.4, -0.15, 0.25], reference_buoy: 1, buoy_sigma: 0.0 };
            let model = LblModel::new(range, buoys[index], 0.0, &lbl);
            assert_relative_eq!(
                model.residual(&golden_from(), &world())[0] + range,
                predicted[index],
                epsilon = 1e-6,
                max_relative = 1e-10
            );
            let row = Anchored::at_keyframe(&model, &golden_from(), &golden_from(), &world());
            rows.push(LblRow { residual: row.residual[0], jacobian: row.jacobian, weight: 1.0 / row.covariance[0] });
        }
        rows
    }

    fn cost(rows: &[LblRow], extra: Option<LblRow>) -> f64 {
        rows.iter().chain(extra.iter()).map(|row| row.residual * row.residual).sum()
    }

    #[test]
    fn golden_numbers_of_the_method_are_met() {
        let mut rows = golden_rows();
        let offset = CommonOffset::new(rows.iter().map(|row| row.weight), f64::INFINITY);
        let estimate = offset.estimate(rows.iter().map(|row| (row.weight, row.residual)));
        assert_relative_eq!(estimate, -0.50804388293, max_relative = 1e-8);
        let mut raw = golden_rows();
        assert_eq!(whiten_epoch(&mut raw, 0.0), None);
        assert_relative_eq!(cost(&raw, None), 50.6070419433, max_relative = 1e-8);
        assert_eq!(whiten_epoch(&mut rows, f64::INFINITY), None);
        assert_relative_eq!(cost(&rows, None), 42.2256825493, max_relative = 1e-8);
        let mut information = Matrix3::zeros();
        for row in &rows {
            let by_position = row.jacobian.fixed_columns::<3>(0);
            information += by_position.transpose() * by_position;
        }
        let golden = [
            (0, 0, 3.16088907327),
            (0, 1, 2.77392176646),
            (0, 2, -0.26406330932),
            (1, 1, 18.007640609),
            (1, 2, -2.2506629617),
            (2, 2, 0.284662358024),
        ];
        for (row, column, expected) in golden {
            assert_relative_eq!(information[(row, column)], expected, max_relative = 1e-9);
        }
    }

    #[test]
    fn any_reference_buoy_gives_the_same_cost_as_the_projection() {
        let rows = golden_rows();
        let mut projected = rows.clone();
        whiten_epoch(&mut projected, f64::INFINITY);
        for reference in 0..4 {
            let others: Vec<usize> = (0..4).filter(|&i| i != reference).collect();
            let differences = Vector3::from_fn(|i, _| rows[others[i]].residual - rows[reference].residual);
            let shared = SIGMAS[reference] * SIGMAS[reference];
            let covariance =
                Matrix3::from_fn(|i, j| shared + if i == j { SIGMAS[others[i]] * SIGMAS[others[i]] } else { 0.0 });
            if reference == 0 {
                assert_relative_eq!(
                    covariance,
                    Matrix3::new(0.18, 0.09, 0.09, 0.09, 0.25, 0.09, 0.09, 0.09, 0.34),
                    epsilon = 1e-15
                );
            }
            let inverse = covariance.try_inverse().expect("positive definite");
            let cost_of_differences = (differences.transpose() * inverse * differences)[0];
            assert_relative_eq!(cost_of_differences, cost(&projected, None), max_relative = 1e-12);
        }
    }

    #[test]
    fn a_finite_offset_sigma_has_the_cost_gradient_and_normal_matrix_of_the_full_covariance() {
        let rows = golden_rows();
        for sigma in [0.01, 0.5, 30.0] {
            let covariance =
                nalgebra::Matrix4::from_fn(|i, j| sigma * sigma + if i == j { 1.0 / rows[i].weight } else { 0.0 });
            let inverse = covariance.cholesky().expect("positive definite").inverse();
            let r = SVector::<f64, 4>::from_fn(|i, _| rows[i].residual);
            let j = SMatrix::<f64, 4, 15>::from_fn(|i, column| rows[i].jacobian[column]);
            let mut whitened = rows.clone();
            let extra = whiten_epoch(&mut whitened, sigma).expect("a finite sigma has a row of its own");
            let (mut normal, mut gradient) = (SMatrix::<f64, 15, 15>::zeros(), SVector::<f64, 15>::zeros());
            for row in whitened.iter().chain([&extra]) {
                normal += row.jacobian.transpose() * row.jacobian;
                gradient += row.jacobian.transpose() * row.residual;
            }
            assert_relative_eq!(cost(&whitened, Some(extra)), (r.transpose() * inverse * r)[0], max_relative = 1e-9);
            assert_relative_eq!(normal, j.transpose() * inverse * j, epsilon = 1e-9);
            assert_relative_eq!(gradient, j.transpose() * inverse * r, epsilon = 1e-8);
        }
    }

    #[test]
    fn a_single_range_with_an_unknown_offset_says_nothing() {
        let mut rows = golden_rows();
        rows.truncate(1);
        assert_eq!(whiten_epoch(&mut rows, f64::INFINITY), None);
        assert!(rows[0].residual.abs() < 1e-12, "{}", rows[0].residual);
        assert!(rows[0].jacobian.norm() < 1e-12, "{}", rows[0].jacobian.norm());
    }

    #[test]
    fn the_median_stands_in_the_middle() {
        assert_eq!(median(&mut []), None);
        assert_eq!(median(&mut [3.0, -1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
    }
}
