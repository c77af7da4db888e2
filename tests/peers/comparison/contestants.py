"""Who competes: the commands that make an estimate of a log directory, and which of ours each peer is held against."""

import subprocess
from dataclasses import dataclass

# Estimators that `ilns replay` may know.
OURS = ["fgo", "ekf", "fkf"]
# Keyframes; peers take minutes over a mission with longer ones.
SLOW_WINDOW = 50


@dataclass(frozen=True)
class Contestant:
    """A command that reads LOG and writes summary.json and keyframes.csv or estimate.csv into OUT."""

    name: str
    command: list  # with LOG and OUT as placeholders
    is_ours: bool = False
    carry: list | None = None  # turns keyframes.csv into estimate.csv, where the command did not

    def slug(self):
        """Folder for its results."""
        return self.name.replace(" ", "-").replace(",", "").replace("(", "").replace(")", "")


@dataclass(frozen=True)
class Task:
    """Ours and its peers on one task, in the order of running: ours, peer, ours, peer, ..."""

    title: str
    ours: Contestant
    peers: list
    is_slow: bool  # minutes per run: run once


def tasks(tools, peers, windows, case):
    """All tasks that the tools at hand allow on a log."""
    found = all_tasks(tools, peers, windows, case)
    if case.kind == "noise-free":
        # Shows that all converge to the truth; the times would be those of the realistic log.
        found = [task for task in found if task.title == f"window {min(windows)}"]
    return found


def all_tasks(tools, peers, windows, case):
    """The windows and the batch."""
    filters = [replay(tools, name, None) for name in OURS[1:] if knows(tools, name, case)]
    found = []
    for window in windows:
        against = []
        if "ceres" in peers:
            against.append(ceres(tools, f"Ceres window {window}", ["--window", str(window)]))
            if window == min(windows):
                against.append(ceres(tools, f"Ceres window {window} (no kernels, no gates)",
                                     ["--window", str(window), "--clean"]))
        if "gtsam" in peers:
            against.append(gtsam(tools, f"GTSAM fixed lag {window} (iSAM2)", ["--lag", str(window)]))
        if window == min(windows):
            if "gtsam" in peers:
                against.append(gtsam(tools, "GTSAM iSAM2, nothing forgotten", ["--lag", "1e6"]))
            against += filters
        ours = replay(tools, "fgo", window)
        if window <= SLOW_WINDOW:
            found.append(Task(f"window {window}", ours, against, is_slow=False))
        else:
            # One by one: a run of minutes that is stopped leaves the others.
            found += [Task(f"window {window}, {peer.name.split()[0]}", ours, [peer], is_slow=True) for peer in against]
    against = []
    if "ceres" in peers:
        against.append(ceres(tools, "Ceres batch", ["--batch"]))
    if "gtsam" in peers:
        against.append(gtsam(tools, "GTSAM batch", ["--batch"], smoothed=True))
    smooth = Contestant("fgo batch", [tools.ilns, "smooth", "LOG", "--out", "OUT"], is_ours=True)
    found.append(Task("batch", smooth, against, is_slow=False))
    return found


def knows(tools, estimator, case):
    """Whether `ilns replay` has that estimator."""
    command = [tools.ilns, "replay", case.directory, "--estimator", estimator, "--print-config"]
    return subprocess.run(command, capture_output=True).returncode == 0


def replay(tools, estimator, window):
    """Ours, by sliding window or filter."""
    name = estimator if window is None else f"{estimator} window {window}"
    flags = ["--estimator", estimator] + ([] if window is None else ["--window", str(window)])
    return Contestant(name, [tools.ilns, "replay", "LOG", "--out", "OUT", *flags], is_ours=True)


def ceres(tools, name, flags):
    """The Ceres peer."""
    return Contestant(name, [tools.ceres / "ceres_smoother", "LOG", "--out", "OUT", *flags])


def gtsam(tools, name, flags, smoothed=False):
    """The GTSAM peer, whose keyframes the Ceres peer's program carries to the IMU samples."""
    carry = [tools.ceres / "carry_keyframes", "LOG", "OUT"] + (["--smoothed"] if smoothed else [])
    return Contestant(name, [tools.python, tools.gtsam_script, "LOG", "--out", "OUT", *flags], carry=carry)
