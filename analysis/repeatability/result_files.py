"""Result files (`result.json`) for `compare`: offsets on their own, where no prior has a part in them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ...model.errors import BadInput
from ...model.parsing.reading import LARGEST_RECORDING, parse_json, read_text
from ...model.parsing.validation import LARGEST, SMALLEST
from ..answer.result import RESULT_SCHEMA, Result, parse_result
from ..misfit import LackOfFit
from ..status import LACK_OF_FIT, RepeatStatus
from .repeat import (
    WHEN,
    PriorInEstimate,
    Repeat,
    RunFinding,
    SharedTolerances,
    StatedMisfit,
)

_WITHOUT_PRIOR = 0.98  # std over the one without priors: from here on they have no part in an estimate


def read_result(path: Path, name: str) -> Repeat:
    """One run from its result; BadInput where the file is not a whole one."""
    text = read_text(path, LARGEST_RECORDING)[0]
    try:
        parse_json(text, file=path, line=1)  # refuses duplicate keys and NaN
        return _of_result(parse_result(text), name)
    except ValueError as error:
        raise BadInput(
            "this is not a whole result of zerobeam",
            found=str(error),
            allowed=f"a result.json of schema {RESULT_SCHEMA}, or a run file (.jsonl)",
            remedy="make it again with zerobeam report or zerobeam analyse --json",
            file=path,
        ) from None


def _of_result(result: Result, name: str) -> Repeat:
    free = [row for row in result.offsets if not row.held]
    fit, inputs = result.fits.likelihood, result.inputs
    scale = _within(fit.noise_scale or 1.0)
    if not scale >= SMALLEST:
        raise ValueError(f"the noise scale is {scale:g}")
    status: list[RepeatStatus] = []
    findings: list[RunFinding] = []
    value, variance, by_geometry = [], [], []
    for row in free:
        if row.std is None or row.estimate is None:
            status.append(row.status)
            without_prior = False
        else:
            if not row.std >= SMALLEST:
                raise ValueError(f"the std of {row.name} is not above 0")
            if row.data_std is None:
                raise ValueError(f"{row.name} has no std without prior")
            without_prior = row.std >= _WITHOUT_PRIOR * row.data_std
            status.append(row.status if without_prior else "prior")
            if not without_prior:
                findings.append(PriorInEstimate(row.name))
        share, std = row.tolerance_share or 0.0, row.std or math.nan
        value.append(_within(row.estimate or 0.0) if without_prior else math.nan)
        variance.append((1 - share) * (_within(std) / scale) ** 2 if without_prior else math.nan)
        by_geometry.append(math.sqrt(share) * std if without_prior else math.nan)
    if any(np.asarray(by_geometry) > 0):
        findings.append(SharedTolerances())
    when = inputs.provenance.get(WHEN)
    if result.misfit is not None:
        findings.extend(StatedMisfit(criterion.sentence or "") for criterion in result.misfit.criteria)
    elif fit.p_value is not None and fit.p_value < LACK_OF_FIT:
        # A result of before there was a verdict for it.
        status = ["unvalidated" if one in ("identified", "weak", "assumed") else one for one in status]
        findings.append(LackOfFit(fit.chi2 or 0.0, fit.dof or 0, fit.p_value))
    return Repeat(
        name=name,
        sha256=inputs.sha256,
        robot=inputs.robot,
        shots=inputs.shots,
        when=when if isinstance(when, str) else None,
        names=tuple(row.name for row in free),
        units=tuple(row.unit for row in free),
        held=tuple(row.name for row in result.offsets if row.held),
        status=tuple(status),
        value=np.array(value),
        covariance=np.diag(variance),
        # A result does not say how deviations work together: offset by offset, each has one of its own.
        by_geometry=np.diag(by_geometry),
        geometry=tuple(row.name for row in free),
        joint=False,
        noise_scale=scale,
        noise_dof=None if inputs.noise_known else max(fit.dof or 1, 1),
        findings=tuple(findings),
        failure=None if fit.converged else fit.reason,
    )


def _within(number: float) -> float:
    if not -LARGEST["mm"] <= number <= LARGEST["mm"]:
        raise ValueError(f"the number {number:g} is out of range")
    return number
