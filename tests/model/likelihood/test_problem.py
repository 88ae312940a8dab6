import json

import numpy as np
import pytest
from made_problem import DISTANCE, OPEN_LASER, OPEN_PROBE, PROBE, SEEN, TOOLS, Made, header
from plain_model import DESIGNED, arm, by_complex_steps, by_differences

from zerobeam.model.files.plan import read_plan, write_plan
from zerobeam.model.files.robot_file import read_robot
from zerobeam.model.files.run import read_run, write_run
from zerobeam.model.files.shot import Shot
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.problem import Distance, Problem


def tool_of(problem):
    kind = problem.tool.name
    return TOOLS[kind if problem.tool.calibrated else f"open {kind}"]


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return {name: arm(name, tmp_path_factory.mktemp("arms")) for name in DESIGNED}


@pytest.fixture(params=TOOLS)
def made(request, arms):
    """Two targets, a distance between them."""
    return Made(arms["irb1600"], header(TOOLS[request.param], distances=DISTANCE))


def test_shapes_and_places(made):
    problem = made.problem
    n, k, d = 6, len(problem.tool.unknowns), problem.tool.residual_size
    assert problem.shots == 8
    assert problem.data_size == 8 * d + 1
    assert problem.targets == ("a", "b")
    np.testing.assert_array_equal(problem.target_index, [0, 1, 0, 0, 1, 0, 1, 1])
    assert problem.distances == (Distance(1, 0, 60.0, 0.5),)
    assert problem.shot_numbers == tuple(range(8))
    parts = problem.split(np.arange(12.0 + k))
    np.testing.assert_array_equal(parts.arm, np.arange(6))
    np.testing.assert_array_equal(parts.targets, [[6, 7, 8], [9, 10, 11]])
    np.testing.assert_array_equal(parts.tool, np.arange(12, 12 + k))
    many = problem.split(np.zeros((5, 4, 12 + k)))
    assert (many.arm.shape, many.targets.shape, many.tool.shape) == ((5, 4, 6), (5, 4, 2, 3), (5, 4, k))
    assert problem.columns.shape == (8, n + 3 + k)
    np.testing.assert_array_equal(problem.columns[1], [*range(6), 9, 10, 11, *range(12, 12 + k)])


def test_from_a_run_and_a_plan(tmp_path):
    postures = [[10, 20, -30, 40, 50, -60], [20, 10, -20, 30, 60, -50], [0, 5, -10, 15, 20, 25]]
    shots = [
        Shot(shot=3, target="b", joints_deg=tuple(postures[0]), spot_mm=(0.5, -0.25)),
        Shot(shot=5, target="a", joints_deg=tuple(postures[1])),
        Shot(shot=4, target="b", joints_deg=tuple(postures[2])),
    ]
    write_run(tmp_path / "r.jsonl", header(noise={"joint_deg": 0.01, "spot_mm": 0.05}), shots)
    problem = Problem.from_run(read_run(tmp_path / "r.jsonl"))
    np.testing.assert_allclose(problem.joints, np.radians(postures))
    np.testing.assert_array_equal(problem.spots, [[0.5, -0.25], [0, 0], [0, 0]])
    assert problem.shot_numbers == (3, 5, 4)
    assert problem.targets == ("b", "a")
    np.testing.assert_array_equal(problem.target_index, [0, 1, 0])
    assert problem.noise.joint[0] == pytest.approx(np.radians(0.01))

    probe = header(PROBE, noise={"joint_deg": 0.01, "spot_mm": 0.05})
    write_run(tmp_path / "p.jsonl", probe, [each.model_copy(update={"spot_mm": None}) for each in shots])
    assert Problem.from_run(read_run(tmp_path / "p.jsonl")).spots.shape == (3, 3)

    write_plan(tmp_path / "plan.yaml", probe, postures, ["b", "a", "b"])
    planned = Problem.from_plan(read_plan(tmp_path / "plan.yaml"))
    np.testing.assert_allclose(planned.joints, np.radians(postures))
    assert planned.shot_numbers == (0, 1, 2)
    assert planned.targets == ("b", "a")
    np.testing.assert_array_equal(planned.spots, np.zeros((3, 3)))


