"""The directory of a campaign of faults: its trials, crashes, samples of memory and runs, a line of JSON each."""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

from eval.analysis.measurements.files import run_of
from eval.bridge.faults.campaign import Trial
from eval.checked import RUN_KINDS, check_values
from eval.kept import MOST_BYTES
from eval.store import Row
from vuca_nav.data_files import parse_json, read_text
from vuca_nav.deploy.manifest import read_manifest
from vuca_nav.deploy.safety.faults import FAULTS
from vuca_nav.errors import BadArgument

FILE = "trials.jsonl"
BUNDLES = "bundles"
"""Directory of the bundle that is deployed."""


class Campaign(NamedTuple):
    """What a directory holds."""

    trials: list[Trial]
    crashes: list[str]
    """Faults in which the deployed stack ended by itself."""
    memory: list[tuple[float, int]]
    """Samples of the deployed stack's memory: time [s] and size [bytes]; a campaign at random has them."""
    loads: list[float]
    """The machine's load average at the end of each trial; those of older campaigns have none."""
    runs: list[Row]
    """Each run of the command, with the robot and the method; those of older campaigns are not known."""


class Keeper:
    """Keeps a campaign in a directory, and goes on with what is there.

    Args:
        directory: The directory.

    Attributes:
        campaign: What there is so far; of the memory only what this process has sampled.
    """

    def __init__(self, directory: Path):
        directory.mkdir(parents=True, exist_ok=True)
        self._path = directory / FILE
        there = _read(self._path) if self._path.exists() else Campaign([], [], [], [], [])
        self.campaign = there._replace(memory=[])

    def note_run(self, command: str, about: Row) -> None:
        """Note that the command runs.

        Args:
            command: The command as typed.
            about: Robot, method and whatever else the trials depend on.
        """
        self._write(run={**run_of(command), **about})

    def add_trial(self, trial: Trial) -> None:
        """Keep what became of a fault."""
        self.campaign.trials.append(trial)
        self._write(trial=trial._asdict(), load=os.getloadavg()[0])

    def add_crash(self, fault: str) -> None:
        """Keep that the deployed stack ended by itself in a fault."""
        self.campaign.crashes.append(fault)
        self._write(crash=fault)

    def add_memory(self, time: float, size: int) -> None:
        """Keep a sample of memory [s, bytes]."""
        self.campaign.memory.append((time, size))
        self._write(memory=(time, size))

    def _write(self, **line: Any) -> None:
        with self._path.open("a") as file:
            file.write(f"{json.dumps(line)}\n")


def is_campaign(directory: Path) -> bool:
    """Whether a directory is that of a campaign of faults."""
    return (directory / FILE).is_file()


def read_campaign(directory: Path) -> Campaign:
    """Read what a directory holds. Robot and commit of older campaigns are those of their bundle.

    Raises:
        BadArgument: The directory holds no campaign, or its robot is not known.
    """
    campaign = _read(directory / FILE)
    if campaign.runs:
        return campaign
    bundles = sorted((directory / BUNDLES).glob("*/manifest.json"))
    if len(bundles) != 1:
        raise BadArgument(f"{directory / FILE} does not say what robot its trials are of, nor does a single bundle")
    manifest = read_manifest(bundles[0].parent)
    made_by = manifest.content.get("made_by", {})
    run = {"robot": manifest.robot, "method": manifest.method}
    return campaign._replace(runs=[run | {name: made_by.get(name) for name in ("commit", "machine")}])


def _read(path: Path) -> Campaign:
    """The lines of a file of trials."""
    campaign = Campaign([], [], [], [], [])
    for number, text in enumerate(read_text(path, BadArgument, MOST_BYTES).splitlines(), start=1):
        wrong = f"{path}: line {number} is not of a campaign of faults"
        line = parse_json(text, wrong, BadArgument)
        if not isinstance(line, dict):
            raise BadArgument(wrong)
        try:
            if "trial" in line:
                campaign.trials.append(Trial(**line["trial"]))
            if "memory" in line:
                time, size = line["memory"]
                campaign.memory.append((float(time), int(size)))
        except (TypeError, ValueError) as error:
            raise BadArgument(wrong) from error
        if "crash" in line:
            campaign.crashes.append(str(line["crash"]))
        if "load" in line:
            campaign.loads.append(float(line["load"]))
        if "run" in line:
            check_values(line["run"], RUN_KINDS, wrong)
            campaign.runs.append(line["run"])
    unknown = {trial.fault for trial in campaign.trials} - FAULTS.keys()
    if unknown:
        raise BadArgument(f"{path} has faults that are unknown: {', '.join(sorted(unknown))}")
    return campaign
