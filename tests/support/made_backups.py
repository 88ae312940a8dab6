"""Backups of controllers made at random, and where an arm is that runs them: without the code that is tested.

A position is made of joints: those that the arm has there, by readings before zeros were entered. What is
written of it is computed by `ControllerArm`, with configurations by side views of data sheets. A converted
file is read here by the lines that this file has written, and solved by `ControllerArm` again.
"""

from __future__ import annotations

import re
import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from tempfile import mkdtemp

import epson_controller
import numpy as np
import yaskawa_controller
from controller_arm import ControllerArm
from scipy.spatial.transform import Rotation

from zerobeam.experiments.command_options import BackupOptions, ZeroOptions
from zerobeam.experiments.converted_programs import kept_programs
from zerobeam.experiments.positions.conversion import Conversion
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import BUILT_IN, load_robot

NUMBER = r"-?\d*\.?\d+(?:[eE][-+]?\d+)?"
ENTERED = np.array([0.113, -0.265, 0.182, -0.094, 0.211, 0.307])  # deg
_MARGIN = 3.0  # deg from limits
_CLEAR = 8.0  # mm, deg from another configuration


@dataclass(frozen=True)
class MadePosition:
    """`joints` (6,) degrees, joint 3 from link 2, with tool and frame by name; `in_joints`: so written."""

    name: str
    joints: Matrix
    tool: str
    frame: str
    in_joints: bool


@dataclass(frozen=True)
class MadeStep:
    """A relative motion, the last of these `lines` of a file: by an `offset` (3,), mm, in the axes of the
    frame or of the tool, from the position `start` or from where the arm is. None: it does not say so."""

    lines: str
    start: str | None
    offset: Matrix | None
    axes: str | None
    behind: str = ""  # lines that follow


@dataclass
class MadeBackup:
    """Texts by file, and what they mean."""

    dialect: Dialect
    tools: dict[str, Matrix]
    frames: dict[str, Matrix]
    positions: list[MadePosition]
    texts: dict[str, str] = field(default_factory=dict)
    step: MadeStep | None = None

    @property
    def options(self) -> dict[str, object]:
        """What has to be stated and accepted."""
        options = self.dialect.options(self)
        accept = [":".join(map(str, self.step_line))] if self.step else []
        return options | {"accept": [*options.get("accept", []), *accept]}  # type: ignore[misc]

    @property
    def step_line(self) -> tuple[str, int]:
        """File and line of the relative motion."""
        assert self.step is not None
        file, _ = self.dialect.steps_before
        behind = self.texts[file].index(self.step.lines) + len(self.step.lines)
        return file, self.texts[file].count("\n", 0, behind) + 1

    def shift(self, entered: Matrix) -> float | None:
        """mm by which the step ends elsewhere once zeros were entered: of 100 mm along each axis where it is
        not in numbers, from the position that moves most where it does not say where it starts."""
        assert self.step is not None
        poses = [one for one in self.positions if not one.in_joints]
        starts = [one for one in poses if one.name == self.step.start]
        starts = (
            starts or sorted(poses, key=lambda one: -self._apart(one, one.joints, one.joints + entered))[:1]
        )
        steps = 100 * np.eye(3) if self.step.offset is None else self.step.offset[None]
        axes = ["frame", "tool"] if self.step.axes is None else [self.step.axes]
        shifts = [self._shift(one, by, each, entered) for one in starts for by in steps for each in axes]
        return max((each for each in shifts if each is not None), default=None)

    def _apart(self, one: MadePosition, joints: Matrix, others: Matrix) -> float:
        places = [(self.dialect.arm.fk(row, "deg") @ self.tools[one.tool])[:3, 3] for row in (joints, others)]
        return float(np.linalg.norm(places[0] - places[1]))

    def _shift(self, one: MadePosition, offset: Matrix, axes: str, entered: Matrix) -> float | None:
        frame, tool, arm, by = self.frames[one.frame], self.tools[one.tool], self.dialect.arm, np.eye(4)
        by[:3, 3] = offset
        ends = []
        for joints in (one.joints, one.joints + entered):
            pose = np.linalg.inv(frame) @ arm.fk(joints, "deg") @ tool
            end = by @ pose if axes == "frame" else pose @ by
            ends.append(arm.straight(frame @ end @ np.linalg.inv(tool), joints))
        before, after = ends
        return None if before is None or after is None else self._apart(one, before + entered, after)

    def readings(self, texts: dict[str, str], near: Matrix) -> list[Matrix]:
        """(6,) the joints to which the controller goes for each position, from those near by."""
        return [self._reading(one, texts, near) for one in self.positions]

    def _reading(self, one: MadePosition, texts: dict[str, str], near: Matrix) -> Matrix:
        numbers, configuration = self.dialect.found(one, texts)
        if one.in_joints:
            return self.dialect.counted(np.array(numbers), -1.0)
        flange = self.frames[one.frame] @ self.dialect.matrix(numbers) @ np.linalg.inv(self.tools[one.tool])
        rows = self.dialect.arm.climbed(flange, one.joints + near)
        assert len(rows), f"{one.name} is not reached"
        assert self.dialect.agrees(configuration, rows[0]), (one.name, configuration, rows[0])
        return rows[0]

    def kept(self, texts: dict[str, str], entered: Matrix) -> bool:
        """Whether the arm comes to the same places with zeros that make it read more by `entered` (6,)."""
        for one, reading in zip(self.positions, self.readings(texts, entered), strict=True):
            if one.in_joints:
                if np.abs(reading - one.joints - entered).max() > self.dialect.joint_digit:
                    return False
                continue
            tool = self.tools[one.tool]
            places = [self.dialect.arm.fk(joints, "deg") @ tool for joints in (one.joints + entered, reading)]
            turn = Rotation.from_matrix(places[0][:3, :3].T @ places[1][:3, :3]).magnitude()
            apart = np.linalg.norm(places[0][:3, 3] - places[1][:3, 3])
            if apart > 0.01 or np.degrees(turn) > self.dialect.turn_digit:
                return False
        return True


class Dialect(ABC):
    """A language as this file writes and reads it back, for one arm."""

    name: str
    robot: str
    main: str  # the file with positions
    joint_digit: float = 1e-5  # deg, of a position in joints
    turn_digit: float = 0.001  # deg, of a pose
    tool_names: Sequence[str]
    frame_names: Sequence[str]
    steps_before: tuple[str, str]  # the file of a relative motion, and the text that it is in front of

    @property
    def arm(self) -> ControllerArm:
        return arm_of(self.robot)

    def counted(self, joints: Matrix, sign: float) -> Matrix:
        """Joints as the controller counts them (sign 1), or back (-1)."""
        return joints

    @abstractmethod
    def clear(self, joints: Matrix) -> float:
        """How far, mm or deg, joints are from another configuration."""

    @abstractmethod
    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool: ...

    @abstractmethod
    def matrix(self, numbers: Sequence[float]) -> Matrix: ...

    @abstractmethod
    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]: ...

    @abstractmethod
    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        """Its numbers and its configuration in these texts."""

    @abstractmethod
    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        """A relative motion from a pose, or from where the arm is; None where it has no name."""

    def label(self, one: MadePosition) -> str:
        """What it is called in the table, where it is not in a motion itself."""
        return one.name

    def options(self, backup: MadeBackup) -> dict[str, object]:
        """What has to be stated, as the language does not say it."""
        return {}

    def pose(self, one: MadePosition, backup: MadeBackup) -> Matrix:
        flange = self.arm.fk(one.joints, "deg")
        return np.asarray(np.linalg.inv(backup.frames[one.frame]) @ flange @ backup.tools[one.tool])

    def made(self, seed: int, count: int = 4, *, stepped: bool = False) -> MadeBackup:
        """A backup with so many positions, in all configurations, with several tools and frames; `stepped`:
        with a relative motion, where one has a name or says where it starts."""
        rng = np.random.default_rng([seed, sum(map(ord, self.name))])
        tools = {name: _random_pose(rng, 200) for name in self.tool_names}
        frames = {name: _random_pose(rng, 800) for name in self.frame_names}
        tools[self.tool_names[0]] = frames[self.frame_names[0]] = np.eye(4)
        positions = [
            MadePosition(
                f"P{number}",
                self.random_joints(rng),
                str(rng.choice(list(tools))),
                str(rng.choice(list(frames))),
                bool(rng.random() < 0.3),
            )
            for number in range(1, count + 1)
        ]
        backup = MadeBackup(self, tools, frames, positions)
        backup.texts = self.texts(backup, rng)
        if stepped:
            by, (file, mark) = np.round(rng.uniform(-20, 20, 3), 1), self.steps_before
            steps = [self.step(one, backup, by, rng) for one in backup.positions if not one.in_joints]
            backup.step = next((step for step in steps if step is not None), None)
        if backup.step is not None:
            before, _, behind = backup.texts[file].rpartition(mark)
            backup.texts[file] = f"{before}{backup.step.lines}\r\n{backup.step.behind}{mark}{behind}"
        # What is written is rounded: it means the joints of what is written.
        joints = backup.readings(backup.texts, np.zeros(6))
        pairs = zip(backup.positions, joints, strict=True)
        backup.positions = [replace(one, joints=row) for one, row in pairs]
        return backup

    def random_joints(self, rng: np.random.Generator) -> Matrix:
        robot = load_robot(self.robot)
        lower, upper = np.degrees(robot.lower) + _MARGIN, np.degrees(robot.upper) - _MARGIN
        while True:
            joints = np.round(rng.uniform(lower, upper), 3)
            third = self.counted(joints, 1.0)[2]
            bound = robot.conventions.range3
            inside = bound is None or np.degrees(bound[0]) + 5 < third < np.degrees(bound[1]) - 5
            # Away from a singularity: two rows of the Jacobian are not nearly parallel there.
            if inside and self.clear(joints) > _CLEAR and _regular(self.arm, joints):
                return np.asarray(joints)


