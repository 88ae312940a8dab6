"""Values that say in Python what a file's header says: tool and noise of a run or plan made from arrays.

They are checked by the models of the files, and their errors name the argument in place of a line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Matrix
from ..errors import BadInput
from ..instruments.flange_tool import LaserBeam, ProbeTip
from ..kinematics.robot import Robot
from ..parsing.reading import KeyPath, did_you_mean
from ..parsing.validation import Model, validate
from .header import Header, StatedNoise, StatedTool, check_header
from .joint_values import check_limits_of_argument
from .measurements import completed
from .robot_file import load_robot

RobotArgument = Robot | str | Path | Mapping[str, str]


@dataclass(frozen=True)
class Laser:
    """A laser on the flange, in the flange frame.

    Parameters
    ----------
    point_mm
        (3,) a point on the beam, mm.
    direction
        (3,) direction of the beam, of any length but 0.
    calibrated
        False: tilts and shifts of the beam are estimated along with the joint offsets.
    tilt_deg, shift_mm
        Prior standard deviations of each tilt (degrees) and shift (mm) of an uncalibrated laser; 3 and 10
        where not stated.

    Raises
    ------
    BadInput
        Names the argument, what was found, and what is allowed.

    Examples
    --------
    >>> import zerobeam as zb
    >>> zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)).calibrated
    True
    """

    point_mm: ArrayLike
    direction: ArrayLike
    calibrated: bool = True
    tilt_deg: float | None = None
    shift_mm: float | None = None

    def __post_init__(self) -> None:
        checked(StatedTool, self.content())

    def content(self) -> dict[str, object]:
        """The header's key `tool`, plain."""
        sigma = _without_none(tilt_deg=self.tilt_deg, shift_mm=self.shift_mm)
        keys = {"point_mm": self.point_mm, "direction": self.direction, "calibrated": self.calibrated}
        return _tool(LaserBeam.name, keys, sigma)


@dataclass(frozen=True)
class Probe:
    """A probe on the flange: its tip is put into a socket, the target.

    Parameters
    ----------
    point_mm
        (3,) the tip in the flange frame, mm.
    calibrated
        False: the tip's place is estimated along with the joint offsets.
    shift_mm
        Prior standard deviation of each coordinate of an uncalibrated tip, mm; 50 where not stated.

    Raises
    ------
    BadInput
        Names the argument, what was found, and what is allowed.

    Examples
    --------
    >>> import zerobeam as zb
    >>> zb.Probe(point_mm=(0, 0, 100), calibrated=False).calibrated
    False
    """

    point_mm: ArrayLike
    calibrated: bool = True
    shift_mm: float | None = None

    def __post_init__(self) -> None:
        checked(StatedTool, self.content())

    def content(self) -> dict[str, object]:
        """The header's key `tool`, plain."""
        keys = {"point_mm": self.point_mm, "calibrated": self.calibrated}
        return _tool(ProbeTip.name, keys, _without_none(shift_mm=self.shift_mm))


@dataclass(frozen=True)
class Noise:
    """Standard deviations of single readings.

    Parameters
    ----------
    joint_deg
        Of a joint reading: one number for all revolute joints, degrees; or (n,) one for each joint, degrees
        (mm for a prismatic joint).
    spot_mm
        Of a spot reading, or of the ball in its socket, in each direction, mm; a laser or a probe requires
        it.
    joint_mm
        Of a prismatic joint's reading, mm, where `joint_deg` is one number.
    scale
        "known"; "estimated": right up to one common factor; "separate": up to one factor for the joints and
        one for the spot.
    plausible_factor
        An estimated factor above this, or below 1 over it, is a misfit and not noise; above 1.

    Raises
    ------
    BadInput
        Names the argument, what was found, and what is allowed.

    Examples
    --------
    >>> import zerobeam as zb
    >>> zb.Noise(joint_deg=0.01, spot_mm=0.05).scale
    'known'
    """

    joint_deg: ArrayLike
    spot_mm: float | None = None
    joint_mm: float | None = None
    scale: Literal["known", "estimated", "separate"] = "known"
    plausible_factor: float = 3.0

    def __post_init__(self) -> None:
        checked(StatedNoise, self.content())

    def content(self) -> dict[str, object]:
        """The header's key `noise`, plain."""
        keys = _without_none(joint_deg=self.joint_deg, joint_mm=self.joint_mm, spot_mm=self.spot_mm)
        if self.scale != "known":
            keys["scale"] = plain(self.scale)
        if self.plausible_factor != 3.0:
            keys["plausible_factor"] = plain(self.plausible_factor)
        return keys


