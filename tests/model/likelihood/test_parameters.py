import numpy as np
import pytest
from plain_model import arm

from zerobeam.analysis.observability.causes import Held
from zerobeam.model.files.header import Header
from zerobeam.model.likelihood.geometry import Geometry
from zerobeam.model.likelihood.noise import NoiseModel
from zerobeam.model.likelihood.parameters import IN_RESIDUAL, ORDER, Parameters
from zerobeam.words.observability import reason

LASER = {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
PROBE = {"kind": "probe", "point_mm": [1, 2, 100]}
TILTS = ("tool.tilt1", "tool.tilt2", "tool.shift1", "tool.shift2")
RAD = np.pi / 180


def build(robot, tool, seen=("psd",), **changes):
    noise = {"joint_deg": 0.01, "joint_mm": 0.01, "spot_mm": 0.05}
    content = {"robot": "irb1600", "tool": tool, "noise": noise, "geometry": "exact", **changes}
    header = Header.model_validate(content)
    geometry = Geometry.from_header(header, robot)
    tool = header.made("tool", robot.n)
    noise = NoiseModel.from_header(header, robot, tool)
    return Parameters.build(robot, tool, noise, geometry, header, dict.fromkeys(seen, tool))


@pytest.fixture
def irb1600(tmp_path):
    return arm("irb1600", tmp_path).robot


@pytest.fixture
def scara(tmp_path):
    """Revolute, revolute, prismatic, revolute."""
    return arm("scara", tmp_path).robot


def held(parameters):
    return [item.name for item in parameters.items if item.held]


def test_offsets_then_targets_then_the_tool(irb1600):
    parameters = build(irb1600, {**LASER, "calibrated": False}, ("psd", "b"))
    offsets = tuple(f"delta{i}" for i in range(1, 7))
    targets = ("psd.x", "psd.y", "psd.z", "b.x", "b.y", "b.z")
    assert parameters.names == (*offsets, *targets, *TILTS)
    assert len(parameters) == 16
    np.testing.assert_array_equal(np.flatnonzero(parameters.group("target")), np.arange(6, 12))
    assert parameters.index("b.y") == 10
    assert build(irb1600, {**PROBE, "calibrated": False}).names[9:] == ("tool.x", "tool.y", "tool.z")
    assert build(irb1600, LASER).names[6:] == ("psd.x", "psd.y", "psd.z")


def test_targets_stand_in_the_order_of_the_shots(irb1600):
    content = {"a": {"guess_mm": [1, 2, 3]}, "z": {"guess_mm": [7, 8, 9]}}
    parameters = build(irb1600, LASER, ("z", "a"), targets=content)
    assert parameters.names[6:] == ("z.x", "z.y", "z.z", "a.x", "a.y", "a.z")
    np.testing.assert_array_equal(parameters.prior_mean[6:], [7, 8, 9, 1, 2, 3])


SEPARATE = {"joint_deg": 0.01, "joint_mm": 0.01, "spot_mm": 0.05, "scale": "separate"}


def test_blocks_cover_the_parameters_in_their_order(irb1600):
    parameters = build(irb1600, {**LASER, "calibrated": False}, ("psd", "a.b"), noise=SEPARATE)
    blocks = [parameters.block(group) for group in ORDER]
    assert blocks == [slice(0, 6), slice(6, 6), slice(6, 12), slice(12, 16), slice(16, 16), slice(16, 18)]
    for group, block in zip(ORDER, blocks, strict=True):
        assert {item.group for item in parameters.items[block]} == ({group} - {"geometry", "frame"})
    assert parameters.arm == parameters.block("offset")
    assert [parameters.block("target", k) for k in (0, 1)] == [slice(6, 9), slice(9, 12)]
    assert parameters.names[parameters.block("target", 1)] == ("a.b.x", "a.b.y", "a.b.z")
    assert [parameters.block("offset", k) for k in (0, 5)] == [slice(0, 1), slice(5, 6)]
    assert parameters.names[parameters.block("noise")] == ("noise.joint", "noise.spot")


def test_the_geometry_is_a_block_between_offsets_and_targets(irb1600):
    content = {"geometry": {}}
    parameters = build(irb1600, {**LASER, "calibrated": False}, ("psd", "b"), noise=SEPARATE, **content)
    block = parameters.block("geometry")
    assert block.start == 6
    assert parameters.block("target").start == block.stop
    assert parameters.arm == slice(0, block.stop)
    assert {item.group for item in parameters.items[block]} == {"geometry"}
    assert parameters.names[block.start : block.start + 3] == ("link1.a", "link1.alpha", "link1.d")
    assert parameters.names[block.stop - 1] == "joint6.sin"
    np.testing.assert_array_equal(parameters.of_shot(1)[: block.stop], np.arange(block.stop))
    plain = parameters.without("geometry")
    assert plain.names == build(irb1600, {**LASER, "calibrated": False}, ("psd", "b"), noise=SEPARATE).names


def test_a_group_without_parameters_is_an_empty_block_at_its_place(irb1600):
    parameters = build(irb1600, LASER)
    assert parameters.block("tool") == parameters.block("noise") == slice(9, 9)
    assert parameters.in_shot("tool") == slice(9, 9)


def test_each_parameter_says_what_it_belongs_to(irb1600):
    parameters = build(irb1600, {**LASER, "calibrated": False}, ("joint1", "a.x"), noise=SEPARATE)
    owners = {item.name: (item.of, item.axis) for item in parameters.items}
    assert owners["delta3"] == ("joint3", "offset")
    assert owners["a.x.z"] == ("a.x", "z")
    assert owners["tool.tilt2"] == ("tool", "tilt2")
    assert owners["noise.spot"] == ("noise", "spot")
    # A target may be called like a joint, or like a coordinate of another.
    np.testing.assert_array_equal(np.flatnonzero(parameters.targets(["joint1"])), [6, 7, 8])
    np.testing.assert_array_equal(np.flatnonzero(parameters.targets(["a.x", "a"])), [9, 10, 11])


def test_a_shot_depends_on_its_own_target_alone(irb1600):
    parameters = build(irb1600, {**LASER, "calibrated": False}, ("psd", "b"), noise=SEPARATE)
    np.testing.assert_array_equal(parameters.of_shot(1), [*range(6), 9, 10, 11, *range(12, 18)])
    np.testing.assert_array_equal(parameters.of_shot(0, noise=False), [*range(9), *range(12, 16)])
    for group in IN_RESIDUAL:
        values = parameters.of_shot(1, noise=False)[parameters.in_shot(group)]
        assert {parameters.items[i].group for i in values} == ({group} - {"geometry", "frame"})
    with pytest.raises(ValueError, match="noise"):
        parameters.in_shot("noise")


def test_groups_in_another_order_are_refused(irb1600):
    parameters = build(irb1600, LASER)
    with pytest.raises(ValueError, match="order"):
        Parameters(parameters.items[::-1])


def test_values_of_some_go_into_the_vector_of_all(irb1600):
    parameters = build(irb1600, {**LASER, "calibrated": False}, noise=SEPARATE)
    known = parameters.without("noise")
    assert known.names == parameters.names[:-2]
    x = parameters.with_values(np.full(len(parameters), -1.0), known, np.arange(13.0))
    np.testing.assert_array_equal(x, [*range(13), -1, -1])


def test_units_of_what_people_read(scara):
    parameters = build(scara, {**LASER, "calibrated": False})
    units = {item.name: item.unit for item in parameters.items}
    assert [units[f"delta{i}"] for i in (1, 2, 3, 4)] == ["deg", "deg", "mm", "deg"]
    assert units["psd.x"] == "mm"
    assert [units[name] for name in TILTS] == ["deg", "deg", "mm", "mm"]
    np.testing.assert_allclose(parameters.display[:4], [1 / RAD, 1 / RAD, 1, 1 / RAD])
    np.testing.assert_allclose(parameters.display[4:], [1, 1, 1, 1 / RAD, 1 / RAD, 1, 1])


def test_the_default_priors_and_tolerances_in_internal_units(scara):
    parameters = build(scara, {**LASER, "calibrated": False})
    np.testing.assert_array_equal(parameters.prior_mean, 0)
    np.testing.assert_allclose(
        parameters.prior_std,
        [5 * RAD, 5 * RAD, 5, 5 * RAD, 10_000, 10_000, 10_000, 3 * RAD, 3 * RAD, 10, 10],
    )
    np.testing.assert_allclose(
        parameters.tolerance, [0.1 * RAD, 0.1 * RAD, 1, 0.1 * RAD, 1, 1, 1, 0.1 * RAD, 0.1 * RAD, 1, 1]
    )


def test_the_stated_priors_and_tolerances_in_internal_units(scara):
    parameters = build(
        scara,
        {**LASER, "calibrated": False, "sigma": {"tilt_deg": 2, "shift_mm": 4}},
        prior={"offset_deg": 1.5, "offset_mm": 0.7},
        tolerance={"offset_deg": 0.02, "length_mm": 0.3, "tilt_deg": 0.05},
        targets={"psd": {"guess_mm": [900, -20, 30], "sigma_mm": 50}},
    )
    np.testing.assert_array_equal(parameters.prior_mean, [0, 0, 0, 0, 900, -20, 30, 0, 0, 0, 0])
    np.testing.assert_allclose(
        parameters.prior_std, [1.5 * RAD, 1.5 * RAD, 0.7, 1.5 * RAD, 50, 50, 50, 2 * RAD, 2 * RAD, 4, 4]
    )
    np.testing.assert_allclose(
        parameters.tolerance,
        [0.02 * RAD, 0.02 * RAD, 0.3, 0.02 * RAD, 0.3, 0.3, 0.3, 0.05 * RAD, 0.05 * RAD, 0.3, 0.3],
    )


def test_a_probe_is_expected_where_it_is_stated_to_be(irb1600):
    parameters = build(irb1600, {**PROBE, "calibrated": False})
    np.testing.assert_array_equal(parameters.prior_mean[9:], [1, 2, 100])
    np.testing.assert_array_equal(parameters.prior_std[9:], [50, 50, 50])
    actual = build(irb1600, {**PROBE, "calibrated": False, "sigma": {"shift_mm": 5}})
    np.testing.assert_array_equal(actual.prior_std[9:], [5, 5, 5])


def test_a_stated_target_without_a_guess_is_expected_at_the_base_but_loosely(irb1600):
    parameters = build(irb1600, LASER, targets={"psd": {"sigma_mm": 200}})
    np.testing.assert_array_equal(parameters.prior_mean[6:], 0)
    np.testing.assert_array_equal(parameters.prior_std[6:], 200)


@pytest.mark.parametrize(
    ("tool", "expected"),
    [
        (LASER, ["delta1"]),
        ({**LASER, "calibrated": False}, ["delta1", "delta6"]),
        (PROBE, ["delta1"]),
        ({**PROBE, "calibrated": False}, ["delta1"]),
    ],
)
def test_what_the_method_holds(irb1600, tool, expected):
    """The last joint only against an uncalibrated laser."""
    parameters = build(irb1600, tool)
    assert held(parameters) == expected
    np.testing.assert_array_equal(parameters.free, [name not in expected for name in parameters.names])
    reasons = {item.name: item.held_by for item in parameters.items}
    assert reasons["delta1"] == "base frame"
    assert "section 3.3" in reason(Held("base frame"))
    if "delta6" in expected:
        assert reasons["delta6"] == "tool rotation"
    assert all((reasons[name] is not None) == (name in expected) for name in parameters.names)


def test_the_last_joint_is_that_of_the_arm(scara):
    assert held(build(scara, {**LASER, "calibrated": False})) == ["delta1", "delta4"]


def test_a_stated_list_takes_the_place_of_the_methods(irb1600):
    parameters = build(irb1600, {**LASER, "calibrated": False}, held=["delta6", "psd.z", "tool.tilt1"])
    assert held(parameters) == ["delta6", "psd.z", "tool.tilt1"]  # delta1 is free now
    reasons = {item.name: item.held_by for item in parameters.items}
    assert reasons["delta6"] == "tool rotation"  # the method's reason holds, whoever states it
    assert "section 3.1" in reason(Held("tool rotation"))
    assert reasons["psd.z"] == "header"
    assert reason(Held("header")) == "held by the header"
    assert reasons["delta1"] is None
    assert held(build(irb1600, LASER, held=[])) == []


SIGMA = {"tilt_deg": 0.05, "shift_mm": 0.1}


@pytest.mark.parametrize(
    ("more", "held", "known"),
    [
        ({"calibrated": False, "sigma": SIGMA}, ["delta1"], True),
        ({"calibrated": False, "sigma": SIGMA}, ["delta1", "delta6"], False),
        ({"calibrated": False, "sigma": SIGMA}, None, False),
        ({"calibrated": False}, ["delta1"], False),
        ({"sigma": SIGMA}, None, True),
    ],
)
def test_a_stated_sigma_is_knowledge_where_the_last_offset_is_to_be_estimated(irb1600, more, held, known):
    parameters = build(irb1600, {**LASER, **more}, held=held)
    assert parameters.tolerated[parameters.group("tool")].tolist() == [known] * 4


@pytest.mark.parametrize("name", ["delta7", "delta0", "psd", "other.x", "tool.tilt1", "Delta1", "noise.spot"])
def test_a_held_name_that_is_none_of_them(irb1600, refused, name):
    error = refused(build, irb1600, LASER, held=["delta1", name])
    assert "held" in error.what
    assert error.found == name
    assert error.allowed == "delta1, delta2, delta3, delta4, delta5, delta6, psd.x, psd.y, psd.z"
    assert "held" in error.remedy


def test_separate_noise_factors_come_last_and_are_free(irb1600):
    """Their logarithms inside, expected at the stated noise, 95 % within a factor of 7."""
    parameters = build(irb1600, {**LASER, "calibrated": False}, noise=SEPARATE)
    assert parameters.names[-3:] == ("tool.shift2", "noise.joint", "noise.spot")
    np.testing.assert_array_equal(np.flatnonzero(parameters.group("noise")), [13, 14])
    for item in parameters.items[-2:]:
        assert (item.group, item.unit, item.held) == ("noise", "1", False)
        assert (item.prior_mean, item.prior_std) == (0.0, 1.0)
        assert 0 < item.tolerance < 1
    assert parameters.free[-2:].all()
    # A known or common scale adds nothing.
    for scale in ("known", "estimated"):
        plain = build(irb1600, {**LASER, "calibrated": False}, noise={**SEPARATE, "scale": scale})
        assert plain.names == parameters.names[:-2]
        assert not plain.group("noise").any()
    np.testing.assert_array_equal(plain.prior_std, parameters.prior_std[:-2])


def test_a_noise_factor_may_be_held(irb1600):
    parameters = build(irb1600, LASER, noise=SEPARATE, held=["delta1", "noise.spot"])
    assert held(parameters) == ["delta1", "noise.spot"]
    assert held(build(irb1600, LASER, noise=SEPARATE)) == ["delta1"]


def test_what_people_read_of_a_noise_factor(irb1600):
    """The factor and not its logarithm; a log-normal prior, by 400 000 draws (mean e^(1/2), std 2.16)."""
    parameters = build(irb1600, LASER, noise=SEPARATE)
    x = np.zeros((2, len(parameters)))
    x[:, 1], x[:, 6], x[:, -2:] = 0.1, 7.0, np.log([2.0, 0.5])
    shown = parameters.shown(x)
    np.testing.assert_allclose(shown[:, 1], 0.1 / RAD)
    np.testing.assert_allclose(shown[:, 6], 7.0)
    np.testing.assert_allclose(shown[:, -2:], [[2.0, 0.5]] * 2)
    np.testing.assert_array_equal(x[:, -1], np.log(0.5))  # not written into
    offset, factor = parameters.items[1], parameters.items[-1]
    assert offset.shown(0.1) == pytest.approx(0.1 / RAD)
    assert factor.shown(np.log(3.0)) == pytest.approx(3.0)
    assert offset.shown_std(0.1, 0.02) == pytest.approx(0.02 / RAD)
    # To first order: a small std of the logarithm is a relative one.
    assert factor.shown_std(np.log(3.0), 1e-3) == pytest.approx(3e-3)
    assert offset.shown_prior == pytest.approx((0.0, 5.0))
    draws = np.exp(np.random.default_rng(1).normal(size=400_000))
    mean, std = factor.shown_prior
    assert abs(draws.mean() - mean) < 5 * std / np.sqrt(len(draws))
    # E f^2 = e^2, with the variance e^8 - e^4 of f^2.
    second = np.sqrt((np.exp(8) - np.exp(4)) / len(draws))
    assert abs((draws**2).mean() - (mean**2 + std**2)) < 5 * second


def noise_of(robot, **noise):
    tool = {"kind": "probe", "point_mm": [0, 0, 0]}
    header = Header.model_validate({"robot": "irb1600", "tool": tool, "noise": noise})
    return NoiseModel.from_header(header, robot, header.made("tool", robot.n))


def test_the_stated_noise_is_that_of_each_joint_in_radians_or_mm(irb1600, scara):
    noise = noise_of(irb1600, joint_deg=0.01, spot_mm=0.05)
    np.testing.assert_allclose(noise.joint, np.full(6, 0.01 * RAD), rtol=1e-15)
    np.testing.assert_allclose(noise.variances, [*[(0.01 * RAD) ** 2] * 6, 0.0025], rtol=1e-14)
    noise = noise_of(scara, joint_deg=0.01, joint_mm=0.02, spot_mm=0)
    np.testing.assert_allclose(noise.joint, [0.01 * RAD, 0.01 * RAD, 0.02, 0.01 * RAD], rtol=1e-15)
    noise = noise_of(scara, joint_deg=[0.01, 0.03, 0.02, 0.04], spot_mm=0)
    np.testing.assert_allclose(noise.joint, [0.01 * RAD, 0.03 * RAD, 0.02, 0.04 * RAD], rtol=1e-15)


@pytest.mark.parametrize("scale", ["known", "estimated", "separate"])
def test_the_stated_figures_stay_whatever_the_scale(irb1600, scale):
    noise = noise_of(irb1600, joint_deg=0.01, spot_mm=0.05, scale=scale)
    assert (noise.estimated, noise.separate) == (scale == "estimated", scale == "separate")
    assert noise.variances[-1] == 0.05**2
