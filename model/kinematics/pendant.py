"""Joints as an arm's pendant and controller count, name and order them, and their limits in that counting.

Inside, joint 3 is the angle between links 2 and 3. Some controllers (FANUC; arms with a parallelogram) count
it from the ground: their joint 3 is that angle less joint 2, and stays as it is when joint 2 alone moves. The
signs of joints 2 and 3 are the controller's in both (ros-industrial/fanuc_driver, fanuc_utils.h, adds J2 to
J3: J23_factor = 1). Such an arm has two ranges: of joint 3 as it is shown, and of the angle between links.
Postures that are spread evenly over ranges keep to both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..arrays import Matrix
from ..errors import BadInput
from ..options import J3, PendantUnit
from ..records import internal, key, record
from .robot import Robot

COUNTED_FROM_GROUND = ("fanuc",)  # vendors whose pendants do so: where nothing is stated, it is asked for
SLACK = 1e-9  # rad or mm by which rounding may take a joint beyond its limit


def beyond_limits(robot: Robot, joints: Matrix, slack: float | Matrix = SLACK) -> NDArray[np.bool_]:
    """Which of joints (…, n), rad or mm, are beyond the limits by more than `slack` (a number, or one for
    each; negative: a margin that is kept): joint 3 also where it is so in the pendant's counting."""
    outside = np.asarray((joints < robot.lower - slack) | (joints > robot.upper + slack))
    if robot.conventions.range3 is not None:
        lower, upper = robot.conventions.range3
        third = joints[..., 2] - joints[..., 1]
        wide = np.broadcast_to(slack, robot.n)[2]
        outside[..., 2] |= (third < lower - wide) | (third > upper + wide)
    return outside


@dataclass(frozen=True)
class Limit:
    """A limit and what is held against it, degrees (mm); `counting` says of what where that is not plain."""

    value: float
    lower: float
    upper: float
    counting: str = ""

    @property
    def excess(self) -> float:
        """By how much the value is beyond it; negative within."""
        return max(self.lower - self.value, self.value - self.upper)


def nearest_limit(robot: Robot, joints: Matrix, i: int) -> Limit:
    """Of joint `i` (from 0) at joints (n,), rad or mm: of its limits the one that is farthest overstepped."""
    display = float(robot.display[i])
    between_links = Limit(
        float(joints[i]) * display, robot.joints[i].lower * display, robot.joints[i].upper * display
    )
    if i != 2 or robot.conventions.range3 is None:
        return between_links
    lower, upper = robot.conventions.range3
    shown = Limit(
        float(joints[2] - joints[1]) * display, lower * display, upper * display, "as the pendant counts it"
    )
    return max(
        shown, replace(between_links, counting="between links 2 and 3"), key=lambda limit: limit.excess
    )


