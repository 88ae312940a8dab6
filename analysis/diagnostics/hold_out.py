"""Targets that the fit has not seen: how well do its offsets and tool hit them?

The offsets and the tool come from the other targets; only the position of a held-out target is found from its
own shots. What is left there is judged against the noise and what the fit leaves open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from ...model.errors import BadInput
from ...model.problem import Problem, rms_length
from ...model.robot import Matrix
from ..estimation.fit import fit_likelihood

_ROUNDS = 20


@dataclass(frozen=True)
class HoldOut:
    """How the offsets and tool of the other targets' measurements do at targets that they have not seen.

    `rms_mm` of the residuals once each held-out target is placed, `rms_before_mm` the same without any
    offset, `expected_mm` what `rms_mm` would be by the noise and what the fit leaves open; chi-squared of
    these residuals against the noise and what the fit leaves open. None where there is none: without degrees
    of freedom, or where the fit without these targets did not converge, for which `failure` is the
    optimiser's reason.
    """

    targets: tuple[str, ...]
    shots: int
    shots_fitted: int
    rms_mm: float | None
    rms_before_mm: float | None
    expected_mm: float | None
    chi2: float | None
    dof: int | None
    p_value: float | None
    failure: str | None


def hold_out(problem: Problem, patterns: Sequence[str], seed: int = 0) -> HoldOut:
    """Fit without the targets whose names match one of `patterns` (* and ? as in file names), then look
    at their shots. Raises BadInput where nothing matches, or nothing would be left to fit."""
    names = [name for name in problem.targets if any(fnmatchcase(name, pattern) for pattern in patterns)]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in problem.targets):
            raise BadInput(
                "no target of that name can be held out",
                found=pattern,
                allowed=", ".join(problem.targets),
            )
    if len(names) == len(problem.targets):
        raise BadInput(
            "all targets are held out: there is nothing left to fit",
            found=", ".join(patterns),
            allowed=f"some of {', '.join(problem.targets)}",
            remedy="leave at least one target in",
        )
    out = np.isin(problem.target_index, [problem.targets.index(name) for name in names])
    seen, unseen = problem.select(np.flatnonzero(~out)), problem.select(np.flatnonzero(out))
    # A distance to a target without shots says nothing of the rest, and leaves the fit no mode.
    there = set(seen.target_index.tolist())
    seen = replace(seen, distances=tuple(d for d in seen.distances if {d.first, d.second} <= there))
    fit = fit_likelihood(seen, starts=0, seed=seed)
    if not fit.converged:
        return HoldOut(tuple(names), unseen.shots, seen.shots, *(None,) * 6, fit.reason)
    moved = problem.parameters.targets(names)
    before = _settled(unseen, problem.nominal(), moved)
    after = _settled(unseen, fit.x, moved)
    rows = unseen.shots * unseen.tool.miss_size
    whitened = unseen.whiten(after)
    residual, jacobian = whitened.residual[:rows], whitened.jacobian[:rows]
    # What is left of the residuals once their targets are placed, with what the fit leaves open of the rest.
    free = problem.parameters.free
    carried = ~problem.parameters.group("target")[free]
    by_rest = jacobian[:, free & ~problem.parameters.group("target")]
    covariance = fit.covariance[np.ix_(carried, carried)]
    factor = np.linalg.cholesky(np.eye(rows) / fit.weight + by_rest @ covariance @ by_rest.T)
    left, columns = np.linalg.solve(factor, residual), np.linalg.solve(factor, jacobian[:, moved & free])
    left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    by_place = jacobian[:, moved & free]
    placed = factor - by_place @ np.linalg.lstsq(by_place, factor, rcond=None)[0]
    expected = whitened.factor @ placed.reshape(unseen.shots, -1, rows)
    chi2, dof = float(left @ left), rows - int(np.linalg.matrix_rank(columns))
    return HoldOut(
        targets=tuple(names),
        shots=unseen.shots,
        shots_fitted=seen.shots,
        rms_mm=rms_length(whitened.residual_mm),
        rms_before_mm=rms_length(unseen.linearise(before)[0]),
        expected_mm=float(np.sqrt((expected**2).sum() / unseen.shots)),
        chi2=chi2 if dof > 0 else None,
        dof=dof,
        p_value=_chance(seen, chi2, dof) if dof > 0 else None,
        failure=None,
    )


def _chance(seen: Problem, chi2: float, dof: int) -> float:
    """That chi-squared comes out as large: by F where the noise scale is estimated from the shots fitted."""
    parameters = seen.parameters
    # A target without shots takes nothing of them.
    unseen = parameters.targets(set(seen.targets) - {seen.targets[k] for k in seen.target_index})
    free = seen.data_size - int((parameters.free & ~unseen).sum())
    if not seen.noise.estimated or free <= 0:
        return float(chdtrc(dof, chi2))
    return float(fdtrc(dof, free, chi2 / dof))


def _settled(problem: Problem, x: Matrix, moved: NDArray[np.bool_]) -> Matrix:
    """x (p,) with the parameters `moved` (the targets') where the residuals are smallest."""
    parameters, rows = problem.parameters, problem.shots * problem.tool.miss_size
    x, moved = x.copy(), moved & parameters.free
    for _ in range(_ROUNDS):
        whitened = problem.whiten(x)
        columns = np.vstack([whitened.jacobian[:rows, moved], np.eye(int(moved.sum()))])
        z = (x - parameters.prior_mean)[moved] / parameters.prior_std[moved]
        step = -np.linalg.lstsq(columns, np.append(whitened.residual[:rows], z), rcond=None)[0]
        x[moved] += step * parameters.prior_std[moved]
        if np.abs(step).max(initial=0.0) < 1e-12:
            break
    return x
