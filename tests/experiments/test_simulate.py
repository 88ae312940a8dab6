import numpy as np
import pytest
from cells import (
    OPEN_LASER,
    PROBE,
    TABLE_2,
    good_plan,
    header,
    pattern_plan,
    plan_of,
    simulated,
    simulated_problem,
)
from scipy import stats

from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.errors import RigFault
from zerobeam.model.likelihood.problem import Problem


def test_without_noise_every_shot_hits():
    plan = good_plan(joint_deg=1e-12, spot_mm=0.0)
    truth, problem = simulated_problem(plan, TABLE_2)
    miss, _ = problem.linearise(truth.x)
    # Joints are recorded to 1e-9 degrees: 2e-11 rad over some 2 m.
    assert np.linalg.norm(miss, axis=1).max() < 1e-6
    assert (problem.spots == 0).all()
    nominal, _ = problem.linearise(problem.nominal())
    assert np.linalg.norm(nominal, axis=1).min() > 1.0


@pytest.mark.parametrize("tool", ["laser", "probe"])
def test_the_misses_are_as_noisy_as_stated(tool):
    """At the truth the whitened misses are unit normals: chi-squared of 40 runs, and their distribution."""
    plan = good_plan(10) if tool == "laser" else good_plan(10, 5, PROBE)
    values = TABLE_2 if tool == "laser" else {"delta2": 0.5, "delta4": -0.8}
    whitened = []
    for seed in range(40):
        truth, problem = simulated_problem(plan, values, seed)
        whitened.append(problem.whiten(truth.x).residual)
    whitened = np.array(whitened)
    low, high = stats.chi2.ppf([0.0005, 0.9995], whitened.size)
    assert low < (whitened**2).sum() < high
    assert abs(whitened.mean()) < 3.5 / np.sqrt(whitened.size)
    assert stats.kstest(whitened.reshape(-1), "norm").pvalue > 1e-3


def test_only_the_wrist_is_turned():
    plan = good_plan(joint_deg=1e-12, spot_mm=0.0)
    _, problem = simulated_problem(plan, TABLE_2)
    np.testing.assert_allclose(problem.joints[:, :3], plan.postures[:, :3], atol=1e-10)
    assert np.abs(problem.joints[:, 3:] - plan.postures[:, 3:]).max() > np.radians(0.3)


def test_the_same_seed_gives_the_same_shots():
    plan = pattern_plan("y")
    first, second, other = (simulated(plan, TABLE_2, seed)[1].shots for seed in (3, 3, 4))
    assert first == second
    assert first != other


def test_what_a_shot_records():
    own = header(targets={"a": {"guess_mm": [900, 0, 0]}, "b": {"guess_mm": [900, 5, 0]}})
    plan = plan_of(own, good_plan().postures[:4], ["a", "b", "b", "a"])
    _, run = simulated(plan)
    assert [shot.shot for shot in run.shots] == [0, 1, 2, 3]
    assert [shot.target for shot in run.shots] == ["a", "b", "b", "a"]
    assert all(len(shot.joints_deg) == 6 and len(shot.spot_mm) == 2 for shot in run.shots)
    _, probe = simulated(good_plan(5, 5, PROBE))
    assert all(shot.spot_mm is None for shot in probe.shots)


def test_a_posture_that_cannot_see_the_target_is_a_fault():
    """The shots before it are recorded; the fault says which and how far off."""
    plan = good_plan(spot_mm=0.1)
    far = plan_of(header(target=(900.0, 0.0, 0.0), tool={**PROBE}), plan.postures)
    truth = Truth.with_values(far, {"psd.x": 30_000.0})
    with pytest.raises(RigFault, match=r"posture 0: .* mm off") as caught:
        list(simulated_shots(truth, np.random.default_rng(1)))
    assert caught.value.exit_status == 3


def test_a_truth_that_is_stated():
    truth = Truth.with_values(good_plan(), {"delta3": -0.5, "psd.y": 12.0})
    i = truth.problem.parameters.index
    assert truth.x[i("delta3")] == pytest.approx(np.radians(-0.5))
    assert truth.x[i("psd.y")] == 12.0
    assert truth.x[i("delta2")] == 0.0
    with pytest.raises(ValueError, match="not in tuple"):
        Truth.with_values(good_plan(), {"delta9": 1.0})


def test_a_truth_that_is_drawn():
    plan = good_plan(12, 5, OPEN_LASER)
    rng = np.random.default_rng(1)
    drawn = np.array([Truth.drawn(plan, rng, offset_deg=0.7).x for _ in range(200)])
    problem = Problem.from_plan(plan)
    names, free = problem.parameters.names, problem.parameters.free
    size = drawn.std(axis=0)
    # 200 draws: a std is right to 1 / sqrt(400) = 5 %; four of these.
    for i, name in enumerate(names):
        if not free[i] or name.startswith("psd"):
            assert size[i] == 0
        elif name.startswith("delta"):
            assert np.degrees(size[i]) == pytest.approx(0.7, rel=0.2)
        else:
            assert size[i] == pytest.approx(problem.parameters.prior_std[i], rel=0.2)


def test_the_truth_goes_into_the_provenance():
    truth = Truth.with_values(
        good_plan(12, 5, OPEN_LASER), {"delta3": -0.5, "tool.tilt1": 1.5, "tool.shift2": -4.0}
    )
    told = truth.provenance()
    assert told["true delta3 (deg)"] == -0.5
    assert told["true tool.tilt1 (deg)"] == 1.5
    assert told["true tool.shift2 (mm)"] == -4.0
    assert not any("psd" in key for key in told)
