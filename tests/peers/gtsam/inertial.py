"""Samples of an interval into GTSAM's preintegration, at the accuracy of the midpoint rule.

GTSAM takes each sample as constant over its step, in the axes of the step's beginning. It is given the means

    ω̄ = ½(ω_i + ω_{i+1}),   f̄ = ½(f_i + Exp(ω̄ dt) f_{i+1})

which make its Euler steps those of the midpoint rule; with the raw samples the noise-free error would be 1e-3 m/s² in a turn.
The turning Earth: its rate is taken from the gyroscope's means along the predicted attitude, −2ω×v joins gravity. GTSAM's
own `omegaCoriolis` adds it to the rotation vector of the whole interval, which loses ½θ×ω: 2e-6 rad a second in a turn.
"""

import gtsam
import numpy as np

# m²/s. What GTSAM adds to the position's noise; with less, its Cholesky factorisation takes the increments of position for
# certain and stops. 0.1 mm over a second, a sixth of what the accelerometer's noise gives.
INTEGRATION_VARIANCE = 1e-8


def rotations(phi):
    """Exp of many rotation vectors, N × 3 × 3."""
    t = np.linalg.norm(phi, axis=1)
    small = t < 1e-6
    safe = np.where(small, 1.0, t)
    a = np.where(small, 1 - t**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - t**2 / 24, (1 - np.cos(safe)) / safe**2)
    skew = np.zeros((len(phi), 3, 3))
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -phi[:, 2], phi[:, 1], -phi[:, 0]
    skew -= skew.transpose(0, 2, 1)
    return np.eye(3) + a[:, None, None] * skew + b[:, None, None] * skew @ skew


class Inertial:
    """The IMU of a log."""

    def __init__(self, log):
        self.log = log
        self.times = np.ascontiguousarray(log.imu[:, 0])
        noise = log.facts["imu"]
        self.variances = [noise[key] ** 2 for key in ("accel_noise_density", "gyro_noise_density",
                                                      "accel_bias_random_walk", "gyro_bias_random_walk")]

    def gyro_at(self, t):
        """Raw rate at `t`."""
        at = np.searchsorted(self.times, t)
        near = self.log.imu[max(at - 2, 0):at + 2]
        return np.array([np.interp(t, near[:, 0], near[:, axis]) for axis in (1, 2, 3)])

    def preintegrate(self, t_from, t_to, stops, state, bias):
        """Preintegration over an interval; the predicted NavStates at `stops` and at its end."""
        imu = self.log.imu
        first, last = np.searchsorted(self.times, [t_from, t_to], side="right")
        inner = self.times[first:last]
        times = np.unique(np.concatenate([[t_from], inner, stops, [t_to]]))
        around = imu[max(first - 1, 0):last + 1]
        samples = np.array([np.interp(times, around[:, 0], around[:, axis]) for axis in range(1, 7)]).T
        dt = np.diff(times)
        rate = 0.5 * (samples[:-1, :3] + samples[1:, :3])
        turn = rotations(rate * dt[:, None])
        force = 0.5 * (samples[:-1, 3:] + np.einsum("nij,nj->ni", turn, samples[1:, 3:]))
        # Attitude along the interval, good enough for the 7e-5 rad/s of the Earth.
        middle = np.cumsum(rate * dt[:, None], axis=0) - 0.5 * rate * dt[:, None]
        earth_body = state.attitude().matrix().T @ self.log.frame.earth_rate_enu
        rate = rate - np.einsum("nji,j->ni", rotations(middle), earth_body)

        velocity = state.velocity()
        gravity = self.log.frame.gravity(state.position() + 0.5 * (t_to - t_from) * velocity)
        parameters = gtsam.PreintegrationCombinedParams(gravity - 2 * np.cross(self.log.frame.earth_rate_enu, velocity))
        accel, gyro, accel_walk, gyro_walk = self.variances
        parameters.setAccelerometerCovariance(accel * np.eye(3))
        parameters.setGyroscopeCovariance(gyro * np.eye(3))
        parameters.setBiasAccCovariance(accel_walk * np.eye(3))
        parameters.setBiasOmegaCovariance(gyro_walk * np.eye(3))
        parameters.setIntegrationCovariance(INTEGRATION_VARIANCE * np.eye(3))
        pim = gtsam.PreintegratedCombinedMeasurements(parameters, bias)
        wanted, predicted = set(stops), {}
        for index, step in enumerate(dt):
            pim.integrateMeasurement(force[index], rate[index], step)
            if times[index + 1] in wanted:
                predicted[times[index + 1]] = pim.predict(state, bias)
        predicted[t_from] = state
        return pim, predicted, pim.predict(state, bias)
