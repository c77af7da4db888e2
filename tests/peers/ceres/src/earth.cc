#include "earth.h"

#include <cmath>

namespace peer {
namespace {

constexpr double kA = 6378137.0;
constexpr double kF = 1 / 298.257223563;
constexpr double kE2 = kF * (2 - kF);
constexpr double kB = kA * (1 - kF);
constexpr double kSecondE2 = kE2 / (1 - kE2);
constexpr double kEarthRate = 7.292115e-5;
constexpr double kEquatorialGravity = 9.7803253359;
constexpr double kPolarGravity = 9.8321849378;
constexpr double kSomigliana = (1 - kF) * kPolarGravity / kEquatorialGravity - 1;
constexpr double kCentrifugalRatio = 0.00344978650684;

struct Normal {
  double sin_lat, cos_lat, sin_lon, cos_lon, height;
};

// Bowring's step, twice, in sines and cosines alone.
Normal NormalAt(const Vector3d& x) {
  const double p = std::hypot(x.x(), x.y());
  double sb = x.z() * kA, cb = p * kB;
  double sin_lat = 0, cos_lat = 1;
  for (int i = 0; i < 2; ++i) {
    const double n = std::sqrt(sb * sb + cb * cb);
    sb /= n;
    cb /= n;
    const double sl = x.z() + kSecondE2 * kB * sb * sb * sb, cl = p - kE2 * kA * cb * cb * cb;
    const double m = std::sqrt(sl * sl + cl * cl);
    sin_lat = sl / m;
    cos_lat = cl / m;
    sb = (1 - kF) * sin_lat;
    cb = cos_lat;
  }
  const double height = p * cos_lat + x.z() * sin_lat - kA * std::sqrt(1 - kE2 * sin_lat * sin_lat);
  return {sin_lat, cos_lat, p > 0 ? x.y() / p : 0, p > 0 ? x.x() / p : 1, height};
}

Matrix3d EnuFromEcef(double sp, double cp, double sl, double cl) {
  Matrix3d c;
  c << -sl, cl, 0, -sp * cl, -sp * sl, cp, cp * cl, cp * sl, sp;
  return c;
}

}  // namespace

Geodetic Geodetic::FromDegrees(double lat_deg, double lon_deg, double height) {
  return {lat_deg * M_PI / 180, lon_deg * M_PI / 180, height};
}

Vector3d Geodetic::ToEcef() const {
  const double sp = std::sin(latitude), cp = std::cos(latitude);
  const double n = kA / std::sqrt(1 - kE2 * sp * sp);
  return {(n + height) * cp * std::cos(longitude), (n + height) * cp * std::sin(longitude),
          (n * (1 - kE2) + height) * sp};
}

Geodetic Geodetic::FromEcef(const Vector3d& ecef) {
  const Normal n = NormalAt(ecef);
  return {std::atan2(n.sin_lat, n.cos_lat), std::atan2(n.sin_lon, n.cos_lon), n.height};
}

LocalFrame::LocalFrame(const Geodetic& origin) : origin_(origin), origin_ecef_(origin.ToEcef()) {
  r_enu_ecef_ = EnuFromEcef(std::sin(origin.latitude), std::cos(origin.latitude), std::sin(origin.longitude),
                            std::cos(origin.longitude));
  earth_rate_enu_ = kEarthRate * r_enu_ecef_.col(2);
}

Vector3d LocalFrame::ToEnu(const Geodetic& point) const { return r_enu_ecef_ * (point.ToEcef() - origin_ecef_); }

LocalFrame::SurfacePoint LocalFrame::SurfaceAt(const Vector3d& enu) const {
  const Normal n = NormalAt(ToEcef(enu));
  const Vector3d up_ecef(n.cos_lat * n.cos_lon, n.cos_lat * n.sin_lon, n.sin_lat);
  return {r_enu_ecef_ * up_ecef, n.height, n.sin_lat};
}

Matrix3d LocalFrame::LocalAxesAt(const Vector3d& enu) const {
  const Normal n = NormalAt(ToEcef(enu));
  return r_enu_ecef_ * EnuFromEcef(n.sin_lat, n.cos_lat, n.sin_lon, n.cos_lon).transpose();
}

Vector3d World::GravityAt(const Vector3d& enu) const {
  const auto point = frame.SurfaceAt(enu);
  const double s2 = point.sin_latitude * point.sin_latitude;
  const double on_ellipsoid = kEquatorialGravity * (1 + kSomigliana * s2) / std::sqrt(1 - kE2 * s2);
  const double ratio = point.height / kA;
  const double slope = 2 * (1 + kF + kCentrifugalRatio - 2 * kF * s2);
  return -on_ellipsoid * (1 - ratio * (slope - 3 * ratio)) * point.up_enu;
}

}  // namespace peer
