#include "sensors.h"

#include <algorithm>
#include <cmath>

namespace peer {

using so3::Skew;

Seen<1> LblModel::See(const Pose& at, const Vector3d&, const World&, bool jacobian) const {
  const Vector3d d = at.p + at.r * lever - buoy_enu;
  const double rho = d.norm();
  Seen<1> seen;
  seen.residual << rho - range;
  if (jacobian) {
    const Eigen::RowVector3d u = d.transpose() / rho;
    seen.h << u, Eigen::RowVector3d::Zero(), -u * at.r * Skew(lever);
  }
  return seen;
}

Eigen::Matrix<double, 1, 1> LblModel::Covariance(const Pose&, const World&) const {
  return Eigen::Matrix<double, 1, 1>(sigma * sigma);
}

Seen<3> GnssModel::See(const Pose& at, const Vector3d&, const World&, bool jacobian) const {
  Seen<3> seen;
  seen.residual = at.p + at.r * lever - antenna_enu;
  if (jacobian) seen.h << Matrix3d::Identity(), Matrix3d::Zero(), -at.r * Skew(lever);
  return seen;
}

Matrix3d GnssModel::Covariance(const Pose&, const World& world) const {
  const Matrix3d axes = world.frame.LocalAxesAt(antenna_enu);
  return axes * sigma_local.cwiseAbs2().asDiagonal() * axes.transpose();
}

Seen<3> DvlModel::See(const Pose& at, const Vector3d& gyro_bias, const World& world, bool jacobian) const {
  const Matrix3d back = at.r.transpose();
  const Vector3d u = back * at.v, earth = back * world.frame.earth_rate_enu();
  Seen<3> seen;
  seen.residual = r_dvl_body * (u + (gyro_body - gyro_bias - earth).cross(lever)) - velocity_dvl;
  if (jacobian) {
    seen.h << Matrix3d::Zero(), r_dvl_body * back, r_dvl_body * (Skew(u) + Skew(lever) * Skew(earth));
  }
  return seen;
}

Matrix3d DvlModel::Covariance(const Pose&, const World&) const {
  const Matrix3d by_gyro = GyroBias();
  return sigma * sigma * Matrix3d::Identity() + gyro_sigma * gyro_sigma * by_gyro * by_gyro.transpose();
}

namespace {

// Rows east and north of R' = C_locᵀ R_j, and cos² of the pitch.
struct Levelled {
  Eigen::RowVector3d east, north;
  double cos2;
  Levelled(const McpModel& model, const Pose& at)
      : east(model.local_east * at.r),
        north(model.local_north * at.r),
        cos2(east[0] * east[0] + north[0] * north[0]) {}
};

}  // namespace

void McpModel::Place(const Pose& at, const World& world) {
  const Matrix3d axes = world.frame.LocalAxesAt(at.p);
  local_east = axes.col(0).transpose();
  local_north = axes.col(1).transpose();
}

Seen<1> McpModel::See(const Pose& at, const Vector3d&, const World&, bool jacobian) const {
  const Levelled l(*this, at);
  Seen<1> seen;
  seen.residual << std::remainder(std::atan2(l.east[0], l.north[0]) - heading, 2 * M_PI);
  if (jacobian) {
    seen.h.setZero();
    seen.h(kAttitude + 1) = -(l.north[0] * l.east[2] - l.east[0] * l.north[2]) / l.cos2;
    seen.h(kAttitude + 2) = (l.north[0] * l.east[1] - l.east[0] * l.north[1]) / l.cos2;
  }
  return seen;
}

Eigen::Matrix<double, 1, 1> McpModel::Covariance(const Pose& at, const World&) const {
  return Eigen::Matrix<double, 1, 1>(sigma * sigma / std::max(Levelled(*this, at).cos2, 0.04));
}

void PsModel::Place(const Pose& at, const World& world) {
  port_enu = at.p + at.r * lever;
  const auto port = world.frame.SurfaceAt(port_enu);
  up_enu = port.up_enu;
  height = port.height;
}

Seen<1> PsModel::See(const Pose& at, const Vector3d&, const World& world, bool jacobian) const {
  Seen<1> seen;
  seen.residual << world.surface_height - (height + up_enu.dot(at.p + at.r * lever - port_enu)) - depth;
  if (jacobian) {
    const Eigen::RowVector3d down = -up_enu.transpose();
    seen.h << down, Eigen::RowVector3d::Zero(), -down * at.r * Skew(lever);
  }
  return seen;
}

Eigen::Matrix<double, 1, 1> PsModel::Covariance(const Pose&, const World&) const {
  return Eigen::Matrix<double, 1, 1>(sigma * sigma);
}

}  // namespace peer
