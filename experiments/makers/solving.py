"""Corrections of a program's targets: the calibrated arm then reaches what they mean.

A target means the pose of the flange that the nominal arm has there: the controller computes with nominal
kinematics. The calibrated arm reaches that pose at other joints, which inverse kinematics finds near the
nominal ones less the offsets. Gravity and harmonics bend the arm at these joints, so that the joints less
what they add have to be commanded: as they are, or as the pose that the nominal arm has at them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from ...model.arrays import ListedMatrix, Matrix
from ...model.files.limits import beyond_limits
from ...model.files.robot_file import load_robot
from ...model.kinematics.branches import Branch, Branches
from ...model.kinematics.inverse import Solver, is_singular, reach
from ...model.kinematics.orientation import from_rotation_vector, orientation
from ...model.kinematics.robot import Robot, same_arm
from ...model.kinematics.transforms import shift
from ...model.records import internal, it, key, or_null, record
from .program_parts import Edit, JointTarget, Motion, Parsed, PoseTarget, Target

_FAR = 5.0  # deg (mm) from the nominal joints less the offsets: such a solution is another posture
_CLEAR = 1.2  # a nearest solution is taken if the next one is so many times as far
_SAME_POSTURE = 0.01  # deg
_OFF_AXIS = 0.05  # rad
_JUMP = np.pi / 2  # rad (mm) from one of them to the next: more is another posture
_FLANGE_OF_IRB1600 = 65.0  # mm
_BENT = 4  # what is left of a deflection of 0.1 deg that changes by as much a radian is below 1e-9 deg
_ON_THE_WAY = 24  # poses of a linear motion that are followed


class _Unsolved(Exception):
    """A target that cannot be corrected; the sentence says why."""


class _Follows(_Unsolved):
    """The same, for no other reason than a target before it, which is a problem already."""


def up_to_flange(robot: Robot, nominal: Robot) -> Robot:
    """The arm up to what its controller calls the flange: that of the paper ends at the wrist's centre."""
    if not same_arm(nominal, load_robot("irb1600")):
        return robot
    return replace(robot, flange=robot.flange @ shift(z=_FLANGE_OF_IRB1600))


@dataclass(frozen=True, eq=False)
class Arms:
    """The arm that the controller computes with, the calibrated one, the offsets between (n,), rad or mm, and
    what depends on the posture besides: (n,) by which offsets are more at commanded joints (n,), rad or mm.
    `up` and `by_joint2` as of `Branches`."""

    nominal: Robot
    calibrated: Robot
    offsets: Matrix
    up: int
    posture_offsets: Callable[[Matrix], Matrix]
    by_joint2: bool = False

    @cached_property
    def solver(self) -> Solver:
        return Solver(self.nominal)

    @cached_property
    def branches(self) -> Branches | None:
        branches = Branches(self.nominal, self.up, self.by_joint2)
        return branches if branches.exist else None

    def branch(self, joints: Matrix) -> Branch | None:
        """The branch of joints in degrees."""
        return None if self.branches is None else self.branches.of(joints)

    def commanded(self, joints: Matrix) -> Matrix:
        """The joints, degrees (mm), at which the calibrated arm has the flange where the nominal one has it
        at `joints`: those to command."""
        display = self.nominal.display
        start = joints / display - self.offsets
        reached, arrived = reach(self.calibrated, self.nominal.fk(joints, "deg"), start[None])
        result = np.asarray(self._unbent(reached[0]) * display)
        if not arrived[0] or np.abs(result - start * display).max() > _FAR:
            raise _Unsolved("the calibrated arm does not reach it near the joints that it has there")
        beyond = [
            f"joint {i}: {value:.3f} {joint.unit}"
            for i, (value, joint, outside) in enumerate(
                zip(result.tolist(), self.nominal.joints, beyond_limits(self.nominal, result), strict=True),
                start=1,
            )
            if outside
        ]
        if beyond:
            raise _Unsolved(f"the corrected joints are beyond their limits ({', '.join(beyond)})")
        return result

    def _unbent(self, joints: Matrix) -> Matrix:
        """The joints at which the arm, as it bends there, is like a stiff one at `joints`; rad or mm."""
        commanded = joints
        for _ in range(_BENT):
            commanded = joints - self.posture_offsets(commanded)
        return commanded


