"""What a reader must not miss, in plain sentences, the gravest first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import chdtrc

from ..observability.verdict import listed
from ..result import FitSummary, HoldOut, PosteriorSummary, Robust, ShotResult
from .displacement import Displacement, displacement_sentence

LACK_OF_FIT = 1e-3  # p-value below which the misfit is not put down to chance
OUTLYING = 1e-3  # chance, over all shots together, of a miss as long as an outlying one
_MOST_NAMED = 10


def misfit(fit: FitSummary) -> float | None:
    """How many times larger than the stated noise the misses are, or None where they agree with it."""
    if fit.p_value is None or fit.p_value >= LACK_OF_FIT or not fit.dof or fit.chi2 is None:
        return None
    return float(np.sqrt(fit.chi2 / fit.dof))


def notes(
    fit: FitSummary,
    contradicted: bool,
    posterior: PosteriorSummary,
    displaced: Displacement | None,
    shots: Sequence[ShotResult],
    robust: Robust | None,
    held_out: HoldOut | None,
    warnings: Sequence[str],
) -> tuple[str, ...]:
    """The notes of a result; `contradicted`: misses and priors together are no chance, `warnings` are those
    of the run's file."""
    return (
        *_on_the_fit(fit, contradicted, posterior),
        *((displacement_sentence(displaced),) if displaced is not None and displaced.significant else ()),
        *_on_held_out(held_out),
        *(_on_shots(fit, shots) if robust is None else _on_robust(robust)),
        *warnings,
    )


def _on_the_fit(fit: FitSummary, contradicted: bool, posterior: PosteriorSummary) -> Iterator[str]:
    if not fit.converged:
        yield f"The fit did not converge: {fit.reason}. Nothing here may be used as an estimate"
    factor = misfit(fit)
    if factor is not None:
        yield (
            f"Lack of fit: chi-squared is {fit.chi2:.0f} for {fit.dof} degrees of freedom; the misses"
            f" ({fit.rms_mm:.2f} mm rms) are {factor:.1f} times what the stated noise explains. The arm is"
            " not quite as drawn (geometry, backlash, elasticity), or the noise is understated: the"
            f" intervals are too narrow by a factor of about {factor:.1f} or more. noise.scale: estimated"
            " widens them by that factor"
        )
    elif contradicted:
        yield (
            "Misses and priors together are larger than chance allows (below 1 in 10 000): noise, priors or"
            " geometry are not as stated, or the best fit was not found. Add shots, so that the fit can be"
            " checked"
        )
    if fit.other_basins:
        yield (
            f"Other solutions: {fit.other_basins} more set(s) of offsets fit nearly as well. The one"
            " reported has the highest posterior; add shots to tell them apart"
        )
    if fit.converged and not posterior.converged:
        yield f"No posterior is shown: {posterior.message}"


def _on_held_out(held_out: HoldOut | None) -> Iterator[str]:
    if held_out is None or held_out.p_value is None or held_out.p_value >= LACK_OF_FIT:
        return
    assert held_out.chi2 is not None
    assert held_out.dof
    yield (
        f"At the targets held out ({listed(list(held_out.targets))}) the misses ({held_out.rms_mm:.2f} mm"
        f" rms) are {np.sqrt(held_out.chi2 / held_out.dof):.1f} times what noise and fit explain: the offsets"
        " do not carry over to them as promised"
    )


def _on_robust(robust: Robust) -> Iterator[str]:
    if not robust.converged:
        yield f"The robust fit did not converge ({robust.reason}): it is not shown"
    elif robust.outliers:
        one = len(robust.outliers) == 1
        named = listed([str(number) for number in robust.outliers[:_MOST_NAMED]])
        yield (
            f"Outlying by the robust fit: shot{'' if one else 's'} {named}. Look into"
            f" {'it' if one else 'them'} before you trust the likelihood's estimates"
        )


def _on_shots(fit: FitSummary, shots: Sequence[ShotResult]) -> Iterator[str]:
    """Single shots that stand out, unless so many do that it is the model that does not fit."""
    if fit.p_value is None:
        return
    whitened = np.array([shot.whitened for shot in shots])
    chance = chdtrc(len(shots[0].miss_mm), whitened**2) * len(shots)
    outlying = [int(i) for i in np.argsort(-whitened) if chance[i] < OUTLYING]
    if not 0 < len(outlying) <= max(3, len(shots) // 10):
        return
    named = listed([str(shots[i].shot) for i in outlying[:_MOST_NAMED]])
    one = len(outlying) == 1
    yield (
        f"Outlying: shot{'' if one else 's'} {named} miss{'es' if one else ''} by far more than the stated"
        " noise. Look into them before you trust the rest"
    )
