"""The algebra of a conversion: where an arm's joints go, and with them each position.

keep: zeros were entered, so that the arm has other readings at the same place: q' = q + entered, whatever the
zeros are worth. A pose is written anew as pose' = F⁻¹ B FK(q') T with q = IK(B⁻¹ F pose T⁻¹), by the nominal
arm, for the controller computes with it (B base, F frame, T tool). reach: nothing was entered; q' are the
joints at which the true arm is where the nominal one is at q. Only a pose can mean a place of the
nominal arm: positions in joints were taught on the true one, and stay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import load_robot
from ...model.kinematics.inverse import Branch, Branches, Solver, is_singular, reach
from ...model.kinematics.pendant import Pendant, beyond_limits, nearest_limit
from ...model.kinematics.robot import Robot, same_arm, shift
from .position import NotConvertible, PositionLanguage, TaughtPosition

LEAST_J5 = 0.5  # deg: nearer to zero, joints 4 and 6 are not determined by a pose
_FLANGE_OF_IRB1600 = 65.0  # mm
_CLEAR = 2.0  # the nearest joints are taken if the next are so many times as far
_SAME_TURN = 1e-6  # deg
_MOST_FOUND = 2  # configurations that are named


def up_to_flange(robot: Robot, nominal: Robot) -> Robot:
    """The arm up to what its controller calls the flange: that of the paper ends at the wrist's centre."""
    if not same_arm(nominal, load_robot("irb1600")):
        return robot
    return replace(robot, flange=robot.flange @ shift(z=_FLANGE_OF_IRB1600))


@dataclass(frozen=True, eq=False)
class PositionFrames:
    """What a pose is of: (4, 4) the base of the arm and the frame in the world, the tool in the flange."""

    base: Matrix
    frame: Matrix
    tool: Matrix

    def flange(self, pose: Matrix) -> Matrix:
        """(4, 4) of the flange in the arm's base, of a pose."""
        return np.asarray(np.linalg.solve(self.base, self.frame @ pose @ np.linalg.inv(self.tool)))

    def pose(self, flange: Matrix) -> Matrix:
        """The reverse."""
        return np.asarray(np.linalg.solve(self.frame, self.base @ flange @ self.tool))


@dataclass(frozen=True, eq=False)
class MovedPosition:
    """Joints before and after, degrees (mm) with joint 3 from link 2, and numbers to be written;
    `uncertainty_mm` is U (k = 2) of the tool's place, None where it is not known or not at stake."""

    before: Matrix
    after: Matrix
    values: tuple[float, ...]
    configuration: tuple[str, ...]
    moved_mm: float
    uncertainty_mm: float | None = None


