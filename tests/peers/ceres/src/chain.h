// The block-tridiagonal normal matrix of a chain of keyframes: covariances and marginalisation by Schur complement.
#pragma once

#include <vector>

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include "nav_state.h"

namespace peer {

// A cost function with its kernel, on one keyframe or two neighbours.
struct Term {
  const ceres::CostFunction* cost = nullptr;
  const ceres::LossFunction* loss = nullptr;
};

// What the terms of one keyframe and of the interval behind it say: ½δᵀHδ + gᵀδ.
struct Link {
  Matrix15 diagonal = Matrix15::Zero(), next = Matrix15::Zero();  // H_kk and H_k,k+1
  Vector15 gradient = Vector15::Zero();
  Matrix15 far_diagonal = Matrix15::Zero();  // the interval's part of H_k+1,k+1
  Vector15 far_gradient = Vector15::Zero();
};

// Linearises at the given states (`x_next` null for the newest); kernels as IRLS weights.
Link Linearise(const std::vector<Term>& terms, const ceres::CostFunction* imu, const double* x, const double* x_next);

// Schur complement of the older state: what it and its terms say of the next one.
void Marginalise(const Link& oldest, Matrix15* information, Vector15* eta);

// Covariance of the newest keyframe: the inverse of the last diagonal block after the sweep.
Matrix15 NewestCovariance(const std::vector<Link>& links);
// Of every keyframe: C_k = L_k⁻ᵀ(I + Y_k C_{k+1} Y_kᵀ)L_k⁻¹.
std::vector<Matrix15> Covariances(const std::vector<Link>& links);

}  // namespace peer
