"""One recorded measurement, and what a header and a robot allow of measurements."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, create_model

from ..errors import BadInput
from ..instruments.kind import POINT, Instrument, Measurement
from ..kinematics.robot import Robot
from ..parsing.reading import did_you_mean, shown
from ..parsing.validation import MOST, FileModel, Name, Positive, TargetName, refusal
from .header import Header
from .joint_values import JointValues, check_limits, require_joint_count


def _spot_values(value: object) -> object:
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 2:
        actual = f"{len(value)} values" if isinstance(value, list | tuple) else shown(value)
        raise refusal("spot_mm is not a pair", found=actual, allowed="[dx, dy], millimetres across the beam")
    return tuple(value)


def _reading_values(value: object) -> object:
    """A number, or a list of them as a tuple."""
    values = value if isinstance(value, list | tuple) else [value]
    for i, item in enumerate(values):
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise refusal(
                "a reading is not a number",
                key=(i,) if isinstance(value, list | tuple) else (),
                found=shown(item),
                allowed="a number, or a list of numbers",
                remedy="leave out a measurement that was not fully recorded",
            )
    numbers = tuple(map(float, values))
    return numbers if isinstance(value, list | tuple) else numbers[0]


def _quaternion(value: object) -> object:
    if not isinstance(value, list | tuple) or len(value) != 4:
        actual = f"{len(value)} values" if isinstance(value, list | tuple) else shown(value)
        raise refusal("a quaternion has four numbers", found=actual, allowed="[w, x, y, z]")
    numbers = _reading_values(value)
    assert isinstance(numbers, tuple)
    length = math.hypot(*numbers)
    if not abs(length - 1.0) <= QUATERNION_LENGTH:
        raise refusal(
            "the quaternion is not of length 1",
            found=f"{shown(list(value))}, length {length:.6g}",
            allowed=f"[w, x, y, z] of length 1 within {QUATERNION_LENGTH:g}",
            remedy="export it with more digits, or look whether these are angles",
        )
    return numbers


QUATERNION_LENGTH = 1e-3
_Reading = Annotated[float | tuple[float, ...], BeforeValidator(_reading_values)]
_Quaternion = Annotated[tuple[float, float, float, float], BeforeValidator(_quaternion)]


class Shot(FileModel):
    """One recorded measurement: the joints and what was read there. Without a reading the beam was on its
    target, or the probe in its socket."""

    shot: int = Field(ge=0, le=MOST, description="number of the measurement, unique in its run")
    posture: Annotated[int, Field(ge=0, le=MOST)] | None = Field(
        default=None,
        description="number of the posture, of measurements that were taken in the same one: the errors of"
        " their joints are the same",
    )
    again: Annotated[int, Field(ge=0, le=MOST)] | None = Field(
        default=None,
        description="number of the measurement whose posture is measured here once more: what changes during"
        " a run shows in the difference",
    )
    instrument: Name | None = Field(
        default=None, description="name of the instrument; required where the header states several"
    )
    reflector: Name | None = Field(
        default=None, description="name of the reflector; required where the header states several"
    )
    target: TargetName | None = Field(
        default=None, description="name of the target; required unless the instrument has none"
    )
    joints_deg: JointValues = Field(
        description="recorded joint positions, joint 1 first, degrees (millimetres for a prismatic joint)"
    )
    spot_mm: Annotated[tuple[float, float] | None, BeforeValidator(_spot_values)] = Field(
        default=None,
        description="position of the target's centre relative to the beam, along b1 and b2, millimetres; "
        "without it: on the beam",
    )
    measured_mm: _Reading | None = Field(
        default=None, description="what the instrument read: [x, y, z] or a length, millimetres"
    )
    measured_quat: _Quaternion | None = Field(
        default=None, description="the orientation that it read, [w, x, y, z] of length 1"
    )
    sigma_mm: Positive | None = Field(
        default=None,
        description="standard deviation of this reading, each direction, if not the header's, millimetres",
    )
    time_s: float | None = Field(default=None, description="when, seconds since the start of the run")
    comment: Name | None = Field(default=None, description="what the operator noted; kept, not used")
    source: Name | None = Field(
        default=None, description="where it was imported from, FILE:LINE: reports name it so; not used"
    )

    @property
    def readings(self) -> dict[str, float | tuple[float, ...]]:
        """What the instrument read, as it is recorded, by column."""
        names = _readings_of(type(self))
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @property
    def called(self) -> str:
        """What is measured, in words: its target, reflector and instrument, as far as they are stated."""
        names = (self.target, self.reflector, self.instrument)
        return ", ".join(name for name in names if name is not None)

    @property
    def met_target(self) -> str:
        """The target's name, of a measurement of a laser or a probe."""
        if self.target is None:
            raise BadInput(
                f"measurement {self.shot} has no target", remedy="use measurements of a laser or a probe"
            )
        return self.target


