"""Jobs of all importers: header, robot, measurements within limits, sentences on how files were read."""

from __future__ import annotations

import gc
import glob
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...model.arrays import Matrix, Progress
from ...model.errors import BadInput, located
from ...model.files.header import Header, check_header
from ...model.files.joint_values import check_limits, require_degrees
from ...model.files.measurements import read_header
from ...model.files.plan import Plan
from ...model.files.robot_file import load_robot, rebased
from ...model.files.shot import (
    Shot,
    ShotRules,
    check_ties,
    copied_rows,
    copies,
    shot_model,
    target_names,
    unknown_targets,
)
from ...model.kinematics.robot import Robot
from ...model.parsing.reading import KeyPath, read_yaml, real_path
from ...model.parsing.validation import validate


class Imported(NamedTuple):
    """Header and measurements of a run, and sentences that say how the files were understood."""

    header: Header
    shots: list[Shot]
    understood: list[str]


Keys = Mapping[str, Sequence[Any] | Matrix | None]


@dataclass(frozen=True)
class FileMeasurements:
    """The K measurements of one file: `noun` is their name in it ('row', 'dwell', 'point').

    `joints` (K, n) are degrees or mm, joint 3 counted from link 2. `keys` are the other keys of a measurement
    in a run file ("target", "shot": its number, "spot_mm", …): (K,) values of each, None where one has none;
    None where all have none.
    `lines` (K,) of the file, if it is text; `notes` say how it was read.
    """

    path: Path
    noun: str
    joints: Matrix
    keys: Keys
    lines: Sequence[int] | None = None
    notes: Sequence[str] = ()

    @cached_property
    def columns(self) -> dict[str, Sequence[Any]]:
        """The keys that there are, with plain values."""
        return {
            key: values.tolist() if isinstance(values, np.ndarray) else values
            for key, values in self.keys.items()
            if values is not None
        }

    @property
    def targets(self) -> tuple[str, ...]:
        """Those that measurements have, in the order in which they first appear."""
        return target_names(self.columns.get("target", ()))

    def line(self, i: int) -> int | None:
        return None if self.lines is None else self.lines[i]

    def called(self, i: int) -> str:
        return f"{self.noun} {self.line(i) or i + 1} of {self.path.name}"


# Farther from the planned posture is another posture; as near as this is the plan itself.
_NEAR_DEG, _NEAR_MM = 30.0, 300.0
_SAME = 5e-4
_WHOLE_DEG, _FEWEST_WHOLE = 5e-4, 3  # so near to whole degrees, in so many joints, nothing is by chance
_MOST_NAMED = 10
_HALF, _TURN = 180.0, 360.0


