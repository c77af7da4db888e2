"""Many random worlds through the navigator: is it as right as it says where nobody has tuned it?"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from world import World


def call(ilns, *arguments):
    done = subprocess.run([ilns, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "failed")
    return done.stdout


def score(ilns, log, out, options):
    call(ilns, "replay", log, "--out", out, *options)
    return json.loads(call(ilns, "score", out, "--truth", log / "truth.csv", "--json"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ilns", default="target/release/ilns", help="the program [target/release/ilns]")
    parser.add_argument("--seeds", default="60", help="how many worlds, or which: 60, or 100..160 [60]")
    parser.add_argument("--estimators", default="fgo", help="fgo, ekf, fkf, comma separated [fgo]")
    parser.add_argument("--keep", metavar="DIR", help="keep the logs there")
    arguments = parser.parse_args()
    first, last = (map(int, arguments.seeds.split("..")) if ".." in arguments.seeds else (0, int(arguments.seeds)))
    estimators = arguments.estimators.split(",")
    found = {estimator: [] for estimator in estimators}
    print("| world | what | estimator | RMS horizontal, up, m | NEES e n u | least within 3 sigma, % |")
    print("|---|---|---|---|---|---|")
    for seed in range(first, last):
        world = World(seed)
        with tempfile.TemporaryDirectory() as scratch:
            log = Path(arguments.keep or scratch) / f"world-{seed}"
            if not log.exists():
                world.write(log)
            for estimator in estimators:
                try:
                    result = score(arguments.ilns, log, Path(scratch) / estimator, ["--estimator", estimator])
                except RuntimeError as error:
                    print(f"| {seed} | {world.describe()} | {estimator} | {error} | | |", flush=True)
                    continue
                found[estimator].append(result)
                nees = " ".join(f"{value:.2f}" for value in result["nees_enu"])
                least = 100 * min(result["three_sigma_share_enu"])
                print(f"| {seed} | {world.describe()} | {estimator} | {result['rms_horizontal']:.3f} "
                      f"{result['rms_enu'][2]:.3f} | {nees} | {least:.1f} |", flush=True)
    print()
    for estimator, results in found.items():
        nees = sorted(value for result in results for value in result["nees_enu"])
        if nees:
            outside = sum(min(result["three_sigma_share_enu"]) < 0.95 for result in results)
            print(f"{estimator}: {len(results)} of {last - first} worlds; NEES mean {sum(nees) / len(nees):.2f}, median "
                  f"{nees[len(nees) // 2]:.2f}, largest {nees[-1]:.2f}; {outside} with less than 95 % within 3 sigma")
    return 0


if __name__ == "__main__":
    sys.exit(main())
