"""What all importers share: header, robot, measurements within limits, and how the files were understood."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from ...model.errors import BadInput
from ...model.files.header import Header, check_header, read_header
from ...model.files.limits import check_limits
from ...model.files.reading import Place, read_yaml
from ...model.files.robot_file import load_robot, rebased
from ...model.files.shot import Shot, check_distances, check_shot, unknown_targets
from ...model.files.validation import validate
from ...model.robot import Matrix, Robot

J3 = Literal["ground", "link"]
J3_NOTE = "joint 3 is counted from the ground (FANUC): joint 2 is added to it"


class Imported(NamedTuple):
    """What `write_run` needs, and sentences that say how the files were understood."""

    header: Header
    shots: list[Shot]
    understood: list[str]


@dataclass(frozen=True)
class Found:
    """The K measurements of one file: `noun` is their name in it ('row', 'dwell', 'point').

    `joints` (K, n) are degrees or mm; `lines` (K,) of the file, if it is text; `numbers` (K,) of the
    measurements; `spots` (K, 2) mm; `times` (K,) s since the start of the recording.
    """

    path: Path
    noun: str
    joints: Matrix
    targets: Sequence[str]
    lines: Sequence[int] | None = None
    numbers: Sequence[int] | None = None
    spots: Matrix | None = None
    times: Matrix | None = None
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Job:
    """Files to import, and what is stated about them."""

    paths: tuple[Path, ...]
    header_path: Path
    header: Header
    robot: Robot

    @classmethod
    def begin(cls, files: Sequence[Path | str], header_path: Path | str) -> Job:
        """Read the header; BadInput for it, without files, or for a duplicate file."""
        paths = tuple(Path(file) for file in files)
        header_path = Path(header_path)
        if not paths:
            raise BadInput("no file to import is given")
        for i, path in enumerate(paths):
            if path.resolve() in [other.resolve() for other in paths[:i]]:
                raise BadInput("the file is a duplicate", file=path, remedy="give each file once")
        header = read_header(header_path)
        robot = load_robot(header.robot, header_path.parent, file=header_path)
        check_header(header, robot, file=header_path, line=read_yaml(header_path).line)
        return cls(paths, header_path, header, robot)

    def finish(self, found: Sequence[Found], out: Path | str, notes: Sequence[str]) -> Imported:
        """The measurements of all files, numbered through; `notes` says how the files were read."""
        robot = self.robot
        names = tuple(dict.fromkeys(target for part in found for target in part.targets))
        check_distances(self.header, names, file=self.header_path, line=None)
        shots: list[Shot] = []
        sentences: list[str] = []
        for part in found:
            new = self._shots(part, len(shots))
            if self.header.limits == "error":
                self._check_limits(part)
            sentences += [f"{part.path}: {_counted(new, part)}", *part.notes]
            shots += new
        _numbered_once(shots)
        joints = np.concatenate([part.joints for part in found])
        numbers = [shot.shot for shot in shots]
        limits = check_limits(robot, joints, "measurement", numbers, numbers, limits="warn", file=None)
        plural = "s" if len(self.paths) > 1 else ""
        understood = [
            f"{len(self.paths)} file{plural}, {len(shots)} measurements, robot {robot.name}"
            f" ({robot.n} joints)",
            *sentences,
            *notes,
            *_ranges_told(robot, joints),
            *(f"note: {sentence}" for sentence in (*limits, *unknown_targets(self.header, names))),
        ]
        moved = rebased(self.header.robot, self.header_path.parent, Path(out).parent)
        return Imported(self.header.model_copy(update={"robot": moved}), shots, understood)

    def _shots(self, part: Found, first: int) -> list[Shot]:
        """Times of several files have no common start: only those of a single file are kept."""
        times = part.times if len(self.paths) == 1 else None
        columns = {
            "shot": range(first, first + len(part.joints)) if part.numbers is None else part.numbers,
            "target": part.targets,
            "joints_deg": part.joints.tolist(),
        }
        if part.spots is not None:
            columns["spot_mm"] = part.spots.tolist()
        if times is not None:
            columns["time_s"] = times.tolist()
        shots = []
        for i, row in enumerate(zip(*columns.values(), strict=True)):
            line = None if part.lines is None else part.lines[i]
            try:
                shot = validate(Shot, dict(zip(columns, row, strict=True)), file=None, line=_nowhere)
                check_shot(self.header, self.robot, shot, file=None, line=None)
            except BadInput as error:
                raise error.at(part.path, line) from None
            shots.append(shot)
        return shots

    def _check_limits(self, part: Found) -> None:
        count = len(part.joints)
        lines = part.lines or [0] * count
        numbers = range(1, count + 1)
        try:
            check_limits(self.robot, part.joints, part.noun, numbers, lines, limits="error", file=None)
        except BadInput as error:
            raise error.at(part.path, error.line or None) from None


@contextmanager
def uncollected() -> Iterator[None]:
    """Without the collector of circles: among millions of rows there are none, and it would visit all of them
    again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _nowhere(_: Place) -> None:
    """The line of a value: `_shots` knows that of the whole row."""


def one_target_each(paths: Sequence[Path], targets: Sequence[str]) -> None:
    """BadInput unless there are as many names as files."""
    if len(targets) != len(paths):
        raise BadInput(
            "one target name is required for each file",
            found=f"{len(targets)} names, {len(paths)} files",
            remedy="state the target of each file, in the order of the files; names may repeat",
        )


def _counted(shots: Sequence[Shot], part: Found) -> str:
    """'3 measurements of target 'a', numbered 0 to 2'."""
    names = list(dict.fromkeys(part.targets))
    plural = "s" if len(names) > 1 else ""
    which = ", ".join(repr(name) for name in names)
    numbers = [shot.shot for shot in shots]
    return f"{len(shots)} measurements of target{plural} {which}, numbered {min(numbers)} to {max(numbers)}"


def _numbered_once(shots: Sequence[Shot]) -> None:
    twice = [number for number, times in Counter(shot.shot for shot in shots).items() if times > 1]
    if twice:
        raise BadInput(
            "duplicate measurement number",
            found=", ".join(map(str, twice[:10])),
            allowed="each number once, over all files",
            remedy="import without the column of numbers: measurements are then numbered from 0",
        )


def _ranges_told(robot: Robot, joints: Matrix) -> list[str]:
    return [
        f"joint {i + 1} ({joint.name}): {joints[:, i].min():.2f} to {joints[:, i].max():.2f} {joint.unit}, "
        f"limits {joint.lower * joint.display:.2f} to {joint.upper * joint.display:.2f}"
        for i, joint in enumerate(robot.joints)
    ]


def from_ground(joints: Matrix, robot: Robot) -> Matrix:
    """(N, n) degrees with J3 + J2 in place of J3: FANUC's joint 3 is the angle of link 3 to the horizontal.

    A robot file or URDF wants the angle between the links. The ROS-Industrial FANUC driver adds J2 to J3 for
    arms that are coupled so (J23_factor = 1; fanuc_driver, fanuc_utils.h; issue 17 of fanuc_experimental).
    The signs of J2 and J3 are FANUC's in both.
    """
    if robot.n < 3 or any(joint.kind != "revolute" for joint in robot.joints[1:3]):
        raise BadInput(
            "joint 3 of this robot is not counted from the ground",
            found=f"{robot.name}, whose joints 2 and 3 are not both revolute",
            remedy="state that joint 3 is counted from link 2",
        )
    turned = joints.copy()
    turned[:, 2] += joints[:, 1]
    return turned