@record
class Pendant:
    """The pendant of a robot; `override` is what --j3 states.

    Joints are (…, n) degrees (mm if prismatic), joint 3 from link 2, joint 1 first, where a method does not
    say otherwise."""

    robot: Annotated[Robot, internal]
    override: Annotated[J3 | None, internal] = None

    def __post_init__(self) -> None:
        if self.joint3 == "ground" and (
            self.robot.n < 3 or any(joint.kind != "revolute" for joint in self.robot.joints[1:3])
        ):
            raise BadInput(
                "joint 3 of this robot is not counted from the ground",
                found=f"{self.robot.name}, whose joints 2 and 3 are not both revolute",
                remedy="state that joint 3 is counted from link 2",
            )

    @property
    @key("what joint 3 is counted from")
    def joint3(self) -> J3:
        return self.override or self.robot.conventions.joint3 or "link"

    @property
    def ground(self) -> bool:
        return self.joint3 == "ground"

    # The counting of joint 3 alone: for the controller's own programs and files

    def counted(self, joints: Matrix) -> Matrix:
        """(…, n) degrees or rad with joint 3 as the controller counts it."""
        return self._with_joint2(joints, -1.0)

    def between_links(self, joints: Matrix) -> Matrix:
        """The same backwards: joint 3 counted from link 2, of joints as the controller counts them."""
        return self._with_joint2(joints, 1.0)

    def _with_joint2(self, joints: Matrix, factor: float) -> Matrix:
        if not self.ground:
            return joints
        changed = joints.copy()
        changed[..., 2] += factor * joints[..., 1]
        return changed

    @property
    @key(
        "by how many times joint 2 each joint, joint 1 first, is less in the pendant's counting than with"
        " joint 3 from link 2"
    )
    def less_joint2(self) -> list[float]:
        """(n,) by how many times joint 2 each joint, joint 1 first, is less as the controller counts it."""
        ones = np.eye(self.robot.n)[1:2]  # joint 2 at one, the others at zero
        return (ones - self.counted(ones))[0].tolist() if self.ground else [0.0] * self.robot.n

    # What a person reads and types: the pendant's counting, order and unit

    def shown(self, joints: Matrix) -> Matrix:
        """(…, n) the values that the pendant shows, in its order."""
        return np.asarray((self.counted(joints) * self._per_degree)[..., self.order])

    def readings(self, joints: Matrix) -> list[tuple[str, float, str]]:
        """Name, value and unit of each joint of one posture (n,) in the pendant's order."""
        return [
            (self.names[i], round(value, 6), self.units[i])
            for i, value in zip(self.order, self.shown(joints).tolist(), strict=True)
        ]

    def read(self, values: Matrix, unit: PendantUnit | None = None) -> Matrix:
        """The joints of values (…, n) in the pendant's order, in `unit` (default: the pendant's)."""
        joints = np.empty_like(values, dtype=float)
        joints[..., self.order] = values
        return self.between_links(joints / self.per_degree(unit))

    def per_degree(self, unit: PendantUnit | None = None) -> Matrix:
        """(n,) what one degree (mm) of each joint is in `unit`; BadInput for pulses that are not stated."""
        unit = unit or self.unit
        if unit == "pulse":
            pulses = self.robot.conventions.pulses_per_deg
            if pulses is None:
                raise BadInput(
                    "the pulses for a degree are not stated",
                    found=f"{self.robot.name}, and values in pulses",
                    remedy="make a robot file that states them, and name it in header and plan"
                    " (robot: mine.yaml): zerobeam robot ROBOT -o mine.yaml --pulses-per-deg P1,P2,…",
                )
            return np.array(pulses)
        return np.ones(self.robot.n) if unit == "deg" else 1.0 / self.robot.display

    @cached_property
    def _per_degree(self) -> Matrix:
        return self.per_degree()

    @property
    @key("that it shows")
    def unit(self) -> PendantUnit:
        return self.robot.conventions.unit

    @property
    def order(self) -> list[int]:
        """Indices of the joints in the order in which the pendant shows them."""
        return list(self.robot.conventions.order or range(self.robot.n))

    @property
    @key("in which it shows the joints, from 1", name="order")
    def numbers(self) -> list[int]:
        return [i + 1 for i in self.order]

    @property
    @key("whether the robot file states `joint3`", name="stated")
    def states_joint3(self) -> bool:
        return self.robot.conventions.joint3 is not None

    @property
    @key("of the joints, joint 1 first")
    def names(self) -> list[str]:
        """What the pendant calls the joints, joint 1 first."""
        return list(self.robot.conventions.names or (f"J{i}" for i in range(1, self.robot.n + 1)))

    @property
    def units(self) -> list[str]:
        """Units of the values, joint 1 first: mm where a joint slides, unless they are pulses."""
        return [
            self.unit if self.unit == "pulse" or joint.kind == "revolute" else "mm"
            for joint in self.robot.joints
        ]

    @property
    def limits(self) -> tuple[Matrix, Matrix]:
        """(n,) lower and upper limits in the controller's counting, degrees (mm), joint 1 first."""
        lower, upper = self.robot.lower.copy(), self.robot.upper.copy()
        range3 = self.robot.conventions.range3
        if self.ground:
            lower[2], upper[2] = range3 or (lower[2] - upper[1], upper[2] - lower[1])
        return lower * self.robot.display, upper * self.robot.display

    @property
    def source(self) -> str:
        """Who says what joint 3 is counted from."""
        of_file = self.robot.conventions.joint3
        if self.override not in (None, of_file):
            return "as --j3 states"
        return f"as the robot file of {self.robot.name} states" if of_file else "as nothing else is stated"

    @property
    def counting(self) -> str | None:
        """What joint 3 is counted from, where it is not from link 2."""
        if not self.ground:
            return None
        return (
            f"joint 3 is counted from the ground, {self.source}: J2 + J3 is the angle between links 2 and 3"
        )

    @property
    def sentence(self) -> str | None:
        """What a reader of the pendant's values must know: None where they are counted in the common way."""
        parts = [] if self.counting is None else [self.counting]
        if self.order != sorted(self.order):
            parts.append("joints are in the pendant's order: " + ", ".join(self.names[i] for i in self.order))
        if self.unit != "deg":
            parts.append(f"values are in {UNITS_IN_WORDS[self.unit]}")
        return "; ".join(parts) or None


