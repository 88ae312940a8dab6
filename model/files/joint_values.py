"""Joint values against a robot: which columns are which joints, their number, its limits, and whether they
are in the stated unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator

from ..arrays import Matrix
from ..errors import BadInput
from ..kinematics import pendant
from ..kinematics.pendant import Pendant, pendant_of
from ..kinematics.plausible import ONE_TURN
from ..kinematics.robot import Robot
from ..options import J3, PendantUnit
from ..parsing.reading import did_you_mean, shown
from ..parsing.validation import refusal
from .text_tables import TextTable, bare_name

# Values recorded at a limit may differ from it by what one conversion between degrees and radians rounds off.
ROUNDING = 1e-6
WIDE = 90.0  # degrees: a joint that can go this far is seldom used within a few degrees of zero only


_PERHAPS_RADIANS = (
    f"radians? all joint angles are within ±{ONE_TURN} degrees, as angles in radians would be; "
    "they were taken as degrees"
)
_NUMBERS = frozenset({float, int})


def _joint_values(value: object) -> object:
    if not isinstance(value, list | tuple) or not value:
        raise refusal(
            "the joints are not a list of numbers", found=shown(value), allowed="[joint 1, joint 2, …]"
        )
    if _NUMBERS.issuperset(map(type, value)):
        return tuple(value)
    for i, item in enumerate(value):
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise refusal(
                f"joint {i + 1} is not a number",
                key=(i,),
                found=shown(item),
                allowed="a number (degrees; mm for a prismatic joint)",
                remedy="leave out a measurement that was not fully recorded",
            )
    return tuple(value)


JointValues = Annotated[tuple[float, ...], BeforeValidator(_joint_values)]


def require_joint_count(
    values: Sequence[float], robot: Robot, what: str, file: Path | None, line: int | None
) -> None:
    """BadInput where `what` ('measurement 3') has not one value for each joint."""
    if len(values) != robot.n:
        raise BadInput(
            f"{what} has the wrong number of joints",
            found=f"{len(values)} values",
            allowed=f"{robot.n} ({robot.name} has {robot.n} joints)",
            file=file,
            line=line,
        )


def beyond_limits(robot: Robot, joints: Matrix) -> NDArray[np.bool_]:
    """Which of joint values (…, n), degrees or mm, are outside the limits."""
    return pendant.beyond_limits(robot, joints / robot.display, ROUNDING / robot.display)


def check_limits(
    robot: Robot,
    joints: Matrix,
    noun: str,
    numbers: Sequence[int],
    lines: Sequence[int | None],
    *,
    limits: Literal["error", "warn"],
    file: Path | None,
) -> tuple[str, ...]:
    """Judge joint values (N, n), degrees or mm; `noun`, `numbers`, `lines` say which row is which.

    A joint outside its limits is BadInput; with `limits` 'warn' it is one sentence for each joint, which
    names all such rows. Values that look like radians, all within limits, are a sentence too.
    """
    outside = beyond_limits(robot, joints)
    if not outside.any():
        return (_PERHAPS_RADIANS,) if like_radians(robot, joints) else ()
    hint = _unit_hint(robot, joints)
    if limits == "error":
        remedy = (
            hint
            or "correct the value; or is it another arm? If this arm was really there, state limits: warn in"
            " the header"
        )
        row, what, value, allowed = _first_outside(robot, joints, outside, noun, numbers)
        raise BadInput(what, found=value, allowed=allowed, remedy=remedy, file=file, line=lines[row])
    warnings = []
    for i in range(robot.n):
        rows = [int(row) for row in np.flatnonzero(outside[:, i])]
        if not rows:
            continue
        limits_met = (pendant.nearest_limit(robot, joints[row] / robot.display, i) for row in rows)
        limit = max(limits_met, key=lambda met: met.excess)
        counting = limit.counting and f", {limit.counting}"
        warnings.append(
            f"joint {i + 1} is outside its limits ({limit.lower:.6g} to {limit.upper:.6g}"
            f" {robot.joints[i].unit}{counting}), up to {limit.value:.6g} {robot.joints[i].unit}, in"
            f" {len(rows)} of {len(joints)} {noun}s: " + ", ".join(str(numbers[row]) for row in rows)
        )
    return (*warnings, hint) if hint else tuple(warnings)


def joint_warnings(robot: Robot, joints: Matrix) -> tuple[str, ...]:
    """The sentences of `check_limits` on joint values (N, n), degrees or mm, that are no measurements."""
    count = len(joints)
    return check_limits(robot, joints, "posture", range(count), [None] * count, limits="warn", file=None)


def check_limits_of_argument(
    robot: Robot,
    joints: Matrix,
    noun: str,
    *,
    unit: Literal["deg", "rad"],
    limits: Literal["error", "warn"],
    argument: str,
) -> None:
    """Judge joint values (N, n), degrees or mm, of a call in Python that states them in `unit`: BadInput for
    one outside its limits, unless `limits` are to warn, and for degrees that are stated to be radians."""
    outside, chosen = beyond_limits(robot, joints), _revolute(robot)
    if not outside.any():
        return
    hint = _unit_hint(robot, joints) if unit == "deg" else None
    as_degrees = (joints / robot.display)[:, chosen]
    wrong = (
        unit == "rad"
        and _far_outside(robot, joints[:, chosen], chosen)
        and _inside(robot, as_degrees, chosen)
    )
    if wrong:
        hint = "unit='rad' is stated; as degrees all values are within the limits: state unit='deg'"
    if wrong or limits == "error":
        remedy = hint or "correct the value; if the arm was really there, state limits='warn'"
        _, what, value, allowed = _first_outside(robot, joints, outside, noun, range(len(joints)), unit)
        raise BadInput(what, found=value, allowed=allowed, remedy=remedy, argument=argument)


def _first_outside(
    robot: Robot,
    joints: Matrix,
    outside: NDArray[np.bool_],
    noun: str,
    numbers: Sequence[int],
    unit: Literal["deg", "rad"] = "deg",
) -> tuple[int, str, str, str]:
    """The first row of joint values (N, n), degrees or mm, that has one `outside`, and what is wrong, found
    and allowed of it, angles in `unit`."""
    row, i = (int(index) for index in np.argwhere(outside)[0])
    joint, limit = robot.joints[i], pendant.nearest_limit(robot, joints[row] / robot.display, i)
    rest = int(outside.any(axis=1).sum()) - 1
    more = "" if rest == 0 else f"; {rest} more like it"
    shown, per = (unit, joint.display if unit == "rad" else 1.0) if joint.kind == "revolute" else ("mm", 1.0)
    return (
        row,
        f"{noun} {numbers[row]}: joint {i + 1} is outside its limits{more}",
        f"{limit.value / per:.6g} {shown}{limit.counting and f', {limit.counting}'}",
        f"{limit.lower / per:.6g} to {limit.upper / per:.6g} {shown} ({robot.name}, {joint.name})",
    )


def _revolute(robot: Robot) -> list[int]:
    return [i for i, joint in enumerate(robot.joints) if joint.kind == "revolute"]


def _inside(robot: Robot, degrees: Matrix, chosen: list[int]) -> bool:
    lower, upper = robot.lower[chosen] * robot.display[chosen], robot.upper[chosen] * robot.display[chosen]
    return bool(np.all((degrees >= lower - ROUNDING) & (degrees <= upper + ROUNDING)))


def _unit_hint(robot: Robot, joints: Matrix) -> str | None:
    """The unit that would bring all revolute joints within their limits, as a question."""
    chosen = _revolute(robot)
    values = joints[:, chosen]
    if not chosen:
        return None
    if np.abs(values).max() <= ONE_TURN and _inside(robot, np.degrees(values), chosen):
        return "radians? read as radians, all values would be within the limits; degrees are wanted"
    if _far_outside(robot, values, chosen) and _inside(robot, np.radians(values), chosen):
        return (
            "degrees, taken for radians? all values are within the limits if they are divided by 57.3: "
            "perhaps they were degrees already (then state deg as their unit), or were converted twice"
        )
    return None


def _far_outside(robot: Robot, degrees: Matrix, chosen: list[int]) -> bool:
    """A single slip also comes back within limits when it is made 57 times smaller; a wrong unit goes far."""
    furthest = np.maximum(np.abs(robot.lower[chosen]), np.abs(robot.upper[chosen])) * robot.display[chosen]
    return bool(np.any(np.abs(degrees) > 3 * furthest))


def like_radians(robot: Robot, joints: Matrix) -> bool:
    """Whether joint values (N, n), degrees or mm, are all so small that they may be radians."""
    chosen = [i for i in _revolute(robot) if np.degrees(robot.upper[i] - robot.lower[i]) > WIDE]
    values = joints[:, chosen]
    return bool(chosen and np.any(values) and np.abs(values).max() <= ONE_TURN)


def require_degrees(
    robot: Robot, joints: Matrix, remedy: str, *, file: Path, line: int | None = None
) -> None:
    """BadInput where joint values (N, n) that are stated to be degrees, or mm, may be radians."""
    if like_radians(robot, joints):
        raise BadInput(
            "the angles look like radians, but degrees are stated",
            found=f"no joint beyond {np.abs(joints).max():.4g}, in {len(joints)} postures",
            allowed="angles in the stated unit",
            remedy=remedy,
            file=file,
            line=line,
        )


_ANGLES = {
    "rad": "angles in radians, converted to degrees",
    "deg": "angles in degrees",
    "pulse": "joints in pulses, converted to degrees by the robot file's pulses_per_deg",
}


@dataclass(frozen=True)
class JointColumns:
    """Joints of a table as they are stated: the column of joint 1, 2, …, the unit (None: not stated), and the
    joints of the other sign. Without `names` the table has the joints alone, in the pendant's order;
    `others`: other columns of it are stated."""

    pendant: Pendant
    names: Sequence[str] | None
    units: PendantUnit | None
    lengths: Literal["mm", "m"] | None = None
    reversed_joints: Sequence[str] = ()
    others: bool = False

    @classmethod
    def of_options(
        cls,
        robot: Robot,
        columns: Sequence[str] | None,
        units: PendantUnit,
        *,
        lengths: Literal["mm", "m"] | None = None,
        reversed_joints: Sequence[str] = (),
        j3: J3 | None = None,
        others: bool = False,
        noun: str = "column",
    ) -> Self:
        """As options state them; `noun` is what joints are called by. BadInput for what no table can have."""
        names = columns_of_joints(columns, robot)
        if units not in _ANGLES:
            raise BadInput(
                "the unit of the angles is not stated", found=shown(units), allowed="deg, rad, pulse"
            )
        if _slides(robot) and units != "pulse" and lengths not in ("mm", "m"):
            raise BadInput(
                "the unit of the prismatic joints is not stated",
                found=f"{robot.name} has prismatic joints",
                allowed="--lengths mm or m",
            )
        if names is not None and (len(names) != robot.n or len(set(names)) != robot.n):
            raise BadInput(
                f"one {noun} is required for each joint",
                found=", ".join(names),
                allowed=f"{robot.n} different ones ({robot.name} has {robot.n} joints)",
            )
        return cls(pendant_of(robot, j3), names, units, lengths, reversed_joints, others)

    @property
    def per_unit(self) -> Matrix:
        """(n,) degrees or mm in one unit of the table; NaN where it is not stated."""
        if self.units == "pulse":
            return 1.0 / self.pendant.per_degree("pulse")
        angle = {"deg": 1.0, "rad": math.degrees(1.0), None: math.nan}[self.units]
        length = {"mm": 1.0, "m": 1000.0, None: math.nan}[self.lengths]
        return np.where([joint.kind == "revolute" for joint in self.pendant.robot.joints], angle, length)

    def read(self, table: TextTable) -> Matrix:
        """(N, n) degrees or mm, joint 3 counted from link 2; BadInput for what is no number, and for a header
        row that says otherwise."""
        if self.names is None:
            columns = self._as_on_pendant(table)
        else:
            columns = [table.column(name) for name in self.names]
        slides = [joint.kind == "prismatic" for joint in self.pendant.robot.joints]
        units = [self.units if self.units == "pulse" or not slide else self.lengths for slide in slides]
        table.require_units(columns, units, "state the unit of the column, or convert the column")
        return self.joints(table.numbers(columns))

    def joints(self, values: Matrix) -> Matrix:
        """The same of values (N, n) as they are in the table, joint 1 first."""
        signs = np.ones(values.shape[1])
        signs[joint_indices(self.reversed_joints, self.pendant.robot)] = -1
        return self.pendant.between_links(values * self.per_unit * signs)

    def _as_on_pendant(self, table: TextTable) -> list[int]:
        """Index of the column of each joint in a table of the joints alone."""
        robot, order, names = self.pendant.robot, self.pendant.order, list(table.names or ())
        joint_names = [robot.joints[i].name for i in order]
        named = [_joint(bare_name(name), robot) for name in names]
        another = set(named) == set(order) and named != order
        if self.others or table.width != robot.n or another:
            raise BadInput(
                "the columns are not just the joints in their order",
                found=", ".join(names) or f"{table.width} columns",
                allowed=f"{robot.n} columns, in the pendant's order ({', '.join(joint_names)})",
                remedy="name the columns of joint 1, 2, … in this order",
                file=table.path,
                line=table.header_line or None,
            )
        return [order.index(i) for i in range(robot.n)]

    @property
    def alone(self) -> bool:
        """Whether the table has nothing but the joints, in the pendant's order."""
        return self.names is None and not self.others

    def sentences(self, head: str = "") -> list[str]:
        """How the joints are understood; `head` says where the rows of the joints alone are."""
        robot = self.pendant.robot
        how = _ANGLES[self.units or "deg"]
        if self.lengths is not None and _slides(robot):
            how += f"; prismatic joints in {self.lengths}"
        if self.names is not None:
            columns = f"columns by name, joint 1 first: {', '.join(self.names)}"
        else:
            plain = self.pendant.order == sorted(self.pendant.order)
            columns = f"columns in file order, {'joint 1 first' if plain else 'as on the pendant'}{head}"
        signs = f"signs reversed: {', '.join(self.reversed_joints)}" if self.reversed_joints else None
        return [sentence for sentence in (how, self.pendant.counting, columns, signs) if sentence]


