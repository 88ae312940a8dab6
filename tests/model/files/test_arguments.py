"""Runs and plans made from arrays: those of the file that says the same; errors name the argument."""

from pathlib import Path

import numpy as np
import pytest

import zerobeam as zb
from zerobeam.model.files.plan import write_plan
from zerobeam.model.files.robot_file import read_robot
from zerobeam.model.files.run import read_run, write_run
from zerobeam.model.likelihood.problem import Problem

POSTURES = np.array([[10, -20, 30, 5, 40, 0], [-15, -25, 35, 0, 35, 20], [25, -10, 20, 15, 50, -30.5]])
LASER = {"point_mm": (0, 0, 65), "direction": (1, 0, 0)}
ARGUMENTS = {
    "robot": "irb1600",
    "tool": zb.Laser(**LASER),
    "joints": POSTURES,
    "unit": "deg",
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
}
SCARA = """\
schema: zerobeam/robot/1
name: scara
convention: standard
joints:
  - {a_mm: 325, alpha_deg: 0, d_mm: 200, theta_deg: 0, lower_deg: -130, upper_deg: 130}
  - {a_mm: 275, alpha_deg: 180, d_mm: 0, theta_deg: 0, lower_deg: -140, upper_deg: 140}
  - {kind: prismatic, a_mm: 0, alpha_deg: 0, d_mm: 50, theta_deg: 0, lower_mm: 0, upper_mm: 200}
"""


def made(**changes):
    return zb.Run.from_arrays(**{**ARGUMENTS, **changes})


def refused(**changes) -> zb.BadInput:
    with pytest.raises(zb.BadInput) as caught:
        made(**changes)
    assert caught.value.file is None
    return caught.value


def test_it_is_the_run_of_a_file_that_says_the_same(tmp_path):
    spots = np.array([[0.1, -0.2], [0, 0.05], [0.3, 0.4]])
    run = made(
        tool=zb.Laser(point_mm=np.array([0, 0, 65]), direction=[2, 0, 0], calibrated=False, tilt_deg=1.5),
        noise=zb.Noise(joint_deg=np.full(6, 0.02), spot_mm=0.05, scale="estimated"),
        targets=np.array(["a", "b", "a"]),
        spots_mm=spots,
        target_priors={"a": {"guess_mm": np.array([800.0, 0, 900]), "sigma_mm": 20.0}, "b": {}},
        distances=[{"between": ["a", "b"], "mm": 200, "sigma_mm": 0.1}],
        prior={"offset_deg": 2},
        held=["delta1", "delta6"],
        provenance={"who": "me"},
        name="mine",
    )
    write_run(tmp_path / "run.jsonl", run.header, run.shots)
    read = read_run(tmp_path / "run.jsonl")
    assert run.header == read.header
    assert run.shots == read.shots
    assert run.sha256 == read.sha256
    assert run.path == Path("mine")
    assert (run.lines, run.header_line) == ((None, None, None), None)
    assert run.target_names == ("a", "b")
    np.testing.assert_array_equal(run.joints, read.joints)
    np.testing.assert_array_equal(run.spots, spots)
    one, other = Problem.from_run(run), Problem.from_run(read)
    assert one.parameters == other.parameters
    for mine, its in zip(one.linearise(one.nominal()), other.linearise(other.nominal()), strict=True):
        np.testing.assert_array_equal(mine, its)


