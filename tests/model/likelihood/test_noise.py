import numpy as np
import pytest
from plain_model import arm

from zerobeam.model.files.header import Header
from zerobeam.model.likelihood.noise import NoiseModel


def header(**noise):
    tool = {"kind": "probe", "point_mm": [0, 0, 0]}
    return Header.model_validate({"robot": "irb1600", "tool": tool, "noise": noise})


@pytest.fixture
def irb1600(tmp_path):
    return arm("irb1600", tmp_path).robot


@pytest.fixture
def scara(tmp_path):
    """Revolute, revolute, prismatic, revolute."""
    return arm("scara", tmp_path).robot


def test_one_figure_for_all_joints_in_radians(irb1600):
    noise = NoiseModel.from_header(header(joint_deg=0.01, spot_mm=0.05), irb1600)
    np.testing.assert_allclose(noise.joint, np.full(6, 0.01 * np.pi / 180), rtol=1e-15)
    assert noise.spot == 0.05
    assert not noise.estimated
    np.testing.assert_allclose(noise.variances, [*[(0.01 * np.pi / 180) ** 2] * 6, 0.0025], rtol=1e-14)


def test_a_prismatic_joint_has_its_figure_in_mm(scara):
    rad = np.pi / 180
    noise = NoiseModel.from_header(header(joint_deg=0.01, joint_mm=0.02, spot_mm=0), scara)
    np.testing.assert_allclose(noise.joint, [0.01 * rad, 0.01 * rad, 0.02, 0.01 * rad], rtol=1e-15)
    noise = NoiseModel.from_header(header(joint_deg=[0.01, 0.03, 0.02, 0.04], spot_mm=0), scara)
    np.testing.assert_allclose(noise.joint, [0.01 * rad, 0.03 * rad, 0.02, 0.04 * rad], rtol=1e-15)


def test_an_estimated_scale(irb1600):
    noise = NoiseModel.from_header(header(joint_deg=0.01, spot_mm=0.05, scale="estimated"), irb1600)
    assert (noise.estimated, noise.separate) == (True, False)


def test_separate_factors(irb1600):
    """The stated figures stay: the factors are parameters."""
    noise = NoiseModel.from_header(header(joint_deg=0.01, spot_mm=0.05, scale="separate"), irb1600)
    assert (noise.estimated, noise.separate) == (False, True)
    known = NoiseModel.from_header(header(joint_deg=0.01, spot_mm=0.05), irb1600)
    assert (known.estimated, known.separate) == (False, False)
    np.testing.assert_array_equal(noise.variances, known.variances)


def test_what_does_not_suit_the_robot_is_refused(irb1600, scara, refused):
    error = refused(NoiseModel.from_header, header(joint_deg=[0.01] * 5, spot_mm=0), irb1600)
    assert "wrong number" in error.what
    assert error.found == "5 values"
    assert "6 numbers" in error.allowed
    error = refused(NoiseModel.from_header, header(joint_deg=0.01, spot_mm=0), scara)
    assert "noise.joint_mm is missing" in error.what
    assert "joint_mm" in error.remedy
