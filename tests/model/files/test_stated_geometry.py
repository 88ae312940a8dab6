"""The key `geometry` of a header: its defaults, and one message for each thing that is wrong with it."""

import json
from typing import Any

import numpy as np
import pytest
from cells import LASER, OPEN_LASER, header, irb1600

import zerobeam as zb
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import Header, StatedGeometry
from zerobeam.model.files.measurements import read_header
from zerobeam.model.likelihood.problem import Problem
from zerobeam.model.parsing.validation import validate

HEADER = """\
robot: {robot}
tool: {{kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}}
noise: {{joint_deg: 0.01, joint_mm: 0.01, spot_mm: 0.05}}
geometry:
  {key}
"""
PLAN = "schema: zerobeam/plan/1\n{header}postures_deg:\n{postures}"
SCARA = """\
schema: zerobeam/robot/1
name: scara
convention: standard
joints:
  - {a_mm: 325, alpha_deg: 0, d_mm: 200, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 275, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_deg: -140, upper_deg: 140}
  - {kind: prismatic, a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_mm: 0, upper_mm: 200}
"""
LINE = 5  # of the key below `geometry`
POSTURES = np.random.default_rng(1).uniform(-40, 40, (5, 6)).round(2)

# What a file states below `geometry`, words of the message, and of what was found.
WRONG = [
    ("tolerance: {length_mm: 0}", "a tolerance of the geometry cannot be used", "0"),
    ("tolerance: {length_mm: -0.3}", "a tolerance of the geometry cannot be used", "-0.3"),
    ("tolerance: {angle_deg: [0.1, 0.1, 0, 0.1, 0.1, 0.1]}", "a tolerance of the geometry cannot", "0"),
    ("tolerance: {angle_deg: true}", "a tolerance of the geometry cannot be used", "true"),
    ("tolerance: {length_mm: [0.3, 0.3]}", "geometry.tolerance.length_mm has the wrong number", "2 values"),
    ("tolerance: {angle_deg: [0.1]}", "geometry.tolerance.angle_deg has the wrong number", "1 values"),
    ("tolerance: {length: 0.3}", "unknown key 'length' in geometry.tolerance", "length: 0.3"),
    ("tolerancs: {}", "unknown key 'tolerancs' in geometry", "tolerancs"),
    ("masses_kg: [1, 2, 3]", "geometry.masses_kg has the wrong number of values", "3 values"),
    ("masses_kg: [1, 2, 3, 4, -5, 6]", "item 5 of geometry.masses_kg is out of range", "-5"),
    ("up: [0, 0, 0]", "geometry.up has no length", "[0, 0, 0]"),
    ("up: [0, 1]", "a list of 3 values is required", "2 values"),
    ("scale: free", "geometry.scale is not one of the allowed words", "free"),
    ("gravity: perhaps", "this rung of the geometry", "perhaps"),
    ("harmonics: 1", "this rung of the geometry", "1"),
]


def refused(call, *arguments):
    with pytest.raises(zb.BadInput) as caught:
        call(*arguments)
    return caught.value


def header_text(key, robot="irb1600"):
    text = HEADER.format(robot=robot, key=key)
    return text if robot != "irb1600" else text.replace("joint_mm: 0.01, ", "")


def plan_of(folder, key, robot="irb1600", postures=POSTURES):
    rows = "".join(f"  - {row.tolist()}\n" for row in postures)
    path = folder / "plan.yaml"
    path.write_text(PLAN.format(header=header_text(key, robot), postures=rows), encoding="utf-8")
    return path


def stated(key):
    from ruamel.yaml import YAML

    return YAML(typ="safe").load(key)


def run_of(folder, key, postures=POSTURES):
    path, tool = folder / "run.jsonl", {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
    header = {"schema": "zerobeam/run/1", "robot": "irb1600", "tool": tool}
    header |= {"noise": {"joint_deg": 0.01, "spot_mm": 0.05}, "geometry": stated(key)}
    shots = [{"shot": i, "joints_deg": row.tolist()} for i, row in enumerate(postures)]
    path.write_text("".join(json.dumps(row) + "\n" for row in (header, *shots)), encoding="utf-8")
    return path


def from_arrays(key, postures=POSTURES):
    return zb.Run.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        joints=postures,
        unit="deg",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        geometry=stated(key),
    )


@pytest.mark.parametrize(("key", "words", "result"), WRONG)
def test_each_fault_has_one_message_wherever_it_is_stated(tmp_path, key, words, result):
    """A plan names the line, a run its header's, a call in Python the argument."""
    errors = [
        refused(zb.read_plan, plan_of(tmp_path, key)),
        refused(lambda path: zb.read_run(path).require_analysable(), run_of(tmp_path, key)),
        refused(from_arrays, key),
    ]
    for error in errors:
        assert words in error.what
        assert result in str(error.found)
        assert error.allowed
    assert [error.line for error in errors[:2]] == [LINE + 1, 1]
    assert errors[2].argument == "geometry"


def test_harmonics_are_not_of_slides(tmp_path):
    (tmp_path / "scara.yaml").write_text(SCARA, encoding="utf-8")
    postures = POSTURES[:, :3] + [0, 0, 100]
    error = refused(zb.read_plan, plan_of(tmp_path, "harmonics: true", "scara.yaml", postures))
    assert "harmonics are of revolute joints" in error.what
    assert "prismatic" in error.found
    assert "auto" in error.remedy
    assert error.line == LINE + 1
    plan = zb.read_plan(plan_of(tmp_path, "harmonics: auto", "scara.yaml", postures))
    assert Problem.from_plan(plan).geometry.harmonics == (0, 1)


