#include "chain.h"

#include <array>
#include <cmath>

namespace peer {
namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, 15, Eigen::RowMajor>;

struct Swept {
  Eigen::LLT<Matrix15> cholesky;
  Matrix15 y;  // L⁻¹ H_k,k+1
};

std::vector<Swept> Sweep(const std::vector<Link>& links) {
  std::vector<Swept> swept(links.size());
  Matrix15 carried = Matrix15::Zero();
  for (std::size_t k = 0; k < links.size(); ++k) {
    swept[k].cholesky.compute(links[k].diagonal + carried);
    swept[k].y = swept[k].cholesky.matrixL().solve(links[k].next);
    carried = links[k].far_diagonal - swept[k].y.transpose() * swept[k].y;
  }
  return swept;
}

}  // namespace

Link Linearise(const std::vector<Term>& terms, const ceres::CostFunction* imu, const double* x, const double* x_next) {
  Link link;
  int count = 0;
  for (const Term& term : terms) count += term.cost->num_residuals();
  Rows rows(count, 15);
  Eigen::VectorXd residuals(count);
  std::array<double, 15 * kAmbient> near, far;
  int at = 0;
  for (const Term& term : terms) {
    const int n = term.cost->num_residuals();
    double* jacobians[1] = {near.data()};
    term.cost->Evaluate(&x, residuals.data() + at, jacobians);
    double root = 1;
    if (term.loss) {
      double rho[3];
      term.loss->Evaluate(residuals.segment(at, n).squaredNorm(), rho);
      root = std::sqrt(rho[1]);
    }
    using Ambient = Eigen::Matrix<double, Eigen::Dynamic, kAmbient, Eigen::RowMajor>;
    rows.middleRows(at, n) = root * Eigen::Map<const Ambient>(near.data(), n, kAmbient).leftCols<15>();
    residuals.segment(at, n) *= root;
    at += n;
  }
  link.diagonal.noalias() = rows.transpose() * rows;
  link.gradient.noalias() = rows.transpose() * residuals;
  if (imu && x_next) {
    const double* states[2] = {x, x_next};
    double* jacobians[2] = {near.data(), far.data()};
    Vector15 r;
    imu->Evaluate(states, r.data(), jacobians);
    using Ambient = Eigen::Matrix<double, 15, kAmbient, Eigen::RowMajor>;
    const RowMatrix15 a = Eigen::Map<const Ambient>(near.data()).leftCols<15>();
    const RowMatrix15 b = Eigen::Map<const Ambient>(far.data()).leftCols<15>();
    link.diagonal.noalias() += a.transpose() * a;
    link.gradient.noalias() += a.transpose() * r;
    link.next.noalias() = a.transpose() * b;
    link.far_diagonal.noalias() = b.transpose() * b;
    link.far_gradient.noalias() = b.transpose() * r;
  }
  return link;
}

void Marginalise(const Link& oldest, Matrix15* information, Vector15* eta) {
  const Eigen::LLT<Matrix15> cholesky(oldest.diagonal);
  const Matrix15 y = cholesky.matrixL().solve(oldest.next);
  const Vector15 g = cholesky.matrixL().solve(oldest.gradient);
  *information = oldest.far_diagonal - y.transpose() * y;
  *eta = oldest.far_gradient - y.transpose() * g;
}

Matrix15 NewestCovariance(const std::vector<Link>& links) {
  return Sweep(links).back().cholesky.solve(Matrix15::Identity());
}

std::vector<Matrix15> Covariances(const std::vector<Link>& links) {
  const auto swept = Sweep(links);
  std::vector<Matrix15> covariances(links.size());
  covariances.back() = swept.back().cholesky.solve(Matrix15::Identity());
  for (std::size_t k = links.size() - 1; k-- > 0;) {
    const Matrix15 inner = Matrix15::Identity() + swept[k].y * covariances[k + 1] * swept[k].y.transpose();
    const Matrix15 half = swept[k].cholesky.matrixU().solve(inner);
    covariances[k] = swept[k].cholesky.matrixU().solve(half.transpose());
  }
  return covariances;
}

}  // namespace peer