def checked(model: type[Model], content: object, arguments: Mapping[str, str] | None = None) -> Model:
    """`content` as the model of a file's part; BadInput names the argument in place of a line.

    `arguments` are those that are called otherwise than the key of the file.
    """
    argument: str | None = None

    def no_line(key: KeyPath) -> None:
        nonlocal argument
        names = [str(part) for part in key if part != "sigma"]  # its keys are arguments of their own
        argument = (arguments or {}).get(names[0], names[0]) if names else None

    try:
        return validate(model, content, file=None, line=no_line)
    except BadInput as error:
        raise error if argument is None else error.of_argument(argument) from None


def plain(value: Any) -> Any:
    """The same in the types that a file has: numbers, text, lists and mappings."""
    if isinstance(value, Laser | Probe | Noise):
        return value.content()
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def _without_none(**values: Any) -> dict[str, object]:
    """The values that are not None, in the types that a file has."""
    return {name: plain(value) for name, value in values.items() if value is not None}


def _tool(kind: str, keys: Mapping[str, Any], sigma: Mapping[str, Any]) -> dict[str, object]:
    """The header's key `tool`, which has no empty `sigma`."""
    content: dict[str, object] = plain({"kind": kind, **keys, **({"sigma": sigma} if sigma else {})})
    return content


def stated_header(
    robot: RobotArgument,
    tool: Laser | Probe | None,
    instruments: Mapping[str, Mapping[str, Any]] | None,
    noise: Noise,
    target_priors: Mapping[str, Mapping[str, Any]] | None,
    others: Mapping[str, Any],
) -> tuple[Header, Robot]:
    """The header that the arguments of `from_arrays` state, and its robot; BadInput names the argument."""
    keys: dict[str, object] = {"noise": noise, **others}
    if tool is not None or instruments is None:
        keys["tool"] = tool
    if instruments is not None:
        keys["instruments"] = instruments
    if target_priors is not None:
        keys["targets"] = target_priors
    ref = robot.name if isinstance(robot, Robot) else str(robot) if isinstance(robot, Path) else robot
    for argument, value, kinds in (("tool", tool, (Laser, Probe)), ("noise", noise, (Noise,))):
        if argument in keys and not isinstance(value, (*kinds, Mapping)):
            allowed = " or ".join(f"zerobeam.{kind.__name__}(…)" for kind in kinds)
            raise BadInput("this cannot be used", found=repr(value), allowed=allowed, argument=argument)
    header = checked(Header, plain({"robot": ref, **keys}), {"targets": "target_priors"})
    try:
        arm = robot if isinstance(robot, Robot) else load_robot(header.robot)
    except BadInput as error:
        raise error.of_argument("robot") from None
    culprit = "noise"

    def no_line(key: KeyPath) -> None:
        nonlocal culprit
        culprit = str(key[0])

    try:
        header = completed(header, Path("."), robot=arm, line=no_line)
    except BadInput as error:
        if header.workspace.positions is None or error.file is not None:
            raise
        raise error.of_argument("workspace") from None
    try:
        check_header(header, arm, file=None, line=no_line)
    except BadInput as error:
        raise error.of_argument(culprit) from None
    return header, arm