def test_units_and_defaults():
    run = made(joints=np.radians(POSTURES), unit="rad")
    np.testing.assert_allclose(run.joints, np.radians(POSTURES), rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose([shot.joints_deg for shot in run.shots], POSTURES, rtol=1e-14)
    assert all(shot.spot_mm is None for shot in run.shots)
    assert run.target_names == ("psd",)
    assert made(targets="ball").target_names == ("ball",)
    assert made(target_priors={"ball": {"guess_mm": [1, 2, 3]}}).target_names == ("ball",)
    assert repr(run) == "<Run arrays: 3 measurements of psd, irb1600>"


def test_prismatic_joints_are_mm_in_either_unit(tmp_path):
    (tmp_path / "scara.yaml").write_text(SCARA)
    noise = zb.Noise(joint_deg=0.01, joint_mm=0.02, spot_mm=0)
    joints = np.array([[10.0, 20, 100], [-30, 40, 150.5]])
    run = made(robot=tmp_path / "scara.yaml", noise=noise, joints=joints)
    np.testing.assert_allclose(run.joints[:, 2], [100, 150.5])
    turned = made(robot=tmp_path / "scara.yaml", noise=noise, joints=run.joints, unit="rad")
    np.testing.assert_allclose(turned.joints, run.joints, rtol=1e-15)
    values = made(robot=read_robot(tmp_path / "scara.yaml"), noise=noise, joints=joints)
    assert values.robot.n == 3
    assert values.header.robot == "scara"


def test_joints_beyond_their_limits_are_warnings_where_that_is_asked_for():
    beyond = POSTURES + np.array([300, 0, 0, 0, 0, 0])
    assert refused(joints=beyond).argument == "joints"
    (warning,) = made(joints=beyond, limits="warn").warnings
    assert "joint 1 is outside its limits" in warning


def test_what_is_wrong_only_for_the_analysis_names_the_run():
    with pytest.raises(zb.BadInput, match=r"^arrays: held names a parameter that is not there"):
        zb.analyse(made(held=["nope"]))
    with pytest.raises(zb.BadInput, match=r"^arrays: one measurement can neither"):
        zb.analyse(made(joints=POSTURES[:1]))


@pytest.mark.parametrize(
    ("changes", "argument", "words"),
    [
        ({"robot": "irb160"}, "robot", "did you mean 'irb1600'"),
        ({"robot": "none.yaml"}, "robot", "none.yaml"),
        ({"robot": 5}, "robot", "neither a name"),
        ({"tool": 3}, "tool", "zerobeam.Laser(…) or zerobeam.Probe(…)"),
        ({"noise": None}, "noise", "zerobeam.Noise(…)"),
        ({"noise": zb.Noise(joint_deg=[0.1] * 5, spot_mm=0.1)}, "noise", "5 values"),
        ({"unit": "grad"}, "unit", "'deg' or 'rad'"),
        ({"unit": None}, "unit", "unit='deg' or unit='rad'"),
        ({"joints": POSTURES[0]}, "joints", "(6,)"),
        ({"joints": POSTURES[:, :5]}, "joints", "(N, 6): irb1600 has 6 joints"),
        ({"joints": POSTURES[:0]}, "joints", "no measurements"),
        ({"joints": "abc"}, "joints", "not an array of numbers"),
        ({"joints": np.where(POSTURES == 5, np.nan, POSTURES)}, "joints", "nan in row 0, column 3"),
        ({"targets": ["a", "b"]}, "targets", "found:   2"),
        ({"targets": 3}, "targets", "list of names"),
        ({"targets": ["a", "b", "tool"]}, "targets", "cannot be called 'tool'"),
        ({"targets": ["a", "b", 1]}, "targets", "text"),
        ({"target_priors": {"a": {}, "b": {}}}, "targets", "several targets"),
        ({"target_priors": {"a": {"guess_mm": [1, 2]}}}, "target_priors", "2 values"),
        ({"spots_mm": np.zeros((3, 3))}, "spots_mm", "(3, 3)"),
        ({"spots_mm": np.zeros((2, 2))}, "spots_mm", "found:   2"),
        ({"spots_mm": np.zeros((3, 2)), "tool": zb.Probe(point_mm=(0, 0, 9))}, "spots_mm", "probe"),
        ({"tolerence": {}}, "tolerence", "did you mean 'tolerance'"),
        ({"prior": {"offset_deg": -1}}, "prior", "> 0"),
    ],
)
def test_a_bad_argument_is_named_with_what_is_allowed(changes, argument, words):
    error = refused(**changes)
    assert error.argument == argument
    assert str(error).startswith(f"argument {argument}: ")
    assert words in str(error)


@pytest.mark.parametrize(
    ("kind", "values", "argument"),
    [
        (zb.Laser, {**LASER, "point_mm": (0, 0)}, "point_mm"),
        (zb.Laser, {**LASER, "point_mm": (0, "a", 0)}, "point_mm"),
        (zb.Laser, {**LASER, "direction": (0, 0, 0)}, "direction"),
        (zb.Laser, {**LASER, "direction": (0, 0, np.nan)}, "direction"),
        (zb.Laser, {**LASER, "calibrated": 1}, "calibrated"),
        (zb.Laser, {**LASER, "tilt_deg": 0}, "tilt_deg"),
        (zb.Probe, {"point_mm": (0, 0, 9), "shift_mm": -1}, "shift_mm"),
        (zb.Noise, {"joint_deg": -1, "spot_mm": 0.1}, "joint_deg"),
        (zb.Noise, {"joint_deg": [0.1, 0.1], "spot_mm": 0.1, "joint_mm": 0.1}, "joint_mm"),
        (zb.Noise, {"joint_deg": 0.1, "spot_mm": 0, "scale": "separate"}, "spot_mm"),
        (zb.Noise, {"joint_deg": 0.1, "spot_mm": 0.1, "scale": "free"}, "scale"),
    ],
)
def test_a_value_is_checked_where_it_is_made(kind, values, argument):
    with pytest.raises(zb.BadInput) as caught:
        kind(**values)
    assert caught.value.argument == argument
    assert caught.value.found is not None


def made_plan(**changes):
    shared = {key: value for key, value in ARGUMENTS.items() if key != "joints"}
    return zb.Plan.from_arrays(**{**shared, "postures": POSTURES, **changes})


def test_it_is_the_plan_of_a_file_that_says_the_same(tmp_path):
    plan = made_plan(
        postures=np.radians(POSTURES),
        unit="rad",
        targets=["a", "b", "a"],
        target_priors={"a": {"guess_mm": [800, 0, 900]}, "b": {}},
    )
    write_plan(tmp_path / "plan.yaml", plan.header, np.degrees(plan.postures), plan.targets)
    read = zb.read_plan(tmp_path / "plan.yaml")
    np.testing.assert_allclose(plan.postures, read.postures, rtol=0, atol=1e-12)
    assert (plan.header, plan.targets, plan.warnings) == (read.header, read.targets, read.warnings)


def test_its_hash_is_that_of_the_file(tmp_path):
    plan = made_plan()
    write_plan(tmp_path / "plan.yaml", plan.header, POSTURES, plan.targets)
    assert plan.sha256 == zb.read_plan(tmp_path / "plan.yaml").sha256
    assert repr(plan) == "<Plan arrays: 3 postures at psd, irb1600>"


@pytest.mark.parametrize(
    ("changes", "argument", "words"),
    [
        ({"postures": POSTURES[:, :5]}, "postures", "wrong shape"),
        ({"postures": POSTURES[:0]}, "postures", "no postures"),
        ({"postures": POSTURES + 400}, "postures", "outside its limits"),
        ({"unit": "grad"}, "unit", "no such unit"),
        ({"unit": None}, "unit", "not stated"),
        ({"targets": ["a"]}, "targets", "not as many rows as in postures"),
        ({"targets": ["a", " ", "b"]}, "targets", "cannot be a name"),
        ({"target_priors": {"a": {}, "b": {}}}, "targets", "several targets"),
        ({"robot": "irb1601"}, "robot", "no robot of this name"),
        ({"tool": "laser"}, "tool", "cannot be used"),
        ({"prior": {"offset": 1}}, "prior", "offset"),
    ],
)
def test_an_error_of_a_plan_names_the_argument(changes, argument, words):
    with pytest.raises(zb.BadInput, match=words) as caught:
        made_plan(**changes)
    assert (caught.value.argument, caught.value.file) == (argument, None)
