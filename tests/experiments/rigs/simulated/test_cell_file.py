"""The cell file: what may stand in it, and errors that say where it is wrong."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import good_plan

from zerobeam.experiments.procedure.steering import Belief
from zerobeam.experiments.rigs.simulated.cell_file import FAULT_KINDS, CellFile, read_cell
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files.plan import Plan
from zerobeam.model.parsing.reading import read_yaml

WHOLE = """\
schema: zerobeam/cell/1
robot: irb1600
arm:
  offsets_deg: {delta2: -1.2}
  drawn_deg: 2
  repeatability_deg: [0.01, 0.01, 0.01, 0.02, 0.02, 0.02]
  resolution_deg: 0.001
  backlash_deg: 0.01
  geometry:
    - {joint: 3, xyz_mm: [0.1, 0, 0], rpy_deg: [0, 0.01, 0]}
  speed: 0.5
  acceleration_deg_s2: 100
  latency_s: 0.2
laser: {tilt_deg: [0.1, 0], shift_mm: [0, 0.5], drift_deg_min: [0, 0.001], \
wander_mm: 0.01, light: 0.9, radius_mm: 1}
psd:
  kind: tetra-lateral
  size_mm: 10
  surround_mm: 60
  leds_mm: 60
  noise_mm: 0.001
  resolution_mm: 0.001
  nonlinearity: 0.01
  ambient: 0.1
  saturation: 3
  rate_hz: 100
  lost: 0.1
  placed:
    psd: {centre_mm: [900, 10, 0], normal: [0, 0, 2], turn_deg: 10, misturned_deg: [0, 0, 0]}
camera:
  width_px: 320
  height_px: 240
  focal_px: 350
  distortion: [0, 0, 0, 0, 0]
  beside_mm: [50, 10]
  behind_mm: 5
  misturned_deg: [0, 0, 0]
  exposure: 2
  noise_grey: 1
  ambient_grey: 5
  led_light: 1000
  spot_light: 1000
  psf_px: 2
  image_s: 0.1
faults:
  - {kind: psd-dropout, shot: 0, lasts: 1}
  - {kind: camera-black, shot: 0}
  - {kind: led-occluded, shot: 0, led: 2}
  - {kind: reflection, shot: 0, at_mm: [1, 2], light: 0.5}
  - {kind: encoder-glitch, shot: 0, joint: 1, deg: 1}
  - {kind: robot-stop, shot: 0}
  - {kind: psd-bump, shot: 0, shift_mm: [1, 0, 0]}
  - {kind: process-killed, shot: 0, call: 1}
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "cell.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_cell_file_that_says_everything_is_read(tmp_path: Path) -> None:
    """Every key of every part stands in it, and none is at its default: nothing is lost on the way."""
    cell = read_cell(written(tmp_path, WHOLE))
    sha256 = cell.sha256
    assert len(sha256) == 64
    assert cell.camera is not None
    parts = [
        cell,
        cell.arm,
        *(cell.arm.geometry or ()),
        cell.laser,
        cell.psd,
        cell.psd.placed["psd"],
        cell.camera,
    ]
    for part in parts:
        keys = type(part).model_fields
        assert part.model_fields_set == set(keys)
        same = {key for key, field in keys.items() if getattr(part, key) == field.default}
        assert same <= {"schema_"}
    assert [fault.kind for fault in cell.faults] == list(FAULT_KINDS)
    assert cell.psd.placed["psd"].normal == (0, 0, 2)
    assert cell.faults[3].at_mm == (1, 2)


def test_every_key_has_a_default(tmp_path: Path) -> None:
    cell = read_cell(written(tmp_path, "schema: zerobeam/cell/1\n"))
    assert cell.model_dump() == CellFile().model_dump()
    assert read_cell(written(tmp_path, "schema: zerobeam/cell/1\ncamera: null\n")).camera is None


