"""Plans made from arrays: the same plan as the file that says the same, and errors that name the argument."""

from __future__ import annotations

import numpy as np
import pytest

import zerobeam as zb
from zerobeam.model.files.plan import write_plan

POSTURES = np.array([[10, -20, 30, 5, 40, 0], [-15, -25, 35, 0, 35, 20], [25, -10, 20, 15, 50, -30.5]])
ARGUMENTS = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "postures": POSTURES,
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
}


def made(**changes):
    return zb.Plan.from_arrays(**{**ARGUMENTS, **changes})


def test_it_is_the_plan_of_a_file_that_says_the_same(tmp_path):
    plan = made(
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
    plan = made()
    write_plan(tmp_path / "plan.yaml", plan.header, POSTURES, plan.targets)
    assert plan.sha256 == zb.read_plan(tmp_path / "plan.yaml").sha256
    assert repr(plan) == "<Plan arrays: 3 postures at psd, irb1600>"


@pytest.mark.parametrize(
    ("changes", "argument", "said"),
    [
        ({"postures": POSTURES[:, :5]}, "postures", "wrong shape"),
        ({"postures": POSTURES[:0]}, "postures", "no postures"),
        ({"postures": POSTURES + 400}, "postures", "outside its limits"),
        ({"unit": "grad"}, "unit", "no such unit"),
        ({"targets": ["a"]}, "targets", "not as many rows as in postures"),
        ({"targets": ["a", " ", "b"]}, "targets", "cannot be a name"),
        ({"target_priors": {"a": {}, "b": {}}}, "targets", "several targets"),
        ({"robot": "irb1601"}, "robot", "no robot of this name"),
        ({"tool": "laser"}, "tool", "cannot be used"),
        ({"prior": {"offset": 1}}, "prior", "offset"),
    ],
)
def test_an_error_names_the_argument(changes, argument, said):
    with pytest.raises(zb.BadInput, match=said) as caught:
        made(**changes)
    assert (caught.value.argument, caught.value.file) == (argument, None)