@dataclass(frozen=True, eq=False)
class ArmChange:
    """The `robot` as its controller computes, up to the flange; `change` and `undo` take joints to those that
    are to be written and back, degrees (mm). `poses_only`: positions in joints stay. `place_uncertainty` is U
    (P,) mm of points (P, 3) of the flange at joints (P, n), rad or mm, NaN where it is not known."""

    robot: Robot
    language: PositionLanguage
    pendant: Pendant
    change: Callable[[Matrix], Matrix]
    undo: Callable[[Matrix], Matrix]
    near: Matrix | None = None
    poses_only: bool = False
    place_uncertainty: Callable[[Matrix, Matrix], Matrix] | None = None

    @cached_property
    def solver(self) -> Solver:
        return Solver(self.robot)

    @cached_property
    def branches(self) -> Branches | None:
        branches = Branches(self.robot, self.language.up, self.language.by_joint2)
        return branches if branches.exist else None

    def moved(
        self,
        one: TaughtPosition,
        old: PositionFrames,
        new: PositionFrames,
        near: TaughtPosition | None = None,
    ) -> MovedPosition:
        """A position with the tool and frame that it was taught with, for those that it will be used with;
        `near` is the position in joints that it is next to."""
        if one.kind == "joints":
            before = self.joints_of(one.values, one.axes)
            after = self.change(before)
            self._require_reachable(before, after, one.axes)
            flanges = self.robot.fk(np.array([before, after]), "deg")
            return MovedPosition(
                before, after, self.values_of(after, one.axes), (), _apart(flanges, old.tool)
            )
        pose = self.language.pose(one.values)
        start = self.near if near is None else self.joints_of(near.values, near.axes)
        before = self.joints_at(old.flange(pose), one.configuration, start)
        after = self.change(before)
        self._require_reachable(before, after)
        self._require_regular(before, after)
        flanges = self.robot.fk(np.array([before, after]), "deg")
        values = tuple(map(float, self.language.pose_numbers(new.pose(flanges[1]))))
        configuration = one.configuration
        if self.branches is not None and configuration:
            branch = self.branches.of(after)
            if not self.language.matches(configuration, branch, after):
                configuration = tuple(self.language.configuration(configuration, branch, after))
        moved_mm, uncertainty = _apart(flanges, old.tool), None
        if self.place_uncertainty is not None:
            rows = (after / self.robot.display)[None], new.tool[:3, 3][None]
            uncertainty = float(self.place_uncertainty(*rows)[0])
            uncertainty = None if np.isnan(uncertainty) else uncertainty
        return MovedPosition(before, after, values, configuration, moved_mm, uncertainty)

    # Joints of positions

    def joints_of(self, values: Sequence[float], axes: Sequence[int]) -> Matrix:
        """(n,) degrees (mm) of numbers of a language; axes that are not stated are zero."""
        if any(axis >= self.robot.n for axis in axes):
            raise NotConvertible(f"it has {max(axes) + 1} axes, and the arm has {self.robot.n}")
        if len(axes) < self.robot.n and self.pendant.ground:
            raise NotConvertible("joints 2 and 3 are counted together, and it does not state all joints")
        joints = np.zeros(self.robot.n)
        joints[list(axes)] = values
        return self.pendant.between_links(joints / self.pendant.per_degree(self.language.unit))

    def values_of(self, joints: Matrix, axes: Sequence[int]) -> tuple[float, ...]:
        """The reverse."""
        values = self.pendant.counted(joints) * self.pendant.per_degree(self.language.unit)
        return tuple(values[list(axes)].tolist())

    def joints_at(self, flange: Matrix, configuration: Sequence[str], near: Matrix | None = None) -> Matrix:
        """(n,) degrees (mm) by which the nominal arm has its flange there with the stated configuration, the
        nearest to joints that are stated."""
        rows = self._solutions(flange, configuration, near)
        if not len(rows):
            if alternatives := self._in_other_configurations(flange, configuration):
                raise NotConvertible(
                    f"joints reach it, but none with the stated configuration ({', '.join(configuration)}):"
                    f" found are {alternatives}"
                )
            what = f" with the stated configuration ({', '.join(configuration)})" if configuration else ""
            raise NotConvertible(
                f"no joints within the limits reach it{what}: is it of this arm, tool, frame?"
            )
        apart = [
            row for row in rows[1:] if not self.solver.same(self._internal(rows[0]), self._internal(row))
        ]
        if near is None and apart:
            raise NotConvertible(
                "several sets of joints reach it, and nothing says which: state --near J1,J2,…"
            )
        if near is None:  # the turns that are farthest from the limits
            return np.asarray(rows[np.argmin(np.abs(rows).max(axis=1))])
        distance = np.abs(rows - near).max(axis=1)
        nearest = rows[np.argmin(distance)]
        others = [np.abs(row - near).max() for row in rows if np.abs(row - nearest).max() > _SAME_TURN]
        if others and min(others) < _CLEAR * distance.min():
            raise NotConvertible("two sets of joints are about as near to those that are stated (--near)")
        return np.asarray(nearest)

    def _in_other_configurations(self, flange: Matrix, configuration: Sequence[str]) -> str:
        """Those by which the arm has its flange there, with joints of each; empty where nothing is known of
        them."""
        if self.branches is None or not configuration:
            return ""
        joints_by_words: dict[str, str] = {}
        for row in sorted(self._solutions(flange, (), None), key=lambda row: float(np.abs(row).max())):
            try:
                words = self.language.configuration(configuration, self.branches.of(row), row)
            except NotConvertible:  # its words are not written
                return ""
            joints_by_words.setdefault(", ".join(words), ", ".join(f"{value:.1f}" for value in row))
        shown = [f"{words} (joints {joints})" for words, joints in joints_by_words.items()][:_MOST_FOUND]
        more = len(joints_by_words) - len(shown)
        return "; ".join(shown) + (f"; {more} more" if more > 0 else "")

    def _solutions(self, flange: Matrix, configuration: Sequence[str], near: Matrix | None) -> Matrix:
        """Those from many starts, and that from the joints nearby, which many starts may miss."""
        by_configuration = bool(configuration) and self.branches is not None
        rows = np.empty((0, self.robot.n))
        for thorough in (False, True):
            solutions = [*self.solver.solutions(flange, thorough=thorough)]
            if near is not None:
                beside, arrived = reach(self.robot, flange, self._internal(near)[None])
                known = any(self.solver.same(beside[0], each) for each in solutions)
                solutions += [beside[0]] if arrived[0] and not known else []
            every = [row * self.robot.display for each in solutions for row in self.solver.with_turns(each)]
            kept = [row for row in every if not by_configuration or self._has(configuration, row)]
            rows = np.array(kept).reshape(-1, self.robot.n)
            if len(rows):
                break
        return rows

    def _has(self, configuration: Sequence[str], joints: Matrix) -> bool:
        branch = self.branch(joints)
        return branch is not None and self.language.matches(configuration, branch, joints)

    def branch(self, joints: Matrix) -> Branch | None:
        return None if self.branches is None else self.branches.of(joints)

    def _internal(self, joints: Matrix) -> Matrix:
        return np.asarray(joints / self.robot.display)

    # What is refused

    def _require_reachable(self, before: Matrix, after: Matrix, axes: Sequence[int] | None = None) -> None:
        judged = range(self.robot.n) if axes is None else axes
        for what, joints in (("", before), ("once converted ", after)):
            inside = self._internal(joints)
            beyond = [i for i in np.flatnonzero(beyond_limits(self.robot, inside)).tolist() if i in judged]
            if beyond:
                limit = nearest_limit(self.robot, inside, beyond[0])
                raise NotConvertible(
                    f"{what}joint {beyond[0] + 1} is at {limit.value:.3f}, beyond its limits"
                    f" ({limit.lower:.5g} to {limit.upper:.5g})"
                )

    def _require_regular(self, before: Matrix, after: Matrix) -> None:
        if self.branch(before) != self.branch(after):
            raise NotConvertible("the arm would reach it in another configuration")
        if self.language.unpublished and _sides_of_wrist(before) != _sides_of_wrist(after):
            raise NotConvertible(
                "joint 4 passes a quarter turn, or a joint half a turn, once converted: what the words of its"
                " configuration say there is not published"
            )
        least = max(LEAST_J5, 2 * float(np.abs(after - before)[4:5].max(initial=0.0)))
        if self.robot.n == 6 and min(abs(_folded(before[4])), abs(_folded(after[4]))) < least:
            raise NotConvertible(
                f"joint 5 is at {before[4]:.3f} deg, nearer to zero than {least:.3g}: its pose does not say"
                " where joints 4 and 6 are; teach it again"
            )
        if is_singular(self.robot, self._internal(before)) or is_singular(self.robot, self._internal(after)):
            raise NotConvertible(
                "the arm is at a singularity there: its pose does not say where all joints are"
            )


