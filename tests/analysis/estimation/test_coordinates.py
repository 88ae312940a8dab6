import numpy as np
import pytest
from fit_problems import KINDS, fit_problems

from zerobeam.analysis.estimation.coordinates import FlangeCoordinates
from zerobeam.model.likelihood.density import Density

CASES = [case for case in KINDS if case not in ("b not measured yet", "links")]


def somewhere(problem, seed=1):
    rng = np.random.default_rng(seed)
    parameters = problem.parameters
    size = np.where(parameters.group("target"), 30.0, 0.3 * parameters.prior_std)
    return parameters.prior_mean + np.where(parameters.free, rng.normal(size=len(parameters)) * size, 0)


def many(problem, count=5):
    return np.array([somewhere(problem, seed) for seed in range(count)])


def recordings(problem, count):
    """A density of data sets whose first shots are not the same."""
    rng = np.random.default_rng(9)
    joints = problem.joints + rng.normal(size=(count, *problem.joints.shape)) * 0.1 / problem.robot.display
    return Density(problem, joints, np.tile(problem.spots, (count, 1, 1)))


@pytest.mark.parametrize("case", CASES)
def test_there_and_back(case):
    problem = fit_problems()[case]
    coordinates = FlangeCoordinates(Density(problem))
    x = many(problem)
    v = coordinates.from_parameters(x)
    assert v.shape == (5, problem.parameters.free.sum())
    np.testing.assert_allclose(coordinates.to_parameters(v), x, atol=1e-9)
    np.testing.assert_array_equal(coordinates.at(v).x, coordinates.to_parameters(v))


@pytest.mark.parametrize("case", CASES)
def test_each_row_is_seen_from_its_own_data_set(case):
    """Row by row what a problem with those recordings gives alone."""
    problem = fit_problems()[case]
    density, of = recordings(problem, 3), np.array([2, 0, 1, 2, 0])
    coordinates, x = FlangeCoordinates(density), many(problem)
    v, by_v = coordinates.from_parameters(x, of), coordinates.jacobian(x, of)
    back = coordinates.to_parameters(v, of)
    np.testing.assert_allclose(back, x, atol=1e-9)
    for row, which in enumerate(of):
        alone = FlangeCoordinates(Density(problem.moved(density.joints[which])))
        values = x[row : row + 1]
        np.testing.assert_array_equal(v[row], alone.from_parameters(values)[0])
        np.testing.assert_array_equal(by_v[row], alone.jacobian(values, "deg")[0])
        np.testing.assert_array_equal(back[row], alone.to_parameters(v[row : row + 1])[0])
    if case != "all targets held":  # control: seen from another data set's shot it stands elsewhere
        other = coordinates.from_parameters(x, (of + 1) % 3)
        assert (np.abs(other - v).max(axis=1) > 1e-5).any()
    values = FlangeCoordinates(recordings(problem, 5))
    np.testing.assert_array_equal(values.from_parameters(x), values.from_parameters(x, np.arange(5)))


@pytest.mark.parametrize("case", CASES)
def test_the_jacobian_against_central_differences(case):
    problem = fit_problems()[case]
    coordinates = FlangeCoordinates(Density(problem))
    parameters = problem.parameters
    x = many(problem)
    v = coordinates.from_parameters(x)
    step = 1e-6
    numeric = np.empty((*v.shape, v.shape[1]))
    for j in range(v.shape[1]):
        up, down = v.copy(), v.copy()
        up[:, j] += step
        down[:, j] -= step
        change = coordinates.to_parameters(up) - coordinates.to_parameters(down)
        numeric[:, :, j] = (change / parameters.prior_std)[:, parameters.free] / (2 * step)
    exact = coordinates.jacobian(x)
    np.testing.assert_allclose(exact, numeric, atol=1e-7)
    moving = "held" not in case
    assert (np.abs(exact - np.eye(v.shape[1])).max() > 1e-3) == (moving or case == "a held")


@pytest.mark.parametrize("case", CASES)
def test_gradients_and_informations_are_carried_over_by_the_jacobian(case):
    problem = fit_problems()[case]
    coordinates = FlangeCoordinates(Density(problem))
    x = many(problem)
    by_v, position = coordinates.jacobian(x), coordinates.at(coordinates.from_parameters(x))
    rng, f = np.random.default_rng(2), by_v.shape[1]
    gradient, root = rng.normal(size=(5, f)), rng.normal(size=(5, f, f))
    inputs = gradient.copy()
    expected = np.einsum("wi,wij->wj", gradient, by_v)
    np.testing.assert_allclose(
        position.gradient(gradient), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )
    np.testing.assert_array_equal(gradient, inputs)  # not written into
    information = root @ root.transpose(0, 2, 1)
    expected = by_v.transpose(0, 2, 1) @ information @ by_v
    np.testing.assert_allclose(
        position.information(information), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )
    np.testing.assert_array_equal(position.jacobian, by_v)


def test_the_gradient_by_v_against_differences_of_the_log_posterior():
    """The two together, as the fit uses them; steps of 1e-5 prior stds."""
    problem = fit_problems()["two targets, open laser"]
    density = Density(problem)
    coordinates, x = FlangeCoordinates(density), many(problem, 2)
    v = coordinates.from_parameters(x)
    gradient = coordinates.at(v).gradient(density.slopes(x).gradient)

    def value(v):
        return density.log_posterior(coordinates.to_parameters(v))

    for j, step in enumerate(1e-5 * np.eye(v.shape[1])):
        near, far = value(v + step) - value(v - step), value(v + 2 * step) - value(v - 2 * step)
        slope = (8 * near - far) / 12e-5
        # Targets are scaled by 10 m (or 0.5 m): that far a step is 0.1 mm, two noises.
        np.testing.assert_allclose(gradient[:, j], slope, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())


@pytest.mark.parametrize("case", CASES)
def test_no_volume_factor(case):
    """The change is a rigid motion for given offsets: the density needs no determinant."""
    problem = fit_problems()[case]
    sign, logdet = np.linalg.slogdet(FlangeCoordinates(Density(problem)).jacobian(many(problem), "deg"))
    np.testing.assert_array_equal(sign, 1)
    np.testing.assert_allclose(logdet, 0, atol=1e-10)


def test_seen_from_its_first_shot_the_target_stays():
    """A turn of joint 6 and the target together leaves the coordinates of the target as they are."""
    problem = fit_problems()["laser"]
    coordinates = FlangeCoordinates(Density(problem))
    x = somewhere(problem)[None]
    moved = coordinates.from_parameters(x)
    moved[0, 4] += 1.0  # delta6 by 5 degrees
    there, x = coordinates.to_parameters(moved)[0], x[0]
    assert there[5] - x[5] == pytest.approx(np.radians(5))
    assert np.linalg.norm(there[6:9] - x[6:9]) > 1.0
    observed = problem.functions.function("seen")
    np.testing.assert_allclose(
        observed(problem.joints[0], there[:6], there[6:9]),
        observed(problem.joints[0], x[:6], x[6:9]),
        atol=1e-9,
    )


def test_held_parameters_stay_at_their_prior_mean():
    problem = fit_problems()["a held"]
    coordinates = FlangeCoordinates(Density(problem))
    x = coordinates.to_parameters(np.random.default_rng(1).normal(size=(20, problem.parameters.free.sum())))
    held = ~problem.parameters.free
    assert held.sum() == 3
    np.testing.assert_array_equal(x[:, held], np.tile(problem.parameters.prior_mean[held], (20, 1)))
