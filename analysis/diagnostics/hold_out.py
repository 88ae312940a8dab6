"""Placements that the fit has not seen: how well do its offsets and tool hit them?

The offsets, the tool and all else that is no target come from the other placements; only where the targets of
a held-out placement are is found from their own measurements and distances. What is left there is judged
against the noise and the uncertainty of what was carried over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
import scipy

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.likelihood.problem import Problem, rms_length
from ..estimation.fit import fit_likelihood
from ..placements import Placement, placements

_ROUNDS = 20
_SEPARATORS = "_-. "


@dataclass(frozen=True)
class HoldOut:
    """How offsets and tool by the other placements' measurements do at placements that they have not seen.

    `targets` are those of the held-out `placements`. `rms_mm` of the residuals once each held-out target is
    placed, `rms_before_mm` the same without any offset, `expected_mm` what `rms_mm` would be by the noise and
    the uncertainty of the fit; chi-squared of these residuals against both. None where there is none: without
    degrees of freedom, or where the fit without these targets did not converge, for which `failure` is the
    optimiser's reason.
    """

    targets: tuple[str, ...]
    placements: tuple[str, ...]
    shots: int
    shots_fitted: int
    rms_mm: float | None
    rms_before_mm: float | None
    expected_mm: float | None
    chi2: float | None
    dof: int | None
    p_value: float | None
    failure: str | None

    @property
    def factor(self) -> float | None:
        """Root of chi-squared over its degrees of freedom."""
        return float(np.sqrt(self.chi2 / self.dof)) if self.chi2 is not None and self.dof else None


def hold_out(problem: Problem, patterns: Sequence[str], seed: int = 0) -> HoldOut:
    """Fit without the placements that `patterns` name (`chosen`), then look at their measurements.

    Raises BadInput where nothing matches, or nothing would be left to fit.
    """
    every = placements(problem)
    held = {placement.name for pattern in patterns for placement in chosen(every, pattern)}
    groups = [placement for placement in every if placement.name in held]
    if len(groups) == len(every):
        raise BadInput(
            "all targets are held out: there is nothing left to fit",
            found=", ".join(patterns),
            allowed=f"some of {', '.join(placement.name for placement in every)}",
            remedy="leave at least one target in; a name takes a whole placement, with all targets that are"
            " tied to it by distances",
        )
    names = [name for placement in groups for name in placement.targets]
    seen = problem.without_targets(names)
    fit = fit_likelihood(seen, starts=0, seed=seed)
    if not fit.converged:
        return not_fitted(problem, groups, seen, fit.reason)
    return judged(problem, groups, seen, fit.x, fit.covariance, fit.weight)


def chosen(every: Sequence[Placement], pattern: str) -> list[Placement]:
    """The placements that a name or pattern means, always whole.

    The name of a placement means it alone, the name of a target its placement. NAME_* (or NAME-*, NAME.*)
    means the placement NAME alone if there is one. Any other pattern (* and ? as in file names) means every
    placement whose name, or the name of one of whose targets, matches. Raises BadInput where there is none.
    """
    stem = pattern.removesuffix("*").rstrip(_SEPARATORS)
    separated = pattern.endswith("*") and pattern[-2:-1] in set(_SEPARATORS)
    for own in (
        [p for p in every if p.name == pattern],
        [p for p in every if pattern in p.targets],
        [p for p in every if separated and p.name == stem],
        [p for p in every if any(fnmatchcase(name, pattern) for name in (p.name, *p.targets))],
    ):
        if own:
            return own
    tied = [placement.name for placement in every if len(placement.targets) > 1]
    names = [*tied, *(name for placement in every for name in placement.targets)]
    raise BadInput(
        "no placement and no target of that name can be held out",
        found=pattern,
        allowed=", ".join(dict.fromkeys(names)),
    )


def not_fitted(problem: Problem, groups: Sequence[Placement], seen: Problem, reason: str) -> HoldOut:
    """The hold-out of placements without which the fit did not converge."""
    return HoldOut(
        tuple(name for placement in groups for name in placement.targets),
        tuple(placement.name for placement in groups),
        problem.shots - seen.shots,
        seen.shots,
        *(None,) * 6,
        reason,
    )


def judged(
    problem: Problem, groups: Sequence[Placement], seen: Problem, x: Matrix, covariance: Matrix, weight: float
) -> HoldOut:
    """The placements `groups` of `problem` by a fit of the problem `seen` without them: its mode `x`, the
    `covariance` of its scaled free parameters, and `weight` 1 / noise scale^2.

    Generalised least squares with the covariance S = I / weight + B C B' of what is left at the targets' best
    places, B the Jacobian by all that is carried over and C its covariance (Seber & Lee, Linear Regression
    Analysis, 2003, section 3.10), solved as an ordinary one by the rows of C's root.
    """
    names = tuple(name for placement in groups for name in placement.targets)
    unseen = problem.without_targets(set(problem.targets) - set(names))
    own, other = unseen.parameters, seen.parameters
    carried = [item.name for item in other.items if item.group != "target"]
    start = unseen.nominal()
    before = _settled(unseen, start, weight)
    start[[own.index(name) for name in carried]] = x[[other.index(name) for name in carried]]
    after = _settled(unseen, start, weight)
    whitened = unseen.whiten(after)
    rows = unseen.shots * unseen.tool.residual_size
    scale = _row_scale(unseen, weight)
    residual, jacobian = whitened.residual * scale, whitened.jacobian * scale[:, None]
    by_place = jacobian[:, own.group("target") & own.free]
    free = [name for name in carried if other.free[other.index(name)]]
    at = other.among_free[[other.index(name) for name in free]]
    values, vectors = np.linalg.eigh(covariance[np.ix_(at, at)])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    by_rest = jacobian[:, [own.index(name) for name in free]] @ root
    # Only what is carried over has a prior here: the places are free.
    prior = np.hstack([np.zeros((len(free), by_place.shape[1])), np.eye(len(free))])
    columns = np.vstack([np.hstack([by_place, by_rest]), prior])
    whole = np.append(residual, np.zeros(len(free)))
    left = whole - columns @ np.linalg.lstsq(columns, whole, rcond=None)[0]
    rank = int(np.linalg.matrix_rank(by_place))
    basis = np.linalg.svd(by_place, full_matrices=False)[0][:, :rank]
    noise = whitened.factor / np.sqrt(weight)
    d = unseen.tool.residual_size
    placed = basis[:rows].reshape(unseen.shots, d, -1)
    squares = float((noise**2).sum() - ((noise @ placed) ** 2).sum())
    rest = (by_rest - basis @ (basis.T @ by_rest))[:rows] / scale[:rows, None]
    squares += float(((whitened.factor @ rest.reshape(unseen.shots, d, -1)) ** 2).sum())
    chi2, dof = float(left @ left), unseen.measured_size - rank
    return HoldOut(
        targets=names,
        placements=tuple(placement.name for placement in groups),
        shots=unseen.shots,
        shots_fitted=seen.shots,
        rms_mm=rms_length(whitened.residual_mm),
        rms_before_mm=rms_length(unseen.linearise(before)[0]),
        expected_mm=float(np.sqrt(max(squares, 0.0) / unseen.shots)),
        chi2=chi2 if dof > 0 else None,
        dof=max(dof, 0),
        p_value=_chance(seen, chi2, dof) if dof > 0 else None,
        failure=None,
    )


def _chance(seen: Problem, chi2: float, dof: int) -> float:
    """That chi-squared comes out as large: by F where the noise scale is estimated from the shots fitted."""
    free = seen.data_size - int(seen.parameters.free.sum())
    if not seen.noise.estimated or free <= 0:
        return float(scipy.special.chdtrc(dof, chi2))
    return float(scipy.special.fdtrc(dof, free, chi2 / dof))


def _row_scale(problem: Problem, weight: float) -> Matrix:
    """(M,) what multiplies whitened rows: the noise scale is that of measurements, not of distances."""
    rows = problem.shots * problem.tool.residual_size
    return np.append(np.full(rows, np.sqrt(weight)), np.ones(len(problem.distances)))


def _settled(problem: Problem, x: Matrix, weight: float) -> Matrix:
    """x (p,) with the free coordinates of its targets where residuals and distances are best met."""
    parameters, scale = problem.parameters, _row_scale(problem, weight)
    x, moved = x.copy(), parameters.group("target") & parameters.free
    for _ in range(_ROUNDS):
        whitened = problem.whiten(x)
        columns = np.vstack([whitened.jacobian[:, moved] * scale[:, None], np.eye(int(moved.sum()))])
        z = (x - parameters.prior_mean)[moved] / parameters.prior_std[moved]
        step = -np.linalg.lstsq(columns, np.append(whitened.residual * scale, z), rcond=None)[0]
        x[moved] += step * parameters.prior_std[moved]
        if np.abs(step).max(initial=0.0) < 1e-12:
            break
    return x
