"""The targets of a KRL module (KUKA): its .src and its .dat as one text, the .dat behind.

Tool and base of a Cartesian target are those that may be active at its motions. The status (bits 0 to 2 of S)
is that which is stated for a PTP with S and T. A linear motion ignores S and T, and a PTP without them has no
other either: the arm keeps the status that it has, which is that of the motions before, along all ways.
"""

from __future__ import annotations

import re
from functools import cached_property
from typing import Literal

import numpy as np
from lark import Token

from ....model.arrays import Matrix
from ....model.kinematics.branches import Branch, Branches, is_kuka_turn, kuka_status, kuka_turn
from ....model.kinematics.orientation import from_abc, orientation
from ..program_parts import (
    NULL,
    Edit,
    JointTarget,
    Language,
    LiteralSpan,
    Motion,
    Parsed,
    PoseTarget,
    Source,
    number_edits,
    span,
)
from .flow import Flow, State, Value, Values, nothing_known, values
from .routines import Routines
from .statements import (
    POSE,
    KrlNames,
    Position,
    fields,
    krl_literals,
    number,
    statements,
    whole,
)


def krl_targets(source: Source) -> Parsed:
    """The targets, motions and problems of a module."""
    parsed = Parsed()
    names = KrlNames(source, parsed)
    rows = statements(source, parsed)
    if not parsed.problems:
        names.declare(rows)
        routines = Routines(names)
        routines.read(rows)
        if not parsed.problems:
            _KrlModule(source, names, routines).read()
    if parsed.problems:  # those alone are named, not the positions that were not looked at because of them
        parsed.literals[:] = [LiteralSpan(*literal, "left") for literal in krl_literals(source.text)]
    return parsed


