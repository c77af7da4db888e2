"""Readings as built-in factors of GTSAM on the keyframe that they are tied to.

GTSAM has no factor for a reading between two keyframes. Each is carried to its keyframe by what the IMU says of the way
between, predicted once: what is lost is the derivative of that way by velocity and attitude, 2 mm for a fix half a second off.

| reading | factor |
|---|---|
| lbl | RangeFactorWithTransform3D on pose and buoy (a variable with a prior of 1 mm), kernel per range |
| gnss, ps | GPSFactorArm, the depth with horizontal sigmas of 1 km |
| dvl | PriorFactorVector on the velocity, turned to ENU by the predicted attitude |
| mcp | PoseRotationPrior3D with information about the heading's axis alone |
"""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X

CHI2_999_OF_THREE = 16.266
TOO_LONG, TOO_SHORT = 4.0, 5.0  # sigmas of a range
REFUSALS_IN_A_ROW = 5
KERNELS = {"lbl": ("Cauchy", 2.0), "dvl": ("Cauchy", 2.385), "gnss": ("Cauchy", 2.385), "mcp": ("Cauchy", 2.385),
           "ps": ("Huber", 1.345)}


def skew(v):
    """[v]×."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def mounting(rpy_deg):
    """R(instrument to body) = Rz Ry Rx."""
    roll, pitch, yaw = np.radians(rpy_deg)
    return gtsam.Rot3.RzRyRx(roll, pitch, yaw).matrix()


class Readings:
    """Makes factors, gates, counts."""

    def __init__(self, log, inertial, is_robust):
        self.log, self.inertial, self.is_robust = log, inertial, is_robust
        facts = log.facts
        self.levers = {sensor: np.array(facts.get(sensor, {}).get("lever_arm", [0.0] * 3), dtype=float)
                       for sensor in ("lbl", "gnss", "dvl", "ps")}
        self.r_body_dvl = mounting(facts.get("dvl", {}).get("mounting_rpy", [0.0] * 3))
        self.sigma = {sensor: facts.get(sensor, {}).get("sigma") for sensor in ("lbl", "dvl", "mcp", "ps")}
        self.transducer = gtsam.Pose3(gtsam.Rot3(), self.levers["lbl"])
        self.counts = {sensor: {"used": 0, "refused": 0} for sensor in KERNELS}
        self.refusals = {"lbl": [0, None, True], "dvl": [0, None, True]}
        self.narrow_dvl, self.improbable_dvl = ("Cauchy", 1.0), 0.05
        self.buoys = {}

    def noise(self, sensor, base):
        """The noise model with the sensor's kernel."""
        if not self.is_robust:
            return base
        kind, width = KERNELS[sensor]
        if sensor == "dvl" and self.improbable_dvl > 0.12:
            kind, width = self.narrow_dvl
        estimator = getattr(gtsam.noiseModel.mEstimator, kind).Create(width)
        return gtsam.noiseModel.Robust.Create(estimator, base)

    def factor(self, reading, key, at_keyframe, at_reading, covariance):
        """The factor on keyframe number `key`; None where the gate refuses it.

        `at_keyframe`, `at_reading`: predicted NavStates. `covariance`: position and velocity of the keyframe, 6 × 6, ENU.
        """
        made = getattr(self, reading.sensor)(reading, key, at_keyframe, at_reading, covariance)
        self.counts[reading.sensor]["used" if made is not None else "refused"] += 1
        return made

    def admits(self, sensor, t, passes):
        """Counts refusals in a row, of ranges by epoch; the sixth is admitted by its kernel alone."""
        if not self.is_robust:
            return True
        state = self.refusals[sensor]
        if state[1] != t:
            state[0], state[1], state[2] = (0 if state[2] else state[0] + 1), t, False
        state[2] |= bool(passes)
        return passes or state[0] >= REFUSALS_IN_A_ROW

    def lbl(self, reading, key, at_keyframe, at_reading, covariance):
        """A range, carried to the keyframe."""
        def distance(state):
            return np.linalg.norm(state.position() + state.attitude().matrix() @ self.levers["lbl"] - reading.buoy_enu)

        moved = distance(at_keyframe) - distance(at_reading)
        sigma = self.sigma["lbl"]
        direction = (at_keyframe.position() - reading.buoy_enu) / np.linalg.norm(at_keyframe.position() - reading.buoy_enu)
        spread = np.sqrt(sigma**2 + direction @ covariance[:3, :3] @ direction)
        off = (distance(at_reading) - reading.value) / spread
        if not self.admits("lbl", reading.t, -TOO_LONG <= off <= TOO_SHORT):
            return None
        self.buoys[reading.buoy] = reading.buoy_enu
        noise = self.noise("lbl", gtsam.noiseModel.Isotropic.Sigma(1, sigma))
        return gtsam.RangeFactorWithTransform3D(X(key), L(reading.buoy), reading.value + moved, noise, self.transducer)

    def gnss(self, reading, key, at_keyframe, at_reading, _covariance):
        """A fix, carried to the keyframe."""
        lever = self.levers["gnss"]
        moved = (at_keyframe.position() - at_reading.position()
                 + (at_keyframe.attitude().matrix() - at_reading.attitude().matrix()) @ lever)
        noise = self.noise("gnss", gtsam.noiseModel.Diagonal.Sigmas(reading.sigma))
        return gtsam.GPSFactorArm(X(key), reading.value + moved, lever, noise)

    def ps(self, reading, key, at_keyframe, at_reading, _covariance):
        """A depth: the height of the port, its horizontal place left open."""
        lever = self.levers["ps"]
        *_, height = self.log.frame.surface(at_reading.position() + at_reading.attitude().matrix() @ lever)
        port = at_keyframe.position() + at_keyframe.attitude().matrix() @ lever
        port[2] += self.log.surface_height - reading.value - height
        noise = self.noise("ps", gtsam.noiseModel.Diagonal.Sigmas(np.array([1e3, 1e3, self.sigma["ps"]])))
        return gtsam.GPSFactorArm(X(key), port, lever, noise)

    def dvl(self, reading, key, at_keyframe, at_reading, covariance):
        """A velocity, in ENU, carried to the keyframe."""
        r = at_reading.attitude().matrix()
        rate = (self.inertial.gyro_at(reading.t) - self.gyro_bias - r.T @ self.log.frame.earth_rate_enu)
        velocity = r @ (self.r_body_dvl @ reading.value - np.cross(rate, self.levers["dvl"]))
        sigma = self.sigma["dvl"]
        off = at_reading.velocity() - velocity
        nis = off @ np.linalg.solve(sigma**2 * np.eye(3) + covariance[3:, 3:], off)
        self.improbable_dvl = 0.98 * self.improbable_dvl + 0.02 * (nis > 7.815)
        if not self.admits("dvl", reading.t, nis <= CHI2_999_OF_THREE):
            return None
        measured = velocity + at_keyframe.velocity() - at_reading.velocity()
        return gtsam.PriorFactorVector(V(key), measured, self.noise("dvl", gtsam.noiseModel.Isotropic.Sigma(3, sigma)))

    def mcp(self, reading, key, at_keyframe, at_reading, _covariance):
        """A heading: the attitude that it leaves, with information about its own axis alone."""
        local = self.log.frame.local_axes(at_reading.position())
        (east, north), r = (local.T @ at_reading.attitude().matrix())[:2], at_keyframe.attitude()
        residual = np.remainder(np.arctan2(east[0], north[0]) - reading.value + np.pi, 2 * np.pi) - np.pi
        level = local.T @ r.matrix()
        (east, north), cos2 = level[:2], level[0, 0] ** 2 + level[1, 0] ** 2
        row = np.array([0, -(north[0] * east[2] - east[0] * north[2]), north[0] * east[1] - east[0] * north[1]]) / cos2
        measured = r.compose(gtsam.Rot3.Expmap(-row * residual / (row @ row)))
        variance = np.radians(self.sigma["mcp"]) ** 2 / cos2 + self.inertial.variances[1] * abs(self.way(reading))
        information = np.outer(row, row) / variance + 1e-2 * np.eye(3)
        return gtsam.PoseRotationPrior3D(X(key), measured, self.noise("mcp", gtsam.noiseModel.Gaussian.Information(information)))

    def way(self, reading):
        """Time from the reading to its keyframe, s."""
        return self.t_keyframe - reading.t

    # Of the interval at hand.
    gyro_bias = np.zeros(3)
    t_keyframe = 0.0
