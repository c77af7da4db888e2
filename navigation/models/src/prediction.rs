//! The covariance of a state that an increment carries on: the prediction of every estimator.

use nalgebra::SMatrix;

use crate::kernels::{Block, add_product_transposed};
use crate::preintegration::Preintegration;
use crate::state::{ERROR_DIM, NavState};
use crate::transport::transport_jacobians;
use crate::wide;
use crate::world::WorldModel;

/// C⁻ = F C Fᵀ + Q of the state at the end of `increment`, which begins at `from`, with F = [T_j; 0 I] and Q = [L P9 Lᵀ, L P96; ·, walk].
pub fn predict_covariance(
    covariance: &Block<ERROR_DIM>,
    from: &NavState,
    increment: &Preintegration,
    world: &WorldModel,
) -> Block<ERROR_DIM> {
    let jacobians = transport_jacobians(from, increment, world);
    let mut f = Block::<ERROR_DIM>::identity();
    f.fixed_rows_mut::<9>(0).copy_from(&jacobians.state);
    let mut g = Block::<ERROR_DIM>::identity();
    g.fixed_view_mut::<9, 9>(0, 0).copy_from(&jacobians.increment);
    let mut predicted = Block::<ERROR_DIM>::zeros();
    let noise = increment.covariance();
    wide!({
        for (outer, inner) in [(&f, covariance), (&g, &noise)] {
            let mut half = SMatrix::<f64, ERROR_DIM, ERROR_DIM>::zeros();
            // outer · inner, inner being symmetric.
            add_product_transposed(&mut half, outer, inner, 1.0);
            add_product_transposed(&mut predicted, &half, outer, 1.0);
        }
    });
    predicted
}
