"""smoother.py LOG --out OUT [--lag N | --batch] [--clean] [--without dvl,mcp]

Fixed-lag smoothing by GTSAM's IncrementalFixedLagSmoother, or the whole log as one batch. Writes keyframes.csv and
summary.json into OUT; `carry_keyframes LOG OUT` of the Ceres peer makes estimate.csv of them.

The times count what GTSAM's C++ does: the update, the newest estimate, the newest covariance, or the batch's solve and all
its covariances. What Python spends on making factors is given beside it and not counted.
"""

import argparse
import json
import time
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, L, V, X

from inertial import Inertial
from logdir import read, schedule
from output import Solution, summarise, write_keyframes
from readings import Readings

# m/s²/√Hz. Below, as in noise-free logs, GTSAM's Cholesky factorisation stops; QR goes on at two to three times the time.
CHOLESKY_ACCEL_NOISE = 1e-5
BUOY_SIGMA = 1e-3  # m; a known buoy is a variable with a tight prior
# Correction from which a state is linearised anew: rad and m, m/s, m/s² and rad/s.
THRESHOLDS = {"x": [2e-3] * 3 + [0.3] * 3, "v": [0.3] * 3, "b": [5e-2] * 3 + [1e-3] * 3, "l": [1.0] * 3}


def now():
    """CPU time of the process, µs: of all its threads, should GTSAM use more than one."""
    return time.process_time_ns() * 1e-3


def joined(marginals, index):
    """Covariance of a keyframe's pose (attitude first), velocity and bias, 15 × 15."""
    keys = [symbol(index) for symbol in (X, V, B)]
    joint = marginals.jointMarginalCovariance(keys)
    return np.block([[joint.at(row, column) for column in keys] for row in keys])


def initial(log):
    """The first state, bias and covariance of pose (attitude first), velocity and bias."""
    facts, imu = log.facts["initial"], log.facts["imu"]
    rotation = gtsam.Rot3.Quaternion(*facts["quaternion"])
    state = gtsam.NavState(rotation, np.array(facts["position"]), np.array(facts["velocity"]))
    axes = np.eye(3)
    axes[:, 2] = rotation.matrix()[2]
    sigmas = np.repeat([0.0, facts["sigma_position"], facts["sigma_velocity"], imu["accel_bias_sigma"],
                        imu["gyro_bias_sigma"]], 3)
    covariance = np.diag(sigmas**2)
    covariance[:3, :3] = axes @ np.diag(np.radians(facts["sigma_attitude"]) ** 2) @ axes.T
    return state, gtsam.imuBias.ConstantBias(), covariance


def position_velocity(state, covariance, dt, accel_variance):
    """6 × 6 covariance of position and velocity after `dt` of inertial navigation; for the gates."""
    r = state.attitude().matrix()
    by_tilt = np.array([[0, 9.8, 0], [-9.8, 0, 0], [0, 0, 0]]) @ r
    way = np.zeros((6, 15))
    way[:3, :3], way[:3, 3:6], way[:3, 6:9] = dt**2 / 2 * by_tilt, r, dt * np.eye(3)
    way[3:, :3], way[3:, 6:9] = dt * by_tilt, np.eye(3)
    noise = np.diag([accel_variance * dt**3 / 3] * 3 + [accel_variance * dt] * 3)
    return way @ covariance @ way.T + noise