@record(eq=False)
class CorrectedTarget:
    """One target: the `joints` (n,) of the nominal arm, degrees (mm), at which the program means it, with the
    `configuration` that it states (of a Cartesian one), and how far it moves: the joint that moves most,
    degrees (mm), and the pose, mm (of a joint target that of the flange)."""

    name: Annotated[str, it("of the target")]
    cartesian: Annotated[bool, internal]
    joints: Annotated[
        ListedMatrix, it("of the nominal arm, as the pendant counts, degrees (mm)", name="joints_deg")
    ]
    configuration: Annotated[str, it("null where none is stated"), or_null]
    moved_joint: Annotated[float, it("of the joint that moves most, degrees (mm)", name="moved_deg")]
    moved_mm: Annotated[float, it("of the pose, of joints that of the flange, millimetres")]

    @property
    @key("how it is stated")
    def kind(self) -> Literal["pose", "joints"]:
        return "pose" if self.cartesian else "joints"


@dataclass(frozen=True)
class Corrections:
    """The edits of a program, and its `targets`.

    `changed` are names of targets whose configuration changes, `nearest` those whose configuration was taken
    from the joints nearest to known ones.
    """

    edits: list[Edit]
    targets: list[CorrectedTarget]
    changed: list[str]
    nearest: list[str]


def correct_targets(parsed: Parsed, arms: Arms, near: Matrix | None) -> Corrections:
    """All targets of a program corrected; what cannot be is added to its problems."""
    work = _Corrector(arms, near, parsed)
    for motion in parsed.motions:
        work.go(motion)
    for target in parsed.targets.values():
        work.solved(target)
    return Corrections(
        work.edits,
        [work.corrected[name] for name in parsed.targets if name in work.corrected],
        work.changed,
        list(dict.fromkeys(work.nearest)),
    )


