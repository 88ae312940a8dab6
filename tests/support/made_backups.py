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

from zerobeam.experiments.converted_programs import kept_programs
from zerobeam.experiments.positions.conversion import Conversion
from zerobeam.experiments.positions.positions_options import BackupOptions, ZeroOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot

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


@dataclass
class MadeBackup:
    """Texts by file, and what they mean. `accept`: lines that a person has to accept."""

    dialect: Dialect
    tools: dict[str, Matrix]
    frames: dict[str, Matrix]
    positions: list[MadePosition]
    texts: dict[str, str] = field(default_factory=dict)

    @property
    def options(self) -> dict[str, object]:
        return self.dialect.options(self)

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

    def label(self, one: MadePosition) -> str:
        """What it is called in the table, where it is not in a motion itself."""
        return one.name

    def options(self, backup: MadeBackup) -> dict[str, object]:
        """What has to be stated, as the language does not say it."""
        return {}

    def pose(self, one: MadePosition, backup: MadeBackup) -> Matrix:
        flange = self.arm.fk(one.joints, "deg")
        return np.asarray(np.linalg.inv(backup.frames[one.frame]) @ flange @ backup.tools[one.tool])

    def made(self, seed: int, count: int = 4) -> MadeBackup:
        """A backup with so many positions, in all configurations, with several tools and frames."""
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
        # What is written is rounded: it means the joints of what is written.
        joints = backup.readings(backup.texts, np.zeros(6))
        backup.positions = [replace(one, joints=row) for one, row in zip(positions, joints, strict=True)]
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
    """Jobs of a GP7 with UFRAME.CND; tools are stated."""

    name, main = "INFORM", "JOBS/WORK.JBI"
    joint_digit, turn_digit = yaskawa_controller.STEP_DEG, 1e-3  # half a pulse; four decimals
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

    def options(self, backup: MadeBackup) -> dict[str, object]:
        return {"tools": [f"{n}={','.join(map(repr, _angles(t, 'xyz')))}" for n, t in backup.tools.items()]}

    def texts(self, backup: MadeBackup, rng: np.random.Generator) -> dict[str, str]:
        frames = []
        for n, pose in backup.frames.items():
            if n != "base":
                values = [f"{value:.4f}" for value in _angles(pose, "xyz")]
                frames += [f"//UFRAME {n}", "///NAME X", "///TOOL 0", "///GROUP 1,0,0", "///PULSE"]
                frames += ["////RORG C000=1,2,3,4,5,6", f"////BUSER {','.join(values)}"]
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
        return {"UFRAME.CND": "\r\n".join([*frames, ""]), "JOBS/WORK.JBI": "\r\n".join(lines)}

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

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        (text,) = texts.values()
        entry = rf"^#?{one.name}(?:\[1,2\])? ([-\d. ]+)\r$|^.*(?:TRANS\(|#\[)([-\d., ]+)[)\]] ;{one.name}\r$"
        found = re.search(entry, text, re.MULTILINE)
        assert found is not None
        return _numbers(found[1] or found[2]), ()


class Spel(Dialect):
    """Points and a program of an arm of Epson with the lengths of another."""

    name, main = "SPEL+", "robot1.pts"
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

    def found(self, one: MadePosition, texts: dict[str, str]) -> tuple[list[float], Sequence[str]]:
        n = one.name[1:]
        line = rf"^(?:P{n}|PA\({n}\)|J{n})=\((.*?)\)(.*)$|^\d+ Mvs \((.*?)\)(\(.*\)) ' P{n} Mov P9\r$"
        found = re.search(line, texts["WORK.PRG"], re.MULTILINE)
        assert found is not None
        return _numbers(found[1] or found[3])[:6], re.findall(r"\d+", found[2] or found[4] or "")


MADE = (Rapid(), Krl(), Fanuc(), Inform(), As(), Spel(), Melfa())
DIALECTS: dict[str, Dialect] = {each.name: each for each in MADE}


def written(backup: MadeBackup, folder: Path) -> Path:
    for name, text in backup.texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(text.encode("latin-1"))
    return folder


def kept(path: Path, robot: str, entered: Matrix = ENTERED, **choices: object) -> Conversion:
    zeros = ",".join(f"J{i}={value}" for i, value in enumerate(entered, start=1))
    return kept_programs(path, ZeroOptions(robot=robot, entered=zeros), BackupOptions(**choices))  # type: ignore[arg-type]


def texts_after(backup: MadeBackup, answer: Conversion) -> dict[str, str]:
    return backup.texts | {name: content.decode("latin-1") for name, content in answer.content.items()}