@dataclass(frozen=True)
class ImportJob:
    """Files to import, and what is stated about them. `patterns` has how many files each argument stands for.

    `out` is the run file that will be written: the robot's path in its header is relative to it. `names` are
    those of targets. `plan` is the plan that was measured, if it is stated: then it says which posture has
    which target. `progress` gets the stage and the share of the whole.
    """

    paths: tuple[Path, ...]
    patterns: tuple[int, ...]
    header_path: Path
    header: Header
    robot: Robot
    out: Path | str
    names: Sequence[str] = ()
    plan: Plan | None = None
    progress: Progress = lambda stage, share: None

    @classmethod
    def begin(
        cls,
        files: Sequence[Path | str],
        header_or_plan: Path | str | Plan,
        out: Path | str,
        names: Sequence[str] = (),
        progress: Progress = lambda stage, share: None,
    ) -> ImportJob:
        """Read the header file `stated`, or that of the plan that was measured; `names` are those of targets.

        BadInput for the header, without files, or for a duplicate file.

        A file that does not exist and has `*`, `?` or `[` in its name stands for all that match, by name.
        """
        each = [matching(Path(file)) for file in files]
        paths = tuple(path for group in each for path in group)
        if not paths:
            raise BadInput("no file to import is given")
        for i, path in enumerate(paths):
            if real_path(path) in map(real_path, paths[:i]):
                raise BadInput("the file is a duplicate", file=path, remedy="give each file once")
        plan = None
        if isinstance(header_or_plan, Plan):
            plan = header_or_plan
            header_path, header, robot = plan.path, plan.header, plan.robot
        else:
            header_path = Path(header_or_plan)
            header = read_header(header_path)
            robot = load_robot(header.robot, header_path.parent, file=header_path)
            check_header(header, robot, file=header_path, line=read_yaml(header_path).line)
        return cls(paths, tuple(map(len, each)), header_path, header, robot, out, names, plan, progress)

    def targets(self) -> list[str]:
        """The target of each file; where a plan is stated it says so in the end, and names are refused.

        BadInput unless there is one name for each file, or for each pattern.
        """
        names = self.names
        if self.plan is not None:
            if names:
                raise BadInput(
                    "targets are stated, and a plan, which says them itself",
                    found=", ".join(names),
                    remedy="leave out --target, or state --header instead of --plan",
                )
            return [self.plan.called[0]] * len(self.paths)
        if len(names) != len(self.patterns):
            raise BadInput(
                "one target name is required for each file",
                found=f"{len(names)} names, {len(self.patterns)} files",
                remedy="state the target of each file, in the order of the files; names may repeat",
            )
        return [name for name, count in zip(names, self.patterns, strict=True) for _ in range(count)]

    def measured(
        self,
        read: Callable[[Path, str | None], FileMeasurements],
        notes: Sequence[str | None] = (),
        *,
        named: bool = True,
        in_radians: str | None = None,
    ) -> Imported:
        """The measurements of all files, each as `read` (path, target) has them, numbered through.

        `notes` say how all files were read. Unless files are `named` targets are in them. `in_radians` says
        what to state where angles that are stated to be degrees may be radians. BadInput, with file and line,
        for what does not fit; nothing is written.
        """
        parts = []
        targets = self.targets() if named else [None] * len(self.paths)
        with uncollected():
            for k, (path, target) in enumerate(zip(self.paths, targets, strict=True)):
                self.progress(f"file {k + 1}/{len(self.paths)}", k / len(self.paths) / 2)
                with located(path):
                    parts.append(read(path, target))
            self.progress(f"{sum(len(part.joints) for part in parts)} measurements", 0.5)
            if in_radians is not None:
                joints = np.concatenate([part.joints for part in parts])
                require_degrees(self.robot, joints, in_radians, file=parts[0].path)
            return self._finish(parts, [note for note in notes if note])

    def _finish(self, parts: Sequence[FileMeasurements], notes: Sequence[str]) -> Imported:
        robot = self.robot
        parts, wrapped = _within_half_a_turn(parts, robot)
        if self.plan is not None:
            parts = [self._planned(part, self.plan, i) for i, part in enumerate(parts)]
        names = target_names(name for part in parts for name in part.targets)
        check_ties(self.header, names, file=self.header_path, line=None)
        shots: list[Shot] = []
        sentences: list[str] = []
        for part in parts:
            new = self._shots(part, len(shots))
            if self.header.limits == "error":
                self._check_limits(part)
            sentences += [f"{part.path}: {_counted(new, part)}", *part.notes]
            shots += new
        _numbered_once(shots)
        of = copies(shots)
        places = [(part, i) for part in parts for i in range(len(part.joints))] if of else []
        copied = [copied_rows(of, len(shots), lambda i: places[i][0].called(places[i][1]))] if of else []
        kept = [i for i in range(len(shots)) if i not in of]
        shots = [shots[i] for i in kept]
        joints = np.concatenate([part.joints for part in parts])[kept]
        numbers = [shot.shot for shot in shots]
        limits = check_limits(robot, joints, "measurement", numbers, numbers, limits="warn", file=None)
        remarks = [
            *copied,
            *_commanded(robot, joints, numbers),
            *limits,
            *unknown_targets(self.header, names),
        ]
        plural = "s" if len(self.paths) > 1 else ""
        understood = [
            f"{len(self.paths)} file{plural}, {len(shots)} measurements, robot {robot.name}"
            f" ({robot.n} joints)",
            *([] if self.plan is None else [f"postures and targets by the plan {self.plan.path}"]),
            *sentences,
            *notes,
            *wrapped,
            *_ranges_told(robot, joints),
            *(f"note: {sentence}" for sentence in remarks),
        ]
        moved = rebased(self.header.robot, self.header_path.parent, Path(self.out).parent)
        header = self.header.model_copy(update={"robot": moved})
        if self.plan is not None:
            about = {**header.provenance, "plan sha256": self.plan.sha256}
            header = header.model_copy(update={"provenance": about})
        return Imported(header, shots, understood)

    def _planned(self, part: FileMeasurements, plan: Plan, file: int) -> FileMeasurements:
        """The measurements of a file as those of the plan's postures: by their numbers, or in their order."""
        if "shot" not in part.columns and file:
            raise BadInput(
                "measurements without numbers are in several files",
                remedy="state one file, in the plan's order; or --header and --target instead of --plan",
                file=part.path,
            )
        numbers = list(part.columns.get("shot", range(len(part.joints))))
        planned = plan.postures * plan.robot.display
        near = np.where(plan.robot.display > 1, _NEAR_DEG, _NEAR_MM)
        for i, (number, row) in enumerate(zip(numbers, part.joints, strict=True)):
            with located(part.path, part.line(i)):
                if number >= len(planned):
                    raise BadInput(
                        "there are more measurements than the plan has postures",
                        found=f"measurement {number}",
                        allowed=f"0 to {len(planned) - 1}",
                    )
                off = np.abs(row - planned[number])
                joint = int(np.argmax(off / near))
                if off[joint] > near[joint]:
                    raise BadInput(
                        f"measurement {number} is not at the plan's posture {number}",
                        found=f"joint {joint + 1} is {off[joint]:.1f} {plan.robot.joints[joint].unit} off",
                        allowed=f"within {near[joint]:g} {plan.robot.joints[joint].unit}",
                        remedy="import with the plan that was measured; measurements without numbers are in"
                        " the plan's order, and none may be missing",
                    )
        if np.abs(part.joints - planned[numbers]).max() < _SAME:
            raise BadInput(
                "these are the planned postures, not measured ones",
                found=f"no joint differs from the plan by {_SAME:g}",
                allowed="joints recorded with the beam on the target",
                remedy="import what the program recorded, not the program; the beam must be centred first",
                file=part.path,
            )
        means = [plan.means[number]._asdict() for number in numbers] if plan.means else []
        planned_with = {name: [one[name] for one in means] for name in (means or [{}])[0]}
        targets = [plan.targets[number] for number in numbers]
        return replace(part, keys={**planned_with, **part.columns, "shot": numbers, "target": targets})

    def _shots(self, part: FileMeasurements, first: int) -> list[Shot]:
        """Times of several files have no common start: only those of a single file are kept."""
        columns = {"shot": range(first, first + len(part.joints)), **part.columns}
        if len(self.paths) > 1:
            columns.pop("time_s", None)
        name = part.path.name
        if part.lines is not None and name.isprintable() and name == name.lstrip():
            columns["source"] = [f"{name}:{line}" for line in part.lines]
        columns["joints_deg"] = part.joints.tolist()
        shots, rules, model = [], ShotRules(self.header, self.robot), shot_model(self.header)
        sparse = any(None in values for values in columns.values())
        for i, row in enumerate(zip(*columns.values(), strict=True)):
            with located(part.path, part.line(i)):
                content = dict(zip(columns, row, strict=True))
                if sparse:
                    content = {key: value for key, value in content.items() if value is not None}
                shot = validate(model, content, file=None, line=_nowhere)
                rules.check(shot, file=None, line=None)
            shots.append(shot)
        rules.check_postures(shots, part.lines or [None] * len(shots), file=part.path)
        return shots

    def _check_limits(self, part: FileMeasurements) -> None:
        count = len(part.joints)
        lines = part.lines or [0] * count
        numbers = range(1, count + 1)
        with located(part.path):
            check_limits(self.robot, part.joints, part.noun, numbers, lines, limits="error", file=None)