class _Corrector:
    def __init__(self, arms: Arms, near: Matrix | None, parsed: Parsed) -> None:
        self.arms, self.near, self.parsed = arms, near, parsed
        self.edits: list[Edit] = []
        self.corrected: dict[str, CorrectedTarget] = {}
        self.changed: list[str] = []
        self.nearest: list[str] = []
        self._joints: dict[str, Matrix | None] = {}
        self._last: Matrix | None = None
        self._broken = False  # the target of the motion before is a problem
        self._linear = False
        self._commanded: dict[str, Matrix] = {}
        self._start: str | None = None  # the target of the motion before
        self._near_motion: Matrix | None = None
        self._words: dict[str, tuple[Branch | None, str]] = {}  # of configurations that are not interpreted

    def go(self, motion: Motion) -> None:
        """Solve the target of a motion, from where the arm is before it."""
        if motion.first:
            self._last = self._start = None
            self._broken = False
        if motion.name is None:
            self._last = self._start = None
            self._broken = False
            return
        target = self.parsed.targets[motion.name]
        before, self._linear, self._near_motion = self._last, motion.linear, motion.near
        start, self._start = self._start, motion.name
        self._last = self._reached(target, motion)
        self._linear, self._near_motion, self._broken = False, None, self._last is None
        if self._last is None or self.arms.branches is None:
            return
        changes = before is not None and self.arms.branch(before) != self.arms.branch(self._last)
        if motion.unchecked:
            self._require_kept(motion, start)
        elif motion.linear and changes:
            self.parsed.problems.append(
                (
                    motion.line,
                    f"the linear motion to {motion.name} would change the arm's configuration, which it"
                    " cannot: its stated configuration is not the one that the arm has there",
                )
            )

    def _require_kept(self, motion: Motion, start: str | None) -> None:
        """The arm keeps its branch in a motion of which the controller ignores the configuration: the target
        `start` and that of the motion must have one, as they are meant, and as they are commanded.

        From a start that is not known the branch is that of the target as it is meant, or the language has
        refused the motion.
        """
        assert motion.name is not None
        for joints in (self._joints, self._commanded):
            begin, end = joints.get(start or ""), joints.get(motion.name)
            if end is None or (start is not None and begin is None):
                return
            kept = self._branch(begin if begin is not None else self._meant(motion.name))
            if self._branch(end) != kept:
                what = "would change the arm's configuration, which it keeps"
            elif begin is not None and motion.linear and not self._smooth(begin, end):
                what = "passes a singularity, behind which the arm's configuration is not known"
            else:
                continue
            by = "as it is" if joints is self._joints else "with the corrected targets"
            self.parsed.problems.append((motion.line, f"{by}, the motion to {motion.name} {what}"))
            return

    def _meant(self, name: str) -> Matrix:
        joints = self._joints[name]
        assert joints is not None
        return joints

    def _smooth(self, begin: Matrix, end: Matrix) -> bool:
        """Whether the arm gets from joints to others, degrees, by a straight line of the flange.

        Where all poses on the way have joints near those of the pose before, the arm ends at the last.
        """
        nominal, share = self.arms.nominal, np.linspace(0, 1, _ON_THE_WAY + 1)
        first = begin / nominal.display
        last = self.arms.solver.nearest_turns(end / nominal.display, first)
        poses = self._line(nominal.fk(begin, "deg"), nominal.fk(end, "deg"), share[1:-1])
        between, arrived = reach(nominal, poses, first + share[1:-1, None] * (last - first))
        rows = np.array([first, *between, last])
        jumps = np.remainder(np.diff(rows, axis=0) + np.pi, 2 * np.pi) - np.pi
        return bool(arrived.all() and np.abs(jumps).max() < _JUMP)

    def solved(self, target: Target) -> Matrix | None:
        """The joints of the target as the program means it, degrees; None where they are not known."""
        if target.name not in self._joints:
            try:
                self._joints[target.name] = self._solve(target)
            except _Unsolved as error:
                self._joints[target.name] = None
                if not isinstance(error, _Follows):
                    self.parsed.problems.append((target.line, f"{target.name}: {error}"))
        return self._joints[target.name]

    def _reached(self, target: Target, motion: Motion) -> Matrix | None:
        """The joints at the end of a motion, degrees. A pose without configuration may have others at each
        use, and then has no correction."""
        first_use = target.name not in self._joints
        joints = self.solved(target)
        if first_use or joints is None or not isinstance(target, PoseTarget) or target.configured:
            return joints
        try:
            again = self._chosen(target, target.frame @ target.pose @ np.linalg.inv(target.tool))
        except _Unsolved as error:
            if not isinstance(error, _Follows):
                self.parsed.problems.append((motion.line, f"{target.name}: {error}"))
            return None
        apart = np.abs((again - joints + 180) % 360 - 180).max()
        if apart > _SAME_POSTURE:
            self.parsed.problems.append(
                (motion.line, f"{target.name} is reached in another configuration here than before")
            )
        return again

    def _solve(self, target: Target) -> Matrix:
        arms = self.arms
        if isinstance(target, JointTarget):
            commanded = self._commanded[target.name] = arms.commanded(target.joints)
            flanges = arms.nominal.fk(np.array([target.joints, commanded]), "deg")
            self._enter(target.name, target.joints, None, flanges)
            self.edits += target.write(commanded)
            return target.joints
        flange = target.frame @ target.pose @ np.linalg.inv(target.tool)
        joints = self._chosen(target, flange)
        commanded = self._commanded[target.name] = arms.commanded(joints)
        pose = np.linalg.inv(target.frame) @ arms.nominal.fk(commanded, "deg") @ target.tool
        self._enter(target.name, joints, target.configuration, np.array([target.pose, pose]))
        branch = arms.branch(commanded)
        if target.turns is not None and not (target.turns(joints) and target.turns(commanded)):
            raise _Unsolved("a joint is, or would be, in another turn than its configuration states")
        if target.matching is not None and not target.matching(commanded):
            raise _Unsolved(f"the corrected joints have another configuration than {target.configuration}")
        if not target.configured and target.configuration:
            self._require_words(target, joints, branch)
        if branch != arms.branch(joints):
            self.changed.append(target.name)
        self.edits += target.write(np.asarray(pose), branch, commanded)
        return joints

    def _enter(self, name: str, joints: Matrix, configuration: str | None, poses: Matrix) -> None:
        """A target that is corrected: `poses` (2, 4, 4) are those before and after."""
        self.corrected[name] = CorrectedTarget(
            name,
            configuration is not None,
            joints,
            configuration or "",
            float(np.abs(self._commanded[name] - joints).max()),
            float(np.linalg.norm(poses[1, :3, 3] - poses[0, :3, 3])),
        )

    def _require_words(self, target: PoseTarget, joints: Matrix, commanded: Branch | None) -> None:
        """The words of a configuration must be those of the joints. Words that are not interpreted must be
        those of one branch, and a branch have one; the corrected target keeps them."""
        meant = self.arms.branch(joints)
        if target.words is not None and meant is not None:
            right = target.words(meant, joints)
            if right != target.configuration:
                raise _Unsolved(
                    f"its configuration is {target.configuration}, and that of the joints nearest by"
                    f" ({', '.join(f'{value:.1f}' for value in joints)}) is {right}; state --near, or a joint"
                    f" target before it{f'. {target.words_mean}' if target.words_mean else ''}"
                )
            return
        if commanded != meant:
            raise _Unsolved(
                f"it is not known how another configuration than {target.configuration} is written"
            )
        for words, (branch, name) in self._words.items():
            if (words == target.configuration) != (branch == meant):
                raise _Unsolved(
                    f"its configuration {target.configuration} and that of {name} ({words}) do not go with"
                    " the joints nearest by; state --near, or a joint target before it"
                )
        self._words[target.configuration] = meant, target.name

    def _chosen(self, target: PoseTarget, flange: Matrix) -> Matrix:
        if self.arms.nominal.n != 6:
            raise _Unsolved(f"a pose does not determine the {self.arms.nominal.n} joints of this arm")
        display = self.arms.nominal.display
        if target.configured:
            if self.arms.branches is None and target.matching is None:
                raise _Unsolved("configurations are known of arms with a spherical wrist only; state --near")
            rows = self._matching_nearby(target, flange)
            for thorough in (False, True):
                if not len(rows):
                    solutions = self.arms.solver.solutions(flange, thorough=thorough)
                    rows = self._with_stated(target, solutions)
            if len(rows) and all(self.arms.solver.same(rows[0] / display, other) for other in rows / display):
                self._require_isolated(flange, rows[0])
                near = next((each for each in (self._last, self.near) if each is not None), rows[0])
                return np.asarray(rows[np.argmin(np.abs(rows - near).max(axis=1))])
            if len(rows):
                raise _Unsolved(
                    f"several sets of joints have the stated configuration {target.configuration}"
                )
            if self.near is None:
                raise _Unsolved(
                    "no joints within the limits reach it with the stated configuration"
                    f" {target.configuration}"
                )
            return self._nearest(target, flange, (self.near,))
        return self._nearest(target, flange, (self._near_motion, self._last, self.near))

    def _require_isolated(self, flange: Matrix, joints: Matrix) -> None:
        """At a singularity a configuration has many sets of joints, and the controller's choice is not known:
        from joints that are moved along the singular direction the arm stays away from these."""
        nominal, row = self.arms.nominal, joints / self.arms.nominal.display
        if not is_singular(nominal, row):
            return
        direction = np.linalg.svd(nominal.jacobian(row, "rad"))[2][-1]
        others, arrived = reach(nominal, flange, row + _OFF_AXIS * np.array([[1.0], [-1.0]]) * direction)
        if any(not self.arms.solver.same(row, other) for other in others[arrived]):
            raise _Unsolved(
                "it is at a singularity, where many sets of joints reach it; replace it by a joint target"
            )

    def _matching_nearby(self, target: PoseTarget, flange: Matrix) -> Matrix:
        """Joints near those of the motion before: off singularities a configuration has one solution only."""
        nominal = self.arms.nominal
        if self._last is None:
            return np.empty((0, nominal.n))
        reached, arrived = reach(nominal, flange, (self._last / nominal.display)[None])
        if not arrived[0] or is_singular(nominal, reached[0]):
            return np.empty((0, nominal.n))
        return self._with_stated(target, reached)

    def _with_stated(self, target: PoseTarget, solutions: Matrix) -> Matrix:
        """The solutions, with their whole turns, that have the stated configuration; degrees."""
        solver, display = self.arms.solver, self.arms.nominal.display
        rows = [row * display for solution in solutions for row in solver.with_turns(solution)]
        return np.array([row for row in rows if self._has_stated(target, row)]).reshape(
            -1, self.arms.nominal.n
        )

    def _has_stated(self, target: PoseTarget, row: Matrix) -> bool:
        if target.matching is not None:
            return target.matching(row)
        assert target.matches is not None
        return target.matches(self._branch(row), row)

    def _branch(self, joints: Matrix) -> Branch:
        branch = self.arms.branch(joints)
        assert branch is not None
        return branch

    def _nearest(self, target: PoseTarget, flange: Matrix, known: Sequence[Matrix | None]) -> Matrix:
        """The joints nearest to the first that are `known`, degrees."""
        near = next((each for each in known if each is not None), None)
        if near is None and self._broken:
            raise _Follows
        if near is None:
            raise _Unsolved("nothing says in which configuration the arm reaches it; state --near")
        solver, display = self.arms.solver, self.arms.nominal.display
        if self._linear and self._last is not None and near is self._last:
            return self._followed(flange, near)
        reached, arrived = reach(self.arms.nominal, flange, (near / display)[None])
        rows = [*reached[arrived], *solver.solutions(flange)]
        unique: list[Matrix] = []
        for row in rows:
            turned = solver.nearest_turns(row, near / display)
            if not any(np.abs(turned - other).max() < 1e-4 for other in unique):
                unique.append(turned)
        if not unique:
            raise _Unsolved("the arm does not reach it")
        apart = [float(np.linalg.norm(row - near / display)) for row in unique]
        order = np.argsort(apart)
        if len(order) > 1 and apart[order[1]] < _CLEAR * apart[order[0]]:
            raise _Unsolved(
                "two configurations of the arm are about as near to the joints before it; state --near, or a"
                " joint target before it"
            )
        if apart[order[0]] > np.radians(_SAME_POSTURE):  # else the known joints reach it themselves
            self._require_isolated(flange, unique[order[0]] * display)
        self.nearest.append(target.name)
        return np.asarray(unique[order[0]] * display)

    def _followed(self, flange: Matrix, start: Matrix) -> Matrix:
        """The joints at the end of a linear motion, degrees, from those at its start."""
        nominal = self.arms.nominal
        joints = start / nominal.display
        for pose in self._line(nominal.fk(start, "deg"), flange, np.linspace(0, 1, _ON_THE_WAY + 1)[1:]):
            reached, arrived = reach(nominal, pose, joints[None])
            if not arrived[0]:
                raise _Unsolved("the arm does not reach it in a straight line from the target before")
            joints = reached[0]
        return np.asarray(joints * nominal.display)

    def _line(self, begin: Matrix, end: Matrix, shares: Matrix) -> Matrix:
        """(N, 4, 4) poses on the straight line between two."""
        turn = np.array(orientation(end[:3, :3] @ begin[:3, :3].T).rotation_vector)
        poses = np.array([from_rotation_vector((0, 0, 0, *(share * turn))) @ begin for share in shares])
        poses[:, :3, 3] = begin[:3, 3] + shares[:, None] * (end[:3, 3] - begin[:3, 3])
        return poses