def _sides_of_wrist(joints: Matrix) -> list[float]:
    """On which side of 90 degrees joint 4 is, of half a turn each."""
    return [*np.floor((joints + 180) / 360).tolist(), *np.floor((joints[3:4] + 90) / 180).tolist()]


def _folded(angle: float) -> float:
    """The angle from the nearest multiple of 180 degrees, where an axis folds or stretches."""
    return float((angle + 90) % 180 - 90)


def _apart(flanges: Matrix, tool: Matrix) -> float:
    """mm between the tool's places at two flanges (2, 4, 4)."""
    places = flanges @ tool
    return float(np.linalg.norm(places[1, :3, 3] - places[0, :3, 3]))


def kept(entered: Matrix) -> tuple[Callable[[Matrix], Matrix], Callable[[Matrix], Matrix]]:
    """The change of joints by zeros that were entered, (n,) degrees (mm), and its reverse."""
    return (lambda joints: joints + entered), (lambda joints: joints - entered)


_FAR, _BENT = 5.0, 6  # deg (mm); steps by which a deflection of 0.1 deg is left out to 1e-9


def reached(
    nominal: Robot, true: Robot, offsets: Matrix, bending: Callable[[Matrix], Matrix]
) -> tuple[Callable[[Matrix], Matrix], Callable[[Matrix], Matrix]]:
    """The change of joints for an arm that is `true` to the run: its flange comes to where the `nominal` one
    is at the joints. `offsets` (n,) rad or mm are those of its joints, `bending` what gravity and harmonics
    add at commanded joints (n,)."""
    display = nominal.display

    def near(robot: Robot, flange: Matrix, start: Matrix) -> Matrix:
        joints, arrived = reach(robot, flange, start[None])
        if not arrived[0] or np.abs((joints[0] - start) * display).max() > _FAR:
            raise NotConvertible("the calibrated arm does not reach it near the joints that it has there")
        return np.asarray(joints[0])

    def change(joints: Matrix) -> Matrix:
        stiff = near(true, nominal.fk(joints, "deg"), joints / display - offsets)
        commanded = stiff
        for _ in range(_BENT):
            commanded = stiff - bending(commanded)
        return np.asarray(commanded * display)

    def undo(joints: Matrix) -> Matrix:
        inside = joints / display
        flange = true.fk((inside + bending(inside)) * display, "deg")
        return np.asarray(near(nominal, flange, inside + offsets) * display)

    return change, undo
