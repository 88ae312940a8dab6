"""Result files (`result.json`) for `compare`: offsets on their own, where no prior has a part in them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...model.errors import BadInput
from ...model.files.reading import LARGEST_RECORDING, parse_json, read_text, shown
from ...model.files.validation import LARGEST, SMALLEST
from ..misfit import LACK_OF_FIT, LackOfFit
from ..result import RESULT_SCHEMA as SCHEMA
from ..status import known
from .repeat import (
    WHEN,
    PriorInEstimate,
    Repeat,
    RepeatStatus,
    RunFinding,
    SharedTolerances,
    StatedMisfit,
)

_WITHOUT_PRIOR = 0.98  # std over the one without priors: from here on they have no part in an estimate


def read_result(path: Path, name: str) -> Repeat:
    """One run from its result; BadInput where the file is not a whole one."""
    try:
        answer = parse_json(read_text(path, LARGEST_RECORDING)[0], file=path, line=1)
        if answer["schema"] != SCHEMA:
            raise ValueError(f"schema {shown(answer['schema'])}")
        return _of_result(answer, name)
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise BadInput(
            "this is not a whole result of zerobeam",
            found=f"{type(error).__name__}: {error}",
            allowed=f"a result.json of schema {SCHEMA}, or a run file (.jsonl)",
            remedy="make it again with zerobeam report or zerobeam analyse --json",
            file=path,
        ) from None


def _of_result(answer: dict[str, Any], name: str) -> Repeat:
    rows = [row for row in answer["parameters"] if row["group"] == "offset"]
    free = [row for row in rows if not row["held"]]
    fit, inputs = answer["fits"]["likelihood"], answer["inputs"]
    noise = inputs["header"].get("noise", {}).get("scale", "known")
    scale = _within(fit["noise_scale"] or 1.0)
    if not scale >= SMALLEST:
        raise ValueError(f"the noise scale is {scale:g}")
    status: list[RepeatStatus] = []
    findings: list[RunFinding] = []
    value, variance, by_geometry = [], [], []
    for row in free:
        if known(row["status"]) and not row["std"] >= SMALLEST:
            raise ValueError(f"the std of {row['name']} is not above 0")
        clean = known(row["status"]) and row["std"] >= _WITHOUT_PRIOR * row["data_std"]
        if known(row["status"]) and not clean:
            findings.append(PriorInEstimate(str(row["name"])))
        status.append(row["status"] if clean or not known(row["status"]) else "prior")
        share = float(row.get("tolerance_share") or 0.0)
        if not 0 <= share < 1:
            raise ValueError(f"the tolerance_share of {row['name']} is {share:g}")
        value.append(_within(row["estimate"]) if clean else math.nan)
        variance.append((1 - share) * (_within(row["std"]) / scale) ** 2 if clean else math.nan)
        by_geometry.append(math.sqrt(share) * float(row["std"]) if clean else math.nan)
    if any(np.asarray(by_geometry) > 0):
        findings.append(SharedTolerances())
    when = inputs["header"].get("provenance", {}).get(WHEN)
    p_value = fit["p_value"]
    misfit = answer.get("misfit")
    if misfit is not None:
        findings.extend(StatedMisfit(str(criterion["sentence"])) for criterion in misfit["criteria"])
    elif p_value is not None and p_value < LACK_OF_FIT:
        # A result of before there was a verdict for it.
        status = ["unvalidated" if own in ("identified", "weak") else own for own in status]
        findings.append(LackOfFit(float(fit["chi2"]), int(fit["dof"]), float(p_value)))
    return Repeat(
        name=name,
        sha256=str(inputs["sha256"]),
        robot=str(inputs["robot"]),
        shots=int(inputs["shots"]),
        when=when if isinstance(when, str) else None,
        names=tuple(str(row["name"]) for row in free),
        units=tuple(str(row["unit"]) for row in free),
        held=tuple(str(row["name"]) for row in rows if row["held"]),
        status=tuple(status),
        value=np.array(value),
        covariance=np.diag(variance),
        # A result does not say how deviations work together: offset by offset, each has one of its own.
        by_geometry=np.diag(by_geometry),
        geometry=tuple(str(row["name"]) for row in free),
        joint=False,
        noise_scale=scale,
        noise_dof=None if noise == "known" else max(int(fit["dof"] or 1), 1),
        findings=tuple(findings),
        failure=None if fit["converged"] else str(fit["reason"]),
    )


def _within(number: float) -> float:
    if not -LARGEST["mm"] <= float(number) <= LARGEST["mm"]:
        raise ValueError(f"the number {float(number):g} is out of range")
    return float(number)
