// The ellipsoid WGS-84, the tangent plane fixed at an origin, normal gravity and the Earth's rate in it.
#pragma once

#include "so3.h"

namespace peer {

// Radians and metres above the ellipsoid.
struct Geodetic {
  double latitude = 0, longitude = 0, height = 0;
  static Geodetic FromDegrees(double lat_deg, double lon_deg, double height);
  Vector3d ToEcef() const;
  static Geodetic FromEcef(const Vector3d& ecef);
};

// East-North-Up frame at an origin. Heights, verticals and local axes go through ECEF exactly.
class LocalFrame {
 public:
  explicit LocalFrame(const Geodetic& origin);
  const Geodetic& origin() const { return origin_; }
  Vector3d ToEnu(const Geodetic& point) const;
  Geodetic ToGeodetic(const Vector3d& enu) const { return Geodetic::FromEcef(ToEcef(enu)); }
  Vector3d ToEcef(const Vector3d& enu) const { return origin_ecef_ + r_enu_ecef_.transpose() * enu; }
  // The ellipsoid's normal through a point in ENU axes, the height above it, and the sine of latitude.
  struct SurfacePoint {
    Vector3d up_enu;
    double height, sin_latitude;
  };
  SurfacePoint SurfaceAt(const Vector3d& enu) const;
  // C_loc: turns vectors along local east, north, up at a point to the axes of the origin.
  Matrix3d LocalAxesAt(const Vector3d& enu) const;
  // Ω(0, cos φ₀, sin φ₀), rad/s.
  const Vector3d& earth_rate_enu() const { return earth_rate_enu_; }

 private:
  Geodetic origin_;
  Vector3d origin_ecef_;
  Matrix3d r_enu_ecef_;
  Vector3d earth_rate_enu_;
};

// What a factor knows of the world.
struct World {
  LocalFrame frame;
  double surface_height;  // m above the ellipsoid

  // −γ(φ, h)·up, m/s², free air.
  Vector3d GravityAt(const Vector3d& enu) const;
};

}  // namespace peer