_NO_READING = frozenset(
    (
        "shot",
        "posture",
        "again",
        "instrument",
        "reflector",
        "target",
        "joints_deg",
        "sigma_mm",
        "time_s",
        "comment",
        "source",
    )
)


@cache
def _readings_of(model: type[Shot]) -> tuple[str, ...]:
    return tuple(name for name in model.model_fields if name not in _NO_READING)


def shot_model(header: Header) -> type[Shot]:
    """The model of a header's measurements: `Shot`, with what else its instruments record."""
    columns = {column for kind in header.kinds.values() for column in kind.columns}
    others = tuple(sorted(columns - Shot.model_fields.keys()))
    return _shot_with(others) if others else Shot


@lru_cache(maxsize=16)
def _shot_with(columns: tuple[str, ...]) -> type[Shot]:
    fields: Any = {
        column: (
            (_Quaternion if column.endswith("_quat") else _Reading) | None,
            Field(default=None, description="what the instrument read"),
        )
        for column in columns
    }
    return create_model("Shot", __base__=Shot, **fields)


class ShotRules:
    """What a header and a robot allow of a measurement."""

    def __init__(self, header: Header, robot: Robot) -> None:
        self.robot = robot
        self.targets = header.targets
        self.instruments: dict[str, Instrument] = {
            label: header.made(label, robot.n) for label in header.labels
        }

    def check(self, shot: Shot, *, file: Path | None, line: int | None, planned: bool = False) -> None:
        """BadInput for a measurement with the wrong number of joints, or that its instrument cannot make; of
        one that is `planned` nothing is read yet."""
        called = f"{_noun(planned)} {shot.shot}"
        require_joint_count(shot.joints_deg, self.robot, called, file, line)
        with _called(called, file, line):
            label = self.label(shot.instrument)
            self.variant(label, shot.reflector)
            self._check_target(label, shot.target)
            if not planned:
                self._check_readings(shot, self.instruments[label])

    def label(self, name: str | None) -> str:
        """The label of the instrument that a measurement or posture names, or of the only one."""
        names = list(self.instruments)
        if name is None and len(names) > 1:
            raise BadInput(
                "the key 'instrument' is missing",
                found=f"{len(names)} instruments in the header",
                allowed=", ".join(names),
                remedy="add 'instrument'",
            )
        if name is not None and name not in names:
            raise BadInput(
                "the header states no such instrument",
                found=name,
                allowed=", ".join(names),
                remedy=did_you_mean(name, names),
            )
        return names[0] if name is None else name

    def variant(self, label: str, reflector: str | None) -> str:
        """The variant of an instrument that `reflector` names, or its only one."""
        names = self.instruments[label].variants
        if reflector is None:
            if len(names) > 1:
                raise BadInput(
                    "the key 'reflector' is missing",
                    found=f"{len(names)} reflectors of {label}",
                    allowed=", ".join(names),
                    remedy="add 'reflector'",
                )
            return names[0]
        if reflector not in names:
            named = [name for name in names if name]
            raise BadInput(
                f"the header states no such reflector of {label}",
                found=reflector,
                allowed=", ".join(named) or "no reflector",
                remedy=did_you_mean(reflector, named) or "correct the name, or state the reflector",
            )
        return reflector

    def _check_target(self, label: str, target: str | None) -> None:
        """BadInput for a target that an instrument cannot measure, or where one is missing."""
        kind = type(self.instruments[label])
        kinds = kind.target_kinds()
        if target is None:
            if kinds:
                raise BadInput(
                    "the key 'target' is missing",
                    found=f"a measurement with a {kind.name}",
                    remedy="add 'target'",
                )
            return
        if not kinds:
            raise BadInput(
                f"a {kind.name} measures no target", found=f"target: {target}", remedy="remove 'target'"
            )
        if target in self.instruments:
            raise BadInput(
                "a target is called as an instrument", found=target, remedy="give one of them another name"
            )
        actual = self.targets[target].kind if target in self.targets else POINT
        if actual not in kinds:
            raise BadInput(
                f"a {kind.name} cannot measure a target that is a {actual}",
                found=f"target: {target}",
                allowed=f"kind: {' or '.join(kinds)}",
                remedy=f"state targets.{target}: {{kind: {kinds[0]}, …}}, or name another target",
            )

    def _check_readings(self, shot: Shot, instrument: Instrument) -> None:
        readings, name = shot.readings, instrument.name
        for column in readings:
            if column not in instrument.columns:
                raise BadInput(
                    f"a {name} records no {column}",
                    found=f"{column}: {shown(readings[column])}",
                    allowed=", ".join(instrument.columns) or "no reading",
                    remedy=f"remove {column}, or state the instrument that records it",
                )
        for column, size in instrument.columns.items():
            allowed = f"{column}: {'a number' if size == 1 else f'a list of {size} numbers'}"
            value = readings.get(column)
            if value is None:
                if instrument.met:
                    continue
                raise BadInput(
                    f"the key {column!r} is missing",
                    found=", ".join(readings) or "no reading",
                    allowed=allowed,
                    remedy="leave out a measurement that was not fully recorded",
                )
            if (len(value) if isinstance(value, tuple) else 1) != size or isinstance(value, tuple) == (
                size == 1
            ):
                raise BadInput(
                    f"{column} has not as many numbers as a {name} reads",
                    found=f"{column}: {shown(value)}",
                    allowed=allowed,
                )
        if shot.sigma_mm is not None and not instrument.varies:
            raise BadInput(
                f"a {name} has the same noise in every measurement",
                found=f"sigma_mm: {shot.sigma_mm:g}",
                remedy="remove sigma_mm, and state the noise in the header",
            )

    def measurements(self, shots: Sequence[Shot]) -> Iterator[Measurement]:
        """Each measurement, once it is checked."""
        postures: dict[int, int] = {}
        count = 0
        for shot in shots:
            if shot.posture is None or shot.posture not in postures:
                number, count = count, count + 1
                if shot.posture is not None:
                    postures[shot.posture] = number
            else:
                number = postures[shot.posture]
            label = self.label(shot.instrument)
            variant = self.variant(label, shot.reflector)
            measured = {column: _measured(column, value) for column, value in shot.readings.items()}
            yield Measurement(label, variant, shot.target, measured, shot.sigma_mm, number)

    def check_postures(
        self, shots: Sequence[Shot], lines: Sequence[int | None], *, file: Path | None
    ) -> None:
        """BadInput where measurements that state the same posture cannot have been taken in one."""
        first: dict[int, Shot] = {}
        taken: dict[tuple[int, str, str], Shot] = {}
        aimed: dict[int, Shot] = {}
        copied = copies(shots)
        for i, (shot, line) in enumerate(zip(shots, lines, strict=True)):
            if shot.posture is None or i in copied:
                continue
            one = first.setdefault(shot.posture, shot)
            label = self.label(shot.instrument)
            twin = taken.setdefault((shot.posture, label, self.variant(label, shot.reflector)), shot)
            before = shot if shot.target is None else aimed.setdefault(shot.posture, shot)
            if one.joints_deg != shot.joints_deg:
                j = next(
                    j
                    for j, pair in enumerate(zip(one.joints_deg, shot.joints_deg, strict=True))
                    if pair[0] != pair[1]
                )
                what, actual = (
                    "have other joints",
                    f"joint {j + 1}: {one.joints_deg[j]:g} and {shot.joints_deg[j]:g}",
                )
                other, remedy = one, "give them one posture each, or the same joints"
            elif twin is not shot:
                what, actual = (
                    "are of the same instrument",
                    label + (f", {shot.reflector}" if shot.reflector else ""),
                )
                other, remedy = twin, "remove one of them, or give them one posture each"
            elif before.target != shot.target:
                what, actual = "have different targets", f"{before.target} and {shot.target}"
                other, remedy = before, "correct the target, or give them one posture each"
            else:
                continue
            raise BadInput(
                f"measurements {other.shot} and {shot.shot} state posture {shot.posture}, but {what}",
                found=actual,
                allowed="equal joints, one target, and each instrument and reflector once in a posture",
                remedy=remedy,
                file=file,
                line=line,
            )


