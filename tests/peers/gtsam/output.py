"""keyframes.csv and summary.json of the GTSAM peer."""

import importlib.metadata
from dataclasses import dataclass

import gtsam
import numpy as np


@dataclass
class Solution:
    """A keyframe: state, bias, covariance of pose (attitude first), velocity and bias."""

    t: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    of_variables: np.ndarray

    def covariance(self):
        """15 × 15 in the order position (ENU), velocity, attitude (body), biases."""
        turn = np.eye(15)
        turn[:9, :9] = 0
        turn[:3, 3:6] = self.state.attitude().matrix()
        turn[3:6, 6:9] = turn[6:9, :3] = np.eye(3)
        return turn @ self.of_variables @ turn.T


def write_keyframes(path, solutions):
    """One row a keyframe, the form of the Ceres peer."""
    upper = np.triu_indices(15)
    with open(path, "w", encoding="ascii") as file:
        file.write("t_ns,e,n,u,ve,vn,vu,qw,qx,qy,qz,bax,bay,baz,bgx,bgy,bgz,covariance by rows of the upper half\n")
        for solution in solutions:
            q = solution.state.attitude().toQuaternion()
            numbers = [*solution.state.position(), *solution.state.velocity(), q.w(), q.x(), q.y(), q.z(),
                       *solution.bias.vector(), *solution.covariance()[upper]]
            file.write(f"{round(solution.t * 1e9)}," + ",".join(f"{number:.17g}" for number in numbers) + "\n")


def quantiles(values):
    """p50, p99, max."""
    if len(values) == 0:
        return {}
    ranked = np.sort(np.array(values))
    rank = [max(int(np.ceil(share * len(ranked))), 1) - 1 for share in (0.5, 0.99)]
    return {"p50": float(ranked[rank[0]]), "p99": float(ranked[rank[1]]), "max": float(ranked[-1])}


def summarise(log, run, lag):
    """What the fixed-lag run did, updates with a full lag alone."""
    # Where nothing is ever forgotten no window fills.
    first = int(np.ceil(lag)) if lag < len(run.times) else 20
    full = run.times[first:]
    update, python = quantiles([times["update"] for times in full]), quantiles([times["python"] for times in full])
    whole = sum(times["update"] + times["python"] for times in full)
    return {
        "estimator": "gtsam fixed lag",
        "version": f"GTSAM {importlib.metadata.version('gtsam')}",
        "window": lag,
        "keyframes": len(run.solutions),
        "origin": list(log.frame.origin),
        "sensors": run.readings.counts,
        "solve_us": update,
        "parts_us": {part: quantiles([times[part] for times in run.parts[first:]])
                     for part in ("isam2", "estimate", "covariance")} | {"python, not counted": python},
        "python_share": sum(times["python"] for times in full) / whole if whole else None,
    }
