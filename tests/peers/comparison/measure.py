"""Runs contestants in turn on one log and scores them by one scorer.

Times are CPU times of the estimating thread, taken by each program around its own updates: a machine's other work does
not count, but its caches and clock rate do. So ours runs before and after every run of a peer, and a ratio is the peer's
time over the mean of its two neighbours.
"""

import json
import os
import statistics
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

# One thread each: neither BLAS nor TBB gets more.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "TBB_NUM_THREADS": "1"}


class Failed(Exception):
    """A contestant that did not finish."""


@dataclass
class Result:
    """What a contestant came to: medians over its runs, and the ratios of its time to that of ours beside it."""

    contestant: object
    p50: list = field(default_factory=list)
    p99: list = field(default_factory=list)
    ratio: list = field(default_factory=list)
    ratio_p99: list = field(default_factory=list)
    ours_before: list = field(default_factory=list)
    score: dict = field(default_factory=dict)
    summary: dict = field(default_factory=dict)

    def add(self, summary, neighbours=None):
        """Takes in one run; `neighbours`: the summaries of ours before and after."""
        times = summary["solve_us"]
        self.summary = summary
        self.p50.append(times["p50"])
        self.p99.append(times["p99"])
        if neighbours:
            self.ratio.append(times["p50"] / statistics.mean(n["solve_us"]["p50"] for n in neighbours))
            self.ours_before.append(neighbours[0]["solve_us"]["p50"])
            self.ratio_p99.append(times["p99"] / statistics.mean(n["solve_us"]["p99"] for n in neighbours))


@dataclass
class Round:
    """One task on one log."""

    case: object
    task: object
    results: list


def side_by_side(tools, case, task, repeats):
    """Ours, peer, ours, peer, ..., ours."""
    ours, peers = Result(task.ours), [Result(peer) for peer in task.peers]
    before = run(tools, case, task.ours)
    ours.add(before)
    for _ in range(1 if task.is_slow else repeats):
        for peer in peers:
            during = run(tools, case, peer.contestant)
            after = run(tools, case, task.ours)
            ours.add(after)
            peer.add(during, (before, after))
            before = after
    for result in [ours, *peers]:
        if result.contestant.carry:
            execute(fill(result.contestant.carry, case, folder(tools, case, result.contestant)))
        result.score = score(tools, case, result.contestant)
    return Round(case, task, [ours, *peers])


def folder(tools, case, contestant):
    """Where the contestant's results on that log are."""
    return tools.work / "runs" / case.name.replace(" ", "-") / contestant.slug()


def fill(command, case, out):
    """The command with its placeholders filled in."""
    return [str({"LOG": case.directory, "OUT": out}.get(part, part)) for part in command]


def run(tools, case, contestant):
    """One run; its summary."""
    out = folder(tools, case, contestant)
    out.mkdir(parents=True, exist_ok=True)
    execute(fill(contestant.command, case, out))
    return json.loads((out / "summary.json").read_text())


def execute(command):
    """Runs a command to its end, silently."""
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **ONE_THREAD})
    if done.returncode != 0:
        raise Failed(f"`{' '.join(command)}` failed: {done.stderr.strip()}")
    return done.stdout


def score(tools, case, contestant):
    """The figures of `ilns score`; empty without a truth."""
    truth = Path(case.directory) / "truth.csv"
    if not truth.exists():
        return {}
    out = folder(tools, case, contestant)
    origin = json.loads((out / "summary.json").read_text())["origin"]
    return json.loads(execute([str(tools.ilns), "score", str(out / "estimate.csv"), "--truth", str(truth), "--json",
                               "--origin", ",".join(map(str, origin))]))