def joint_positions(
    value: ArrayLike,
    argument: str,
    robot: Robot,
    unit: str | None,
    *,
    noun: str,
    limits: Literal["error", "warn"],
) -> Matrix:
    """`value` (N, n) in `unit` as degrees, mm for prismatic joints; BadInput names the argument.

    A row is called by `noun`. Outside the robot's limits is BadInput too, unless `limits` are to warn."""
    if unit is None:
        raise BadInput(
            f"the unit of the {argument} is not stated",
            allowed="unit='deg' or unit='rad'",
            remedy="state the unit in which the positions were recorded",
            argument="unit",
        )
    if unit not in ("deg", "rad"):
        raise BadInput("there is no such unit", found=repr(unit), allowed="'deg' or 'rad'", argument="unit")
    positions = array(value, argument, columns=robot.n, meaning=f"{robot.name} has {robot.n} joints")
    degrees = positions * robot.display if unit == "rad" else positions
    angle: Literal["deg", "rad"] = "rad" if unit == "rad" else "deg"
    check_limits_of_argument(robot, degrees, noun, unit=angle, limits=limits, argument=argument)
    return degrees


def require_arguments(function: Callable[..., object], header: Mapping[str, object]) -> None:
    """BadInput where one of the further arguments `header` of a function is no key of a header."""
    arguments = [name for name, one in signature(function).parameters.items() if one.kind is one.KEYWORD_ONLY]
    allowed = [*arguments, *(key for key in Header.model_fields if key not in (*arguments, "schema_"))]
    for name in header:
        if name not in allowed:
            raise BadInput(
                "there is no such argument",
                found=name,
                allowed=", ".join(allowed),
                remedy=did_you_mean(name, allowed),
                argument=name,
            )


def target_of_each(
    targets: str | Sequence[str | None] | None, header: Header, count: int, rows: str
) -> list[str | None]:
    """N names, one for each row of the argument `rows`; by default all are of the header's only target, or
    of none where no instrument has one."""
    if targets is None and not any(kind.target_kinds() for kind in header.kinds.values()):
        return [None] * count
    if targets is None:
        if len(header.targets) > 1:
            raise BadInput(
                "there are several targets, and it is not stated which measurement is of which",
                found=", ".join(header.targets),
                allowed="the name of its target for each measurement",
                argument="targets",
            )
        targets = header.only_target
    if isinstance(targets, str):
        return [targets] * count
    try:
        names: list[str | None] = plain(list(targets))
    except TypeError:
        raise BadInput(
            "these are not names", found=repr(targets), allowed="a list of names", argument="targets"
        ) from None
    require_count("targets", len(names), count, rows)
    return names


def measured_of_each(
    measured: Mapping[str, Sequence[Any] | ArrayLike] | None, count: int
) -> list[dict[str, object]]:
    """For each of N measurements the keys of a file that the argument `measured` states of it."""
    rows: list[dict[str, object]] = [{} for _ in range(count)]
    for key, values in (measured or {}).items():
        try:
            items = plain(list(values))  # type: ignore[arg-type]
        except TypeError:
            raise BadInput(
                f"{key} is not a list",
                found=type(values).__name__,
                allowed="one value for each measurement",
                argument="measured",
            ) from None
        require_count("measured", len(items), count, "joints")
        for row, item in zip(rows, items, strict=True):
            if item is not None:
                row[key] = item
    return rows


def require_count(argument: str, actual: int, count: int, rows: str) -> None:
    """BadInput where an argument has not as many rows as the argument `rows`."""
    if actual != count:
        raise BadInput(
            f"there are not as many rows as in {rows}", found=actual, allowed=count, argument=argument
        )


def array(value: ArrayLike, argument: str, *, columns: int, meaning: str) -> Matrix:
    """`value` as (N, columns) finite numbers; BadInput names the argument."""
    allowed = f"an array of shape (N, {columns}): {meaning}"
    try:
        result = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise BadInput(
            "this is not an array of numbers",
            found=type(value).__name__,
            allowed=allowed,
            argument=argument,
        ) from None
    if result.ndim != 2 or result.shape[1] != columns:
        raise BadInput(
            "the array has the wrong shape", found=result.shape, allowed=allowed, argument=argument
        )
    if not np.isfinite(result).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(result))[0])
        raise BadInput(
            "a number is not finite",
            found=f"{result[row, column]} in row {row}, column {column}",
            allowed="finite numbers",
            remedy="leave out the measurements that were not fully recorded",
            argument=argument,
        )
    return result
