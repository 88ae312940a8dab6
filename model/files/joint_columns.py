"""Columns of a table as joints: which is which, in which unit and with which sign."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from ..arrays import Matrix
from ..errors import BadInput
from ..kinematics.pendant import Pendant, pendant_of
from ..kinematics.robot import J3, PendantUnit, Robot
from ..parsing.reading import did_you_mean, shown
from .text_tables import TextTable

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
        another = set(names) == set(joint_names) and names != joint_names
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