def _within_half_a_turn(
    parts: Sequence[FileMeasurements], robot: Robot
) -> tuple[Sequence[FileMeasurements], list[str]]:
    """Joints that a controller counts from 0 to 360° (Kinova's do), above 180° less a turn, and a sentence on
    them: where the limits of one joint ask for it, or the maker does."""
    joints = np.concatenate([part.joints for part in parts])
    turning = np.array([joint.kind == "revolute" for joint in robot.joints])
    counted = (
        turning & (joints >= 0).all(axis=0) & (joints <= _TURN).all(axis=0) & (joints > _HALF).any(axis=0)
    )
    less = np.where(joints > _HALF, joints - _TURN, joints)
    lower, upper = robot.lower * robot.display, robot.upper * robot.display
    outside = ((joints > upper) | (joints < lower)).any(axis=0)
    inside = ((less <= upper) & (less >= lower)).all(axis=0)
    if not (counted & inside & (outside | (robot.vendor == "kinova"))).any():
        return parts, []
    chosen = counted & inside
    names = ", ".join(str(i + 1) for i in np.flatnonzero(chosen))
    sentence = f"joints counted from 0 to 360°: of joint {names} values above 180° are taken less 360°"
    right = [
        replace(part, joints=np.where(chosen & (part.joints > _HALF), part.joints - _TURN, part.joints))
        for part in parts
    ]
    return right, [sentence]


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


