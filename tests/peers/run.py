#!/usr/bin/env python3
"""The estimator beside its peers: builds them, feeds all the same log directories, prints accuracy and time side by side.

    python3 tests/peers/run.py                     # simulated missions: noise-free, realistic, with outliers
    python3 tests/peers/run.py --log DIR --log DIR # log directories of one's own
    python3 tests/peers/run.py --install           # fetch what is missing first (Debian packages, a virtual environment)

What is compared, and how fair it is, stands in README.md beside this file.
"""

import argparse
import sys
from pathlib import Path

from comparison import build, contestants, logs, measure, report

REPOSITORY = Path(__file__).resolve().parents[2]


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--log", metavar="DIR", type=Path, action="append", default=[],
                        help="a log directory with truth.csv and [initial] in its sensors.toml; may be given several times")
    parser.add_argument("--seeds", metavar="N", type=int, default=1, help="simulated missions of each kind (default 1)")
    parser.add_argument("--windows", metavar="N,N", default="20,200", help="window lengths in keyframes (default 20,200)")
    parser.add_argument("--repeats", metavar="N", type=int, default=3,
                        help="runs of each of the quick contestants, interleaved with ours (default 3)")
    parser.add_argument("--without", metavar="PEER", action="append", default=[], help="ceres or gtsam: leave a peer out")
    parser.add_argument("--install", action="store_true", help="install what is missing (apt-get needs root)")
    parser.add_argument("--markdown", metavar="FILE", type=Path, default=Path(__file__).with_name("results.md"),
                        help="where the report goes (default results.md beside this file)")
    return parser.parse_args()


def main():
    arguments = parse_arguments()
    peers = [name for name in ("ceres", "gtsam") if name not in arguments.without]
    tools = build.prepare(REPOSITORY, peers, arguments.install)
    windows = [int(text) for text in arguments.windows.split(",")]
    cases = [logs.given(path) for path in arguments.log] or logs.simulated(tools, arguments.seeds)
    pairs = [(case, task) for case in cases for task in contestants.tasks(tools, peers, windows, case)]
    rounds = []
    # The quick ones of all logs first; the report grows with each, so that a run that is stopped leaves what it had.
    for case, task in sorted(pairs, key=lambda pair: pair[1].is_slow):
        print(f"{case.name}: {task.title}", file=sys.stderr, flush=True)
        rounds.append(measure.side_by_side(tools, case, task, arguments.repeats))
        arguments.markdown.write_text(report.markdown(REPOSITORY, tools, rounds, sys.argv[1:]))
    print(arguments.markdown.read_text())


if __name__ == "__main__":
    try:
        main()
    except (build.Missing, measure.Failed) as problem:
        print(f"run.py: {problem}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
