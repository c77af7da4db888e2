"""WGS-84 and rotations, written anew from their definitions: nothing here is shared with the navigator that is tested."""

import numpy as np

SEMI_MAJOR = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
EARTH_RATE = 7.292115e-5


def ecef(lat, lon, height):
    """Geodetic (rad, rad, m) to ECEF, m."""
    normal = SEMI_MAJOR / np.sqrt(1 - ECCENTRICITY_2 * np.sin(lat) ** 2)
    return np.stack([
        (normal + height) * np.cos(lat) * np.cos(lon),
        (normal + height) * np.cos(lat) * np.sin(lon),
        (normal * (1 - ECCENTRICITY_2) + height) * np.sin(lat),
    ], -1)


def geodetic(position):
    """ECEF, m, to (rad, rad, m), by iteration; away from the poles."""
    x, y, z = np.moveaxis(position, -1, 0)
    distance, lon = np.hypot(x, y), np.arctan2(y, x)
    lat = np.arctan2(z, distance * (1 - ECCENTRICITY_2))
    for _ in range(8):
        normal = SEMI_MAJOR / np.sqrt(1 - ECCENTRICITY_2 * np.sin(lat) ** 2)
        height = distance / np.cos(lat) - normal
        lat = np.arctan2(z, distance * (1 - ECCENTRICITY_2 * normal / (normal + height)))
    return lat, lon, height


def enu_axes(lat, lon):
    """East, north and up as rows, in ECEF."""
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.stack([
        np.stack([-sin_lon, cos_lon, np.zeros_like(sin_lon)], -1),
        np.stack([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat], -1),
        np.stack([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat], -1),
    ], -2)


def gravity(lat, height):
    """Normal gravity, m/s², along the inward normal of the ellipsoid."""
    sin_2 = np.sin(lat) ** 2
    at_surface = 9.7803253359 * (1 + 0.00193185265241 * sin_2) / np.sqrt(1 - ECCENTRICITY_2 * sin_2)
    ratio = 0.00344978650684
    linear = 2 * (1 + FLATTENING + ratio - 2 * FLATTENING * sin_2) * height / SEMI_MAJOR
    return at_surface * (1 - linear + 3 * (height / SEMI_MAJOR) ** 2)


def rotation(roll, pitch, yaw):
    """Rz(yaw) Ry(pitch) Rx(roll), for arrays of angles, rad."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.stack([
        np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], -1),
        np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], -1),
        np.stack([-sp, cp * sr, cp * cr], -1),
    ], -2)


def apply(matrices, vectors):
    """One matrix a vector."""
    return np.einsum("...ij,...j->...i", matrices, vectors)


def transposed(matrices):
    return np.swapaxes(matrices, -1, -2)


def quaternion(matrix):
    """qw qx qy qz of one rotation, by its largest component."""
    m, trace = matrix, np.trace(matrix)
    squares = [1 + trace, *(1 + 2 * m[i, i] - trace for i in range(3))]
    largest = int(np.argmax(squares))
    scale = 2 * np.sqrt(squares[largest])
    rows = [
        [None, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
        [m[2, 1] - m[1, 2], None, m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
        [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], None, m[1, 2] + m[2, 1]],
        [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], None],
    ]
    return np.array([scale / 4 if value is None else value / scale for value in rows[largest]])