class FixedLag:
    """The run: keyframe after keyframe into the incremental fixed-lag smoother."""

    def __init__(self, log, lag, is_robust, keep_all):
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = 1
        thresholds = gtsam.ISAM2ThresholdMap()
        for symbol, values in THRESHOLDS.items():
            thresholds.insert((symbol, np.array(values)))
        parameters.setRelinearizeThreshold(thresholds)
        parameters.findUnusedFactorSlots = True
        if log.facts["imu"]["accel_noise_density"] < CHOLESKY_ACCEL_NOISE:
            parameters.setFactorization("QR")
        self.smoother = gtsam.IncrementalFixedLagSmoother(float(lag), parameters)
        self.log, self.inertial = log, Inertial(log)
        self.readings = Readings(log, self.inertial, is_robust)
        self.known_buoys = set()
        self.graph = gtsam.NonlinearFactorGraph() if keep_all else None
        self.values = gtsam.Values()
        self.times, self.parts, self.solutions = [], [], []
        self.state, self.bias, self.covariance = initial(log)
        self.t = log.facts["initial"]["t"]

    def run(self):
        """All keyframes."""
        self.first()
        for index, (t, before, this) in enumerate(schedule(self.log), start=1):
            began = now()
            graph, values, stamps = self.make(index, t, before, this)
            made = now()
            self.update(index, graph, values, stamps)
            done = now()
            self.times.append({"update": done - made, "python": made - began})
            self.t = t
            self.publish(graph, values, index)

    def first(self):
        """The prior on the first keyframe."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        models = [gtsam.noiseModel.Gaussian.Covariance(self.covariance[part, part])
                  for part in (slice(0, 6), slice(6, 9), slice(9, 15))]
        graph.add(gtsam.PriorFactorPose3(X(0), self.state.pose(), models[0]))
        graph.add(gtsam.PriorFactorVector(V(0), self.state.velocity(), models[1]))
        graph.add(gtsam.PriorFactorConstantBias(B(0), self.bias, models[2]))
        stamps = self.insert(values, 0, self.t, self.state)
        self.smoother.update(graph, values, stamps)
        self.publish(graph, values, 0)

    def insert(self, values, index, t, state):
        """A keyframe's variables and their times."""
        values.insert(X(index), state.pose())
        values.insert(V(index), state.velocity())
        values.insert(B(index), self.bias)
        stamps = gtsam.FixedLagSmootherKeyTimestampMap()
        for symbol in (X, V, B):
            stamps.insert((symbol(index), t))
        return stamps

    def make(self, index, t, before, this):
        """Factors of the interval that ends with keyframe `index`."""
        stops = sorted({reading.t for reading in (*before, *this) if reading.t > self.t})
        pim, predicted, there = self.inertial.preintegrate(self.t, t, stops, self.state, self.bias)
        predicted[t] = there
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.add(gtsam.CombinedImuFactor(X(index - 1), V(index - 1), X(index), V(index), B(index - 1), B(index), pim))
        stamps = self.insert(values, index, t, there)
        self.readings.gyro_bias = self.bias.gyroscope()
        accel_variance = self.inertial.variances[0]
        for group, key, state, t_keyframe in ((before, index - 1, self.state, self.t), (this, index, there, t)):
            covariance = position_velocity(self.state, self.covariance, t_keyframe - self.t, accel_variance)
            self.readings.t_keyframe = t_keyframe
            for reading in group:
                factor = self.readings.factor(reading, key, state, predicted[reading.t], covariance)
                if factor is not None:
                    graph.add(factor)
        for buoy, place in self.readings.buoys.items():
            if buoy not in self.known_buoys:
                self.known_buoys.add(buoy)
                values.insert(L(buoy), place)
                graph.add(gtsam.PriorFactorPoint3(L(buoy), place, gtsam.noiseModel.Isotropic.Sigma(3, BUOY_SIGMA)))
        return graph, values, stamps

    def update(self, index, graph, values, stamps):
        """One update, the newest estimate, its covariances."""
        began = now()
        self.smoother.update(graph, values, stamps)
        updated = now()
        pose = self.smoother.calculateEstimatePose3(X(index))
        self.state = gtsam.NavState(pose, self.smoother.calculateEstimateVector(V(index)))
        self.bias = self.smoother.calculateEstimateConstantBias(B(index))
        estimated = now()
        self.covariance = joined(self.smoother.getISAM2(), index)
        self.parts.append({"isam2": updated - began, "estimate": estimated - updated, "covariance": now() - estimated})

    def publish(self, graph, values, index):
        """Keeps the newest solution, and for a batch everything."""
        self.solutions.append(Solution(self.t, self.state, self.bias, self.covariance))
        if self.graph is not None:
            self.graph.push_back(graph)
            for key in values.keys():
                symbol = chr(gtsam.Symbol(key).chr())
                if symbol == "l":
                    self.values.insert(key, values.atPoint3(key))
            self.values.insert(X(index), self.state.pose())
            self.values.insert(V(index), self.state.velocity())
            self.values.insert(B(index), self.bias)


def batch(run):
    """The whole log by Gauss-Newton from the fixed-lag estimates; solutions and times."""
    parameters = gtsam.GaussNewtonParams()
    parameters.setRelativeErrorTol(1e-6)
    began = now()
    optimiser = gtsam.GaussNewtonOptimizer(run.graph, run.values, parameters)
    values = optimiser.optimize()
    solved = now()
    marginals = gtsam.Marginals(run.graph, values)
    covariances = [joined(marginals, index) for index in range(len(run.solutions))]
    done = now()
    solutions = [Solution(solution.t, gtsam.NavState(values.atPose3(X(index)), values.atVector(V(index))),
                          values.atConstantBias(B(index)), covariances[index])
                 for index, solution in enumerate(run.solutions)]
    return solutions, {"solve": solved - began, "covariance": done - solved, "iterations": optimiser.iterations()}


def main():
    """Runs from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--lag", type=float, default=20.0, help="s")
    parser.add_argument("--batch", action="store_true")
    parser.add_argument("--clean", action="store_true", help="no kernels, no gates")
    parser.add_argument("--without", default="")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    log = read(arguments.log, set(arguments.without.split(",")))
    run = FixedLag(log, arguments.lag, not arguments.clean, arguments.batch)
    run.run()
    solutions, summary = run.solutions, summarise(log, run, arguments.lag)
    if arguments.batch:
        solutions, times = batch(run)
        whole = times["solve"] + times["covariance"]
        summary |= {"estimator": "gtsam batch", "solve_us": {"p50": whole, "p99": whole, "max": whole}, "parts_us": times}
    write_keyframes(arguments.out / "keyframes.csv", solutions)
    (arguments.out / "summary.json").write_text(json.dumps(summary, indent=2))


if __name__ == "__main__":
    main()
