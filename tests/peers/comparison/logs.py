"""The log directories that all contestants are fed."""

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

# Kind of mission, and the flags of `ilns simulate` that make it.
KINDS = {
    "noise-free": ["--preset", "none"],
    "realistic": ["--preset", "realistic"],
    "outliers": ["--preset", "realistic", "--fault", "lbl.multipath=0.2", "--fault", "dvl.spikes=0.03,1"],
}


@dataclass(frozen=True)
class Case:
    """One log directory."""

    name: str
    directory: Path
    kind: str


def given(directory):
    """A log directory of the user's."""
    return Case(name=directory.name, directory=directory, kind="given")


def simulated(tools, seeds):
    """The mission of 37 minutes: once noise-free, then `seeds` times realistic and with outliers."""
    cases = []
    for kind, flags in KINDS.items():
        for seed in range(1, (1 if kind == "noise-free" else seeds) + 1):
            name = f"{kind} {seed}"
            directory = tools.work / "logs" / name.replace(" ", "-")
            if not (directory / ".complete").exists():
                shutil.rmtree(directory, ignore_errors=True)
                command = [tools.ilns, "simulate", "mission", *flags, "--seed", str(seed), "--out", directory]
                subprocess.run(command, check=True)
                (directory / ".complete").touch()
            cases.append(Case(name=name, directory=directory, kind=kind))
    return cases