@cache
def arm_of(name: str) -> ControllerArm:
    return ControllerArm.of(load_robot(name))


def _regular(arm: ControllerArm, joints: Matrix) -> bool:
    pose, moved = arm.fk(joints, "deg"), []
    for row in np.eye(6):
        other = arm.fk(joints + 1e-4 * row, "deg")
        turn = Rotation.from_matrix(other[:3, :3] @ pose[:3, :3].T).as_rotvec()
        moved.append(np.concatenate([(other[:3, 3] - pose[:3, 3]) / 1000, turn]) / np.radians(1e-4))
    return bool(np.linalg.svd(np.array(moved), compute_uv=False)[-1] > 0.02)


def _random_pose(rng: np.random.Generator, mm: float) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", np.round(rng.uniform(-60, 60, 3), 3), degrees=True).as_matrix()
    pose[:3, 3] = np.round(rng.uniform(-mm, mm, 3), 3)
    return pose


def _angles(pose: Matrix, axes: str) -> list[float]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)  # of two rotations about one axis
        turns = Rotation.from_matrix(pose[:3, :3]).as_euler(axes, degrees=True)
    return [*pose[:3, 3].tolist(), *turns.tolist()]


def _of_angles(numbers: Sequence[float], axes: str) -> Matrix:
    pose = np.eye(4)
    pose[:3, 3] = numbers[:3]
    pose[:3, :3] = Rotation.from_euler(axes, numbers[3:6], degrees=True).as_matrix()
    return pose


def _numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(NUMBER, text)]