def _slides(robot: Robot) -> bool:
    return any(joint.kind == "prismatic" for joint in robot.joints)


def columns_of_joints(columns: Sequence[str] | None, robot: Robot) -> Sequence[str] | None:
    """The columns of joint 1, 2, …, in this order, from a list of them or of `column=joint`.

    A joint is named as in the robot file or on the pendant, or j1, j2, …, or by its number. BadInput for a
    joint that is not there, is missing or a duplicate.
    """
    if columns is None or not any("=" in column for column in columns):
        return columns
    pairs = [column.rpartition("=") for column in columns]
    indices = joint_indices([joint.strip() for _, _, joint in pairs], robot, columns)
    column_of = dict(zip(indices, (column.strip() for column, _, _ in pairs), strict=True))
    missing = [joint.name for i, joint in enumerate(robot.joints) if not column_of.get(i)]
    if missing:
        raise BadInput(
            "a joint has no column",
            found=", ".join(columns),
            allowed=f"one column for each of {', '.join(joint.name for joint in robot.joints)}",
            remedy=f"add COLUMN={missing[0]}",
        )
    return [column_of[i] for i in range(robot.n)]


def joint_indices(texts: Sequence[str], robot: Robot, columns: Sequence[str] | None = None) -> list[int]:
    """Indices of the joints that are named, behind which of the `columns`, if they are columns'; BadInput for
    one that is not there, or a duplicate."""
    names = [joint.name for joint in robot.joints]
    indices: list[int] = []
    for text, typed in zip(texts, columns or texts, strict=True):
        index = _joint(text, robot)
        if index is None or index in indices:
            which = "to be reversed" if columns is None else "of a column"
            raise BadInput(
                f"the joint {which} is not understood" if index is None else "duplicate joint",
                found=typed,
                allowed=f"{'' if columns is None else 'COLUMN=JOINT, '}each joint once: {', '.join(names)}"
                f", or j1 to j{robot.n}",
                remedy=did_you_mean(text, names),
            )
        indices.append(index)
    return indices


def _joint(text: str, robot: Robot) -> int | None:
    for names in ([joint.name for joint in robot.joints], robot.conventions.names or ()):
        if text in names:
            return names.index(text)
    digits = text[1:] if text[:1] in ("j", "J") else text
    return int(digits) - 1 if digits.isdecimal() and 1 <= int(digits) <= robot.n else None