@pytest.mark.parametrize(("key", "unknowns"), [("gravity: true", 5 + 3 + 2), ("harmonics: true", 5 + 3 + 12)])
def test_a_rung_that_is_asked_for_needs_the_numbers_for_it(tmp_path, key, unknowns):
    """Two numbers of each measurement of a laser; `auto` never needs any."""
    few = (
        POSTURES[: unknowns // 2 - 1]
        if unknowns < 12
        else np.vstack([POSTURES, POSTURES + 0.5])[: unknowns // 2 - 1]
    )
    run = from_arrays(key, few)
    errors = [
        refused(Problem.from_run, run),
        refused(Problem.from_plan, zb.read_plan(plan_of(tmp_path, key, postures=few))),
    ]
    for error in errors:
        assert key.split(":")[0] in error.what
        assert f"{2 * len(few)} numbers of {len(few)} measurements" in error.found
        assert f"at least {unknowns}" in error.allowed
        assert "auto" in error.remedy
    enough = np.vstack([few, few[:1] + 1])
    assert Problem.from_run(from_arrays(key, enough)).geometry
    auto = key.replace("true", "auto")
    assert Problem.from_run(from_arrays(auto, few)).parameters.names


def test_the_defaults_are_those_of_the_design(tmp_path):
    path = tmp_path / "header.yaml"
    path.write_text(header_text("tolerance: {}"), encoding="utf-8")
    made_header = read_header(path).geometry
    assert (made_header.tolerance.length_mm, made_header.tolerance.angle_deg) == (0.3, 0.1)
    assert (made_header.scale, made_header.masses_kg) == ("known", None)
    assert made_header.gravity == made_header.harmonics == "auto"
    assert made_header.up == (0, 0, 1)
    path.write_text(header_text("tolerance: {}").split("geometry")[0], encoding="utf-8")
    assert read_header(path).geometry is None


def test_what_is_stated_arrives(tmp_path):
    """A tolerance for each link; up of any length, also a tiny one."""
    key = "{tolerance: {length_mm: [1, 2, 3, 4, 5, 6], angle_deg: 0.2}, up: [0, 1.0e-200, 0]}"
    problem = Problem.from_run(from_arrays(key))
    std = dict(zip(problem.parameters.names, problem.parameters.prior_std, strict=True))
    assert [std[f"link{i}.a"] for i in range(1, 7)] == [1, 2, 3, 4, 5, 6]
    assert std["link3.alpha"] == pytest.approx(np.radians(0.2))
    assert std["joint2.gravity"] == pytest.approx(np.radians(0.05))
    assert std["joint2.cos"] == std["joint2.sin"] == pytest.approx(np.radians(0.02))
    np.testing.assert_allclose(problem.geometry.gravity.up, [0, 1, 0])


def test_a_header_that_says_nothing_of_the_geometry_is_of_a_typical_arm() -> None:
    """Links, the last one whole, gravity, harmonics and the calibrated tool, each with its prior."""
    own = header(geometry=None)
    assert (own.geometry, own.arm) == (None, StatedGeometry())
    assert not own.exact_tool
    parameters = Problem.build(own, irb1600(), POSTURES, ["psd"] * len(POSTURES)).parameters
    std = dict(zip(parameters.names, parameters.prior_std * parameters.display, strict=True))
    expected = {"link2.a": 0.3, "link2.beta": 0.1, "joint3.gravity": 0.05, "joint6.cos": 0.02}
    expected |= {"tool.tilt1": 0.05, "tool.tilt2": 0.05, "tool.shift1": 0.1, "tool.shift2": 0.1}
    assert {name: std[name] for name in expected} == pytest.approx(expected)
    last = [item.axis for item in parameters.items if item.of == "link6"]
    assert last == ["a", "b", "d", "alpha", "beta"]
    estimated = np.array(parameters.names)[parameters.free & ~parameters.tolerated]
    assert set(estimated) == {f"delta{i}" for i in range(2, 7)} | {"psd.x", "psd.y", "psd.z"}
    exact = Problem.build(header(), irb1600(), POSTURES, ["psd"] * len(POSTURES)).parameters
    assert exact.names == (*(f"delta{i}" for i in range(1, 7)), "psd.x", "psd.y", "psd.z")


def test_exact_geometry_takes_a_calibrated_tool_as_stated() -> None:
    own = header(geometry="exact")
    assert own.arm is None
    assert own.exact_tool
    assert not header(OPEN_LASER, geometry="exact").exact_tool
    assert not header({**LASER, "sigma": {"tilt_deg": 0.02}}, geometry="exact").exact_tool


@pytest.mark.parametrize("geometry", [None, {}])
def test_a_calibrated_tool_of_an_uncertain_arm_is_uncertain(geometry: dict[str, Any] | None) -> None:
    own = header(geometry=geometry)
    assert own.arm is not None
    assert not own.exact_tool
    assert (own.tool.sigma.tilt_deg, own.tool.sigma.shift_mm) == (0.05, 0.1)
    assert header({**LASER, "sigma": {"mm": 0.3}}, geometry=geometry).tool.sigma.shift_mm == 0.3
    assert header(OPEN_LASER, geometry=geometry).tool.sigma.shift_mm == 10.0


@pytest.mark.parametrize("stated", ["nominal", 0.3, True, ["exact"]])
def test_other_words_for_the_geometry_are_refused(stated: object) -> None:
    content = {"robot": "irb1600", "tool": LASER, "noise": {"joint_deg": 0.01, "spot_mm": 0.05}}
    with pytest.raises(BadInput, match="says nothing of the arm's geometry"):
        validate(Header, {**content, "geometry": stated}, file=None, line=lambda place: None)