class Rapid(Dialect):
    """A module of an IRB 120."""

    name, robot, main = "RAPID", "irb120", "TASK1/Work.mod"
    steps_before = ("TASK1/Work.mod", "  ENDPROC")
    tool_names, frame_names = ("tool0", "tGrip", "tTorch"), ("wobj0", "wFixture", "wTable")

    def _sides(self, row: Matrix) -> tuple[float, float, float]:
        """By the data sheet: axis 2 at 290 mm, lower arm 270, wrist's centre 72 before the flange."""
        flange = self.arm.fk(row - np.array([row[0], 0, 0, 0, 0, 0]), "deg")
        wrist = flange[:3, 3] - 72 * flange[:3, 2]
        lower = 270 * np.array([np.sin(np.radians(row[1])), np.cos(np.radians(row[1]))])
        fore = np.array([wrist[0], wrist[2]]) - np.array([0, 290]) - lower
        return wrist[0], float(lower[1] * fore[0] - lower[0] * fore[1]) / 270, float(row[4])

    def clear(self, joints: Matrix) -> float:
        return min(map(abs, self._sides(joints)))

    def _confdata(self, joints: Matrix) -> list[int]:
        ahead, before, bent = self._sides(joints)
        quadrants = [int(np.floor(joints[i] / 90)) for i in (0, 3, 5)]
        return [*quadrants, 4 * int(ahead < 0) + 2 * int(before < 0) + int(bent < 0)]

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        near = [joints + slack for slack in (-1e-3, 0.0, 1e-3)]
        return [int(each) for each in configuration] in [self._confdata(each) for each in near]

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        pose = np.eye(4)
        pose[:3, 3] = numbers[:3]
        pose[:3, :3] = Rotation.from_quat([*numbers[4:7], numbers[3]]).as_matrix()
        return pose

    def _seven(self, pose: Matrix) -> str:
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
        place = ",".join(f"{value:.6g}" if abs(value) > 1 else f"{value:.6f}" for value in pose[:3, 3])
        return f"[{place}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}]"

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        unused, load = "[9E9,9E9,9E9,9E9,9E9,9E9]", "[1,[0,0,1],[1,0,0,0],0,0,0]"
        data = [
            *(
                f"  PERS tooldata {name}:=[TRUE,[{self._seven(pose)}],{load}];"
                for name, pose in backup.tools.items()
                if name != "tool0"
            ),
            *(
                f'  TASK PERS wobjdata {name}:=[FALSE,TRUE,"",[{self._seven(pose)}],[[0,0,0],[1,0,0,0]]];'
                for name, pose in backup.frames.items()
                if name != "wobj0"
            ),
        ]
        body = []
        for one in backup.positions:
            inline = rng.random() < 0.2
            if one.in_joints:
                value = f"[[{','.join(f'{each:.3f}' for each in one.joints)}],{unused}]"
                kind, move = "jointtarget", "MoveAbsJ"
            else:
                exact = self.matrix(_numbers(self._seven(self.pose(one, backup))))
                value = f"[{self._seven(exact)},{str(self._confdata(one.joints)).replace(' ', '')},{unused}]"
                kind, move = "robtarget", str(rng.choice(["MoveJ", "MoveL"]))
            frame = f"\\WObj:={one.frame}" if one.frame != "wobj0" or rng.random() < 0.3 else ""
            goal = f"\\Conc,{value}" if inline and rng.random() < 0.3 else value if inline else one.name
            if not inline:
                data.append(f"  CONST {kind} {one.name}:={value};")
            body.append(f"    {move} {goal},v500,z10,{one.tool}{frame}; ! {one.name} is P99")
        lines = ["%%%", "  VERSION:1", "%%%", "MODULE Work ! made", *data, "  PROC main()", *body]
        return {
            "TASK1/Work.mod": "\r\n".join(
                [*lines, '    TPWrite "MoveL p,v,z,t;";', "  ENDPROC", "ENDMODULE", ""]
            )
        }

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        if f"robtarget {one.name}:=" not in backup.texts[self.main]:
            return None
        word, axes = [("Offs", "frame"), ("RelTool", "tool")][rng.integers(2)]
        numbers = ",".join(f"{each:g}" for each in by)
        frame = "" if one.frame == "wobj0" else f"\\WObj:={one.frame}"
        line = f"    MoveL {word}({one.name},{numbers}),v100,fine,{one.tool}{frame};"
        return MadeStep(line, one.name, by, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        (text,) = texts.values()
        declared = re.search(rf"target {one.name}:=(.*?);", text)
        line = declared or re.search(rf"(?:MoveAbsJ|MoveJ|MoveL) (.*?),v500,[^\n]*! {one.name} is", text)
        assert line is not None
        numbers = _numbers(line[1])
        if one.in_joints:
            return numbers[:6], ()
        return numbers[:7], [str(int(each)) for each in numbers[7:11]]


class Krl(Dialect):
    """Programs and data lists of a KR 6 R900, with $config.dat."""

    name, robot, main = "KRL", "kr6_r900", "KRC/R1/Program/work.dat"
    steps_before = ("KRC/R1/Program/work.src", "END\r\n")
    tool_names, frame_names = ("0", "1", "3"), ("0", "2", "5")

    def label(self, one: MadePosition) -> str:
        return f"X{one.name}"

    def _sides(self, row: Matrix) -> tuple[float, float, float]:
        q2, q3 = np.radians(row[1]), np.radians(row[1] + row[2])
        ahead = 25 + 455 * np.cos(q2) + 35 * np.sin(q3) + 420 * np.cos(q3)
        return (
            float(ahead),
            float((row[2] - np.degrees(np.arctan2(35, 420)) + 180) % 360 - 180),
            float(row[4]),
        )

    def clear(self, joints: Matrix) -> float:
        return min(map(abs, self._sides(joints)))

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        ahead, elbow, bent = self._sides(joints)
        status, *turns = map(int, configuration)
        right = status & 7 == int(ahead < 0) + 2 * int(elbow > 0) + 4 * int(bent < 0)
        return right and all(
            turns[0] >> i & 1 == int(joints[i] < 0) or abs(joints[i]) < 1e-3 for i in range(6) if turns
        )

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "ZYX")

    def _components(self, pose: Matrix) -> str:
        names = zip("XYZABC", _angles(pose, "ZYX"), strict=True)
        return ",".join(f"{name} {value:.6f}" for name, value in names)

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        config = [
            "DEFDAT  $CONFIG PUBLIC",
            *(f"TOOL_DATA[{n}]={{{self._components(pose)}}}" for n, pose in backup.tools.items() if n != "0"),
            *(
                f"BASE_DATA[{n}]={{{self._components(pose)}}}"
                for n, pose in backup.frames.items()
                if n != "0"
            ),
            "LOAD_DATA[1]={M 5.0,CM {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0},J {X 0.1,Y 0.1,Z 0.1}}",
            "ENDDAT",
        ]
        data, body = ["&ACCESS RVP", "DEFDAT  WORK"], ["&ACCESS RVP", "DEF work( )", "BAS (#INITMOV,0 )"]
        for one in backup.positions:
            rest = ",".join(f"E{i} 0.0" for i in range(1, 7))
            if one.in_joints:
                axes = ",".join(f"A{i} {value:.3f}" for i, value in enumerate(one.joints, start=1))
                kind, value = "E6AXIS", f"{{{axes},{rest}}}"
            else:
                ahead, elbow, bent = self._sides(one.joints)
                status = (
                    int(ahead < 0) + 2 * int(elbow > 0) + 4 * int(bent < 0) + int(16 * (rng.random() < 0.3))
                )
                turns = sum(1 << i for i in range(6) if one.joints[i] < 0)
                kind = "E6POS"
                value = f"{{{self._components(self.pose(one, backup))},S {status},T {turns},{rest}}}"
            tool, frame = one.tool, one.frame
            way = rng.integers(3)
            data.append(f"DECL {kind} X{one.name}={value} ; {{X 1,Y 2}}")
            if way == 0:
                frames = f'{{TOOL_NO {tool},BASE_NO {frame},IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}'
                data.append(f"DECL FDAT F{one.name}={frames}")
                body += [f"FDAT_ACT=F{one.name}", "BAS(#PTP_PARAMS,100)", f"PTP X{one.name} C_PTP"]
            elif way == 1:
                body += [f"BAS(#TOOL,{tool})", f"BAS(#BASE,{frame})", f"PTP X{one.name}"]
            else:
                body += [
                    f"$TOOL={'$NULLFRAME' if tool == '0' else f'TOOL_DATA[{tool}]'}",
                    f"$BASE={'$NULLFRAME' if frame == '0' else f'BASE_DATA[{frame}]'}",
                    f"{'PTP' if one.in_joints else 'LIN'} X{one.name}",
                ]
        folder = "KRC/R1/Program/"
        return {
            "KRC/R1/System/$config.dat": "\r\n".join([*config, ""]),
            f"{folder}work.dat": "\r\n".join([*data, "ENDDAT", ""]),
            f"{folder}work.src": "\r\n".join([*body, "END", ""]),
        }

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        mode, axes = [("", "frame"), (" #BASE", "frame"), (" #TOOL", "tool")][rng.integers(3)]
        fields = ",".join(f"{name} {each:g}" for name, each in zip("XYZ", by, strict=True))
        return MadeStep(f"LIN_REL {{{fields}}}{mode}", None, by, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        line = re.search(rf" X{one.name}=\{{(.*?)\}}", texts["KRC/R1/Program/work.dat"])
        assert line is not None
        fields = dict(part.split() for part in line[1].split(","))
        if one.in_joints:
            return [float(fields[f"A{i}"]) for i in range(1, 7)], ()
        return [float(fields[name]) for name in "XYZABC"], (fields["S"], fields["T"])


class Fanuc(Dialect):
    """Listings of an LR Mate 200iD with SYSFRAME.VA and POSREG.VA."""

    name, robot, main = "TP", "lrmate_200id", "WORK.LS"
    joint_digit, turn_digit = 5.1e-4, 1.5e-3  # three decimals of each joint, of each of three angles
    steps_before = ("WORK.LS", "/POS")
    tool_names, frame_names = ("0", "1", "3"), ("0", "2", "4")

    def label(self, one: MadePosition) -> str:
        return f"P[{one.name[1:]}]"

    def counted(self, joints: Matrix, sign: float) -> Matrix:
        return np.asarray(joints - sign * np.array([0, 0, joints[1], 0, 0, 0]))

    def _sides(self, row: Matrix) -> tuple[float, float, float]:
        q2, q3 = np.radians(row[1]), np.radians(row[2] - row[1])
        elbow = np.array([330 * np.sin(q2), 330 * np.cos(q2)])
        fore = np.array([335 * np.cos(q3) - 35 * np.sin(q3), 335 * np.sin(q3) + 35 * np.cos(q3)])
        return (
            float((elbow[1] * fore[0] - elbow[0] * fore[1]) / 330),
            float(50 + elbow[0] + fore[0]),
            float(row[4]),
        )

    def clear(self, joints: Matrix) -> float:
        return min(map(abs, self._sides(joints)))

    def _config(self, joints: Matrix) -> str:
        up, ahead, bent = self._sides(joints)
        turns = ", ".join(str(int(np.floor((joints[k] + 180) / 360))) for k in (0, 3, 5))
        return f"{'N' if bent < 0 else 'F'} {'U' if up > 0 else 'D'} {'T' if ahead > 0 else 'B'}, {turns}"

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return ", ".join(configuration) in [self._config(joints + slack) for slack in (-1e-3, 0.0, 1e-3)]

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "xyz")

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        def entry(number: str, pose: Matrix) -> list[str]:
            x, y, z, w, p, r = _angles(pose, "xyz")
            return [
                f"    [1,{number}] = ",
                "  Group: 1   Config: N D B, 0, 0, 0",
                f"  X: {x:9.3f}   Y: {y:9.3f}   Z: {z:9.3f}".replace(" 0.", "  ."),
                f"  W: {w:9.3f}   P: {p:9.3f}   R: {r:9.3f}",
            ]

        frames = ["[*SYSTEM*]$MNUFRAME  Storage: SHADOW  Access: RW  : ARRAY[2,9] OF POSITION"]
        frames += [line for n, pose in backup.frames.items() if n != "0" for line in entry(n, pose)]
        frames += ["", "[*SYSTEM*]$MNUTOOL  Storage: SHADOW  Access: RW  : ARRAY[2,9] OF POSITION"]
        frames += [line for n, pose in backup.tools.items() if n != "0" for line in entry(n, pose)]
        registers = ["[*POSREG*]$POSREG  Storage: SHADOW  Access: RW  : ARRAY[1,100] OF TaughtPosition Reg"]
        body, points = [], []
        for number, one in enumerate(backup.positions, start=1):
            shown = self.counted(one.joints, 1.0)
            if one.in_joints and rng.random() < 0.4:
                axes = [f"J{k} = {value:9.3f} deg" for k, value in enumerate(shown, start=1)]
                registers += [f"    [1,{number}] =   '{one.name}'   Group: 1", "  " + "   ".join(axes[:3])]
                registers += ["  " + "   ".join(axes[3:]), ""]
                body.append(f"J PR[{number}:{one.name}] 100% FINE")
                continue
            frame = f"\tUF : {one.frame}, UT : {one.tool},\t"
            if one.in_joints:
                parts = [f"J{k}= {value:9.3f} deg" for k, value in enumerate(shown, start=1)]
            else:
                units = ["mm"] * 3 + ["deg"] * 3
                values = zip("XYZWPR", _angles(self.pose(one, backup), "xyz"), units, strict=True)
                parts = [f"{key} = {value:9.3f} {unit:>3}" for key, value, unit in values]
                frame += f"\tCONFIG : '{self._config(one.joints)}',"
            rows = ["\t" + ",\t".join(parts[:3]) + ",", "\t" + ",\t".join(parts[3:])]
            points += [f'P[{number}:"{one.name}"]{{', "   GP1:", frame, *rows, "};"]
            body.append(f"{'J' if one.in_joints else rng.choice(['J', 'L'])} P[{number}] 100% FINE")
        registers.append("    [1,90] =   'spare' Uninitialized")
        lines = [f"{n:4}:{row}    ;" for n, row in enumerate(["  !P[9]=LPOS", *body], start=1)]
        head = ["/PROG  WORK", "/ATTR", "OWNER\t\t= MNEDITOR;", "/APPL", "/MN"]
        return {
            "SYSFRAME.VA": "\n".join([*frames, ""]),
            "POSREG.VA": "\n".join([*registers, ""]),
            "WORK.LS": "\n".join([*head, *lines, "/POS", *points, "/END", ""]),
        }

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        word, axes = [("Offset", "frame"), ("Tool_Offset", "tool")][rng.integers(2)]
        return MadeStep(f"  99:L P[{one.name[1:]}] 9mm/sec FINE {word},PR[90]    ;", one.name, None, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        point = re.search(rf'P\[\d+:"{one.name}"\]\{{(.*?)\}}', texts["WORK.LS"], re.DOTALL)
        if point is None:
            entry = re.search(rf"'{one.name}'   Group: 1(.*?)\n *(?:\n|\[)", texts["POSREG.VA"], re.DOTALL)
            assert entry is not None
            return [float(each) for each in re.findall(rf"J\d = +({NUMBER})", entry[1])], ()
        keys = [f"J{k}" for k in range(1, 7)] if one.in_joints else list("XYZWPR")
        numbers = [float(re.search(rf"\b{key} ?= *({NUMBER})", point[1])[1]) for key in keys]  # type: ignore[index]
        stated_configuration = re.search(r"CONFIG : '([A-Z ]+), (.*?)'", point[1])
        return numbers, stated_configuration.groups() if stated_configuration else ()


class Inform(Dialect):
    """Jobs of a GP7 with TOOL.CND and UFRAME.CND."""

    name, main = "INFORM", "JOBS/WORK.JBI"
    joint_digit, turn_digit = yaskawa_controller.STEP_DEG, 1e-3  # half a pulse; four decimals
    steps_before = ("JOBS/WORK.JBI", "END\r\n")
    tool_names, frame_names = ("0", "1", "7"), ("base", "2", "10")

    def label(self, one: MadePosition) -> str:
        return f"C{int(one.name[1:]) - 1:05d}"

    @cached_property
    def robot(self) -> str:  # type: ignore[override]
        return yaskawa_controller.robot_file(Path(mkdtemp()))

    def _sides(self, row: Matrix) -> tuple[float, float]:
        """By the data sheet: axis L 40 mm before axis S, lower arm 445, fore arm 440 and 40 across it."""
        lower, fore = np.radians(row[1]), np.radians(row[2] - row[1])
        arm = 445 * np.array([np.sin(lower), np.cos(lower)])
        centre = 440 * np.array([np.cos(fore), np.sin(fore)]) + 40 * np.array([-np.sin(fore), np.cos(fore)])
        return 40 + arm[0] + centre[0], float(arm[1] * centre[0] - arm[0] * centre[1]) / 445

    def clear(self, joints: Matrix) -> float:
        ahead, above = self._sides(joints)
        turns = np.abs(np.abs(joints[[0, 3, 5]]) - 180).min(), abs(abs(joints[3]) - 90), abs(joints[4])
        return min(ahead, abs(above), *turns)  # behind axis S nothing is converted

    def _rconf(self, joints: Matrix) -> str:
        flip = int(90 < abs(joints[3]) <= 270)
        beyond = [int(abs(joints[i]) > 180) for i in (3, 5, 0)]
        return ",".join(map(str, [flip, int(self._sides(joints)[1] < 0), 0, *beyond, 0, 0]))

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return self._rconf(joints) == configuration[0]

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "xyz")

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        frames = []
        for n, pose in backup.frames.items():
            if n != "base":
                values = [f"{value:.4f}" for value in _angles(pose, "xyz")]
                frames += [f"//UFRAME {n}", "///NAME X", "///TOOL 0", "///GROUP 1,0,0", "///PULSE"]
                frames += ["////RORG C000=1,2,3,4,5,6", f"////BUSER {','.join(values)}"]
        tools = []
        for n, pose in backup.tools.items():
            *place, rx, ry, rz = _angles(pose, "xyz")
            angles = [f"{value:.4f}" for value in (rx, ry, rz)]
            numbers = ",".join([*(f"{value:.3f}" for value in place), *angles])
            tools += [f"//TOOL {n}", *(["///CRC 1"] if n == "1" else []), f"///NAME T {n}", numbers]
            tools += ["1.000,2.000,3.000", "4.000", "0.100,0.200,0.300", "0.000,0,1"]
        rows, body = [], []
        for number, one in enumerate(backup.positions):
            pulses = one.in_joints
            rows += [f"///TOOL {one.tool}"] if rng.random() < 0.5 or not pulses else []
            if pulses:
                rows += ["///POSTYPE PULSE", "///PULSE"]
                values = [f"{value:.0f}" for value in one.joints * yaskawa_controller.PULSES]
            else:
                rows += [f"///USER {one.frame}"] if one.frame != "base" else []
                rows += [f"///POSTYPE {'USER' if one.frame != 'base' else rng.choice(['ROBOT', 'BASE'])}"]
                rows += ["///RECTAN ", f"///RCONF {self._rconf(one.joints)}"]
                decimals = (3, 3, 3, 4, 4, 4)
                numbers = zip(_angles(self.pose(one, backup), "xyz"), decimals, strict=True)
                values = [f"{value:.{digits}f}" for value, digits in numbers]
            rows.append(f"C{number:05d}={','.join(values)}")
            move = f"\t {rng.choice(['MOVJ', 'MOVL'])} C{number:05d} VJ=50.00 PL=0 "
            body += ["IFTHENEXP I040=20 ", move, "ENDIF"]
        head = ["/JOB", "//NAME WORK", "//POS", f"///NPOS {len(backup.positions)},0,0,0,0,0"]
        inst = ["//INST", "///DATE 2026/01/01 00:00", "///ATTR SC,RW,RJ", "////FRAME BASE"]
        inst += ["///GROUP1 RB1", "NOP"]
        lines = [*head, *rows, *inst, "'MOVJ C00099", *body, 'MSG "MOVJ P001"', "END", ""]
        data = {"UFRAME.CND": frames, "TOOL.CND": tools, "JOBS/WORK.JBI": lines[:-1]}
        return {name: "\r\n".join([*of_file, ""]) for name, of_file in data.items()}

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        return MadeStep("IMOV P099 V=10.0 BF", None, None, None)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        before, _, behind = texts["JOBS/WORK.JBI"].partition(f"C{int(one.name[1:]) - 1:05d}=")
        numbers = _numbers(behind.split("\r\n")[0])
        if one.in_joints:
            return (np.array(numbers) / yaskawa_controller.PULSES).tolist(), ()
        return numbers, (before.rpartition("///RCONF ")[2].strip(),)


