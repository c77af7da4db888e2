"""The report: one table a task and log, as Markdown."""

import statistics
import subprocess
from datetime import date

HEADER = ["", "RMS E/N/U [m]", "NEES E/N/U", "within 3σ [%]", "time per keyframe p50 / p99", "× ours p50", "× ours p99",
          "× ours p50, quickest runs"]


def markdown(repository, tools, rounds, arguments):
    """The whole report."""
    lines = ["# Ours beside its peers", "", *facts(repository, tools, rounds, arguments), ""]
    for case in dict.fromkeys(entry.case.name for entry in rounds):
        lines += [f"## {case}", ""]
        for entry in rounds:
            if entry.case.name == case:
                lines += [f"**{entry.task.title}**", "", *table(entry), ""]
    return "\n".join(lines)


def facts(repository, tools, rounds, arguments):
    """On what, of what, by which command."""
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=repository, capture_output=True, text=True)
    versions = {result.summary.get("version", "") for entry in rounds for result in entry.results if not result.contestant.is_ours}
    return [
        f"- {date.today().isoformat()}, {cpu()}",
        f"- ours: commit {commit.stdout.strip() or 'unknown'}; peers: {', '.join(sorted(filter(None, versions))) or 'none'}",
        f"- `{' '.join(['python3 tests/peers/run.py', *arguments])}`",
        "- times: CPU time of the estimating thread for one whole update (append, solve, marginalise, covariance of the "
        "newest), full windows only; batch: the solve with all covariances. Ratios: against ours run just before and after, and "
        "the quickest run of each against the quickest of as many of ours.",
    ]


def cpu():
    """Model name of the processor."""
    with open("/proc/cpuinfo", encoding="ascii") as lines:
        names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]} ({len(names)} threads)" if names else "unknown processor"


def table(entry):
    """One task on one log."""
    rows = [HEADER, ["---"] * len(HEADER)]
    for result in entry.results:
        rows.append([result.contestant.name, *accuracy(result.score), times(result), ratio(result.ratio), ratio(result.ratio_p99),
                     quickest(result)])
    return ["| " + " | ".join(row) + " |" for row in rows]


def accuracy(score):
    """RMS, NEES, share within three sigmas."""
    if not score:
        return ["–", "–", "–"]
    rms = " / ".join(f"{value:.4f}" if value >= 1e-4 else f"{value:.0e}" for value in score["rms_enu"])
    nees = " / ".join(f"{value:.2f}" for value in score["nees_enu"])
    inside = " / ".join(f"{100 * value:.1f}" for value in score["three_sigma_share_enu"])
    return [rms, nees, inside]


def times(result):
    """Median over the runs, µs or ms."""
    return " / ".join(duration(statistics.median(values)) for values in (result.p50, result.p99))


def duration(us):
    """Three digits with a unit that suits."""
    for limit, scale, unit in ((1e3, 1, "µs"), (1e6, 1e3, "ms")):
        if us < limit:
            return f"{us / scale:.3g} {unit}"
    return f"{us / 1e6:.3g} s"


def quickest(result):
    """Of the run that was disturbed least, over that of as many of ours: what others do on the machine only ever adds to a time."""
    return f"{min(result.p50) / min(result.ours_before):.3g}" if result.ours_before else ""


def ratio(values):
    """Median over the runs."""
    return f"{statistics.median(values):.3g}" if values else ""
