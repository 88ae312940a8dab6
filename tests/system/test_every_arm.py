"""Every built-in arm from plan to offsets: joints as its pendant counts them, within its limits, no link
through another. The arms' conventions are stated here again, and the arithmetic is this module's."""

import csv
import io
import itertools
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import zerobeam
from numpy.typing import NDArray
from pypdf import PdfReader
from ruamel.yaml import YAML

from zerobeam.model.files.robot_file import BUILT_IN, built_in_robots
from zerobeam.model.files.run import read_run

Matrix = NDArray[np.float64]

# mm that the mounting face is below the base frame; 0 of all others.
BELOW = {
    **{"gp7": 330, "gp8": 330, "gp12": 450, "gp25": 505, "hc10dt": 275},
    **{"lrmate_200id": 330, "m10ia": 450, "crx10ia": 245, "m20id_25": 425, "r2000ic_165f": 670},
    **{"tx2_60": 375, "tx2_90": 478, "rx160": 550},
}
# Pendants that count joint 3 from the ground, with their range of joint 3, degrees.
GROUND = {
    **{"lrmate_200id": (-140, 280), "m10ia": (-180, 264), "crx10ia": (-250.9, 430.9)},
    **{"m20id_25": (-250, 320), "r2000ic_165f": (-155, 240)},
}
# Range of J2 + J3 there: the LR Mate's by its maker; the M-10iA's where its forearm is through the upper arm.
BETWEEN = {
    **{"lrmate_200id": (-70, 205), "m10ia": (-93, 266), "crx10ia": (-71, 251)},
    **{"m20id_25": (-90, 220), "r2000ic_165f": (-79, 180)},
}
LANGUAGES = {
    "abb": ("rapid", "zb.mod", r"jointtarget zb_p0:=\[\[(.*?)\]"),
    "kuka": ("krl", "zb.src", r"AXIS ZB_P0=\{(.*?)\}"),
    "universal-robots": ("urscript", "zb.script", r"movej\(\[(.*?)\], a="),
    "fanuc": ("fanuc", "zb.ls", r"P\[1:.*?UT : 1,(.*?)\};"),
}
SHEETS = {"abb": "rapid", "kuka": "kuka", "universal-robots": "ur", "fanuc": "fanuc"}
NUMBER = r"[-+]?\d+\.?\d*"
HEIGHTS = (0.0, 0.25, 0.5)  # of the reach, above the mounting face
TOOL = [0.0, 0.0, 65.0]


@dataclass
class Arm:
    """An arm by its robot file, read as plain YAML."""

    name: str

    def __post_init__(self) -> None:
        self.stated: dict[str, Any] = YAML(typ="safe").load(BUILT_IN / f"{self.name}.yaml")
        self.rows = self.stated["joints"]
        self.n = len(self.rows)

    @property
    def floor(self) -> float:
        return -float(BELOW.get(self.name, 0))

    def pendant(self, joints: Matrix) -> Matrix:
        """What the pendant shows of joints with joint 3 from link 2: the direction of link 3 where it counts
        from the ground."""
        shown = joints.copy()
        if self.name in GROUND:
            shown[..., 2] = joints[..., 2] - joints[..., 1]
        return shown

    def chain(self, joints: Matrix) -> Matrix:
        """(P, 3) mm: mounting face, base, every corner of the links by the rows, flange, TCP."""
        pose = frame(self.stated.get("base"))
        points = [np.array([0.0, 0.0, self.floor]), np.zeros(3), pose[:3, 3]]
        for row, value in zip(self.rows, joints, strict=True):
            turn = rotation("z", row["theta_deg"] + value) @ moved(z=row["d_mm"])
            link = moved(x=row["a_mm"]) @ rotation("x", row["alpha_deg"])
            for part in (turn, link) if self.stated["convention"] == "standard" else (link, turn):
                pose = pose @ part
                points.append(pose[:3, 3])
        pose = pose @ frame(self.stated.get("flange"))
        return np.array([*points, pose[:3, 3], (pose @ np.array([*TOOL, 1.0]))[:3]])

    @property
    def shoulder(self) -> int:
        """How many points of the chain are of the arm's base: joint 2 moves what comes behind them."""
        return 5 if self.stated["convention"] == "standard" else 6