def test_a_distance_to_a_target_that_no_shot_has(arms, refused):
    distances = [{"between": ["a", "c"], "mm": 60, "sigma_mm": 0.5}]
    error = refused(Made, arms["irb1600"], header(distances=distances))
    assert error.found == "c"
    assert error.allowed == "a, b"


def test_moved_shots_are_those_of_a_problem_made_there(made):
    problem = made.problem
    before = problem.whiten(made.x)
    other = problem.joints + 0.01
    spots = problem.spots + 1.0
    moved = problem.moved(other, spots)
    fresh = Problem.build(header(tool_of(problem), distances=DISTANCE), problem.robot, other, SEEN, spots)
    for one, two in zip(moved.whiten(made.x), fresh.whiten(made.x), strict=True):
        np.testing.assert_array_equal(one, two)
    assert np.abs(moved.whiten(made.x).residual - before.residual).max() > 1  # nothing is kept from before
    for one, two in zip(problem.whiten(made.x), before, strict=True):
        np.testing.assert_array_equal(one, two)


def test_some_of_the_shots(made):
    """The unknowns stay all of them, also a target that none of the chosen shots has."""
    problem, rows = made.problem, np.array([6, 0, 1])
    some = problem.select(rows)
    assert some.shots == 3
    assert some.parameters.names == problem.parameters.names
    assert some.shot_numbers == (6, 0, 1)
    np.testing.assert_array_equal(some.target_index, [1, 0, 1])
    residual, jacobian = problem.linearise(made.x)
    for expected, got in zip((residual, jacobian), some.linearise(made.x), strict=True):
        np.testing.assert_array_equal(got, expected[rows])
    for expected, got in zip((residual, jacobian), problem.linearise(made.x, rows=rows), strict=True):
        np.testing.assert_array_equal(got, expected[rows])
    alone = problem.select(np.array([1, 4, 6, 7])).whiten(made.x)
    np.testing.assert_array_equal(alone.jacobian[:-1, 6:9], 0)
    assert np.abs(alone.jacobian[-1, 6:9]).max() > 0  # only the distance sees target a


def test_misses_and_jacobians_shot_by_shot(made):
    residual, jacobian = made.problem.linearise(made.x)
    for i in range(made.problem.shots):
        np.testing.assert_allclose(residual[i], made.miss(made.x, i).real, rtol=0, atol=1e-9)
        derivative = by_complex_steps(lambda x, i=i: made.miss(x, i), made.x)
        np.testing.assert_allclose(jacobian[i], derivative[:, made.problem.columns[i]], rtol=0, atol=1e-9)
        # The other target has no part in it.
        others = np.delete(derivative, made.problem.columns[i], axis=1)
        assert others.shape[1] == 3
        np.testing.assert_array_equal(others, 0)
    there, _ = made.problem.linearise(made.x, made.problem.joints + 0.02)
    np.testing.assert_array_equal(there, made.problem.moved(made.problem.joints + 0.02).linearise(made.x)[0])
    assert np.abs(there - residual).max() > 1


