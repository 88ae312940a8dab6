"""What all importers share: header, robot, shots within limits, and sentences on what was understood."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...model.errors import BadInput
from ...model.files.header import Header, check_header, read_header
from ...model.files.limits import check_limits
from ...model.files.robot_file import load_robot, rebased
from ...model.files.run import Shot, check_distances, check_shot, unknown_targets
from ...model.files.validation import validate
from ...model.robot import Matrix, Robot


class Imported(NamedTuple):
    """What `write_run` needs, and sentences that say how the files were understood."""

    header: Header
    shots: list[Shot]
    understood: list[str]


@dataclass(frozen=True)
class Found:
    """The K shots of one file. `noun` is what they were in it ('row', 'stand', 'point'); `told` is on them.

    `joints` (K, n) are degrees or mm; `lines` (K,) where they stand, if the file is text; `numbers` (K,) are
    the shots' own; `spots` (K, 2) mm; `times` (K,) s since the start of the recording.
    """

    path: Path
    noun: str
    joints: Matrix
    targets: Sequence[str]
    lines: Sequence[int] | None = None
    numbers: Sequence[int] | None = None
    spots: Matrix | None = None
    times: Matrix | None = None
    told: Sequence[str] = ()


@dataclass(frozen=True)
class Job:
    """Files to import, and what is stated about them."""

    paths: tuple[Path, ...]
    header_path: Path
    header: Header
    robot: Robot

    @classmethod
    def begin(cls, files: Sequence[Path | str], header_path: Path | str) -> Job:
        """Read the header; BadInput for it, for no files or for one that is given twice."""
        paths = tuple(Path(file) for file in files)
        header_path = Path(header_path)
        if not paths:
            raise BadInput("there is no file to import")
        for i, path in enumerate(paths):
            if path.resolve() in [other.resolve() for other in paths[:i]]:
                raise BadInput("the file is given twice", file=path, remedy="give each file once")
        header = read_header(header_path)
        robot = load_robot(header.robot, header_path.parent, file=header_path)
        check_header(header, robot, file=header_path, line=lambda _: None)
        return cls(paths, header_path, header, robot)

    def finish(self, found: Sequence[Found], out: Path | str, told: Sequence[str]) -> Imported:
        """The shots of all files, numbered on, within limits; `told` says how the files were read."""
        robot = self.robot
        names = tuple(dict.fromkeys(target for part in found for target in part.targets))
        check_distances(self.header, names, file=self.header_path, line=None)
        shots: list[Shot] = []
        sentences: list[str] = []
        for part in found:
            new = self._shots(part, len(shots))
            if self.header.limits == "error":
                self._check_limits(part)
            sentences += [f"{part.path}: {_counted(new, part)}", *part.told]
            shots += new
        _numbered_once(shots)
        joints = np.concatenate([part.joints for part in found])
        numbers = [shot.shot for shot in shots]
        limits = check_limits(robot, joints, "shot", numbers, numbers, limits="warn", file=None)
        plural = "s" if len(self.paths) > 1 else ""
        understood = [
            f"{len(self.paths)} file{plural}, {len(shots)} shots, robot {robot.name} ({robot.n} joints)",
            *sentences,
            *told,
            *_ranges_told(robot, joints),
            *(f"note: {sentence}" for sentence in (*limits, *unknown_targets(self.header, names))),
        ]
        moved = rebased(self.header.robot, self.header_path.parent, Path(out).parent)
        return Imported(self.header.model_copy(update={"robot": moved}), shots, understood)

    def _shots(self, part: Found, first: int) -> list[Shot]:
        """A clock is that of one file: the times of several have no common start, and are left out."""
        times = part.times if len(self.paths) == 1 else None
        shots = []
        for i, (row, target) in enumerate(zip(part.joints.tolist(), part.targets, strict=True)):
            content = {
                "shot": first + i if part.numbers is None else part.numbers[i],
                "target": target,
                "joints_deg": row,
                "spot_mm": None if part.spots is None else part.spots[i].tolist(),
                "time_s": None if times is None else float(times[i]),
            }
            stated = {key: value for key, value in content.items() if value is not None}
            line = None if part.lines is None else part.lines[i]
            try:
                shot = validate(Shot, stated, file=None, line=lambda _: None)
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


def one_target_each(paths: Sequence[Path], targets: Sequence[str]) -> None:
    """BadInput unless there are as many names as files."""
    if len(targets) != len(paths):
        raise BadInput(
            "one target name is wanted for each file",
            found=f"{len(targets)} names, {len(paths)} files",
            remedy="state the target of each file, in the order of the files; a name may come more than once",
        )


def _counted(shots: Sequence[Shot], part: Found) -> str:
    """'3 shots of target 'a', numbered 0 to 2'."""
    names = list(dict.fromkeys(part.targets))
    plural = "s" if len(names) > 1 else ""
    which = ", ".join(repr(name) for name in names)
    numbers = [shot.shot for shot in shots]
    return f"{len(shots)} shots of target{plural} {which}, numbered {min(numbers)} to {max(numbers)}"


def _numbered_once(shots: Sequence[Shot]) -> None:
    twice = [number for number, times in Counter(shot.shot for shot in shots).items() if times > 1]
    if twice:
        raise BadInput(
            "a shot number stands twice",
            found=", ".join(map(str, twice[:10])),
            allowed="each number once, over all files",
            remedy="import without the column of numbers: then the shots are numbered from 0",
        )


def _ranges_told(robot: Robot, joints: Matrix) -> list[str]:
    return [
        f"joint {i + 1} ({joint.name}): {joints[:, i].min():.2f} to {joints[:, i].max():.2f} {joint.unit}, "
        f"limits {joint.lower * joint.display:.2f} to {joint.upper * joint.display:.2f}"
        for i, joint in enumerate(robot.joints)
    ]