class As(Dialect):
    """A saved file of an RS007N. It states no configuration: all poses are near some joints."""

    name, robot, main = "AS", "rs007n", "saved.as"
    joint_digit = 1e-5
    steps_before = ("saved.as", ".TRANS\r\n")
    tool_names, frame_names = ("null", "grip", "torch"), ("null", "jig", "table")
    near = np.array([15.0, 25.0, -75.0, 30.0, 50.0, -20.0])

    def label(self, one: MadePosition) -> str:
        return f"#{one.name}" if one.in_joints else f"{one.name}[1,2]"

    def random_joints(self, rng: np.random.Generator) -> Matrix:
        return np.asarray(self.near + np.round(rng.uniform(-12, 12, 6), 3))

    def clear(self, joints: Matrix) -> float:
        return float(joints[4])

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return configuration == ()

    def options(self, backup: MadeBackup) -> dict[str, object]:
        return {"near": ",".join(map(str, self.near))}

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "ZYZ")

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        frames = {**backup.tools, **backup.frames}
        stays = rng.random() < 0.3  # no program sets a tool or base: those of .SYSDATA
        if stays:
            one = backup.positions[0]
            backup.positions[:] = [replace(each, tool=one.tool, frame=one.frame) for each in backup.positions]
        first = backup.positions[0]
        shown = {name: " ".join(f"{value:.6f}" for value in _angles(frames[name], "ZYZ")) for name in frames}
        used = set() if stays else {each for one in backup.positions for each in (one.tool, one.frame)}
        trans = [f"{name} {shown[name]}" for name in sorted(used - {"null"})]
        joints, programs = [], []
        for one in backup.positions:
            if one.in_joints:
                values = [f"{value:.6f}" for value in one.joints]
                way = rng.integers(3)
                joints += [f"#{one.name} {' '.join(values)}"] if way == 0 else []
                block = f"  JOINT SPEED9 ACCU1 TOOL1 (OFF,0,0,O) OX= WX= #[{','.join(values)}] ;{one.name}"
                moves = [f"  JMOVE #{one.name}", f"  JMOVE #[{', '.join(values)}] ;{one.name}", block][way]
            else:
                values = [f"{value:.6f}" for value in _angles(self.pose(one, backup), "ZYZ")]
                inline = rng.random() < 0.3
                trans += [] if inline else [f"{one.name}[1,2] {' '.join(values)}"]
                goal = f"TRANS({','.join(values)}) ;{one.name}" if inline else f"{one.name.lower()}[1,2]"
                moves = f"  {rng.choice(['LMOVE', 'JMOVE'])} {goal}"
            sets = [] if stays else [f"  TOOL {one.tool}", f"  BASE {one.frame.upper()}"]
            programs += [f".PROGRAM go.{one.name}() #12", *sets, moves, "  DELAY 1 ;LMOVE away", ".END"]
        head = [".*=== AS GROUP ===         : ASE_000000000", '.NETCONF     10.0.0.2,"x",255.255.255.0']
        system = ["ZROBOT.TYPE    30   4   6 2010      -30751   RS007N-A001 ( 2017-05-24 10:38 )", ".END"]
        system += [".SYSDATA", f"BASE   {shown[first.frame]}", f"TOOL   {shown[first.tool]}", "TOOLSHAPE 0 1"]
        lines = [
            *head,
            ".ROBOTDATA1",
            *system,
            ".END",
            *programs,
            ".TRANS",
            *trans,
            ".END",
            ".JOINTS",
            *joints,
        ]
        return {"saved.as": "\r\n".join([*lines, ".END", ".REALS", "a = 1", ".END", ""])}

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        sets = [f"  TOOL {one.tool}", f"  BASE {one.frame}"] if "  TOOL " in backup.texts[self.main] else []
        away, numbers = np.array([0, 0, -abs(by[2])]), ",".join(f"{each:g}" for each in by)
        start, line, by, axes = [
            (one.name, f"  LAPPRO {one.name}[1,2],{-away[2]:g}", away, "tool"),
            (None, f"  LDEPART {-away[2]:g}", away, "tool"),
            (None, f"  DRAW {numbers}", by, "frame"),
            (None, f"  TDRAW {numbers}", by, "tool"),
        ][rng.integers(4)]
        if start and not re.search(rf"^{one.name}\[1,2\] ", backup.texts[self.main], re.MULTILINE):
            return None
        program = "\r\n".join([".PROGRAM step()", *sets, line])
        return MadeStep(program, start, by, axes, ".END\r\n")

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        (text,) = texts.values()
        entry = rf"^#?{one.name}(?:\[1,2\])? ([-\d. ]+)\r$|^.*(?:TRANS\(|#\[)([-\d., ]+)[)\]] ;{one.name}\r$"
        found = re.search(entry, text, re.MULTILINE)
        assert found is not None
        return _numbers(found[1] or found[2]), ()