@contextmanager
def _called(noun: str, file: Path | None, line: int | None) -> Iterator[None]:
    """Within, a BadInput names the measurement, and its place."""
    try:
        yield
    except BadInput as error:
        raise error.restated(what=f"{noun}: {error.what}", file=file, line=line, argument=None) from None


def _measured(column: str, value: float | tuple[float, ...]) -> tuple[float, ...]:
    numbers = value if isinstance(value, tuple) else (value,)
    if not column.endswith("_quat"):
        return numbers
    length = math.hypot(*numbers)
    return tuple(number / length for number in numbers)


def check_ties(header: Header, targets: Sequence[str], *, file: Path | None, line: int | None) -> None:
    """BadInput for a distance or an angle to a target that no measurement has."""
    pairs = [("a distance", distance.between) for distance in header.distances]
    for what, between in [*pairs, *(("an angle", angle.between) for angle in header.angles)]:
        for name in between:
            if name not in targets:
                raise BadInput(
                    f"{what} names a target that no measurement has",
                    found=name,
                    allowed=", ".join(targets),
                    remedy=did_you_mean(name, targets) or f"correct the name, or take out {what}",
                    file=file,
                    line=line,
                )


def unknown_targets(header: Header, targets: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each name that is only in the header, or only in the measurements."""
    if not header.targets:
        return ()
    names = tuple(header.targets)
    sentences = [
        f"the header states target {name!r}, but no measurement has it"
        for name in names
        if name not in targets
    ]
    for name in targets:
        if name not in names:
            near = did_you_mean(name, names)
            sentences.append(
                f"target {name!r} is not among the header's targets ({', '.join(names)})"
                + (f"; {near}" if near else "")
            )
    return tuple(sentences)


def _noun(planned: bool) -> str:
    return "posture" if planned else "measurement"


def check_shots(
    header: Header,
    robot: Robot,
    shots: Sequence[Shot],
    lines: Sequence[int | None],
    *,
    file: Path | None,
    planned: bool = False,
) -> tuple[str, ...]:
    """Judge measurements against header and robot: BadInput, or the sentences that a reader must see."""
    if not shots:
        raise BadInput("the run has no measurements", file=file, remedy="record some")
    first_line: dict[int, int | None] = {}
    rules = ShotRules(header, robot)
    for shot, line in zip(shots, lines, strict=True):
        rules.check(shot, file=file, line=line, planned=planned)
        if shot.shot in first_line:
            raise BadInput(
                f"duplicate measurement number {shot.shot}",
                found=f"first on line {first_line[shot.shot]}",
                allowed="each number once",
                remedy="remove the wrong measurement, or give it the next number",
                file=file,
                line=line,
            )
        first_line[shot.shot] = line
    rules.check_postures(shots, lines, file=file)
    _check_repeats(robot, shots, lines, file=file, planned=planned)
    limits = check_limits(
        robot,
        np.array([shot.joints_deg for shot in shots]),
        _noun(planned),
        [shot.shot for shot in shots],
        lines,
        limits=header.limits,
        file=file,
    )
    return robot.doubts + limits + unknown_targets(header, target_names(shot.target for shot in shots))


# Of a measurement and its repeat, each turned onto the target: further apart they are two postures.
_ANOTHER_POSTURE = {"revolute": 10.0, "prismatic": 100.0}  # deg, mm


def _check_repeats(
    robot: Robot, shots: Sequence[Shot], lines: Sequence[int | None], *, file: Path | None, planned: bool
) -> None:
    """BadInput for a repeat that is none: what it repeats may be missing from a run, but not from a plan, in
    which the joints are the same too."""
    alike = np.array([0.0 if planned else _ANOTHER_POSTURE[joint.kind] for joint in robot.joints])
    by_number = {shot.shot: shot for shot in shots}
    noun = _noun(planned)
    for shot, line in zip(shots, lines, strict=True):
        if shot.again is None or (shot.again not in by_number and not planned):
            continue
        first, actual = by_number.get(shot.again), f"again: {shot.again}"
        if first is None or first is shot or first.again is not None:
            what = f"{noun} {shot.shot} repeats what is no {noun} of its own"
        elif planned and shot.again > shot.shot:
            what = f"{noun} {shot.shot} repeats a later one"
        elif (first.target, first.instrument, first.reflector) != (
            shot.target,
            shot.instrument,
            shot.reflector,
        ):
            what = f"{noun} {shot.shot} repeats {shot.again}, but measures something else"
            actual = f"{first.called} and {shot.called}"
        elif (off := np.abs(np.subtract(shot.joints_deg, first.joints_deg)) - alike).max() > 0:
            joint = int(np.argmax(off))
            what = f"{noun} {shot.shot} repeats {shot.again}, but has other joints"
            apart, unit = off[joint] + alike[joint], robot.joints[joint].unit
            actual = f"joint {joint + 1} differs by {apart:.6g} {unit}"
        else:
            continue
        raise BadInput(
            what,
            found=actual,
            allowed=f"the number of an earlier {noun} of the same target and instrument, itself no repeat",
            remedy="correct `again`, or leave it out",
            file=file,
            line=line,
        )


def copies(shots: Sequence[Shot]) -> dict[int, int]:
    """Places of measurements whose joints, readings and time are those of an earlier one to the last digit,
    each with the place of that one: copied rows, and no measurements. None where all are of one."""
    first: dict[tuple[object, ...], int] = {}
    result = {}
    for i, shot in enumerate(shots):
        readings = tuple(sorted(shot.readings.items()))
        means = (shot.instrument, shot.reflector, shot.target, shot.sigma_mm, shot.time_s)
        before = first.setdefault((shot.joints_deg, readings, means), i)
        if before != i:
            result[i] = before
    return result if len(first) > 1 else {}


def copied_rows(of: Mapping[int, int], count: int, called: Callable[[int], str]) -> str:
    """A sentence on the copies among `count` measurements; `called` names the one at a place."""
    (copy, original), many = next(iter(of.items())), len(of) > 1
    what = f"{len(of)} of {count} measurements are copies" if many else f"{called(copy)} is a copy"
    example = f"{called(copy)} of {called(original)}" if many else f"of {called(original)}"
    among = f", such as {example}" if many else f" {example}"
    return (
        f"{what}{among}: joints and readings are identical to the last digit. A copy is no measurement: each"
        f" is counted once, {count - len(of)} measurements in all"
    )


def target_names(targets: Iterable[str | None]) -> tuple[str, ...]:
    """The targets in the order in which they first appear."""
    return tuple(dict.fromkeys(target for target in targets if target is not None))
