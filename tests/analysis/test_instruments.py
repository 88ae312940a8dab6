"""Offsets by every kind of instrument, and by mixes of them, against a simulator that shares no code with the
model: errors in their uncertainties, coverage of the intervals, p-values of the fits."""

from dataclasses import dataclass

import numpy as np
import pytest
from cells import irb1600
from measured_arms import CELLS, Recorded, recorded
from scipy import stats

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.recordings.recordings import placements
from zerobeam.analysis.solution import Solution
from zerobeam.analysis.status import known
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.likelihood.problem import Problem

LEVEL = 1e-4  # of one test that is right
POSTURES, JOINT_DEG = 24, 0.002


@dataclass(frozen=True, eq=False)
class Outcome:
    """Of arms: errors of the offsets in their u and half widths of their 95 % intervals in u, (A, n), nan
    where they have none; p-values of the fits (A,), and which are a misfit (A,)."""

    z: np.ndarray
    k: np.ndarray
    p: np.ndarray
    misfit: np.ndarray


def outcome(
    kind: str,
    count: int,
    *,
    understated: float = 1.0,
    off_mm: float = 0.0,
    joint_deg: float = JOINT_DEG,
) -> Outcome:
    """A misfit has its z as well: the uncertainties of the fit, whatever becomes of them."""
    cell, rng = CELLS[kind], np.random.default_rng(3)
    header = cell.header(geometry="exact", joint_deg=joint_deg, understated=understated)
    z, k, p, misfit = [], [], [], []
    with one_blas_thread():
        for _ in range(count):
            arm = recorded(cell, POSTURES, rng, exact=True, joint_deg=joint_deg, off_mm=off_mm)
            solution = solve_run(Problem.of_measured(header, irb1600(), arm.joints, arm.measured), header)
            assert solution.converged
            z.append(_z(solution, arm.offsets))
            k.append(solution.quantiles[: len(arm.offsets)])
            p.append(solution.p_value)
            misfit.append(solution.misfit is not None)
    return Outcome(np.array(z), np.array(k), np.array(p, dtype=float), np.array(misfit))


def _z(solution: Solution, offsets: np.ndarray) -> np.ndarray:
    n = len(offsets)
    std = solution.problem.parameters.unscaled(solution.fit.std)[:n]
    determined = [known(status) for status in solution.identified.status[:n]]
    return np.where(determined, (solution.fit.x[:n] - offsets) / std, np.nan)


def require_honest(arms: Outcome) -> None:
    """Bounds are those of offsets that are correlated altogether: as many draws as arms."""
    count = len(arms.z)
    determined = np.isfinite(arms.z).any(axis=0)
    assert determined.sum() >= 4
    mean_square = float(np.nanmean(arms.z**2))
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], count) / count
    assert low < mean_square < high
    number = np.isfinite(arms.z).sum(axis=0)[determined]
    held = (np.abs(arms.z) < arms.k).sum(axis=0)[determined]
    fewest, most = stats.binom.ppf([[LEVEL / 12], [1 - LEVEL / 12]], number, 0.95)
    assert (fewest <= held).all()
    assert (held <= most).all()
    assert stats.kstest(arms.p, "uniform").pvalue > LEVEL


@pytest.mark.parametrize("kind", CELLS)
@pytest.mark.at_length(r"^(?!tracker$)")
def test_offsets_of_exact_arms_are_as_uncertain_as_stated(kind: str) -> None:
    require_honest(outcome(kind, 6))


@pytest.mark.parametrize("kind", ["tracker", "pose", "ballbar"])
@pytest.mark.long
def test_a_reading_whose_std_is_understated_fails_the_same_check(kind: str) -> None:
    understated = outcome(kind, 6, understated=3.0)
    with pytest.raises(AssertionError):
        require_honest(understated)


@pytest.mark.long
@pytest.mark.parametrize("kind", CELLS)
def test_sixty_arms_of_every_kind(kind: str) -> None:
    """And the control: a noise understated by a half fails the same check."""
    require_honest(outcome(kind, 60))
    with pytest.raises(AssertionError):
        require_honest(outcome(kind, 60, understated=1.5, joint_deg=JOINT_DEG / 4))


@pytest.mark.long
def test_a_reflector_off_its_tight_sigma_is_noticed() -> None:
    known_frame = "tracker, frame known"
    assert outcome(known_frame, 3, off_mm=2.0).misfit.all()
    assert not outcome(known_frame, 3).misfit.any()


@pytest.mark.long
def test_right_angles_of_a_cube_make_offsets_better_known_and_a_wrong_one_is_noticed() -> None:
    """The same touches with three angles, with one, with none: u falls with each. A cube that is 0.1° off,
    taken for a right one, is a misfit; as the planes that it is made of it is none."""
    cell, rng = CELLS["cube"], np.random.default_rng(6)
    count, smallest = 18, []
    for _ in range(3):
        arm = recorded(cell, count, rng, exact=True, joint_deg=JOINT_DEG)

        def solved(angles: list[dict[str, object]], arm: Recorded = arm) -> Solution:
            header = cell.header(geometry="exact", joint_deg=JOINT_DEG, angles=angles)
            return solve_run(Problem.of_measured(header, irb1600(), arm.joints, arm.measured), header)

        u = []
        for angles in (0, 1, 3):
            solution = solved(cell.angles[:angles])
            assert solution.misfit is None
            assert solution.problem.measured_size == count + angles
            u.append(solution.problem.parameters.unscaled(solution.fit.std)[1:6])
        assert (u[1] < 1.001 * u[0]).all()
        assert (u[2] < 1.001 * u[1]).all()
        smallest.append((u[2] / u[0]).min())
        assert solved([{**cell.angles[0], "deg": 90.1}, *cell.angles[1:]]).misfit is not None
    assert max(smallest) < 0.75


def test_a_cube_of_which_angles_are_stated_is_one_placement() -> None:
    cell = CELLS["cube"]
    arm = recorded(cell, 12, np.random.default_rng(6), exact=True, joint_deg=JOINT_DEG)
    for angles, expected in ((cell.angles, [3]), (cell.angles[:1], [2, 1]), ([], [1, 1, 1])):
        header = cell.header(geometry="exact", joint_deg=JOINT_DEG, angles=angles)
        problem = Problem.of_measured(header, irb1600(), arm.joints, arm.measured)
        assert [len(each.targets) for each in placements(problem)] == expected