def rotation(axis: str, degrees: float) -> Matrix:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    result, (i, j) = np.eye(4), {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    result[i, i] = result[j, j] = c
    result[i, j], result[j, i] = -s, s
    return result


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Matrix:
    result = np.eye(4)
    result[:3, 3] = x, y, z
    return result


def frame(stated: dict[str, Any] | None) -> Matrix:
    stated = stated or {}
    roll, pitch, yaw = stated.get("rpy_deg", (0, 0, 0))
    turn = rotation("z", yaw) @ rotation("y", pitch) @ rotation("x", roll)
    return moved(*stated.get("xyz_mm", (0, 0, 0))) @ turn


def nearest_parts(arm: Arm, joints: Matrix) -> float:
    """mm between parts of an arm that do not share a joint and have more than a quarter of it between them:
    what is nearer to each other is bounded by the limits of the joints there, as are base and upper arm."""
    points = arm.chain(joints)
    places, along = [], 0.0
    length = float(np.linalg.norm(np.diff(points[arm.shoulder - 1 :], axis=0), axis=1).sum())
    parts = [(k, a, b) for k, (a, b) in enumerate(itertools.pairwise(points)) if np.linalg.norm(b - a) > 1e-6]
    for _, a, b in parts:
        places += [
            (along + share * np.linalg.norm(b - a), *(a + share * (b - a))) for share in np.linspace(0, 1, 40)
        ]
        along += float(np.linalg.norm(b - a))
    table, part = np.array(places), np.repeat(np.arange(len(parts)), 40)
    distance = np.linalg.norm(table[:, None, 1:] - table[None, :, 1:], axis=2)
    judged = np.abs(table[:, None, 0] - table[None, :, 0]) > length / 4
    judged &= np.abs(part[:, None] - part[None, :]) > 1
    base = [i for i, (k, _, _) in enumerate(parts) if k < arm.shoulder - 1]
    judged &= ~(np.isin(part, base)[:, None] & (part == len(base))[None, :])
    return float(distance[judged & (part[:, None] < part[None, :])].min(initial=np.inf))


def reach_of(name: str) -> float:
    return float(zerobeam("robot", name, "--json").json["reach_mm"])


def header_of(folder: Path, name: str) -> Path:
    path = folder / "header.yaml"
    path.write_text(
        f"robot: {name}\ntool: {{kind: laser, calibrated: true, point_mm: {TOOL}, direction: [1, 0, 0],\n"
        "  sigma: {tilt_deg: 0.01, shift_mm: 0.05}}\n"  # stated: else all of few measurements rests on it
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\n"
        "geometry: exact\n"  # a few measurements are enough then
    )
    return path


def planned(folder: Path, name: str, share: float, shots: int) -> tuple[Path, Matrix]:
    """A plan for a target in front, at a share of the reach above the mounting face, and its postures."""
    far, plan = reach_of(name), folder / f"plan{share}.yaml"
    target = f"{0.6 * far:.0f},0,{Arm(name).floor + share * far:.0f}"
    made = zerobeam(
        "plan", "optimal", "--header", header_of(folder, name), "--target", target, "--shots", shots,
        "--candidates", 60, "--repeat", 0, "-o", plan,
    )  # fmt: skip
    assert made.status == 0, made.err
    return plan, np.array(YAML(typ="safe").load(plan)["postures_deg"], dtype=float)


def require_sound(arm: Arm, postures: Matrix) -> None:
    """Within the pendant's limits, above the floor, no link through another."""
    shown = arm.pendant(postures)
    for i, row in enumerate(arm.rows):
        low, high = GROUND.get(arm.name, (0, 0)) if i == 2 and arm.name in GROUND else (
            row["lower_deg"], row["upper_deg"]
        )  # fmt: skip
        assert (low, high) == (row["lower_deg"], row["upper_deg"])
        assert ((shown[:, i] >= low) & (shown[:, i] <= high)).all(), (arm.name, i)
    if arm.name in BETWEEN:
        between = shown[:, 1] + shown[:, 2]
        low, high = BETWEEN[arm.name]
        assert ((between >= low) & (between <= high)).all()
    for posture in postures:
        assert arm.chain(posture)[arm.shoulder :, 2].min() > arm.floor, arm.name
        assert nearest_parts(arm, posture) > 15.0, (arm.name, posture)


def require_same(values: Any, expected: Matrix) -> None:
    np.testing.assert_allclose(np.array(values, dtype=float), expected, atol=2e-6, rtol=0)


def texts_of_maker(folder: Path, arm: Arm, plan: Path, expected: Matrix) -> None:
    """Every form in which a person or a controller gets the plan."""
    written = zerobeam("export", "plan", "csv", plan, "-o", folder / "plan.csv")
    assert ("counted from the ground" in written.out) == (arm.name in GROUND)
    table = list(csv.reader(io.StringIO((folder / "plan.csv").read_text(encoding="utf-8-sig"))))
    require_same([row[2:] for row in table[1:]], expected)
    assert zerobeam("export", "plan", "pdf", plan, "-o", folder / "plan.pdf").status == 0
    pages = PdfReader(io.BytesIO((folder / "plan.pdf").read_bytes())).pages
    first = re.sub(r"\s+", " ", pages[1].extract_text()).replace("−", "-")
    for value in expected[0]:
        assert f"{value + 0.0:.3f}°" in first
    assert ("counted from the ground" in re.sub(r"\s+", " ", pages[0].extract_text())) == (arm.name in GROUND)
    assert zerobeam("export", "plan", "robodk", plan, "-o", folder / "zb.py").status == 0
    rows = re.findall(r"^    \(\d+, 'psd', \[\], \[(.*)\]\),$", (folder / "zb.py").read_text(), re.MULTILINE)
    require_same([row.split(",") for row in rows], expected)
    vendor = arm.stated["vendor"]
    if vendor in LANGUAGES and arm.n == 6:
        kind, name, pattern = LANGUAGES[vendor]
        assert zerobeam("export", "plan", kind, plan, "-o", folder / name).status == 0
        text = (folder / name).with_suffix(".dat" if kind == "krl" else Path(name).suffix).read_text()
        found = re.search(pattern, text, re.DOTALL)
        assert found is not None
        values = re.findall(rf"(?:d2r\(|(?:[AJ]\d=? ?\s*)|^|,)({NUMBER})", found[1])
        require_same(values[:6], expected[0])


def ros_counts_from_link_2(folder: Path, plan: Path, postures: Matrix) -> None:
    assert zerobeam("export", "plan", "ros", plan, "-o", folder / "ros.yaml").status == 0
    found = re.findall(r"positions: \[(.*?)\]", (folder / "ros.yaml").read_text())
    np.testing.assert_allclose(
        [[float(v) for v in row.split(",")] for row in found], np.radians(postures), atol=1e-7
    )


def imports_of_the_pendants_values(
    folder: Path, arm: Arm, plan: Path, postures: Matrix, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the pendant shows comes back with joint 3 from link 2: as a table, and typed."""
    shown = arm.pendant(postures)
    (folder / "shown.csv").write_text("".join(",".join(map(repr, row)) + "\n" for row in shown.tolist()))
    told = zerobeam(
        "import", "csv", folder / "shown.csv", "--header", header_of(folder, arm.name), "--target", "psd",
        "--units", "deg", "-o", folder / "shown.jsonl",
    )  # fmt: skip
    assert told.status == 0, told.err
    require_same(np.degrees(read_run(folder / "shown.jsonl").joints), postures)
    monkeypatch.setattr(
        "sys.stdin", io.StringIO("".join(" ".join(map(repr, row)) + "\n" for row in shown.tolist()))
    )
    answer = zerobeam("run", plan, "--rig", "manual", "-o", folder / "typed.jsonl", "--json-lines")
    require_same(np.degrees(read_run(folder / "typed.jsonl").joints), postures)
    asked = [
        json.loads(line) for line in answer.out.splitlines() if '"event":"posture"' in line.replace(" ", "")
    ]
    require_same([[own["value"] for own in event["pendant"]] for event in asked], shown)


def offsets_for_the_controller(folder: Path, arm: Arm) -> None:
    """The sheet of its maker has the offset of joint 3 that its encoder needs: that of the angle between the
    links, which the encoders of all these arms measure."""
    plan, _ = planned(folder, arm.name, 0.3, 12)
    run, vendor = folder / "run.jsonl", arm.stated["vendor"]
    assert zerobeam("run", plan, "--rig", "simulated", "--no-camera", "--seed", 3, "-o", run).status in (0, 1)
    # Of an exact arm one run in many speaks against its values by chance: a typical one leaves room for that.
    run.write_text(run.read_text(encoding="utf-8").replace('"geometry":"exact",', "", 1), encoding="utf-8")
    made = zerobeam("export", "json", run, "-o", folder / "offsets.json", "--allow-weak")
    assert made.status == 0, made.err
    (third,) = (
        row for row in json.loads((folder / "offsets.json").read_text())["offsets"] if row["name"] == "delta3"
    )
    if vendor in SHEETS:
        sheet = zerobeam("export", SHEETS[vendor], run, "-o", folder / "sheet.txt", "--allow-weak")
        if vendor == "universal-robots":
            assert "factory calibration" in sheet.refused()
        else:
            assert sheet.status == 0, sheet.err
    if vendor == "fanuc":
        text = (folder / "sheet.txt").read_text()
        found = re.search(r"^J3 +([-+][\d.]+)", text, re.MULTILINE)
        assert found is not None
        assert float(found[1]) == pytest.approx(third["applied"], abs=1e-6)
        assert "DCS" in text


@pytest.mark.parametrize("name", ["lrmate_200id", "gp7"])
@pytest.mark.long
def test_an_arm_whose_base_frame_is_above_its_mounting_face(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The short one: neither arm had a plan, and the pendant of the first counts another joint 3."""
    arm = Arm(name)
    plan, postures = planned(tmp_path, name, 0.25, 4)
    require_sound(arm, postures)
    texts_of_maker(tmp_path, arm, plan, arm.pendant(postures))
    imports_of_the_pendants_values(tmp_path, arm, plan, postures, monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize("name", built_in_robots())
def test_every_arm_from_plan_to_offsets(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = Arm(name)
    for share in HEIGHTS:
        plan, postures = planned(tmp_path, name, share, 8)
        require_sound(arm, postures)
        checked = zerobeam("check", plan, "--json")
        assert checked.status in (0, 1)
        assert "outside" not in " ".join(checked.json["notes"])
    texts_of_maker(tmp_path, arm, plan, arm.pendant(postures))
    ros_counts_from_link_2(tmp_path, plan, postures)
    imports_of_the_pendants_values(tmp_path, arm, plan, postures, monkeypatch)
    offsets_for_the_controller(tmp_path, arm)


def test_the_conventions_of_all_arms_are_stated() -> None:
    for name in built_in_robots():
        stated = Arm(name).stated
        assert stated["mounting"] == {"below_base_mm": BELOW.get(name, 0)}, name
        assert stated["pendant"]["joint3"] == ("ground" if name in GROUND else "link"), name
        lowest = min(Arm(name).chain(np.zeros(len(stated["joints"])))[:, 2])
        assert lowest == -BELOW.get(name, 0)  # the arm stands on its mounting face


def test_parts_of_an_arm_that_touch_are_found() -> None:
    """The control of this module's own measure: an elbow folded through the upper arm."""
    arm = Arm("m10ia")
    assert nearest_parts(arm, np.array([0.0, 20, -60, 0, 0, 0])) > 100
    assert nearest_parts(arm, np.array([0.0, 20, -115, 0, 0, 0])) < 15