UNITS_IN_WORDS: Mapping[PendantUnit, str] = {"deg": "degrees", "rad": "radians", "pulse": "pulses"}


def pendant_of(robot: Robot, j3: J3 | None = None, vendor: str | None = None) -> Pendant:
    """The pendant by `j3`, else by the robot file. BadInput where neither says what joint 3 of an arm is
    counted from whose maker (`vendor`, where the robot file names none) counts it from the ground."""
    maker = robot.vendor or vendor
    if j3 not in (None, "ground", "link"):
        raise BadInput("the reference of joint 3 is not understood", found=j3, allowed="ground, link")
    if j3 is None and robot.conventions.joint3 is None and maker in COUNTED_FROM_GROUND:
        raise BadInput(
            f"what is joint 3 of {robot.name} counted from?",
            found="neither --j3 nor pendant: {joint3: …} in the robot file",
            allowed="--j3 ground: as FANUC's pendants and programs count it; --j3 link: from link 2",
        )
    return Pendant(robot, j3)


def encoder3_of(robot: Robot, vendor: str | None = None) -> J3:
    """What the encoder of joint 3 measures. BadInput where the robot file does not state it and the maker
    (`vendor`, where the robot file names none) counts joint 3 from the ground, or the pendant does."""
    facts, maker = robot.conventions, robot.vendor or vendor
    if facts.encoder3 is None and (facts.joint3 == "ground" or maker in COUNTED_FROM_GROUND):
        raise BadInput(
            "what does the encoder of joint 3 measure?",
            found=f"{robot.name}, whose robot file does not state it",
            allowed="link: the angle between links 2 and 3 (the motor is at the elbow); ground: the direction"
            " of link 3 (a parallelogram)",
            remedy="state encoder: {joint3: link} (or ground) in the robot file",
        )
    return facts.encoder3 or "link"


def require_link_encoder(robot: Robot, what: str) -> None:
    """BadInput for an arm whose offsets `what` cannot hold: those of encoders that measure from the
    ground."""
    if encoder3_of(robot) == "ground":
        raise BadInput(
            f"{what} has no place for an encoder of joint 3 that measures from the ground",
            found=f"{robot.name}: encoder: {{joint3: ground}}",
            allowed="an encoder that measures the angle between links 2 and 3",
            remedy="zerobeam export json has the offsets; that of this encoder is delta3 - delta2",
        )


def within_limits(robot: Robot, joints: Matrix) -> Matrix:
    """Those of joints (N, n) that the arm can take: where joint 3 is counted from the ground its range
    depends on joint 2."""
    return joints if robot.conventions.range3 is None else joints[~beyond_limits(robot, joints).any(axis=1)]


def spread_postures(lower: Matrix, upper: Matrix, count: int) -> Matrix:
    """(count, n) evenly between `lower` and `upper` (n,): Kronecker's sequence with the powers of the root of
    x^(n + 1) = x + 1 (Roberts 2018), which has no seed."""
    return np.asarray(lower + _shares(len(lower), count) * (upper - lower))


@lru_cache(maxsize=16)
def _shares(n: int, count: int) -> Matrix:
    """(count, n) from 0 to 1 of `spread_postures`."""
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (n + 1))
    steps = root ** -np.arange(1.0, n + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
