"""Measurements of one arm, as a run has made them or a plan states them, and their header as it is read."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..arrays import ByValue, Matrix
from ..errors import BadInput
from ..instruments.kind import Measurement
from ..instruments.registry import kind_of
from ..kinematics.robot import Robot
from ..parsing.confinement import TOLERANCES
from ..parsing.reading import KeyPath, read_yaml
from ..parsing.validation import FileModel, Positive, validate
from .header import EXACT, Header, StatedGeometry, StatedSigma, StatedTool, Switch
from .robot_file import load_robot, require_loadable
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


# A header as it is read: as its file states it, with the plant's tolerances where it leaves them out, and
# with the postures of a file of positions.
#
# Tolerances are in the file that the header names (`geometry: {tolerances: …}`), or in that of the
# environment variable ZEROBEAM_TOLERANCES. The header that comes out states all that the file states: a run
# or a result that is written with it means the same at any other plant. What neither states stays assumed.


class PlantLinkTolerance(FileModel):
    """Standard deviations of the link parameters of any arm."""

    length_mm: Positive = Field(default=0.3, description="of each length, millimetres")
    angle_deg: Positive = Field(default=0.1, description="of each angle, degrees")


class PlantToolSigma(FileModel):
    """How far a calibrated tool may be from what is stated of it."""

    mm: Positive = Field(default=0.1, description="of each shift, millimetres")
    tilt_deg: Positive = Field(default=0.05, description="of each tilt of a beam, degrees")


class PlantTolerances(FileModel):
    """What is typical of the arms and tools of a plant: prior standard deviations, as in a header."""

    tolerance: PlantLinkTolerance = Field(
        default=PlantLinkTolerance(), description="of the link parameters, one number for all links"
    )
    gravity: Switch = Field(
        default="auto", description="whether joints deflect under the weight of the links"
    )
    harmonics: Switch = Field(default="auto", description="whether joint readings have a first harmonic")
    gravity_deg: Positive = Field(
        default=0.05, description="of a joint's deflection where the torque is largest, degrees"
    )
    harmonics_deg: Positive = Field(default=0.02, description="of each harmonic, cosine and sine, degrees")
    tool_sigma: PlantToolSigma = Field(
        default=PlantToolSigma(), description="of a calibrated tool, as tool.sigma of a header"
    )


def read_header(path: Path | str) -> Header:
    """Header of a YAML file of its own, for `plan` and the importers."""
    document = read_yaml(Path(path))
    header = validate(Header, document.data, file=document.file, line=document.line)
    return completed(header, document.file.parent, file=document.file, line=document.line)


def completed(
    header: Header,
    folder: Path,
    *,
    robot: Robot | None = None,
    file: Path | None = None,
    line: Callable[[KeyPath], int | None],
) -> Header:
    """The header with the plant's tolerances, if there are any, in place of typical ones that it leaves out,
    and with the postures of the file of positions that it names.

    An exact arm has no tolerances. `folder` is where its paths start; `file` and `line` are where it is
    stated; `robot` is that of the header, if it was loaded already. BadInput where one of the files cannot be
    used.
    """
    if header.workspace.positions is not None:
        arm = robot or load_robot(header.robot, folder, file=file, line=line(("robot",)))
        at = line(("workspace", "positions"))
        workspace = header.workspace.with_postures(arm, folder, file=file, line=at)
        header = header.model_copy(update={"workspace": workspace})
    if header.geometry == EXACT:
        return header
    geometry = header.geometry or StatedGeometry()
    plant = _plant(geometry, folder, file, line)
    if plant is None:
        return header
    explicit = geometry.model_dump(exclude_unset=True, exclude={"tolerances"})
    typical = plant.model_dump(exclude_unset=True, exclude={"tool_sigma"})  # its defaults are nobody's
    tolerance = {**typical.pop("tolerance", {}), **explicit.pop("tolerance", {})}
    links = {"tolerance": tolerance} if tolerance else {}
    merged = StatedGeometry.model_validate({**typical, **explicit, **links})
    update: dict[str, object] = {"geometry": merged}
    if header.tool is not None:
        update["tool"] = _completed(header.tool, plant.tool_sigma)
    if header.instruments:
        update["instruments"] = {
            name: _completed(entry, plant.tool_sigma) if isinstance(entry, StatedTool) else entry
            for name, entry in header.instruments.items()
        }
    return header.model_copy(update=update)


def _plant(
    geometry: StatedGeometry, folder: Path, file: Path | None, line: Callable[[KeyPath], int | None]
) -> PlantTolerances | None:
    if geometry.tolerances is not None:
        try:
            return _read(folder / geometry.tolerances)
        except BadInput as error:
            if error.line is not None:
                raise
            # There is no such file, or no reading it: that is said where it is named.
            at = line(("geometry", "tolerances"))
            raise error.restated(found=geometry.tolerances, file=file, line=at) from None
    path = os.environ.get(TOLERANCES)
    if not path:
        return None
    try:
        return _read(Path(path).expanduser())
    except BadInput as error:
        remedy = f"{error.remedy or 'correct the file'}; the environment variable {TOLERANCES} names it"
        raise error.restated(remedy=remedy) from None


def _read(path: Path) -> PlantTolerances:
    document = read_yaml(path)
    return validate(PlantTolerances, document.data, file=document.file, line=document.line)


def _completed(tool: StatedTool, typical: PlantToolSigma) -> StatedTool:
    """The tool with what is typical where nothing is stated; one that is not calibrated is as it is."""
    if not tool.calibrated:
        return tool
    values = typical.model_dump(exclude_unset=True)
    if not kind_of(tool.kind).beam:
        values.pop("tilt_deg", None)
    if "mm" in values:
        values["shift_mm"] = values.pop("mm")
    if "sigma" in tool.model_fields_set:
        values |= tool.sigma.model_dump(exclude_unset=True)
    return tool.model_copy(update={"sigma": StatedSigma.model_validate(values)}) if values else tool
