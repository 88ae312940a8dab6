"""Programs as people have them, in four languages, and what their controllers command the joints to.

Both are written without the code that is tested: rotations by SciPy, poses solved by SciPy from the joints
that are meant, configurations by their definitions.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from zerobeam.experiments.makers.user_programs import ProgramOptions, corrected_program
from zerobeam.model.arrays import Matrix
from zerobeam.model.kinematics.robot import Robot


def frame(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Matrix:
    """(4, 4) of mm and degrees, about fixed x, y, z."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("xyz", [roll, pitch, yaw], degrees=True).as_matrix()
    result[:3, 3] = x, y, z
    return result


TOOL = frame(10, -5, 120, 0, 30, 20)
TABLE = frame(300, -100, 50, 0, 0, 15)
SUFFIX = {"rapid": ".mod", "krl": ".src", "fanuc": ".ls", "urscript": ".script"}


def flange_arm(robot: Robot) -> Robot:
    """Up to the flange: the arm of the paper ends 65 mm before it."""
    if robot.name != "irb1600":
        return robot
    flange = robot.flange.copy()
    flange[:3, 3] += 65.0 * flange[:3, 2]
    return replace(robot, flange=flange)


def solved_pose(robot: Robot, flange: Matrix, start: Matrix) -> Matrix:
    """The joints, degrees, at which the nominal arm has its flange at a pose, near others."""
    arm = flange_arm(robot)

    def off(joints: Matrix) -> Matrix:
        now = arm.fk(joints, "deg")
        turn = Rotation.from_matrix(flange[:3, :3] @ now[:3, :3].T).as_rotvec()
        return np.concatenate([now[:3, 3] - flange[:3, 3], 300 * turn])

    found = least_squares(off, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    # The digits of a listing of FANUC, at most.
    assert np.abs(found.fun).max() < 1e-2
    return np.asarray(found.x)


@dataclass(frozen=True)
class UserProgram:
    """Rows of joints, degrees of the robot file; every second target is Cartesian."""

    language: str
    robot: Robot
    rows: Matrix

    @property
    def poses(self) -> Matrix:
        """(N, 4, 4) of the tool in the frame, as the programs state them; URScript has no frame."""
        tcp = flange_arm(self.robot).fk(self.rows, "deg") @ TOOL
        return tcp if self.language == "urscript" else np.linalg.inv(TABLE) @ tcp

    def cartesian(self, i: int) -> bool:
        return i % 2 == 1

    def text(self) -> str:
        return str(getattr(self, f"_{self.language}")())

    def commanded(self, text: str) -> Matrix:
        """(N, n) degrees: what the controller of the nominal arm commands at each motion."""
        return np.array(getattr(self, f"_read_{self.language}")(text))

    def solved(self, pose: Matrix, start: Matrix) -> Matrix:
        """The joints at which the nominal arm has the tool at a pose, near others."""
        base = np.eye(4) if self.language == "urscript" else TABLE
        return solved_pose(self.robot, base @ pose @ np.linalg.inv(TOOL), start)

    def _rapid(self) -> str:
        def listed(values: Sequence[float]) -> str:
            return ",".join(f"{value:.9g}" for value in values)

        def pose(matrix: Matrix) -> str:
            x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
            return f"[{listed(matrix[:3, 3])}],[{listed([w, x, y, z])}]"

        lines, moves = [], []
        for i, row in enumerate(self.rows):
            if self.cartesian(i):
                unused = ",".join(["9E+09"] * 6)
                text = f"[{pose(self.poses[i])},[{', '.join(map(str, self.confdata(row)))}],[{unused}]]"
                lines.append(f"  CONST robtarget p{i}:={text};  ! p{i} caf\xe9")
                moves.append(f"    MoveJ p{i},v100,fine,tGrip\\WObj:=wTable;")
            else:
                lines.append(f"  CONST jointtarget j{i}:=[[{listed(row)}],[9E9,9E9,9E9,9E9,9E9,9E9]];")
                moves.append(f"    MoveAbsJ j{i}\\NoEOffs,v100,fine,tool0;")
        return "\r\n".join(
            [
                "%%%",
                "  VERSION:1",
                "%%%",
                "MODULE job",
                f"  PERS tooldata tGrip:=[TRUE,[{pose(TOOL)}],[1,[0,0,1],[1,0,0,0],0,0,0]];",
                f'  PERS wobjdata wTable:=[FALSE,TRUE,"",[{pose(TABLE)}],[[0,0,0],[1,0,0,0]]];',
                *lines,
                "  PROC main()",
                *moves,
                "  ENDPROC",
                "ENDMODULE",
                "",
            ]
        )

    def confdata(self, row: Matrix) -> list[int]:
        return [*(int(np.floor(row[k] / 90)) for k in (0, 3, 5)), self._cfx(row)]

    def _cfx(self, row: Matrix) -> int:
        """By the wrist's centre of an ABB arm, from the geometry of its data sheet's side view."""
        arm = self.robot
        q = np.radians(row)
        turned = arm.fk(row - np.array([row[0], 0, 0, 0, 0, 0]), "deg")
        wrist = (
            turned[:3, 3]
            if arm.name == "irb1600"
            else (turned @ np.diag([1.0, 1, 1, 1]))[:3, 3] - (flange_depth(arm) * turned[:3, 2])
        )
        elbow = np.array([_A1[arm.name] + _A2[arm.name] * np.sin(q[1]), _A2[arm.name] * np.cos(q[1])])
        shoulder = np.array([_A1[arm.name], 0.0])
        centre = np.array([wrist[0], wrist[2] - _D1[arm.name]])
        lower, fore = elbow - shoulder, centre - elbow
        behind_arm = lower[1] * fore[0] - lower[0] * fore[1] < 0
        return 4 * int(wrist[0] < 0) + 2 * int(behind_arm) + int(row[4] < 0)

    def _read_rapid(self, text: str) -> list[Matrix]:
        found = []
        for i in range(len(self.rows)):
            name = f"p{i}" if self.cartesian(i) else f"j{i}"
            value = re.search(rf"target {name}:=(.*?);", text)[1]
            numbers = [float(each) for each in re.findall(r"-?[\d.]+(?:E\+?\d+)?", value)]
            if not self.cartesian(i):
                found.append(np.array(numbers[:6]))
                continue
            pose = np.eye(4)
            pose[:3, 3] = numbers[:3]
            w, x, y, z = numbers[3:7]
            assert abs(np.linalg.norm(numbers[3:7]) - 1) < 1e-7
            pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
            row = self.solved(pose, self.rows[i])
            assert self.confdata(row) == numbers[7:11]
            found.append(row)
        return found

    def _krl(self) -> str:
        moves, data = [], []
        for i, row in enumerate(self.rows):
            if self.cartesian(i):
                x, y, z = self.poses[i][:3, 3]
                c, b, a = Rotation.from_matrix(self.poses[i][:3, :3]).as_euler("xyz", degrees=True)
                turn = sum(1 << k for k, value in enumerate(row) if value < 0)
                status = self._status(row) + 16
                data.append(
                    f"DECL E6POS XP{i}={{X {x:.6f},Y {y:.6f},Z {z:.6f},A {a:.6f},B {b:.6f},C {c:.6f},"
                    f"S {status},T {turn},E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}}"
                )
                data.append(f'DECL FDAT FP{i}={{TOOL_NO 3,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}}')
                moves += [
                    f";FOLD PTP P{i} Vel=100 % PDAT{i} Tool[3]:grip Base[2];%{{PE}}",
                    f"FDAT_ACT=FP{i}",
                    "BAS(#PTP_PARAMS,100)",
                    f"PTP XP{i} C_PTP",
                    ";ENDFOLD",
                ]
            else:
                axes = ",".join(f"A{k} {value:.6f}" for k, value in enumerate(row, start=1))
                data.append(f"DECL E6AXIS XP{i}={{{axes},E1 0.0}}")
                moves.append(f"PTP XP{i}")
        source = ["&ACCESS RVP", "DEF job( )", "BAS (#INITMOV,0 )", "PTP $AXIS_ACT ; here", *moves, "END", ""]
        return "\r\n".join([*source, "&ACCESS RVP", "DEFDAT job PUBLIC", "; caf\xe9", *data, "ENDDAT", ""])

    def _status(self, row: Matrix) -> int:
        """S: the arm of the KR AGILUS, A3 where upper arm and wrist are in line at atan(35 / 420)."""
        q2, q3 = np.radians(row[1]), np.radians(row[1] + row[2])
        ahead = 25 + 455 * np.cos(q2) + 35 * np.sin(q3) + 420 * np.cos(q3)
        line = np.degrees(np.arctan2(35, 420))
        return int(ahead < 0) + 2 * int(line < row[2] < line + 180) + 4 * int(row[4] < 0)

    def _read_krl(self, text: str) -> list[Matrix]:
        found = []
        for i in range(len(self.rows)):
            value = re.search(rf"XP{i}={{(.*?)}}", text)[1]
            fields = {key: float(number) for key, number in (part.split() for part in value.split(","))}
            if not self.cartesian(i):
                found.append(np.array([fields[f"A{k}"] for k in range(1, 7)]))
                continue
            pose = frame(*(fields[key] for key in ("X", "Y", "Z", "C", "B", "A")))
            row = self.solved(pose, self.rows[i])
            assert fields["S"] == self._status(row) + 16
            assert all(int(fields["T"]) >> k & 1 == (value < 0) for k, value in enumerate(row))
            found.append(row)
        return found

    def _fanuc(self) -> str:
        moves, positions = ["  UFRAME_NUM=2 ", "  UTOOL_NUM=3 "], []
        for i, row in enumerate(self.rows):
            moves.append(f"J P[{i + 1}] 50% FINE    ")
            head = f'P[{i + 1}:"caf\xe9"]{{\r\n   GP1:\r\n\tUF : 2, UT : 3,\t'
            if self.cartesian(i):
                values = [*self.poses[i][:3, 3]]
                values += [*Rotation.from_matrix(self.poses[i][:3, :3]).as_euler("xyz", degrees=True)]
                turns = [int(np.floor((row[k] + 180) / 360)) for k in (0, 3, 5)]
                config = f"\tCONFIG : '{self._letters(row)}, {turns[0]}, {turns[1]}, {turns[2]}',\r\n"
                units = ["mm"] * 3 + ["deg"] * 3
                names = "XYZWPR"
                parts = [f"{n} = {v:9.3f} {u:>3}" for n, v, u in zip(names, values, units, strict=True)]
                body = config + _two_lines(parts)
            else:
                shown = row - np.array([0, 0, row[1], 0, 0, 0])
                parts = [f"J{k}= {value:9.3f} deg" for k, value in enumerate(shown, start=1)]
                body = "\r\n" + _two_lines(parts)
            positions.append(f"{head}{body}\r\n}};")
        lines = [f"{n:4}:{line};" for n, line in enumerate(moves, start=1)]
        return "\r\n".join(["/PROG  JOB", "/ATTR", "/MN", *lines, "/POS", *positions, "/END", ""])

    def _letters(self, row: Matrix) -> str:
        """CONFIG of the LR Mate: N where J5 is negative, U and T by the side view of its data sheet."""
        q2, q3 = np.radians(row[1]), np.radians(row[2] - row[1])
        elbow = np.array([330 * np.sin(q2), 330 * np.cos(q2)])
        fore = np.array([335 * np.cos(q3) - 35 * np.sin(q3), 335 * np.sin(q3) + 35 * np.cos(q3)])
        up = elbow[1] * fore[0] - elbow[0] * fore[1] > 0
        ahead = 50 + elbow[0] + fore[0] > 0
        return f"{'N' if row[4] < 0 else 'F'} {'U' if up else 'D'} {'T' if ahead else 'B'}"

    def _read_fanuc(self, text: str) -> list[Matrix]:
        found = []
        for i in range(len(self.rows)):
            block = re.search(rf"P\[{i + 1}:[^{{]*{{(.*?)}};", text, re.DOTALL)[1]
            values = {n: float(v) for n, v in re.findall(r"\b([XYZWPR]|J\d) ?= *(-?[\d.]+) +\w+", block)}
            if not self.cartesian(i):
                row = np.array([values[f"J{k}"] for k in range(1, 7)])
                row[2] += row[1]
                found.append(row)
                continue
            row = self.solved(frame(*(values[key] for key in "XYZWPR")), self.rows[i])
            letters, *turns = re.search(r"CONFIG : '(.*?)'", block)[1].split(", ")
            assert letters == self._letters(row)
            assert [int(turn) for turn in turns] == [int(np.floor((row[k] + 180) / 360)) for k in (0, 3, 5)]
            found.append(row)
        return found

    def _urscript(self) -> str:
        def pose(matrix: Matrix) -> str:
            values = [*(matrix[:3, 3] / 1000), *Rotation.from_matrix(matrix[:3, :3]).as_rotvec()]
            return f"p[{', '.join(f'{value:.9f}' for value in values)}]"

        lines = ["def job():", f"  set_tcp({pose(TOOL)})  # caf\xe9"]
        for i, row in enumerate(self.rows):
            listed = ", ".join(f"{value:.9f}" for value in np.radians(row))
            if self.cartesian(i):
                lines += [
                    f"  global Waypoint_{i}_p={pose(self.poses[i])}",
                    f"  global Waypoint_{i}_q=[{listed}]",
                ]
                near = f"get_inverse_kin(Waypoint_{i}_p, qnear=Waypoint_{i}_q)"
                lines.append(f"  movej({near}, a=1.4, v=1.05)")
            elif i % 4:
                lines.append(f"  movej([{', '.join(f'd2r({value:.6f})' for value in row)}], a=1.4, v=1.05)")
            else:
                lines.append(f"  movej([{listed}], a=1.4, v=1.05)")
        return "\n".join([*lines, "end", ""])

    def _read_urscript(self, text: str) -> list[Matrix]:
        found = []
        for i, move in enumerate(re.findall(r"movej\((.*), a=", text)):
            if not self.cartesian(i):
                numbers = [float(each) for each in re.findall(r"-?\d+\.\d+", move)]
                found.append(np.array(numbers if "d2r" in move else np.degrees(numbers)))
                continue
            value = re.search(rf"Waypoint_{i}_p=p\[(.*?)\]", text)[1]
            numbers = [float(each) for each in value.split(",")]
            pose = np.eye(4)
            pose[:3, 3] = 1000 * np.array(numbers[:3])
            pose[:3, :3] = Rotation.from_rotvec(numbers[3:]).as_matrix()
            near = [float(each) for each in re.search(rf"Waypoint_{i}_q=\[(.*?)\]", text)[1].split(",")]
            row = self.solved(pose, np.degrees(near))
            np.testing.assert_allclose(np.radians(row), near, atol=1e-5)
            found.append(row)
        return found


def _two_lines(parts: Sequence[str]) -> str:
    return "\t" + ",\t".join(parts[:3]) + ",\r\n\t" + ",\t".join(parts[3:])


# Of the data sheets, mm: axis 1 to axis 2, the lower arm, the height of axis 2, the wrist's centre to tool0.
_A1 = {"irb1600": 150.0, "irb120": 0.0}
_A2 = {"irb1600": 700.0, "irb120": 270.0}
_D1 = {"irb1600": 486.5, "irb120": 290.0}


def flange_depth(arm: Robot) -> float:
    return {"irb120": 72.0}[arm.name]


OFFSETS = np.array([0.0, -0.9, 0.6, 0.4, -0.7, 0.5])
STATED: dict[str, ProgramOptions] = {
    "krl": ProgramOptions(tools=["3=10,-5,120,20,30,0"], frames=["2=300,-100,50,15,0,0"]),
    "fanuc": ProgramOptions(tools=["3=10,-5,120,0,30,20"], frames=["2=300,-100,50,0,0,15"], j3="ground"),
}


def judged(robot: Robot, offsets: Matrix = OFFSETS) -> Any:
    """What a filter needs of a calibration, with these offsets, degrees."""
    own = [
        SimpleNamespace(
            applied_rad=np.radians(value),
            applied=value,
            exported=value != 0,
            name=f"delta{i}",
            status="identified",
        )
        for i, value in enumerate(offsets, start=1)
    ]
    return SimpleNamespace(
        offsets=own,
        corrected=robot.with_offsets(np.radians(offsets)),
        posture_offsets=lambda joints: np.zeros(robot.n),
        head=["offsets of a test"],
        warnings=[],
        inputs=SimpleNamespace(versions={"zerobeam": "0"}, sha256="0" * 64),
    )


def deviating(robot: Robot, rng: np.random.Generator, joints: Sequence[int], mm: float = 0.5) -> Robot:
    """The robot, the links before some joints moved at random by up to `mm` along each axis."""
    moved = list(robot.joints)
    for i in joints:
        fixed = moved[i].fixed.copy()
        fixed[:3, 3] += rng.uniform(-mm, mm, 3)
        moved[i] = replace(moved[i], fixed=fixed)
    return replace(robot, joints=tuple(moved))


def corrected_for(links: Robot, offsets: Matrix, robot: Robot, file: Path, options: ProgramOptions) -> Any:
    """The program in `file` corrected for an arm with these links and offsets (6,), degrees."""
    calibration = judged(robot, offsets)
    calibration.corrected = links.with_offsets(np.radians(offsets))
    return corrected_program(robot, calibration, file, file.with_name(f"out{file.suffix}"), options)


def varied(robot: Robot, count: int, seed: int = 3) -> Matrix:
    """Joints, degrees, away from the limits and from the wrist's singularity."""
    rng = np.random.default_rng(seed)
    lower, upper = np.maximum(robot.lower, -3.0) * 0.8, np.minimum(robot.upper, 3.0) * 0.8
    lower = np.maximum(lower, robot.lower + 0.05)  # a limit may be zero
    rows = np.degrees(rng.uniform(lower, upper, (10 * count, robot.n)))
    return np.round(rows[np.abs(rows[:, 4]) > 8][:count], 3)


def written(folder: Path, program: UserProgram, text: str) -> Path:
    """The file or files of a program, in Latin-1."""
    path = folder / f"job{SUFFIX[program.language]}"
    if program.language == "krl":
        cut = text.index("END\r\n") + 5
        path.with_suffix(".dat").write_bytes(text[cut:].encode("latin-1"))
        text = text[:cut]
    path.write_bytes(text.encode("latin-1"))
    return path


def read(done: Any) -> str:
    return "".join(content.decode("latin-1") for content in done.files.values())