def test_the_factors_are_those_of_the_covariance_of_joint_and_spot_noise(made):
    _, jacobian = made.problem.linearise(made.x)
    for i, factor in enumerate(made.problem.factors(made.x, jacobian)):
        np.testing.assert_allclose(factor @ factor.T, made.covariance(made.x, i).real, rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(factor, np.tril(factor))


def test_whitened_misses_and_distances(made):
    problem, x = made.problem, made.x
    white = problem.whiten(x)
    assert white.residual.shape == (problem.data_size,)
    assert white.jacobian.shape == (problem.data_size, len(problem.parameters))
    d = problem.tool.residual_size
    for i, (m, covariance) in enumerate(made.gaussians(x)):
        expected = np.linalg.solve(np.linalg.cholesky(covariance), m)
        np.testing.assert_allclose(white.residual[d * i : d * i + d], expected, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(white.residual_mm[i], m, atol=1e-9)
    a, b = problem.split(x).targets
    assert white.residual[-1] == pytest.approx((np.linalg.norm(a - b) - 60) / 0.5, rel=1e-12)


def test_the_whitened_jacobian_against_differences_by_scaled_parameters(made):
    """With the weights kept, as the fit keeps them. Steps 1e-3 rad, 0.1 mm: the step error is 1e-12 / 30 of a
    fifth derivative of some 1e3 times the first (tilts), rounding 1e-12 mm / (0.05 mm * 1e-3)."""
    problem, x = made.problem, made.x
    white = problem.whiten(x)
    scale = problem.parameters.prior_std

    def residual(z):
        return problem.whiten(z, white.factor).residual

    expected = by_differences(residual, x, made.steps(1e-3, 0.1)) * scale
    size = np.abs(expected).max(axis=0)
    assert (size > 1e-3).all()
    np.testing.assert_allclose(white.jacobian / size, expected / size, rtol=0, atol=1e-9)
    # Negative control: the weights of another place make another Jacobian.
    elsewhere = problem.whiten(x + made.steps(0.2, 100.0))
    assert np.abs(problem.whiten(x, elsewhere.factor).jacobian - white.jacobian).max() > 1e-3 * size.max()


def test_a_noise_that_leaves_a_direction_free_is_refused(arms, refused):
    """Without spot noise, two joints scatter a probe's misses in two of the three directions only."""
    full = arms["irb1600"].robot
    short = Robot("two joints", full.joints[:2], np.eye(4))
    noise = {"joint_deg": 0.01, "spot_mm": 0}
    problem = Problem.build(header(PROBE, noise=noise), short, np.zeros((3, 2)), ["a"] * 3)
    x = problem.parameters.prior_mean
    error = refused(problem.whiten, x)
    assert "without any noise" in error.what
    assert "spot_mm" in error.remedy
    content = Problem.build(header(PROBE), short, np.zeros((3, 2)), ["a"] * 3)
    assert np.isfinite(content.whiten(x).residual).all()


def test_separate_noise_factors_are_in_the_weights_and_in_no_miss(arms):
    """The variances of many parameter vectors, and factors and residuals of one."""
    noise = {"joint_deg": 0.01, "spot_mm": 0.05, "scale": "separate"}
    made = Made(arms["irb1600"], header(OPEN_LASER, noise=noise, distances=DISTANCE))
    problem, walkers = made.problem, made.walkers(4)
    assert problem.parameters.names[-2:] == ("noise.joint", "noise.spot")
    np.testing.assert_allclose(problem.variances(walkers), [made.variances(x) for x in walkers], rtol=1e-12)
    np.testing.assert_allclose(problem.variances(made.x), made.variances(made.x), rtol=1e-12)
    assert problem.split(made.x).tool.shape == (4,)  # the tool's, and not the noise's
    residual, jacobian = problem.linearise(made.x)
    for i, factor in enumerate(problem.factors(made.x, jacobian)):
        np.testing.assert_allclose(factor @ factor.T, made.covariance(made.x, i).real, rtol=1e-9, atol=1e-12)
    louder = made.x.copy()
    louder[-2:] += np.log(3)
    np.testing.assert_array_equal(problem.linearise(louder)[0], residual)
    white, other = problem.whiten(made.x), problem.whiten(louder)
    np.testing.assert_allclose(3 * other.residual[:-1], white.residual[:-1], rtol=1e-9, atol=1e-9)
    assert other.residual[-1] == white.residual[-1]  # a distance has a std of its own
    np.testing.assert_array_equal(white.jacobian[:, -2:], 0)
    # As stated, where the noise is not free: whatever x.
    known = Made(arms["irb1600"], header(OPEN_LASER)).problem
    np.testing.assert_array_equal(known.variances(made.walkers(2)), known.noise.variances)


def test_the_same_problem_with_its_noise_as_known(arms):
    """At the noise factors of x: the weights stay, the factors are no parameters any more."""
    noise = {"joint_deg": 0.01, "spot_mm": 0.05, "scale": "separate"}
    made = Made(arms["irb1600"], header(OPEN_LASER, noise=noise, distances=DISTANCE))
    known, x = made.problem.with_noise_of(made.x)
    assert known.parameters.names == made.problem.parameters.names[:-2]
    assert (known.noise.separate, known.noise.estimated) == (False, False)
    np.testing.assert_array_equal(x, made.x[:-2])
    np.testing.assert_allclose(known.noise.variances, made.variances(made.x), rtol=1e-12)
    one, two = known.whiten(x), made.problem.whiten(made.x)
    np.testing.assert_allclose(one.residual, two.residual, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(one.jacobian, two.jacobian[:, :-2], rtol=1e-12, atol=1e-12)
    assert made.problem.noise.separate  # as it was


def test_each_shot_may_have_parameters_of_its_own(made):
    """Row i of x for shot i: what each alone gives."""
    problem, walkers = made.problem, made.walkers(8)
    residual, jacobian = problem.linearise(walkers)
    origin, direction = problem.beams(walkers)
    some = problem.linearise(walkers, rows=np.array([6, 2]))
    for i, x in enumerate(walkers):
        for part, alone in zip((residual, jacobian), problem.linearise(x), strict=True):
            np.testing.assert_array_equal(part[i], alone[i])
        for part, alone in zip((origin, direction), problem.beams(x), strict=True):
            np.testing.assert_array_equal(part[i], alone[i])
    for part, whole in zip(some, (residual, jacobian), strict=True):
        np.testing.assert_array_equal(part, whole[[6, 2]])
    assert np.abs(residual - problem.linearise(made.x)[0]).max() > 0.1


def test_two_targets_in_one_place_have_no_direction_but_no_nan_either(made):
    x = made.x.copy()
    x[9:12] = x[6:9]
    white = made.problem.whiten(x)
    assert np.isfinite(white.jacobian).all()
    assert white.residual[-1] == pytest.approx(-60 / 0.5)


def test_distances_of_many_parameter_vectors(made):
    """Each row by itself, and the Jacobian by complex steps of the plain model."""
    walkers = made.walkers(3)
    residual, jacobian = made.problem.tie_rows(walkers)
    assert residual.shape == (3, 1)
    for x, other, by_x in zip(walkers, residual, jacobian, strict=True):
        np.testing.assert_allclose(other, made.distances(x), rtol=1e-12)
        np.testing.assert_allclose(by_x, by_complex_steps(made.distances, x), rtol=0, atol=1e-12)
    none = Made(made.arm, header(tool_of(made.problem))).problem
    assert [part.shape for part in none.tie_rows(walkers)] == [(3, 0), (3, 0, len(made.x))]


MAST = """schema: zerobeam/robot/1
name: mast
convention: modified
joints:
  - {kind: prismatic, a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_mm: -9000, upper_mm: 9000}
  - {a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -180, upper_deg: 180}
  - {kind: prismatic, a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_mm: -9000, upper_mm: 9000}
"""
# lift z, turn about it, then slide along the turned -y (modified DH with alpha 90: z3 is -y2).


@pytest.fixture(scope="module")
def mast(tmp_path_factory):
    path = tmp_path_factory.mktemp("mast") / "mast.yaml"
    path.write_text(MAST)
    return read_robot(path)


def on_the_mast(mast, joints, seen, tool=None, **changes):
    """Joints in mm, degrees, mm. The beam goes along x of the flange, from its origin."""
    tool = tool or {"kind": "laser", "point_mm": [0, 0, 0], "direction": [1, 0, 0]}
    joints = np.array(joints, dtype=float) / mast.display
    problem = Problem.build(header(tool, **changes), mast, joints, seen)
    return problem, problem.nearest_targets(problem.parameters.prior_mean[None]).reshape(-1, 3)


def test_the_point_nearest_to_beams_that_meet(mast):
    """At height 100: along x through y = -30, and along y through x = 50; and another target on its own."""
    problem, nearest = on_the_mast(
        mast, [[100, 0, 30], [7, 0, 0], [100, 90, 50], [7, 90, 0]], ["a", "b", "a", "b"]
    )
    origin, direction = problem.beams(problem.parameters.prior_mean)
    np.testing.assert_allclose(direction, [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(origin[[0, 2]], [[0, -30, 100], [50, 0, 100]], atol=1e-12)
    np.testing.assert_allclose(nearest, [[50, -30, 100], [0, 0, 7]], atol=1e-6)


def test_the_point_nearest_to_skew_beams(mast):
    """Two beams 20 apart: halfway. And in general the least squares of the distances to the lines."""
    _, nearest = on_the_mast(mast, [[100, 0, 30], [120, 90, 50]], ["a", "a"])
    np.testing.assert_allclose(nearest, [[50, -30, 110]], atol=1e-6)
    rng = np.random.default_rng(7)
    joints = np.column_stack([rng.uniform(0, 500, 9), rng.uniform(-170, 170, 9), rng.uniform(-500, 500, 9)])
    problem, nearest = on_the_mast(mast, joints, ["a"] * 9)
    origin, direction = problem.beams(problem.parameters.prior_mean)
    across = np.eye(3) - np.einsum("ni,nj->nij", direction, direction)
    expected = np.linalg.lstsq(
        across.reshape(-1, 3), np.einsum("nij,nj->ni", across, origin).ravel(), rcond=None
    )[0]
    np.testing.assert_allclose(nearest[0], expected, atol=1e-5)


def test_nearest_targets_of_many_offsets_tools_and_recordings(made):
    """Row by row what each gives alone, and for its own joints what a problem recorded there gives."""
    problem = made.problem
    x = made.walkers(3)
    joints = problem.joints + np.random.default_rng(2).normal(scale=1e-3, size=(3, *problem.joints.shape))
    many, recorded = problem.nearest_targets(x), problem.nearest_targets(x, joints)
    assert many.shape == recorded.shape == (3, 6)
    for i in range(3):
        alone = x[i : i + 1]
        np.testing.assert_allclose(many[i], problem.nearest_targets(alone)[0], rtol=1e-12)
        there = problem.moved(joints[i])
        np.testing.assert_allclose(recorded[i], there.nearest_targets(alone)[0], rtol=1e-12)
        assert np.abs(recorded[i] - many[i]).max() > 0.1
    assert np.abs(np.diff(many, axis=0)).max(axis=1).min() > 0.1


@pytest.mark.parametrize("guess", [None, [300.0, 40.0, 90.0]])
def test_parallel_beams_leave_their_direction_at_the_prior(mast, guess):
    """One beam, or three parallel ones, along x: y and z between them, x where it is expected, all finite."""
    targets = {} if guess is None else {"a": {"guess_mm": guess}}
    _, nearest = on_the_mast(mast, [[100, 0, 30]], ["a"], targets=targets)
    x = 0 if guess is None else guess[0]
    np.testing.assert_allclose(nearest, [[x, -30, 100]], atol=1e-3)
    _, nearest = on_the_mast(mast, [[100, 0, 30], [130, 0, 60], [100, 0, 0]], ["a"] * 3, targets=targets)
    np.testing.assert_allclose(nearest, [[x, -30, 110]], atol=1e-3)
    # Parallel, but in opposite senses.
    _, nearest = on_the_mast(mast, [[100, 0, 30], [120, 180, 0]], ["a"] * 2, targets=targets)
    np.testing.assert_allclose(nearest, [[x, -15, 110]], atol=1e-3)


def test_of_a_probe_the_mean_of_the_tips(mast):
    tool = {"kind": "probe", "point_mm": [5, 0, 0]}
    _, nearest = on_the_mast(mast, [[100, 0, 30], [7, 0, 0], [140, 0, 10]], ["a", "b", "a"], tool)
    np.testing.assert_allclose(nearest, [[5, -20, 120], [5, 0, 7]], atol=1e-5)


def test_what_is_supposed_before_any_shot(mast):
    """A guess where one is stated, even far off; else the nearest point; no offsets, the nominal tool."""
    joints = [[100, 0, 30], [100, 0, 30], [100, 90, 50], [100, 90, 50], [7, 0, 0]]
    observed = ["a", "b", "a", "b", "c"]
    tool = {"kind": "laser", "point_mm": [0, 0, 0], "direction": [1, 0, 0], "calibrated": False}
    targets = {"b": {"guess_mm": [1, 2, 3]}, "c": {"sigma_mm": 5}}
    problem = Problem.build(header(tool, targets=targets), mast, np.array(joints) / mast.display, observed)
    np.testing.assert_array_equal(problem.guessed, [False, True, False])
    supposed = problem.nominal()
    expected = [0, 0, 0, 50, -30, 100, 1, 2, 3, 0, 0, 7, 0, 0, 0, 0]
    np.testing.assert_allclose(supposed, expected, atol=1e-5)
    np.testing.assert_array_equal(supposed[6:9], [1, 2, 3])  # to the last digit
    supposed[:] = 0  # a copy: the priors do not move
    np.testing.assert_array_equal(problem.parameters.prior_mean[6:9], [1, 2, 3])
    probe = Problem.build(header(OPEN_PROBE), mast, np.array(joints) / mast.display, observed)
    np.testing.assert_array_equal(probe.nominal()[-3:], [10, 20, 100])


def test_weights_multiply(made):
    """A measurement that counts three times, of which half is taken, counts one and a half times."""
    thrice = made.problem.weighted(np.array([3.0, 1, 0, 1, 1, 2, 1, 1]))
    both = thrice.weighted(np.array([0.5, 1, 1, 0, 1, 0.25, 1, 1]))
    np.testing.assert_array_equal(both.weights, [1.5, 1, 0, 0, 1, 0.5, 1, 1])


def test_a_noise_is_estimated_from_more_numbers_than_unknowns_alone(arms):
    stated = {"joint_deg": 0.01, "spot_mm": 0.05}
    made = Made(arms["irb1600"], header(noise={**stated, "scale": "estimated"}), seen=("a",) * 8)
    free = int(made.problem.parameters.free.sum())
    assert free == 8  # five offsets and a target: four measurements of two numbers each
    estimable = {count: made.problem.select(np.arange(count)).noise_estimable for count in (3, 4, 5, 8)}
    assert estimable == {3: False, 4: False, 5: True, 8: True}
    known = Made(arms["irb1600"], header(noise=stated), seen=("a",) * 8).problem
    assert known.select(np.arange(3)).noise_estimable


def test_a_measurement_with_a_sigma_of_its_own_has_that_variance(tmp_path):
    """Without noise of the joints the factor of its covariance is the sigma itself, else the instrument's."""
    tracker = {"kind": "tracker", "sigma_mm": 0.05, "reflectors": {"R1": {"guess_mm": [0, 0, 100]}}}
    head = {
        "schema": "zerobeam/run/1",
        "robot": "irb1600",
        "geometry": "exact",
        "instruments": {"left": tracker},
        "noise": {"joint_deg": 1e-9},
    }
    row = {"instrument": "left", "reflector": "R1", "measured_mm": [900, 100, 200]}
    rows = [
        {**row, "shot": i, "joints_deg": [10 * i, 20, -30, 40, 50, -60], **own}
        for i, own in enumerate([{}, {"sigma_mm": 0.2}, {"sigma_mm": 0.025}])
    ]
    (tmp_path / "r.jsonl").write_text("".join(json.dumps(line) + "\n" for line in (head, *rows)))
    problem = Problem.from_run(read_run(tmp_path / "r.jsonl"))
    factor = problem.whiten(problem.nominal()).factor
    expected = np.array([0.05, 0.2, 0.025])[:, None, None] * np.eye(3)
    np.testing.assert_allclose(factor, expected, rtol=1e-6, atol=1e-9)
