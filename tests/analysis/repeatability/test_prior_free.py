"""The offsets of a result without any prior, with their covariance, and what errors of them do to the TCP."""

from dataclasses import replace

import numpy as np
import pytest
from cells import good_plan, simulated
from example_results import x_pattern

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.diagnostics.accuracy import tool_point
from zerobeam.analysis.repeatability.compare import compare
from zerobeam.analysis.status import has_numbers
from zerobeam.analysis.tcp_region import region_postures
from zerobeam.model.errors import UnsoundResult
from zerobeam.model.files.run import Run


@pytest.fixture(scope="module")
def run() -> Run:
    return simulated(good_plan(), seed=4)[1]


def test_they_are_what_compare_takes(run: Run) -> None:
    found = analyse(run, sampling="never")
    alone = found.result.without_prior
    first = compare([run, replace(run, sha256="1" * 64)]).runs[0]
    assert alone.names == tuple(own.name for own in first.offsets)
    np.testing.assert_allclose(alone.values, [own.estimate for own in first.offsets], rtol=1e-9)
    std = np.sqrt(np.diag(alone.covariance))
    np.testing.assert_allclose(std, [own.std for own in first.offsets], rtol=1e-9)
    assert alone.dof is None
    # A wide prior adds next to nothing: the joint covariance is that of the solution.
    own = found.covariance.select(alone.names)
    np.testing.assert_allclose(alone.covariance, own.matrix, rtol=0.02, atol=1e-6)


def test_nothing_that_is_not_determined_is_in_it() -> None:
    result = x_pattern()
    names = {row.name for row in result.parameters if row.group == "offset" and has_numbers(row.status)}
    assert set(result.without_prior.names) == names
    with pytest.raises(UnsoundResult, match="'delta2' is unidentifiable"):
        replace(
            result.without_prior,
            names=("delta2", *result.without_prior.names[1:]),
            status=("unidentifiable", *result.without_prior.status[1:]),
        )


def test_the_sensitivity_is_what_errors_of_the_offsets_do_to_the_tcp(run: Run) -> None:
    found = analyse(run, sampling="never")
    own, problem = found.result.accuracy, found.problem
    error_deg = np.array([0.0, 0.01, -0.02, 0.03, 0.01, -0.02])
    joints = region_postures(problem, 4096)
    moved = found.fit.x.copy()
    moved[problem.parameters.block("offset")] += np.radians(error_deg)
    at, _ = tool_point(problem, found.fit.x, np.array(own.point_mm), joints)
    there, _ = tool_point(problem, moved, np.array(own.point_mm), joints)
    rms = np.sqrt(np.mean(np.sum((there - at) ** 2, axis=1)))
    assert np.sqrt(error_deg @ np.array(own.sensitivity_mm2) @ error_deg) == pytest.approx(rms, rel=1e-3)
