"""Measurements of one arm, as a run has made them or a plan states them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..arrays import ByValue, Matrix
from ..instruments.kind import Measurement
from ..kinematics.robot import Robot
from ..parsing.reading import KeyPath
from .header import Header
from .robot_file import require_loadable
from .shot import Shot, ShotRules, target_names
from .whole_file import refuse_existing


@dataclass(frozen=True, eq=False, repr=False)
class Measurements(ByValue):
    """N measurements with what they have in common; equal to others of which header, robot and measurements
    are, wherever they are kept.

    Attributes
    ----------
    header : Header
        What all measurements have in common.
    robot : Robot
        The arm, with n joints.
    shots : tuple of Shot
        (N,) the measurements, in degrees and mm; those of a plan have nothing measured.
    lines
        (N,) where each is in its file; None for those that are in no file.
    path : Path
        The file; the name of measurements that are in none.
    sha256 : str
        Of the file, or of the text that a file would have.
    warnings : tuple of str
        Sentences that a reader must see: a torn last line, joints outside their limits.
    """

    header: Header
    robot: Robot
    shots: tuple[Shot, ...]
    lines: tuple[int | None, ...] = field(compare=False)
    path: Path = field(compare=False)
    sha256: str = field(compare=False)
    warnings: tuple[str, ...] = field(compare=False)

    def __repr__(self) -> str:
        warnings = self.warnings
        more = "" if len(warnings) < 2 else f" ({len(warnings) - 1} more in warnings)"
        # A doubt about the unit is the last.
        end = f"; warning: {warnings[-1]}{more}" if warnings else ""
        return f"<{type(self).__name__} {self.path.name}: {self._content}, {self.robot.name}{end}>"

    @property
    @abstractmethod
    def _content(self) -> str:
        """How many of what, in words."""

    def write(self, path: Path | str, *, force: bool = False) -> Path:
        """Write them to a new file, whole or not at all: a run's .jsonl, a plan's .yaml.

        Parameters
        ----------
        path
            The file; what the header names is relative to its folder.
        force
            A file that is there is replaced.

        Returns
        -------
        Path
            The file. Reading it gives an equal run; the postures of a plan are rounded to 1e-9 degrees (mm).

        Raises
        ------
        BadInput
            The file is there, or it could not be read again: the robot is in no file, say.
        """
        path = Path(path)
        refuse_existing(path, force=force)
        require_loadable(self.robot, self.header.robot, path)
        self._write(path, force=force)
        return path

    @abstractmethod
    def _write(self, path: Path, *, force: bool) -> None: ...

    @cached_property
    def joints(self) -> Matrix:
        """(N, n) joint positions, rad or mm."""
        return np.array([shot.joints_deg for shot in self.shots]) / self.robot.display

    @cached_property
    def targets(self) -> tuple[str | None, ...]:
        """(N,) the target of each; None where its instrument has none."""
        return tuple(shot.target for shot in self.shots)

    @cached_property
    def target_names(self) -> tuple[str, ...]:
        """The targets in the order in which they first appear."""
        return target_names(self.targets)

    @cached_property
    def target_index(self) -> NDArray[np.int64]:
        """(N,) index into `target_names` of each; -1 of one that has no target."""
        index: dict[str | None, int] = {None: -1}
        index |= {name: k for k, name in enumerate(self.target_names)}
        return np.array([index[name] for name in self.targets], dtype=np.int64)

    @cached_property
    def measurements(self) -> tuple[Measurement, ...]:
        """(N,) what each measurement is of, and what was measured: nothing yet, of a plan."""
        return tuple(ShotRules(self.header, self.robot).measurements(self.shots))


def always(line: int | None) -> Callable[[KeyPath], int | None]:
    """All keys are on one line, as those of a line of JSON, or on none."""
    return lambda _: line