def _nowhere(_: KeyPath) -> None:
    """The line of a value: `_shots` knows that of the whole row."""


def matching(path: Path) -> list[Path]:
    """The file, or those that its name stands for; BadInput without any."""
    if not any(sign in path.name for sign in "*?[") or path.exists():
        return [path]
    paths = sorted(Path(name) for name in glob.glob(str(path)))
    if not paths:
        raise BadInput("no file matches", found=path.name, file=path)
    return paths


def _counted(shots: Sequence[Shot], part: FileMeasurements) -> str:
    """'3 measurements of target 'a', numbered 0 to 2'."""
    names = part.targets
    which = ", ".join(map(repr, names))
    of = f" of target{'s' if len(names) > 1 else ''} {which}" if names else ""
    numbers = [shot.shot for shot in shots]
    return f"{len(shots)} measurements{of}, numbered {min(numbers)} to {max(numbers)}"


def _numbered_once(shots: Sequence[Shot]) -> None:
    twice = [number for number, times in Counter(shot.shot for shot in shots).items() if times > 1]
    if twice:
        raise BadInput(
            "duplicate measurement number",
            found=", ".join(map(str, twice[:10])),
            allowed="each number once, over all files",
            remedy="import without the column of numbers: measurements are then numbered from 0",
        )


def _commanded(robot: Robot, joints: Matrix, numbers: Sequence[int]) -> list[str]:
    """A sentence on the rows of joints (N, n), degrees or mm, in which every joint is a whole degree: no
    encoder reads that."""
    angles = joints[:, [joint.kind == "revolute" for joint in robot.joints]]
    if angles.shape[1] < _FEWEST_WHOLE:
        return []
    rows = np.flatnonzero((np.abs(angles - np.round(angles)) < _WHOLE_DEG).all(axis=1))
    if not len(rows):
        return []
    whole = "all joints are whole degrees. Record what the encoders read at the posture"
    if len(rows) == len(joints):
        return [f"the joints of every measurement look commanded, not read back: {whole}"]
    named = ", ".join(str(numbers[i]) for i in rows[:_MOST_NAMED])
    more = f" and {len(rows) - _MOST_NAMED} more" if len(rows) > _MOST_NAMED else ""
    of, them = ("measurement", "it") if len(rows) == 1 else ("measurements", "them")
    return [f"the joints of {of} {named}{more} look commanded, not read back: {whole}, or remove {them}"]


def _ranges_told(robot: Robot, joints: Matrix) -> list[str]:
    return [
        f"joint {i + 1} ({joint.name}): {joints[:, i].min():.2f} to {joints[:, i].max():.2f} {joint.unit}, "
        f"limits {joint.lower * joint.display:.2f} to {joint.upper * joint.display:.2f}"
        for i, joint in enumerate(robot.joints)
    ]


def without_unused(joints: tuple[float, ...], robot: Robot) -> tuple[float, ...]:
    """Without the zeros at the end, of axes that the robot does not have."""
    return joints if any(joints[robot.n :]) else joints[: robot.n]