class Spel(Dialect):
    """Points and a program of an arm of Epson with the lengths of another."""

    name, main = "SPEL+", "robot1.pts"
    steps_before = ("Main.prg", "Fend")
    tool_names, frame_names = ("0", "1", "3"), ("0", "2", "5")
    near = np.array([15.0, 25.0, -75.0, 30.0, 50.0, -20.0])

    def label(self, one: MadePosition) -> str:
        return f"at{one.name}"

    @cached_property
    def robot(self) -> str:  # type: ignore[override]
        return epson_controller.robot_file(Path(mkdtemp()))

    def random_joints(self, rng: np.random.Generator) -> Matrix:
        return np.asarray(self.near + np.round(rng.uniform(-12, 12, 6), 3))

    def clear(self, joints: Matrix) -> float:
        return float(joints[4])

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return [*configuration] in (["1", "1", "2"], [])

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "ZYX")

    def options(self, backup: MadeBackup) -> dict[str, object]:
        frames = [f"{n}={','.join(map(repr, _angles(pose, 'ZYX')))}" for n, pose in backup.frames.items()]
        return {"near": ",".join(map(str, self.near)), "frames": frames, "accept": ["robot1.pts:1"]}

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        # A literal XY is of Local 0, and a literal is in no file of points.
        literal = [one.in_joints or number % 3 == 2 for number, one in enumerate(backup.positions)]
        pairs = zip(backup.positions, literal, strict=True)
        backup.positions[:] = [replace(one, frame="0") if inline else one for one, inline in pairs]
        sets = [
            f"  TLSet {n}, XY({', '.join(f'{value:.6f}' for value in _angles(pose, 'ZYX'))})"
            for n, pose in backup.tools.items()
            if n != "0"
        ]
        points, body = [], ["  Motor On", "  Power Low", *sets]
        for number, (one, inline) in enumerate(zip(backup.positions, literal, strict=True)):
            body.append(f"  Tool {one.tool}")
            if one.in_joints:
                body.append(f"  Go JA({', '.join(f'{value:.6f}' for value in one.joints)}) ' {one.name}")
                continue
            values = [f"{value:.6f}" for value in _angles(self.pose(one, backup), "ZYX")]
            if inline:
                body.append(
                    f"  {rng.choice(['Go', 'Move'])} XY({', '.join(values)}) /R /A /F CP ' {one.name}"
                )
                continue
            fields = [f"nNumber={number}", f'sLabel="at{one.name}"', 'sDescription=""', "nUndefined=0"]
            fields += [f"r{axis}={value}" for axis, value in zip("XYZUVW", values, strict=True)]
            fields += ["rR=0", "rS=0", "rT=0", f"nLocal={one.frame}", "nHand=1", "nElbow=1", "nWrist=2"]
            fields += ["nJ1Flag=0", "nJ4Flag=0", "nJ6Flag=0", "rJ1Angle=0", "bSimVisible=False"]
            points += [f"Point{number + 1} {{", *(f"\t{field}" for field in fields), "}"]
            goal = str(rng.choice([f"AT{one.name}", f"P{number}", f"P({number})"]))
            body.append(f"  {rng.choice(['Go', 'Move', 'Jump'])} {goal}{rng.choice(['', ' CP', ' LJM'])}")
        count = sum(line.startswith("Point") for line in points)
        head = ["ENVT0100,1234567", "sVersion=1.0.0", "nNumberOfJoints=6", f"nNumberOfPoints={count}"]
        lines = ["Global Preserve Integer n", "Function main", *body, "Fend", ""]
        return {"robot1.pts": "\r\n".join([*head, *points, ""]), "Main.prg": "\r\n".join(lines)}

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        added = " ".join(f"{'-' if v < 0 else '+'}{a}({abs(v):g})" for a, v in zip("XYZ", by, strict=True))
        numbers = ", ".join(f"{each:g}" for each in by)
        start, line, axes = [
            (one.name, f"  Go at{one.name} {added}", "frame"),
            (None, f"  TMove XY({numbers}, 0)", "tool"),
            (None, f"  BGo XY({numbers}, 0, 0, 0)", "frame"),
        ][rng.integers(3)]
        if start and f'"at{one.name}"' not in backup.texts[self.main]:
            return None
        return MadeStep(f"  Tool {one.tool}\r\n{line}", start, by, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        if (
            line := re.search(rf"(?:JA|XY)\((.*?)\).* ' {one.name}\r$", texts["Main.prg"], re.MULTILINE)
        ) is not None:
            return _numbers(line[1]), ()
        (block,) = re.findall(rf'sLabel="at{one.name}"([^}}]*)\}}', texts["robot1.pts"])
        fields = dict(field.split("=") for field in block.split())
        return [float(fields[f"r{axis}"]) for axis in "XYZUVW"], [
            fields[f"n{w}"] for w in ("Hand", "Elbow", "Wrist")
        ]


class Melfa(Dialect):
    """A program of an RV-4FRL with its variables; flags of a position stay as they are."""

    name, robot, main = "MELFA-BASIC", "rv4frl", "WORK.PRG"
    joint_digit = 1e-4
    steps_before = ("WORK.PRG", "End")
    tool_names, frame_names = ("P_NTool", "PGrip", "PTorch"), ("0",)
    near = np.array([15.0, 25.0, 75.0, 30.0, 50.0, -20.0])

    def random_joints(self, rng: np.random.Generator) -> Matrix:
        return np.asarray(self.near + np.round(rng.uniform(-12, 12, 6), 3))

    def clear(self, joints: Matrix) -> float:
        return float(joints[4])

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return [*configuration] in (["7", "0"], [])

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "xyz")

    def options(self, backup: MadeBackup) -> dict[str, object]:
        return {"near": ",".join(map(str, self.near))}

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        def values(pose: Matrix) -> str:
            return ",".join(f"{value:+.4f}" for value in _angles(pose, "xyz"))

        used = sorted({one.tool for one in backup.positions} - {"P_NTool"})
        stored, body = [f"{n}=({values(backup.tools[n])})(7,0)" for n in used], []
        for one in backup.positions:
            body.append(f"Tool {one.tool if rng.random() < 0.5 else one.tool.upper()}")
            if one.in_joints:
                stored.append(f"J{one.name[1:]}=({','.join(f'{value:+.4f}' for value in one.joints)})")
                body.append(f"Mov J{one.name[1:]}")
            elif rng.random() < 0.3:
                body.append(f"Mvs ({values(self.pose(one, backup))})(7,0) ' {one.name} Mov P9")
            else:
                name = one.name if rng.random() < 0.5 else f"PA({one.name[1:]})"
                stored.append(f"{name}=({values(self.pose(one, backup))},+0.00,+0.00)(7,0)")
                body.append(f"{rng.choice(['Mov', 'Mvs'])} {name} {rng.choice(['', 'Wth M_Out(1)=1'])}")
        lines = [f"{number} {line}" for number, line in enumerate([*body, "Dly 0.5", "End"], start=1)]
        return {"WORK.PRG": "\r\n".join([*lines, *stored, ""])}

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        names = [
            name for name in (one.name, f"PA({one.name[1:]})") if f"\n{name}=" in backup.texts[self.main]
        ]
        if not names:
            return None
        numbers = ",".join(f"{each:+.2f}" for each in by)
        away = np.array([0, 0, by[2]])
        line, by, axes = [
            (f"Mvs {names[0]}, {by[2]:g}", away, "tool"),
            (f"P98=({numbers},0,0,0)(0,0)\r\nMov {names[0]}+P98", by, "frame"),
            (f"P98=({numbers},0,0,0)(0,0)\r\nMov {names[0]} * P98", by, "tool"),
        ][rng.integers(3)]
        return MadeStep(f"Tool {one.tool}\r\n{line}", one.name, by, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        n = one.name[1:]
        line = rf"^(?:P{n}|PA\({n}\)|J{n})=\((.*?)\)(.*)$|^\d+ Mvs \((.*?)\)(\(.*\)) ' P{n} Mov P9\r$"
        found = re.search(line, texts["WORK.PRG"], re.MULTILINE)
        assert found is not None
        return _numbers(found[1] or found[3])[:6], re.findall(r"\d+", found[2] or found[4] or "")


class Val3(Dialect):
    """An application of a TX2-60, of s6 or of s7."""

    name, robot, main = "VAL3", "tx2_60", "usrapp/work/work.dtx"
    joint_digit = 1e-5
    steps_before = ("usrapp/work/start.pgx", "  waitEndMove()")
    tool_names, frame_names = ("flange", "tGrip", "tTorch"), ("world", "fTable", "fJig")

    def label(self, one: MadePosition) -> str:
        return f"p{one.name}[{'1' if int(one.name[1:]) % 2 else '0'}]"

    def _sides(self, row: Matrix) -> tuple[float, float, float]:
        """By the data sheet: axis 2 is above axis 1, upper arm 290 mm, forearm 310 mm."""
        second, third = np.radians(row[1]), np.radians(row[1] + row[2])
        return 290 * np.sin(second) + 310 * np.sin(third), float(row[2]), float(row[4])

    def clear(self, joints: Matrix) -> float:
        return min(map(abs, self._sides(joints)))

    def _words(self, joints: Matrix) -> list[str]:
        ahead, elbow, wrist = self._sides(joints)
        signs = [
            f"{letter}{'positive' if side > 0 else 'negative'}"
            for letter, side in (("e", elbow), ("w", wrist))
        ]
        return ["lefty" if ahead > 0 else "righty", *signs]

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return [*configuration] in (self._words(joints), [])

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "XYZ")

    def _six(self, pose: Matrix) -> str:
        keys = zip(("x", "y", "z", "rx", "ry", "rz"), _angles(pose, "XYZ"), strict=True)
        return " ".join(f'{key}="{value:.6f}"' for key, value in keys)

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        older = bool(rng.random() < 0.5)
        # fJig is in fTable, tTorch in tGrip.
        jig = np.linalg.inv(backup.frames["fTable"]) @ backup.frames["fJig"]
        torch = np.linalg.inv(backup.tools["tGrip"]) @ backup.tools["tTorch"]
        made = [
            ("frame", "fTable", "world", self._six(backup.frames["fTable"]), ""),
            ("frame", "fJig", "fTable", self._six(jig), ""),
            ("tool", "tGrip", "flange", self._six(backup.tools["tGrip"]), ""),
            ("tool", "tTorch", "tGrip", self._six(torch), ""),
        ]
        body = []
        for one in backup.positions:
            name, index = self.label(one)[:-1].split("[")
            if one.in_joints:
                values = " ".join(f'j{i}="{value:.6f}"' for i, value in enumerate(one.joints, start=1))
                made.append(("joint", self.label(one), "", values, ""))
                body.append(f"  movej({name}[{index}],{one.tool},mNom)")
            else:
                words = zip(("shoulder", "elbow", "wrist"), self._words(one.joints), strict=True)
                six, config = (
                    self._six(self.pose(one, backup)),
                    " ".join(f'{k}="{word}"' for k, word in words),
                )
                made.append(("point", self.label(one), one.frame, six, config))
                goal = name if index == "0" else f"{name}[{index}]"
                body.append(
                    f"  {rng.choice(['movej', 'nMove=movel'])}({goal}, {one.tool}, mNom) // movel(pX,t,m)"
                )
        body += ["  waitEndMove()", '  putln("movej(p1,t,m)")']
        code = "\r\n".join(["begin", *body, "end"])
        head = '<?xml version="1.0" encoding="utf-8"?>'
        if older:
            data = [
                f'{head}\r\n<dataList xmlns="DataNameSpace">',
                *map(self._element, made),
                "</dataList>",
                "",
            ]
            program = (
                f'{head}<programList xmlns="ProgramNameSpace"><program name="start"><source><code>{code}'
            )
            program += "</code></source></program></programList>"
        else:
            data = [f'{head}\r\n<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2">\r\n<Datas>']
            data += [*map(self._value, made), "</Datas>", "</Database>", ""]
            space = "http://www.staubli.com/robotics/VAL3/Program/2"
            program = f'{head}<Programs xmlns="{space}"><Program name="start"><Code><![CDATA[{code}]]></Code>'
            program += "</Program></Programs>"
        return {self.main: "\r\n".join(data), "usrapp/work/start.pgx": program}

    @staticmethod
    def _value(row: tuple[str, ...]) -> str:
        kind, name, father, numbers, config = row
        word, _, index = name.partition("[")
        size, of = int(index[:-1] or 0) + 1 if index else 1, f' fatherId="{father}[0]"' if father else ""
        kind = {"joint": "jointRx", "point": "pointRx"}.get(kind, kind)
        value = f'<Value key="{size - 1}" {numbers} {config}{of} />'
        return f'  <Data name="{word}" xsi:type="array" type="{kind}" size="{size}">{value}</Data>'.replace(
            'xsi:type="array" ', ""
        )

    @staticmethod
    def _element(row: tuple[str, ...]) -> str:
        kind, name, father, numbers, config = row
        word, _, index = name.partition("[")
        value = {"joint": "jointValue", "point": "tpValue", "tool": "ttValue", "frame": "tfValue"}[kind]
        of = f'<{kind[0]}Father alias="" name="{father}" fatherIndex="0" />' if father else ""
        words = f"<cpValue {config} />" if config else ""
        inner = f'<value{kind.title()} index="{index[:-1] or 0}"><{value} {numbers} />{words}'
        return f'  <{kind} name="{word}" public="false">{of}{inner}</value{kind.title()}></{kind}>'

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        numbers = ",".join(f"{each:g}" for each in by)
        goal, axes = [
            (f"appro({self.label(one)},{{{numbers},0,0,0}})", "tool"),
            (f"compose({self.label(one)},{one.frame},{{{numbers},0,0,0}})", "frame"),
        ][rng.integers(2)]
        return MadeStep(f"  movel({goal},{one.tool},mNom)", one.name, by, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        name, text = self.label(one).split("[")[0], texts[self.main]
        (block,) = re.findall(rf'<(?:Data|joint|point) name="{name}"(.*?)</(?:Data|joint|point)>', text)
        keys = [f"j{i}" for i in range(1, 7)] if one.in_joints else ["x", "y", "z", "rx", "ry", "rz"]
        numbers = [float(re.search(rf' {key}="({NUMBER})"', block)[1]) for key in keys]  # type: ignore[index]
        words = re.findall(r'(?:shoulder|elbow|wrist)="(\w+)"', block)
        return numbers, words


class Drl(Dialect):
    """A program of an M0609. It states no configuration; tools and user frames are stated."""

    name, robot, main = "DRL", "m0609", "work.drl"
    joint_digit = 1e-5
    steps_before = ("work.drl", "wait(0.5)")
    tool_names, frame_names = ("none", "Grip 1", "Torch"), ("base", "DR_USER1", "101")
    near = np.array([15.0, 25.0, 75.0, 30.0, 50.0, -20.0])

    def random_joints(self, rng: np.random.Generator) -> Matrix:
        return np.asarray(self.near + np.round(rng.uniform(-12, 12, 6), 3))

    def clear(self, joints: Matrix) -> float:
        return float(joints[4])

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return configuration == ()

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "ZYZ")

    def options(self, backup: MadeBackup) -> dict[str, object]:
        stated = {
            what: [f"{name}={','.join(map(repr, _angles(pose, 'ZYZ')))}" for name, pose in poses.items()]
            for what, poses in (("tools", backup.tools), ("frames", backup.frames))
        }
        return {"near": ",".join(map(str, self.near)), **stated}

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        data, body = ["from DRCF import *  # movej(posj(1,2,3,4,5,6))"], []
        for one in backup.positions:
            kind, values = "posj" if one.in_joints else "posx", one.joints
            values = values if one.in_joints else np.array(_angles(self.pose(one, backup), "ZYZ"))
            numbers = ", ".join(f"{value:.6f}" for value in values)
            form = str(rng.choice([f"{kind}({numbers})", f"{kind}([{numbers}])", f"[{numbers}]"]))
            goal = one.name
            if rng.random() < 0.3:
                goal = form if rng.random() < 0.5 else form.replace(", ", ",\r\n    ", 2)
            else:
                data.append(f"{one.name} = {form}")
                goal = f"posx({one.name})" if kind == "posx" and rng.random() < 0.2 else goal
            body.append(f'set_tcp("{one.tool}")')
            frame = {"base": "DR_BASE"}.get(one.frame, one.frame)
            ref, sets = f", ref={frame}", [f"set_ref_coord({frame})"]
            body += sets if rng.random() < 0.5 else []
            ref = "" if len(body) and body[-1] in sets else ref
            word = "movej" if one.in_joints else str(rng.choice(["movel", "movejx", "amovel"]))
            body.append(
                f"{word}({goal}, vel=100, acc=100{'' if one.in_joints else ref})  # {one.name} is next"
            )
        return {self.main: "\r\n".join([*data, "set_velj(10)", *body, "wait(0.5)", ""])}

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        six = f"{', '.join(f'{each:g}' for each in by)}, 0, 0, 0"
        frame = {"base": "DR_BASE"}.get(one.frame, one.frame)
        start, line, axes = [
            (None, f"movel(posx({six}), v=50, a=50, mod=DR_MV_MOD_REL)", "frame"),
            (None, f"movel([{six}], vel=50, ref=DR_TOOL, mod=DR_MV_MOD_REL)", "tool"),
            (one.name, f"movel(trans({one.name}, [{six}], DR_BASE), ref={frame})", "frame"),
        ][rng.integers(3)]
        if start and f"{one.name} = " not in backup.texts[self.main]:
            return None
        return MadeStep(f'set_tcp("{one.tool}")\r\n{line}', start, by, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        literal = r"(?:pos[jx]\()?[\[\d.-][-\d.,\s]*"
        entry = rf"^{one.name} = ({literal})|move\w+\(({literal})[^\n]*# {one.name} is"
        found = re.search(entry, texts[self.main], re.MULTILINE)
        assert found is not None
        return _numbers(found[1] or found[2])[:6], ()


class PacScript(Dialect):
    """A program of a VS-060 with tools and works that it defines; figures stay as they are."""

    name, robot, main = "PacScript", "vs060", "work.pcs"
    joint_digit = 1e-5
    steps_before = ("work.pcs", "  GiveArm")
    tool_names, frame_names = ("0", "1", "3"), ("0", "2", "5")
    near = np.array([15.0, 25.0, 60.0, 30.0, 50.0, -20.0])

    def label(self, one: MadePosition) -> str:
        n = int(one.name[1:])
        named = [f"J[{n}]", f"j{n}"] if one.in_joints else [f"P[{n}]", f"P{n}", f"pos_{n}"]
        return named[n % len(named)]

    def random_joints(self, rng: np.random.Generator) -> Matrix:
        return np.asarray(self.near + np.round(rng.uniform(-12, 12, 6), 3))

    def clear(self, joints: Matrix) -> float:
        return float(joints[4])

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return [*configuration] in (["5"], ["-1"], [])

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        return _of_angles(numbers, "xyz")

    def options(self, backup: MadeBackup) -> dict[str, object]:
        return {"near": ",".join(map(str, self.near))}

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        def six(pose: Matrix) -> str:
            return ", ".join(f"{value:.6f}" for value in _angles(pose, "xyz"))

        data = [f"  Tool {n}, P({six(pose)})" for n, pose in backup.tools.items() if n != "0"]
        data += [f"  Work {n}, P({six(pose)})" for n, pose in backup.frames.items() if n != "0"]
        body = []
        for one in backup.positions:
            kind, values = "J", ", ".join(f"{value:.6f}" for value in one.joints)
            if not one.in_joints:
                kind, values = "P", six(self.pose(one, backup)) + str(rng.choice([", 5", ", -1", ""]))
            label = self.label(one)
            data += [f"  Dim {label} As Position"] if label.startswith("pos") else []
            body += [f"  ChangeTool {one.tool}", f"  ChangeWork {one.frame}"]
            inline, word = rng.random() < 0.3, "P" if one.in_joints else rng.choice(["P", "L"])
            goal = f"{kind}({values})" if inline else label
            data += [] if inline else [f"  {label} = {rng.choice([kind, ''])}({values})"]
            goal = goal.upper() if rng.random() < 0.3 else goal
            pass_ = rng.choice(["", "@0 ", "@P ", "@E, ", "@0, "])
            body.append(
                f"  Move {word}, {pass_}{goal}{rng.choice(['', ', S=50', ', NEXT'])} ' {one.name} Move P, P99"
            )
        head = ['\'!TITLE "work"', "Sub Main", "  TakeArm Keep = 0", "  Speed 100"]
        return {self.main: "\r\n".join([*head, *data, *body, "  GiveArm", "End Sub", ""])}

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        away, numbers = np.array([0, 0, -abs(by[2])]), ", ".join(f"{each:g}" for each in by)
        label = self.label(one)
        start, line, by, axes = [
            (one.name, f"  Move L, @P {label} + P({numbers}, 0, 0, 0)", by, "frame"),
            (one.name, f"  Move L, {label}+({numbers}, 0, 0, 0), S=20", by, "frame"),
            (one.name, f"  Move P, DevH({label}, P({numbers}, 0, 0, 0))", by, "tool"),
            (one.name, f"  Approach L, {label}, @0 {-away[2]:g}", away, "tool"),
            (None, f"  Depart L, @P {-away[2]:g}, S=10", away, "tool"),
            (None, f"  Draw L, V({numbers})", by, "frame"),
        ][rng.integers(6)]
        if start and f"  {label} = " not in backup.texts[self.main]:
            return None
        return MadeStep(f"  ChangeTool {one.tool}\r\n  ChangeWork {one.frame}\r\n{line}", start, by, axes)

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        label = re.escape(self.label(one))
        found = re.search(
            rf"^  {label} = [PJ]?\((.*?)\)|^  Move .*?[PJ]\((.*?)\)[^\n]*' {one.name} Move",
            texts[self.main],
            re.MULTILINE,
        )
        assert found is not None
        numbers = _numbers(found[1] or found[2])
        return numbers[:6], [str(int(each)) for each in numbers[6:]]


class UrScript(Dialect):
    """A script as a UR writes it beside its program: each pose has the joints near it."""

    name, main = "URScript", "programs/work.script"
    joint_digit = 1e-6
    steps_before = ("programs/work.script", "end\r\n")
    tool_names, frame_names = ("none", "grip", "torch"), ("base",)

    @cached_property
    def robot(self) -> str:  # type: ignore[override]
        """A UR5e as its own controller has it: links a little other than the nominal ones."""
        text = (BUILT_IN / "ur5e.yaml").read_text()
        text = text.replace("name: ur5e", "name: mine").replace("d_mm: 133.3", "d_mm: 133.9")
        text = text.replace("a_mm: -425, ", "a_mm: -425.6, ")
        path = Path(mkdtemp()) / "mine.yaml"
        path.write_text(f"# UR5e with the factory calibration of calibration.conf\n{text}")
        return str(path)

    def label(self, one: MadePosition) -> str:
        return f"{one.name}_q" if one.in_joints else f"{one.name}_p"

    def clear(self, joints: Matrix) -> float:
        folded = np.abs((joints + 90) % 180 - 90)
        return float(min(folded[2], folded[4]))

    def agrees(self, configuration: Sequence[str], joints: Matrix) -> bool:
        return configuration == ()

    def matrix(self, numbers: Sequence[float]) -> Matrix:
        pose = np.eye(4)
        pose[:3, 3] = 1000 * np.array(numbers[:3])
        pose[:3, :3] = Rotation.from_rotvec(numbers[3:6]).as_matrix()
        return pose

    def _p(self, pose: Matrix) -> str:
        values = [*(pose[:3, 3] / 1000), *Rotation.from_matrix(pose[:3, :3]).as_rotvec()]
        texts = [re.sub(r"^(-?)0\.", r"\1.", f"{value:.12f}") for value in values]
        return f"p[{', '.join(texts)}]"

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        data, body = ["def work():", "  # movej(p[1,2,3,4,5,6])"], []
        for one in [*backup.positions]:
            body.append(f"  set_tcp({self._p(backup.tools[one.tool])})")
            joints = one.joints if one.in_joints else np.round(one.joints + rng.uniform(-0.3, 0.3, 6), 3)
            q = f"[{', '.join(repr(value) for value in np.radians(joints).tolist())}]"
            inline = rng.random() < 0.3
            if not inline:
                data.append(f"  global {one.name}_q={q}")
            if one.in_joints:
                body.append(
                    f"  movej({q if inline else f'{one.name}_q'}, a=1.4, v=1.05) # {one.name} is next"
                )
                continue
            # The joints near a pose are a position too.
            backup.positions.append(
                MadePosition(f"N{one.name[1:]}", joints, one.tool, "base", in_joints=True)
            )
            p = self._p(self.pose(one, backup))
            if not inline:
                data.append(f"  global {one.name}_p={p}")
            near = (
                f"get_inverse_kin({p}, {q})"
                if inline
                else f"get_inverse_kin({one.name}_p, qnear={one.name}_q)"
            )
            beside = not inline and rng.random() < 0.4
            goal = f"movel({one.name}_p, a=1.2, v=0.25)" if beside else f"movej({near}, a=1.4, v=1.05)"
            body.append(f"  {goal} # {one.name} is next")
        return {self.main: "\r\n".join([*data, *body, "end", ""])}

    def step(
        self, one: MadePosition, backup: MadeBackup, by: Matrix, rng: np.random.Generator
    ) -> MadeStep | None:
        offset = f"p[{', '.join(f'{each / 1000:g}' for each in by)}, 0, 0, 0]"
        start, goal, axes = [
            (one.name, f"pose_trans({one.name}_p, {offset})", "tool"),
            (one.name, f"pose_add({one.name}_p, {offset})", "frame"),
            (None, f"pose_trans(get_forward_kin(), {offset})", "tool"),
        ][rng.integers(3)]
        if start and f"{one.name}_p=" not in backup.texts[self.main]:
            return None
        return MadeStep(
            f"  set_tcp({self._p(backup.tools[one.tool])})\r\n  movel({goal}, a=1)", start, by, axes
        )

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        name = f"P{one.name[1:]}"
        inline = r"\[(.*?)\]" if one.in_joints and one.name[0] == "P" else r"p\[(.*?)\], \[(.*?)\]"
        line = re.search(rf"move\w\(.*?{inline}.*# {name} is", texts[self.main])
        declared = re.search(rf"{name}_{'q=' if one.in_joints else 'p=p'}\[(.*?)\]", texts[self.main])
        match = declared or line
        assert match is not None
        text = match[2] if declared is None and one.name[0] == "N" else match[1]
        return _numbers(text) if not one.in_joints else np.degrees(_numbers(text)).tolist(), ()


MADE = (
    Rapid(),
    Krl(),
    Fanuc(),
    Inform(),
    As(),
    Spel(),
    Melfa(),
    Val3(),
    Drl(),
    PacScript(),
    UrScript(),
)
DIALECTS: dict[str, Dialect] = {each.name: each for each in MADE}


def written(backup: MadeBackup, folder: Path) -> Path:
    for name, text in backup.texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(text.encode("latin-1"))
    return folder


def kept(path: Path, robot: str, entered: Matrix = ENTERED, **choices: object) -> Conversion:
    zeros = ",".join(f"J{i}={value}" for i, value in enumerate(entered, start=1))
    return kept_programs(path, ZeroOptions(robot=robot, entered=(zeros,)), BackupOptions(**choices))  # type: ignore[arg-type]


def texts_after(backup: MadeBackup, answer: Conversion) -> dict[str, str]:
    return backup.texts | {name: content.decode("latin-1") for name, content in answer.content.items()}
