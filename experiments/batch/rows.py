"""What is kept of each run of a batch: enough for the tables and the page, of a run that failed why."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Literal

from ...analysis.analyse import Sampling
from ...analysis.status import Status, UnsoundResult, Verdict, known, require_no_more_than, versions
from ...model.files.run import Run
from ...model.kinematics.robot import Robot
from ..source import source_hash

Outcome = Verdict | Literal["failed"]


@dataclass(frozen=True)
class BatchSettings:
    """How all runs of a batch are solved."""

    seed: int
    ess: float
    sampling: Sampling
    report: bool


@dataclass(frozen=True)
class BatchOffset:
    """An offset of a run: no estimate, u and interval where the data do not determine it."""

    name: str
    unit: str
    status: Status
    estimate: float | None
    u: float | None
    interval95: tuple[float, float] | None

    def __post_init__(self) -> None:
        claims = {"u": self.u, "interval95": self.interval95}
        if self.status != "held":
            claims["estimate"] = self.estimate
        require_no_more_than(self.name, self.status, **claims)


@dataclass(frozen=True)
class BatchRow:
    """One run. `outcome` is its verdict, or `failed`: then `message` says why, and there is nothing else.

    `factor` is the root of chi-squared over its degrees of freedom, `p_value` that of the residuals by the
    stated noise (None where it is estimated); `posterior` says what became of it.
    """

    name: str
    file: str
    outcome: Outcome
    message: str
    sha256: str | None = None
    robot: str | None = None
    serial: str | None = None
    when: str | None = None
    measurements: int | None = None
    factor: float | None = None
    p_value: float | None = None
    misfit: tuple[str, ...] = ()
    posterior: str | None = None
    offsets: tuple[BatchOffset, ...] = ()

    def __post_init__(self) -> None:
        if self.outcome == "failed" and self.offsets:
            raise UnsoundResult(f"{self.name!r} failed, yet it has offsets")

    @property
    def worst(self) -> BatchOffset | None:
        """The offset with the largest u, of those that are measured in degrees if any is; None where one of
        them is not determined, or all are held."""
        free = [row for row in self.offsets if row.status != "held"]
        if not free or not all(known(row.status) for row in free):
            return None
        angles = [row for row in free if row.unit == "deg"]
        return max(angles or free, key=lambda row: row.u or 0.0)


@dataclass(frozen=True)
class Finished:
    """A run that is done, and by what that is recognised."""

    key: str
    row: BatchRow


def key_of(run: Run, settings: BatchSettings) -> str:
    """What a result depends on: the run's content, the arm, the settings, the program."""
    content = [
        [run.path.name, run.sha256],
        _arm(run.robot),
        asdict(settings),
        versions(),
        source_hash(),
    ]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


@lru_cache(maxsize=16)
def _arm(robot: Robot) -> str:
    """All numbers of an arm."""
    joints = [
        [joint.name, joint.kind, joint.fixed.tolist(), joint.axis.tolist(), joint.lower, joint.upper]
        for joint in robot.joints
    ]
    return json.dumps([robot.name, robot.vendor, robot.flange.tolist(), joints, asdict(robot.conventions)])