class _KrlModule:
    def __init__(self, source: Source, names: KrlNames, routines: Routines) -> None:
        self.source, self.names, self.parsed = source, names, names.parsed
        self.moves, self.frames = routines.moves, routines.frames
        self.flow = Flow(routines.routines, self._at_start)
        self.keys: dict[int, str] = {}  # of the targets of motions; not of those that are left
        self.uses: dict[str, list[int]] = {}
        self.joints: dict[str, Matrix] = {}  # of the targets that are axes
        self.near = None if source.facts.near is None else self._status_at(source.facts.near)

    def read(self) -> None:
        for at in range(len(self.moves)):
            self._read_move(at)
        self._left_and_unused()
        for key, uses in self.uses.items():
            position = self.names.positions[key]
            assert position is not None
            if position.axes:
                self._add_joints(position, uses)
            else:
                self._add_pose(position, uses)
        if not self.parsed.problems:
            self._motions()

    def _problem(self, pos: int, sentence: str) -> None:
        self.parsed.problems.append((self.source.line(pos), sentence))

    # Motions

    def _read_move(self, at: int) -> None:
        move, part = self.moves[at], self.moves[at].target
        if isinstance(part, Token):
            if part == "$POS_ACT":
                self._require_same_frames(at)
            return
        if part.data == "aggregate":
            key = self.source.key_at(move.pos, self.names.positions)
            self.names.positions[key] = Position(key, part, fields(part) or {})
        else:
            key = "".join(str(each).lower() for each in part.children[:1])
            if len(part.children) > 1:
                key += f"[{part.children[1]}]"
            if self.source.facts.leaves(key, self.source.written(key)):
                return
            if self.names.positions.get(key) is None:
                written = self.source.written(key)
                self._problem(move.pos, f"{written} has no value in these files (--leave {written}?)")
                return
        self.keys[at] = key
        self.uses.setdefault(key, []).append(at)

    def _left_and_unused(self) -> None:
        for key, position in self.names.positions.items():
            if position is None:
                continue
            written = self.source.written(key)
            as_frame = position.pos in self.frames.poses
            if self.source.facts.leaves(key, written):
                if not as_frame:
                    self.names.claim(position.aggregate, "left")
            elif key in self.uses and as_frame:
                self._problem(position.pos, f"{written} is a target and a frame")
            elif key not in self.uses and not as_frame:
                self._problem(
                    position.pos,
                    f"{written} is not the target of a motion here, so that its tool is not known (--leave?)",
                )

    def _state(self, at: int) -> State:
        state = self.flow.before(at)
        if state is None:
            return nothing_known({})
        for change in self.moves[at].changes:
            state = change(state)
        return state

    def _before(self, at: int) -> Values:
        """The motions that may have ended last before one."""
        return self.flow.resolved(at, values(self.flow.before(at) or nothing_known({}), "arm"))

    def _require_same_frames(self, at: int) -> None:
        here = {word: self._frames(at, word) for word in ("tool", "base")}
        before = self._before(at)
        if any(
            value[0] != "motion"
            or any(self._frames(int(str(value[1])), word) != here[word] for word in ("tool", "base"))
            for value in before
        ):
            self._problem(
                self.moves[at].pos,
                "$POS_ACT may be another position here, with another tool or base; use PTP $AXIS_ACT",
            )

    def _frames(self, at: int, word: str) -> Values:
        return self.flow.resolved(at, values(self._state(at), word))

    def _at_start(self, variable: str) -> Values:
        """The values of a variable when another file calls a routine of this one."""
        if variable in ("tool", "base"):
            return frozenset([("open", "at the start")])
        word, _, index = variable.partition(" ")
        if index:
            persistent: list[Value] = [("literal", pos) for pos in self.frames.defined.get(variable, ())]
            return frozenset([("number", int(index)), *persistent])
        return frozenset([("start", word)])

    # Targets

    def _add_joints(self, position: Position, uses: list[int]) -> None:
        n, written = self.source.robot.n, self.source.written(position.key)
        axes = [f"A{i}" for i in range(1, n + 1)]
        values_of_axes = [number(position.fields.get(axis)) for axis in axes]
        others = [number(value) for name, value in position.fields.items() if name not in axes]
        joints = [value for value in values_of_axes if value is not None]
        if len(joints) != n or None in others or any(name[0] not in "AE" for name in position.fields):
            self._problem(position.pos, f"{written} does not state the {n} axes of the robot, in numbers")
            return
        if any(self.moves[at].linear for at in uses):
            self._problem(
                self.moves[uses[0]].pos, f"{written} states axes, which a linear motion cannot have"
            )
            return
        spans = [span(position.fields[axis]) for axis in axes]

        def write(commanded: Matrix) -> list[Edit]:
            return number_edits(spans, self.source.text, commanded.tolist(), [6] * n)

        self.names.claim(position.aggregate, "target")
        self.joints[position.key] = np.array(joints)
        line = self.source.line(position.pos)
        self.parsed.targets[position.key] = JointTarget(written, line, np.array(joints), write)

    def _add_pose(self, position: Position, uses: list[int]) -> None:
        written, pos, parts = self.source.written(position.key), position.pos, position.fields
        numbers = [number(parts.get(name)) for name in POSE]
        pose = [value for value in numbers if value is not None]
        external = [number(value) for name, value in parts.items() if re.fullmatch("E[1-6]", name)]
        if len(pose) != len(POSE) or None in external:
            self._problem(pos, f"{written} does not state X, Y, Z, A, B and C in numbers")
            return
        if any(external):
            self._problem(pos, f"{written} has positions of external axes, which may carry the robot")
            return
        status, turn = (whole(parts.get(name)) for name in "ST")
        allowed = {*POSE, "S", "T", *(f"E{i}" for i in range(1, 7))}
        if set(parts) - allowed or any(name in parts and whole(parts[name]) is None for name in "ST"):
            self._problem(pos, f"{written} has components that are not understood")
            return
        frames = [self._known(position, uses, word) for word in ("tool", "base")]
        own_status, turn = self._status_of(position.key), turn if self._turns(uses) else None
        if frames[0] is None or frames[1] is None:
            return
        spans = [span(parts[name]) for name in POSE]

        def matches(branch: Branch, joints: Matrix) -> bool:
            return own_status == kuka_status(branch) and (turn is None or is_kuka_turn(turn, joints))

        def write(new_pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
            new = [*new_pose[:3, 3].tolist(), *orientation(new_pose[:3, :3]).abc]
            edits = number_edits(spans, self.source.text, new, [6] * 6)
            if branch is not None and status is not None and status & 7 != kuka_status(branch):
                edits.append(Edit(*span(parts["S"]), str(status & ~7 | kuka_status(branch))))
            if turn is not None and not is_kuka_turn(turn, joints):
                edits.append(Edit(*span(parts["T"]), str(turn & ~63 | kuka_turn(joints))))
            return edits

        self.names.claim(position.aggregate, "target")
        self.parsed.targets[position.key] = PoseTarget(
            written,
            self.source.line(pos),
            from_abc(pose),
            frames[0],
            frames[1],
            None if own_status is None else matches,
            f"S {own_status}" + ("" if turn is None else f", T {turn}"),
            write,
        )

    def _turns(self, uses: list[int]) -> bool:
        return any(not self.moves[at].linear for at in uses)

    def _known(self, position: Position, uses: list[int], word: str) -> Matrix | None:
        """The one tool or base that a target has at all its motions; None where that is a problem."""
        poses: list[Matrix] = []
        complete = True
        for at in uses:
            for value in sorted(self._frames(at, word), key=str):
                pose = self._pose(word, value)
                if pose is None:
                    option: Literal["--tool", "--frame"] = "--tool" if word == "tool" else "--frame"
                    numbered = value[0] == "number"
                    known = f"{word} {value[1]}" if numbered else f"the active {word}"
                    why = f" ({value[1]})" if value[0] in ("open", "unknown") else ""
                    request = self.source.facts.require(
                        option, str(value[1]) if numbered else "", "X,Y,Z,A,B,C"
                    )
                    self._problem(self.moves[at].pos, f"{known} is not known{why}; {request}")
                    complete = False
                    continue
                poses.append(pose)
                if not np.allclose(pose, poses[0], atol=1e-9):
                    written = self.source.written(position.key)
                    self._problem(self.moves[at].pos, f"{written} is used with different tools or bases")
                    return None
        return poses[0] if complete else None

    def _pose(self, word: str, value: Value) -> Matrix | None:
        pose_of = self.source.facts.tool if word == "tool" else self.source.facts.frame
        if value[0] == "null":
            return NULL
        if value[0] == "number":
            return pose_of(str(value[1]))
        if value[0] == "literal":
            return self.frames.poses[int(str(value[1]))]
        return pose_of(str(value[1])) if value[0] == "open" else None

    # The status

    @cached_property
    def _branches(self) -> Branches | None:
        branches = Branches(self.source.robot, -1)
        return branches if branches.exist else None

    def _status_at(self, joints: Matrix) -> int | None:
        return None if self._branches is None else kuka_status(self._branches.of(joints))

    def _stated_status(self, key: str) -> tuple[int | None, bool]:
        """Bits 0 to 2 of S, and whether T is stated too."""
        position = self.names.positions[key]
        assert position is not None
        status = whole(position.fields.get("S"))
        return None if status is None else status & 7, "T" in position.fields

    def _keeps(self, at: int) -> bool:
        """Whether the arm keeps its status in a motion: but for PTP to axes, or to a pose with S and T."""
        if self.moves[at].linear:
            return True
        key = self.keys[at]
        status, turned = self._stated_status(key)
        position = self.names.positions[key]
        return position is not None and not position.axes and (status is None or not turned)

    @cached_property
    def _statuses(self) -> dict[int, frozenset[int | None]]:
        """The statuses that the arm may have after each motion; None: not known."""
        result: dict[int, frozenset[int | None]] = {at: frozenset() for at in self.keys}
        for at, key in self.keys.items():
            if not self._keeps(at):
                position = self.names.positions[key]
                assert position is not None
                status = (
                    self._status_at(self._axes(position)) if position.axes else self._stated_status(key)[0]
                )
                result[at] = frozenset([status])
        going = True
        while going:
            going = False
            for at in self.keys:
                if self._keeps(at):
                    statuses = frozenset[int | None]().union(
                        *(self._status_after(value, result) for value in self._before(at))
                    )
                    going |= statuses != result[at]
                    result[at] = statuses
        return result

    def _axes(self, position: Position) -> Matrix:
        return np.array([number(position.fields.get(f"A{i}")) or 0.0 for i in range(1, 7)])

    def _status_after(self, value: Value, known: dict[int, frozenset[int | None]]) -> frozenset[int | None]:
        if value[0] == "motion" and int(str(value[1])) in known:
            return known[int(str(value[1]))]
        return frozenset([self.near])

    def _status_of(self, key: str) -> int | None:
        """The status of a target at all its motions; None where only --near can state it."""
        stated_status, _ = self._stated_status(key)
        written, statuses = self.source.written(key), set[int | None]()
        for at in self.uses[key]:
            here, pos = self._statuses[at], self.moves[at].pos
            if None in here and self.near is None and (stated_status is not None or len(here) > 1):
                self._problem(
                    pos,
                    f"the configuration at {written} is that of the motion before, which is not known here;"
                    " go to a target with S and T before it by PTP, or state --near",
                )
            elif len(here) > 1:
                self._problem(
                    pos,
                    f"{written} may be reached in several configurations here (S"
                    f" {', '.join(str(each) for each in sorted(each or 0 for each in here))}); go to a target"
                    " with S and T before it by PTP",
                )
            elif stated_status is not None and here and here != {stated_status}:
                self._problem(
                    pos,
                    f"the arm has S {min(each or 0 for each in here)} at {written}, which states S"
                    f" {stated_status}: this motion keeps the configuration, and would change the arm's"
                    " configuration, which it cannot",
                )
            statuses |= here
        if len(statuses) > 1:
            pos = self.moves[self.uses[key][0]].pos
            self._problem(pos, f"{written} is reached in several configurations")
        return next(iter(statuses), None)

    def _motions(self) -> None:
        """Each target for itself; then each pair of motions of which the second keeps the configuration."""
        for at, key in self.keys.items():
            line, target = self.source.line(self.moves[at].pos), self.parsed.targets[key]
            by_near = isinstance(target, PoseTarget) and target.matches is None
            self.parsed.motions.append(Motion(key, line, linear=False, first=by_near))
        for at, key in self.keys.items():
            if not self._keeps(at):
                continue
            line, linear = self.source.line(self.moves[at].pos), self.moves[at].linear
            for value in sorted(self._before(at), key=str):
                before = self.keys.get(int(str(value[1]))) if value[0] == "motion" else None
                if before is not None:
                    self.parsed.motions.append(Motion(before, line, False, True))
                self.parsed.motions.append(Motion(key, line, linear, before is None, unchecked=True))


KRL = Language(
    "KRL",
    krl_targets,
    r"^[ \t]*(?:GLOBAL\s+)?DEF(?:FCT|DAT)?\b[^\n]*\n",
    "; ",
    from_abc,
    "X,Y,Z,A,B,C",
    krl_literals,
    up=-1,
)
