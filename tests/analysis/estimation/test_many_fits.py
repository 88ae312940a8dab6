"""Fits side by side are those of each run alone, to the bit."""

from dataclasses import fields, replace

import numpy as np
import pytest
from exact_runs import demo_runs
from measured_arms import CELLS, recorded

from zerobeam.analysis.estimation import fit as fitting
from zerobeam.analysis.estimation.fit import LikelihoodFit, fit_likelihood, fits_of
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.kernel import compiled_at_once
from zerobeam.model.likelihood.problem import Problem


def problems():
    """Of two shapes and of two kinds of noise, with readings of their own."""
    rng = np.random.default_rng(8)
    runs = [read_run(run.path) for run in demo_runs()[:2]]
    exact = [replace(run, header=run.header.model_copy(update={"geometry": "exact"})) for run in runs]
    good, x_pattern = map(Problem.from_run, exact)
    estimated = replace(good, noise=replace(good.noise, estimated=True))

    def again(problem):
        return problem.moved(problem.joints + rng.normal(size=problem.joints.shape) * 2e-4)

    return [again(item) for item in (good, x_pattern, good, estimated, good, x_pattern, estimated)]


def same(one: LikelihoodFit, other: LikelihoodFit) -> bool:
    names = [item.name for item in fields(LikelihoodFit) if item.name not in ("problem", "others")]
    return (
        all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
        and len(one.others) == len(other.others)
        and all(
            np.array_equal(a.z, b.z) and np.array_equal(a.std, b.std) and a.below == b.below
            for a, b in zip(one.others, other.others, strict=True)
        )
    )


def test_fits_side_by_side_are_those_of_each_alone():
    with compiled_at_once():
        values = problems()
        together = fits_of(values, seed=3)
        assert [fit.problem is problem for fit, problem in zip(together, values, strict=True)] == [True] * 7
        for fit, problem in zip(together, values, strict=True):
            assert same(fit, fit_likelihood(problem, seed=3))
        assert together[1].other_basins or together[5].other_basins or not together[0].other_basins
        # Whatever is beside it: another order gives the same.
        assert all(same(*pair) for pair in zip(fits_of(values[::-1], seed=3)[::-1], together, strict=True))


def test_those_of_one_shape_go_together(monkeypatch: pytest.MonkeyPatch):
    sizes: list[int] = []
    alike = fitting.fit_alike

    def counted(group, **how):
        sizes.append(len(group))
        return alike(group, **how)

    monkeypatch.setattr(fitting, "fit_alike", counted)
    with compiled_at_once():
        fits_of(problems())
    assert sorted(sizes) == [2, 2, 3]


@pytest.mark.long
def test_fits_side_by_side_have_each_its_own_readings():
    """What an instrument reads differs between runs as their joints do."""
    cell, runs = replace(CELLS["tracker"], turns=((("leica", "R1", None),),)), []
    header = cell.header(geometry="exact", joint_deg=0.005)
    robot = read_run(demo_runs()[0].path).robot
    for seed in (1, 2):
        arm = recorded(cell, 16, np.random.default_rng(seed), exact=True, joint_deg=0.005)
        runs.append(Problem.of_measured(header, robot, arm.joints, arm.measured))
    with compiled_at_once():
        together = fits_of(runs, seed=3)
        for fit, problem in zip(together, runs, strict=True):
            assert fit.converged
            assert same(fit, fit_likelihood(problem, seed=3))
        # Control: with the readings of the other run the fit is another.
        assert not same(together[1], fit_likelihood(replace(runs[1], readings=runs[0].readings), seed=3))