@pytest.mark.parametrize(
    ("change", "by", "line", "says"),
    [
        ("schema: zerobeam/cell/1", "schema: zerobeam/plan/1", 1, "not a cell file"),
        ("  speed: 0.5", "  speed: 0", 11, "arm.speed is out of range"),
        ("  speed: 0.5", "  speed: 1.5", 11, "<= 1"),
        ("  speed: 0.5", "  speeed: 0.5", 11, "did you mean 'speed'?"),
        ("  backlash_deg: 0.01", "  backlash_deg: -0.01", 8, "not a valid value for a joint"),
        ("  backlash_deg: 0.01", "  backlash_deg: [0, 90]", 8, "arm.backlash_deg is more than any arm has"),
        ("  backlash_deg: 0.01", "  backlash_deg: [0, -0.01]", 8, "0 or more"),
        ("  backlash_deg: 0.01", "  backlash_deg: [0, true]", 8, "found:   true"),
        ("{joint: 3,", "{joint: 0,", 10, "joint"),
        ("{joint: 3,", "{", 10, "'joint' is missing"),
        (
            "geometry:\n    - {joint: 3,",
            "geometry:\n    - {joint: 3}\n    - {joint: 3,",
            11,
            "two geometric errors",
        ),
        ("tilt_deg: [0.1, 0]", "tilt_deg: [0.1]", 14, "a list of 2 values is required"),
        ("kind: tetra-lateral", "kind: trilateral", 16, "'duo-lateral' or 'tetra-lateral'"),
        ("  lost: 0.1", "  lost: 1", 26, "psd.lost"),
        ("normal: [0, 0, 2]", "normal: [0, 0, 0]", 28, "any length but zero"),
        ("normal: [0, 0, 2]", "normal: [0, 2]", 28, "[x, y, z]"),
        ("normal: [0, 0, 2]", "normal: up", 28, "or beam"),
        ("distortion: [0, 0, 0, 0, 0]", "distortion: [0, 0]", 33, "a list of 5 values is required"),
        ("kind: robot-stop", "kind: robot-stopp", 50, "did you mean 'robot-stop'?"),
        ("kind: robot-stop, shot: 0", "shot: 0", 50, "unknown kind of fault"),
        ("{kind: robot-stop, shot: 0}", "robot-stop", 50, "faults"),
        ("kind: robot-stop, shot: 0", "kind: robot-stop", 50, "'shot' is missing"),
        ("kind: robot-stop, shot: 0", "kind: robot-stop, shot: 0, lasts: 2", 50, "allowed: shot, kind"),
        ("at_mm: [1, 2]", "at_mm: [1]", 48, "a list of 2 values is required"),
        ("led: 2", "led: 3", 47, "1 or 2"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(
    tmp_path: Path, refused: Callable[..., BadInput], change: str, by: str, line: int, says: str
) -> None:
    assert WHOLE.count(change) == 1
    file = written(tmp_path, WHOLE.replace(change, by))
    error = refused(read_cell, file)
    assert (error.file, error.line) == (str(file), line)
    assert says in str(error)


def test_a_fault_of_a_camera_needs_one(tmp_path: Path, refused: Callable[..., BadInput]) -> None:
    text = "schema: zerobeam/cell/1\ncamera: null\nfaults:\n  - {kind: psd-dropout, shot: 0}\n"
    read_cell(written(tmp_path, text))
    for kind in ("camera-black", "led-occluded"):
        error = refused(read_cell, written(tmp_path, f"{text}  - {{kind: {kind}, shot: 0}}\n"))
        assert error.line == 5
        assert kind in str(error)


@cache
def plan() -> Plan:
    return good_plan(3)


@cache
def looks() -> list[Matrix]:
    """Joints by which the beam of a cell without anything stated is on the face, and on the housing."""
    parts = SimulatedRig(plan(), CellFile(), 0)._parts
    problem = parts.truth.problem.select(np.array([0]))
    found = [
        Belief(problem, parts.truth.x).with_target(parts.centres["psd"] + off).onto_target(plan().postures[0])
        for off in (np.array([2.0, 1.0, 0.0]), np.array([0.0, 45.0, 0.0]))
    ]
    return [joints for joints in found if joints is not None]


def outputs(content: dict[str, Any]) -> bytes:
    """Everything that a rig tells while it is led through the same motions."""
    small = {"width_px": 160, "height_px": 120, "focal_px": 175.0, **content.get("camera", {})}
    rig = SimulatedRig(plan(), CellFile.model_validate({**content, "camera": small}), 0)
    psd = rig.psds["psd"]
    told: list[Any] = [psd.saturation, psd.markers, *sorted(rig.provenance().items())]
    for shot, joints in enumerate(looks()):
        rig.begin(shot, "psd", None)
        rig.move(joints)
        told += [rig.now(), rig.image()]
        rig.laser(True)
        told += [rig.currents(40), rig.image(), rig.joints(), rig.now()]
    return b"".join(np.asarray(value).tobytes() for value in told)


def leaves(value: Any, place: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, item in value.items():
        if isinstance(item, dict) and key != "offsets_deg":
            yield from leaves(item, (*place, key))
        else:
            yield (*place, key), item


def stated(place: tuple[str, ...], value: Any) -> dict[str, Any]:
    for key in reversed(place):
        value = {key: value}
    return {"schema": "zerobeam/cell/1", **value}


@pytest.mark.long
def test_every_key_has_its_effect(tmp_path: Path) -> None:
    """A key that nothing reads would change nothing of what a rig tells."""
    assert len(looks()) == 2
    content = read_yaml(written(tmp_path, WHOLE)).data
    del content["schema"], content["faults"]
    plain = outputs({})
    idle = [".".join(place) for place, value in leaves(content) if outputs(stated(place, value)) == plain]
    # The control: which robot it is must be so, and changes nothing.
    assert idle == ["robot"]


def test_every_fault_has_its_effect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed: list[int] = []
    monkeypatch.setattr("os.kill", lambda pid, signal: killed.append(signal))
    content = read_yaml(written(tmp_path, WHOLE)).data
    plain = outputs({})
    for fault in content["faults"]:
        if fault["kind"] == "robot-stop":
            with pytest.raises(RigFault, match="stopped by itself"):
                outputs({"faults": [fault]})
        elif fault["kind"] == "process-killed":
            assert killed == []
            outputs({"faults": [fault]})
            assert len(killed) == 1
        else:
            assert outputs({"faults": [fault]}) != plain
            # Only in its shot.
            assert outputs({"faults": [{**fault, "shot": 2}]}) == plain


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("arm:\n  backlash_deg: [0, 0, 0]\n", 3, "found:   3 values"),
        ("arm:\n  resolution_deg: [0, 0, 0]\n", 3, "arm.resolution_deg"),
        ("arm:\n  repeatability_deg: [0, 0, 0]\n", 3, "one number, or 6"),
        ("arm:\n  offsets_deg:\n    delta2: 1\n    delta7: 1\n", 5, "allowed: delta1, delta2"),
        ("arm:\n  geometry:\n    - {joint: 7}\n", 4, "the arm has no such joint"),
        (
            "faults:\n  - {kind: robot-stop, shot: 0}\n  - {kind: encoder-glitch, shot: 0, deg: 1, joint: 7}",
            4,
            "1 to 6",
        ),
        ("psd:\n  placed:\n    psdd: {}\n", 4, "did you mean 'psd'?"),
        ("psd:\n  placed:\n    psd: {centre_mm: [-900, 0, 3000]}\n", 2, "out of view in 3 of the plan's 3"),
        ("robot: arm.yaml\n", 2, "the file of the robot is not there"),
    ],
)
def test_what_does_not_go_with_the_plan_is_said_with_its_line(
    tmp_path: Path, refused: Callable[..., BadInput], text: str, line: int, says: str
) -> None:
    file = written(tmp_path, f"schema: zerobeam/cell/1\n{text}")
    error = refused(SimulatedRig, good_plan(3), read_cell(file), 0)
    assert (error.file, error.line) == (str(file), line)
    assert says in str(error)


def test_a_robot_is_named_relative_to_the_cell_file(tmp_path: Path, refused: Callable[..., BadInput]) -> None:
    folder = tmp_path / "cells"
    folder.mkdir()
    (folder / "arm.yaml").write_text(
        "schema: zerobeam/robot/1\nname: two rods\nconvention: standard\njoints:\n"
        + 2 * "  - {a_mm: 500, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -90, upper_deg: 90}\n",
        encoding="utf-8",
    )
    file = written(folder, "schema: zerobeam/cell/1\ncamera: null\nrobot: arm.yaml\n")
    cell = read_cell(file)
    robot = cell.named_robot()
    assert robot.name == "two rods"
    error = refused(SimulatedRig, good_plan(3), cell, 0)
    assert (error.file, error.line) == (str(file), 3)
    assert "the plan is for another robot than the one in the cell" in str(error)
    own = read_cell(written(tmp_path, "schema: zerobeam/cell/1\nrobot: irb1600\n"))
    SimulatedRig(good_plan(3), own, 0)
