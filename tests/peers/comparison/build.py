"""What the comparison needs: says what is missing, installs it if asked to, builds."""

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path


class Missing(Exception):
    """Something that has to be installed first, one line each."""


@dataclass(frozen=True)
class Tools:
    """Where everything is."""

    work: Path  # target/peers
    ilns: Path
    ceres: Path | None  # folder of the built programs
    python: Path | None  # interpreter that has gtsam
    gtsam_script: Path


# What has to be there: a test, and the Debian package that brings it.
DEBIAN = [
    ("the Ceres headers", lambda: Path("/usr/include/ceres/ceres.h").exists(), "libceres-dev"),
    ("toml++", lambda: Path("/usr/include/toml++/toml.h").exists(), "libtomlplusplus-dev"),
    ("cmake", lambda: shutil.which("cmake"), "cmake"),
    ("a C++ compiler", lambda: shutil.which("c++"), "g++"),
]
GTSAM = "gtsam==4.3.0"


def prepare(repository, peers, install):
    """Everything built; raises Missing with a line for each thing that is not there."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", repository / "target"))
    work = target / "peers"
    work.mkdir(parents=True, exist_ok=True)
    python = work / "venv" / "bin" / "python"
    lacking = [(what, package) for what, found, package in DEBIAN if "ceres" in peers or "gtsam" in peers if not found()]
    if lacking and install:
        run(["apt-get", "install", "-y", "--no-install-recommends", *[package for _, package in lacking]])
        lacking = []
    problems = [f"{what} is missing: apt-get install {package}" for what, package in lacking]
    if "gtsam" in peers and not has_gtsam(python):
        if install:
            run(["python3", "-m", "venv", str(work / "venv")])
            run([str(python), "-m", "pip", "install", "--quiet", GTSAM, "numpy"])
        else:
            problems.append(f"gtsam is missing: python3 -m venv {work}/venv && {python} -m pip install {GTSAM} numpy")
    if problems:
        raise Missing("\n".join(problems) + "\n(or `python3 tests/peers/run.py --install`, or --without PEER)")
    run(["cargo", "build", "--release", "--bin", "ilns"], cwd=repository)
    # Also for GTSAM alone: carry_keyframes writes the estimates of both peers.
    if peers:
        source = repository / "tests" / "peers" / "ceres"
        run(["cmake", "-S", str(source), "-B", str(work / "ceres"), "-DCMAKE_BUILD_TYPE=Release"], quiet=True)
        run(["cmake", "--build", str(work / "ceres")], quiet=True)
        run([str(work / "ceres" / "check_factors")], quiet=True)
    return Tools(
        work=work,
        ilns=target / "release" / "ilns",
        ceres=work / "ceres" if peers else None,
        python=python if "gtsam" in peers else None,
        gtsam_script=repository / "tests" / "peers" / "gtsam" / "smoother.py",
    )


def has_gtsam(python):
    """Whether that interpreter is there and finds gtsam."""
    return python.exists() and subprocess.run([python, "-c", "import gtsam"], capture_output=True).returncode == 0


def run(command, cwd=None, quiet=False):
    """Runs a command; raises Missing with what it said if it fails."""
    done = subprocess.run(command, cwd=cwd, capture_output=quiet, text=True)
    if done.returncode != 0:
        raise Missing(f"`{' '.join(map(str, command))}` failed" + (f":\n{done.stdout}{done.stderr}" if quiet else ""))
