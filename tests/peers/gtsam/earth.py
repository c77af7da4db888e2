"""WGS-84: the tangent plane at an origin, heights and verticals through ECEF, normal gravity, the Earth's rate."""

import numpy as np

A = 6378137.0
F = 1 / 298.257223563
E2 = F * (2 - F)
RATE = 7.292115e-5  # rad/s
EQUATORIAL_GRAVITY, POLAR_GRAVITY = 9.7803253359, 9.8321849378
SOMIGLIANA = (1 - F) * POLAR_GRAVITY / EQUATORIAL_GRAVITY - 1
CENTRIFUGAL_RATIO = 0.00344978650684


def to_ecef(lat_deg, lon_deg, height):
    """ECEF of a geodetic position, m."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    n = A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    return np.array([(n + height) * np.cos(lat) * np.cos(lon), (n + height) * np.cos(lat) * np.sin(lon),
                     (n * (1 - E2) + height) * np.sin(lat)])


def axes(lat, lon):
    """Rows east, north, up in ECEF axes; radians."""
    sp, cp, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.array([[-sl, cl, 0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])


class Frame:
    """East-North-Up at an origin in degrees and metres."""

    def __init__(self, origin):
        self.origin = origin
        self.origin_ecef = to_ecef(*origin)
        self.r_enu_ecef = axes(np.radians(origin[0]), np.radians(origin[1]))
        self.earth_rate_enu = RATE * self.r_enu_ecef[:, 2]

    def to_enu(self, lat_deg, lon_deg, height):
        """ENU of a geodetic position, m."""
        return self.r_enu_ecef @ (to_ecef(lat_deg, lon_deg, height) - self.origin_ecef)

    def surface(self, enu):
        """Latitude and longitude in rad and height in m of an ENU position (Bowring's step, twice)."""
        x = self.origin_ecef + self.r_enu_ecef.T @ enu
        p, b = np.hypot(x[0], x[1]), A * (1 - F)
        beta = np.arctan2(x[2] * A, p * b)
        for _ in range(2):
            lat = np.arctan2(x[2] + E2 / (1 - E2) * b * np.sin(beta) ** 3, p - E2 * A * np.cos(beta) ** 3)
            beta = np.arctan2((1 - F) * np.sin(lat), np.cos(lat))
        height = p * np.cos(lat) + x[2] * np.sin(lat) - A * np.sqrt(1 - E2 * np.sin(lat) ** 2)
        return lat, np.arctan2(x[1], x[0]), height

    def local_axes(self, enu):
        """C_loc: from local east, north, up at a position to the axes of the origin."""
        lat, lon, _ = self.surface(enu)
        return self.r_enu_ecef @ axes(lat, lon).T

    def gravity(self, enu):
        """Gravity vector, m/s², free air."""
        lat, lon, height = self.surface(enu)
        s2 = np.sin(lat) ** 2
        on_ellipsoid = EQUATORIAL_GRAVITY * (1 + SOMIGLIANA * s2) / np.sqrt(1 - E2 * s2)
        slope = 2 * (1 + F + CENTRIFUGAL_RATIO - 2 * F * s2)
        gamma = on_ellipsoid * (1 - height / A * (slope - 3 * height / A))
        return -gamma * (self.r_enu_ecef @ axes(lat, lon)[2])
