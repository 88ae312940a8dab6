"""What is promised of the TCP, kept by arms of another simulator, in each region that a header can state."""

import dataclasses
import functools
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from cells import LASER, header, irb1600
from deviating_arms import POINT, Arms, N
from scipy import stats

from zerobeam.analysis.diagnostics.values_to_enter import TcpError, entered
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability.predictions import TcpForecast
from zerobeam.analysis.solution import Solution
from zerobeam.analysis.status import Status
from zerobeam.analysis.tcp_region import arm_covariance, region_postures, tool_point
from zerobeam.experiments.plans.candidates import candidates
from zerobeam.experiments.plans.optimal import Planner
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import Header
from zerobeam.model.files.stated_workspace import StatedWorkspace
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.likelihood.problem import Problem

TARGET = np.array([900.0, 0.0, 0.0])
OWN = header(target=(900.0, 0.0, 0.0), geometry=None)
UNCALIBRATED = header({**LASER, "calibrated": False}, target=(900.0, 0.0, 0.0), geometry=None)
# Work of a person: the flange down at 6 x 4 places and two heights, degrees.
PROGRAM = np.array(
    [
        [35 * (x - 2.5) / 2.5, 5 + 12 * y, 20 - 9 * y + 6 * z, 10 * (x - 2.5), 60 + 5 * y - 6 * z, 15 * x]
        for x in range(6)
        for y in range(4)
        for z in range(2)
    ]
)


@functools.cache
def planned(shots: int) -> Matrix:
    pools = [candidates(OWN, irb1600(), TARGET, 1000, seed=0)]
    return Planner(OWN, irb1600(), {"psd": TARGET}, pools).optimal(shots, starts=2).postures


def regions(folder: Path) -> dict[str, StatedWorkspace]:
    path = folder / "cell.csv"
    np.savetxt(path, PROGRAM, delimiter=",", header="A,B,C,D,E,F", comments="")
    of_file = StatedWorkspace(positions=path.name, units="deg")
    return {
        "central": StatedWorkspace(),
        "full": StatedWorkspace(joints="full"),
        "box": StatedWorkspace(box_mm=((600.0, -300.0, 200.0), (1000.0, 300.0, 800.0)), joints="full"),
        "positions": of_file.with_postures(irb1600(), folder, file=None, line=None),
    }


def controller(values: dict[str, float]) -> Arms:
    """The nominal arm with these offsets entered, degrees."""
    offsets = np.radians([[values.get(f"delta{k + 1}", 0.0) for k in range(N)]])
    none = np.zeros
    return Arms(
        sizes=Arms.at_random(1, np.random.default_rng(0)).sizes,
        offsets=offsets,
        links=none((1, N, 5)),
        gravity=none((1, N)),
        harmonics=none((1, N, 2)),
        tilt=none((1, 2)),
        shift=none((1, 2)),
    )


def one_of(arms: Arms, k: int) -> Arms:
    parts = ("offsets", "links", "gravity", "harmonics", "tilt", "shift")
    return dataclasses.replace(arms, **{name: getattr(arms, name)[k : k + 1] for name in parts})


def best_values(arm: Arms, joints: Matrix) -> dict[str, float]:
    """Degrees: the offsets with which the nominal arm comes nearest to this one, by Gauss and Newton."""
    names = [f"delta{k}" for k in range(2, 7)]
    points = [np.zeros(3), POINT, *(POINT + 100.0 * np.array(at) for at in _BESIDE)]

    def places(own: Arms) -> Matrix:
        return np.concatenate([own.tcp(joints[None], point)[0] for point in points]).reshape(-1)

    truth, values = places(arm), np.degrees(arm.offsets[0, 1:])
    for _ in range(3):
        at = places(controller(dict(zip(names, values, strict=True))))
        slopes = [
            (places(controller(dict(zip(names, values + 0.01 * np.eye(5)[k], strict=True)))) - at) / 0.01
            for k in range(5)
        ]
        values = values + np.linalg.lstsq(np.array(slopes).T, truth - at)[0]
    return dict(zip(names, values, strict=True))


_BESIDE = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))


def within(error: TcpError | None, arm: Arms, values: dict[str, float], joints: Matrix) -> bool:
    """Whether the true median is in its band."""
    assert error is not None
    apart = arm.tcp(joints[None], POINT)[0] - controller(values).tcp(joints[None], POINT)[0]
    low, high = error.median_band_mm
    return bool(low <= np.median(np.linalg.norm(apart, axis=1)) <= high)


def in_region(solution: Solution, workspace: StatedWorkspace) -> Solution:
    problem = dataclasses.replace(solution.problem, workspace=workspace)
    return dataclasses.replace(solution, fit=dataclasses.replace(solution.fit, problem=problem))


