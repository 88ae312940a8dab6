"""Corrected rows are the corrected arm, exactly, in either convention."""

import functools
from pathlib import Path

import numpy as np
import pytest

from zerobeam.model.files.robot_file import RobotFile, stated_rows
from zerobeam.model.kinematics.dh import RowTable, dh_chain
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.geometry import Geometry

HERE = Path(".")
BASED = {
    "schema": "zerobeam/robot/1",
    "name": "mixed",
    "base": {"xyz_mm": [10, 20, 30], "rpy_deg": [1, 2, 3]},
    "flange": {"xyz_mm": [5, 0, 80], "rpy_deg": [0, 90, 0]},
}
ROWS = [
    {"a_mm": 100, "alpha_deg": -90, "d_mm": 400, "theta_deg": 10, "lower_deg": -170, "upper_deg": 170},
    {"a_mm": 300, "alpha_deg": 180, "d_mm": 20, "theta_deg": -90, "lower_deg": -90, "upper_deg": 90},
    {
        "a_mm": 200,
        "alpha_deg": 2,
        "d_mm": 0,
        "theta_deg": 0,
        "beta_deg": 1,
        "lower_deg": -90,
        "upper_deg": 90,
    },
    {
        "a_mm": 0,
        "alpha_deg": 45,
        "d_mm": 0,
        "theta_deg": 0,
        "kind": "prismatic",
        "lower_mm": 0,
        "upper_mm": 300,
    },
    {"a_mm": 0, "alpha_deg": 0, "d_mm": 50, "theta_deg": 0, "lower_deg": -90, "upper_deg": 90},
]


# One of each family of rows: parallel axes, twists of 180 degrees, transforms to base and flange, modified.
BUILT_IN = ("irb1600", "panda", "iiwa14", "gen3_lite", "ur5e", "kr6_r900", "lrmate_200id")


OWN = ("standard", "modified")


@functools.cache
def stated_by(name: str) -> RobotFile:
    if name in OWN:
        return RobotFile.model_validate({**BASED, "convention": name, "joints": ROWS})
    return stated_rows(name, HERE)


def robot_of(stated: RobotFile, table: RowTable) -> Robot:
    own = stated.robot()
    fixed, last = dh_chain(table.rows, stated.convention)
    assert np.isfinite(last).all()
    joints = [
        type(joint)(joint.name, joint.kind, transform, joint.axis, joint.lower, joint.upper)
        for joint, transform in zip(own.joints, fixed, strict=True)
    ]
    first = joints[0]
    base = stated.base.matrix() @ first.fixed
    joints[0] = type(first)(first.name, first.kind, base, first.axis, first.lower, first.upper)
    return Robot(own.name, tuple(joints), last @ table.flange)


@pytest.mark.parametrize("name", [*BUILT_IN, *OWN])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, 5))])
@pytest.mark.one_in(4)
def test_forward_kinematics_are_the_corrected_arm_s(name: str, seed: int) -> None:
    stated = stated_by(name)
    robot, rng = stated.robot(), np.random.default_rng(seed)
    geometry = Geometry.of_links(robot, 0.3, 0.1)
    values = rng.normal(size=len(geometry.names)) * [geometry.prior_std(*own) for own in geometry.names] * 3
    delta = rng.normal(size=robot.n) * 0.03
    moved = geometry.applied(robot, values)
    corrected = moved.with_offsets(delta)
    recorded = rng.uniform(robot.lower, robot.upper, (200, robot.n))
    wanted = moved.fk(recorded + delta, "rad")
    np.testing.assert_allclose(corrected.fk(recorded, "rad"), wanted, atol=1e-9)
    table = stated.table_of(corrected)
    np.testing.assert_allclose(robot_of(stated, table).fk(recorded, "rad"), wanted, atol=1e-9)
    # The rows are near the file's own: no length of kilometres for an axis that is nearly parallel.
    for row, nominal in zip(table.rows, (joint.row for joint in stated.joints), strict=True):
        assert abs(row.a - nominal.a) < 30
        assert abs(row.d - nominal.d) < 30
        assert abs(row.alpha - nominal.alpha) < 0.1
        assert abs(row.theta - nominal.theta) < 0.5
    assert abs(robot.fk(recorded + delta, "rad") - wanted).max() > 0.1  # links matter


@pytest.mark.parametrize("name", [*BUILT_IN, *OWN])
def test_nothing_estimated_changes_nothing(name: str) -> None:
    stated = stated_by(name)
    table = stated.table_of(stated.robot())
    assert table.rows == tuple(joint.row for joint in stated.joints)
    np.testing.assert_allclose(table.flange, stated.flange.matrix(), atol=1e-12)


def test_offsets_alone_change_theta_alone() -> None:
    stated = stated_rows("irb1600", HERE)
    delta = np.radians([0.0, -1.2, 0.7, 0.1, 0.2, 0.3])
    table = stated.table_of(stated.robot().with_offsets(delta))
    for row, joint, value in zip(table.rows, stated.joints, delta, strict=True):
        nominal = joint.row
        assert (row.a, row.alpha, row.d, row.beta) == (nominal.a, nominal.alpha, nominal.d, 0.0)
        assert row.theta == pytest.approx(nominal.theta + value, abs=1e-12)
