import numpy as np
import pytest
from cells import OPEN_LASER, OPEN_PROBE, good_plan, header, irb1600, plan_of, random_robot

from zerobeam.analysis.coordinates import SeenCoordinates
from zerobeam.model.problem import Problem

TARGETS = {"a": {"guess_mm": [900, 0, 0]}, "b": {"guess_mm": [800, 100, 200], "sigma_mm": 500.0}}


def problems():
    good = good_plan(8)
    two = header(OPEN_LASER, targets=TARGETS)
    robot = random_robot("rprrr", 4)
    slide = header(OPEN_PROBE, noise={"joint_mm": 0.02})
    joints = np.random.default_rng(3).uniform(-1, 1, (6, 5)) * np.where(robot.display > 1, 1.0, 100.0)
    return {
        "laser": Problem.from_plan(good),
        "two targets, open laser": Problem.from_plan(plan_of(two, good.postures, ["a", "b"] * 4)),
        "a held": Problem.from_plan(
            plan_of(header(targets=TARGETS, held=["delta1", "a.y"]), good.postures, ["a", "b"] * 4)
        ),
        "prismatic, open probe": Problem.build(slide, robot, joints, ["psd"] * 6),
        "all targets held": Problem.from_plan(
            plan_of(header(held=["delta1", "psd.x", "psd.y", "psd.z"]), good.postures)
        ),
    }


CASES = list(problems())


def somewhere(problem, seed=1):
    rng = np.random.default_rng(seed)
    parameters = problem.parameters
    size = np.where(parameters.group("target"), 30.0, 0.3 * parameters.prior_std)
    return parameters.prior_mean + np.where(parameters.free, rng.normal(size=len(parameters)) * size, 0)


@pytest.mark.parametrize("case", CASES)
def test_there_and_back(case):
    problem = problems()[case]
    coordinates = SeenCoordinates(problem)
    x = np.array([somewhere(problem, seed) for seed in range(3)])
    v = np.array([coordinates.from_parameters(row) for row in x])
    assert v.shape == (3, problem.parameters.free.sum())
    np.testing.assert_allclose(coordinates.to_parameters(v), x, atol=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_the_jacobian_against_central_differences(case):
    problem = problems()[case]
    coordinates = SeenCoordinates(problem)
    parameters = problem.parameters
    x = somewhere(problem)
    v = coordinates.from_parameters(x)
    step = 1e-6
    numeric = np.empty((len(v), len(v)))
    for j in range(len(v)):
        up, down = v.copy(), v.copy()
        up[j] += step
        down[j] -= step
        change = (coordinates.to_parameters(up[None]) - coordinates.to_parameters(down[None]))[0]
        numeric[:, j] = (change / parameters.prior_std)[parameters.free] / (2 * step)
    exact = coordinates.jacobian(x)
    np.testing.assert_allclose(exact, numeric, atol=1e-7)
    moving = "held" not in case
    assert (np.abs(exact - np.eye(len(v))).max() > 1e-3) == (moving or case == "a held")


@pytest.mark.parametrize("case", CASES)
def test_no_volume_factor(case):
    """The change is a rigid motion for given offsets: the density needs no determinant."""
    problem = problems()[case]
    sign, logdet = np.linalg.slogdet(SeenCoordinates(problem).jacobian(somewhere(problem)))
    assert sign == 1
    assert logdet == pytest.approx(0, abs=1e-10)


def test_seen_from_its_first_shot_the_target_stays():
    """A turn of joint 6 and the target together leaves the coordinates of the target as they are."""
    problem = problems()["laser"]
    coordinates = SeenCoordinates(problem)
    x = somewhere(problem)
    v = coordinates.from_parameters(x)
    moved = v.copy()
    moved[4] += 1.0  # delta6 by 5 degrees
    there = coordinates.to_parameters(moved[None])[0]
    assert there[5] - x[5] == pytest.approx(np.radians(5))
    assert np.linalg.norm(there[6:9] - x[6:9]) > 1.0
    first = problem.moved(problem.joints[:1])
    np.testing.assert_allclose(
        first.functions.seen(first.joints[0], there[:6], there[6:9]),
        first.functions.seen(first.joints[0], x[:6], x[6:9]),
        atol=1e-9,
    )
    assert irb1600().n == 6


def test_held_parameters_stay_at_their_prior_mean():
    problem = problems()["a held"]
    coordinates = SeenCoordinates(problem)
    x = coordinates.to_parameters(np.random.default_rng(1).normal(size=(20, problem.parameters.free.sum())))
    held = ~problem.parameters.free
    assert held.sum() == 2
    np.testing.assert_array_equal(x[:, held], np.tile(problem.parameters.prior_mean[held], (20, 1)))