def held(
    shots: int, count: int, folder: Path, seed: int, *, own: Header = OWN, floor: bool = False
) -> Counter[tuple[str, str]]:
    """How often the band held the truth: by region, and before, after, or at best. `of` counts the runs."""
    rng, counts = np.random.default_rng(seed), Counter[tuple[str, str]]()
    arms = Arms.at_random(count, rng)
    arms.links[:, 0, 2] = 0.0  # the height of the base along axis 1 is a choice of frame, as delta1 is
    joints, hit = arms.recorded(planned(shots), TARGET, rng)
    stated = regions(folder)
    with one_blas_thread():
        for k in range(count):
            rows, arm = joints[k][hit[k]], one_of(arms, k)
            solution = solve_run(Problem.build(own, irb1600(), rows, ["psd"] * len(rows)), own)
            if solution.verdict in ("misfit", "degenerate"):
                continue
            counts["all", "of"] += 1
            for name, workspace in stated.items():
                answer, _, _ = entered(here := in_region(solution, workspace))
                assert answer is not None
                at = region_postures(here.problem, 256)
                counts[name, "before"] += within(answer.tcp_before, arm, {}, at)
                counts[name, "after"] += within(answer.tcp_after, arm, answer.values, at)
                if floor and name in ("central", "full"):
                    best = best_values(arm, region_postures(here.problem, 128))
                    counts[name, "best"] += within(answer.tcp_best, arm, best, at)
    return counts


@pytest.mark.long
def test_the_band_of_the_median_holds_in_each_region(tmp_path: Path) -> None:
    counts = held(12, 6, tmp_path, seed=3)
    of = counts.pop(("all", "of"))
    assert of >= 5
    assert len(counts) == 8
    # With 95 % fewer than 4 of 6 have a probability of 2e-3 for one.
    assert min(counts.values()) >= of - 2


@pytest.mark.long
@pytest.mark.parametrize("shots", [7, 12, 20])
def test_the_bands_of_four_hundred_arms_hold_in_each_region(shots: int, tmp_path: Path) -> None:
    counts = held(shots, 400, tmp_path, seed=11, floor=True)
    of = counts.pop(("all", "of"))
    assert of >= 390
    # Of runs that hold in 90 to 99 %: fewer or more with a probability of 1 %. Measured: 90.2 to 96.7 %.
    least, most = stats.binom.ppf(0.01, of, 0.9), stats.binom.isf(0.01, of, 0.99)
    assert all(least <= count <= most for count in counts.values()), counts


def test_the_last_link_that_a_free_tool_takes_up_moves_the_tcp_by_its_tolerances() -> None:
    """By the other simulator: however well all else is known."""
    joints = PROGRAM[::12] * np.pi / 180
    problem = Problem.build(UNCALIBRATED, irb1600(), joints, ["psd"] * len(joints))
    arms = Arms.at_random(4000, np.random.default_rng(8))
    none = {part: np.zeros_like(getattr(arms, part)) for part in ("offsets", "gravity", "harmonics")}
    links = np.where(np.arange(N)[:, None] == N - 1, arms.links, 0.0)
    places = dataclasses.replace(arms, **none, links=links).tcp(
        np.broadcast_to(joints, (4000, *joints.shape)), POINT
    )
    known = np.zeros((problem.parameters.free.sum(),) * 2)
    jacobian = tool_point(problem, problem.parameters.prior_mean, POINT, joints)[1]
    variance = np.einsum("pka,ab,pkb->pk", jacobian, arm_covariance(problem, known), jacobian)
    np.testing.assert_allclose(places.std(axis=0), np.sqrt(variance), rtol=0.06)  # of 4,000: 1.1 %
    status: list[Status] = ["identified"] * len(problem.parameters)
    forecast = TcpForecast(problem, problem.parameters.prior_mean, status)
    at = region_postures(problem, 128)
    moved = dataclasses.replace(arms, **none, links=links).tcp(np.broadcast_to(at, (4000, *at.shape)), POINT)
    assert forecast.unmeasured_square == pytest.approx(moved.var(axis=0).sum(axis=1).mean(), rel=0.05)
    calibrated = Problem.build(OWN, irb1600(), joints, ["psd"] * len(joints))
    known = np.zeros((calibrated.parameters.free.sum(),) * 2)
    assert not arm_covariance(calibrated, known).any()


@pytest.mark.long
def test_with_an_uncalibrated_laser_the_bands_hold_too(tmp_path: Path) -> None:
    """Without the last link the box's would hold the truth in three of four runs."""
    counts = held(30, 100, tmp_path, seed=7, own=UNCALIBRATED)
    of = counts.pop(("all", "of"))
    assert of >= 95
    least = stats.binom.ppf(0.01, of, 0.9)
    assert all(count >= least for count in counts.values()), counts
