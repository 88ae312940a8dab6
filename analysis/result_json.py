"""`result.json` (schema `zerobeam/result/1`): a Result as plain JSON types, checked on the way out.

JSON has no NaN or Infinity, so a float that is not finite is an error and never a quiet null.
What the data cannot tell leaves here as null, or not at all.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from typing import Any

import numpy as np

from ..model.errors import ZerobeamError
from .result import FitSummary, ParameterResult, Result

SCHEMA = "zerobeam/result/1"

_NEEDED_VERDICT = {"unidentifiable": "degenerate", "weak": "weak"}
_GRAVITY = {"pass": 0, "weak": 1, "degenerate": 2}


class UnsoundResult(ZerobeamError):
    """A result that breaks its own rules: a fault of the program. Nothing of it may be written."""

    exit_status = 3


def to_json(result: Result) -> dict[str, Any]:
    """The result as dicts, lists, strings, bools, ints and finite floats, keys in the design's order.

    Raises UnsoundResult if a number is not finite, or if a parameter, a fit, the posterior or the
    verdict claims more than its status allows.
    """
    for parameter in result.parameters:
        _check_parameter(parameter)
    _check_verdict(result)
    _check_posterior(result)
    _check_untold(result)
    _check_accuracy(result)
    _check_fit("likelihood", result.likelihood)
    _check_fit("midpoint", result.midpoint)
    answer: dict[str, Any] = {
        "schema": SCHEMA,
        "verdict": result.verdict,
        "headline": result.headline,
        "parameters": [_parameter(parameter) for parameter in result.parameters],
        "identifiability": _plain(result.identifiability, "identifiability"),
        "fits": {
            "likelihood": _plain(result.likelihood, "fits.likelihood"),
            "midpoint": _plain(result.midpoint, "fits.midpoint"),
        },
        "posterior": _plain(result.posterior, "posterior"),
        "shots": _plain(result.shots, "shots"),
        "distances": _plain(result.distances, "distances"),
        "intervals": _plain(result.intervals, "intervals"),
        "accuracy": _plain(result.accuracy, "accuracy"),
        "budget": _plain(result.budget, "budget"),
        "robust": _plain(result.robust, "robust"),
        "hold_out": _plain(result.hold_out, "hold_out"),
        "scene": _plain(result.scene, "scene"),
        "notes": _plain(result.notes, "notes"),
        "inputs": _plain(result.inputs, "inputs"),
    }
    return answer


def dumps(answer: dict[str, Any]) -> str:
    """The text of `result.json`: keys in their given order, floats to the last digit, UTF-8 safe."""
    text = json.dumps(answer, indent=1, allow_nan=False, ensure_ascii=False)
    # A lone surrogate cannot be encoded in UTF-8, but its escape is legal JSON and says the same.
    return re.sub("[\ud800-\udfff]", lambda found: f"\\u{ord(found.group()):04x}", text) + "\n"


def _parameter(parameter: ParameterResult) -> dict[str, Any]:
    order = ("name", "unit", "status", "held", "estimate", "std", "data_std", "interval95", "prior_std")
    where = f"parameter {parameter.name!r}"
    return {
        key: _plain(getattr(parameter, key), f"{where}, {key}")
        for key in (*order, "midpoint", "group", "reason")
    }


def _check_parameter(parameter: ParameterResult) -> None:
    def refuse(what: str) -> None:
        raise UnsoundResult(f"the result is unsound and was not written: {parameter.name!r} {what}")

    numbers = {key: getattr(parameter, key) for key in ("estimate", "std", "interval95", "midpoint")}
    if parameter.held != (parameter.status == "held"):
        refuse(f"is held: {parameter.held}, but its status is {parameter.status}")
    if parameter.status == "unidentifiable":
        claimed = [key for key, value in numbers.items() if value is not None]
        if claimed:
            refuse(f"is unidentifiable, yet it has a value as {', '.join(claimed)}")
    elif parameter.status == "held":
        if parameter.estimate is None or not parameter.reason:
            refuse("is held without the value that it is held at or the reason")
        if parameter.std is not None or parameter.interval95 is not None:
            refuse("is held, yet it has an uncertainty")
    else:
        if parameter.estimate is None or parameter.std is None or parameter.interval95 is None:
            refuse(f"is {parameter.status}, but lacks estimate, std or interval95")
        elif not parameter.std > 0 or not parameter.interval95[0] < parameter.interval95[1]:
            refuse(f"is {parameter.status}, but its std or interval95 is empty")


def _check_verdict(result: Result) -> None:
    needed = max(
        (
            _NEEDED_VERDICT.get(parameter.status, "pass")
            for parameter in result.parameters
            if parameter.group == "offset"
        ),
        key=lambda verdict: _GRAVITY[verdict],
        default="pass",
    )
    if _GRAVITY[result.verdict] < _GRAVITY[needed]:
        raise UnsoundResult(
            f"the result is unsound and was not written: verdict {result.verdict!r}, "
            f"but the statuses of its offsets make it {needed!r}"
        )


def _check_posterior(result: Result) -> None:
    rows = result.posterior.parameters
    if rows is None:
        return
    if not result.posterior.converged:
        raise UnsoundResult("the result is unsound and was not written: an unconverged posterior has values")
    untold = {parameter.name for parameter in result.parameters if parameter.status == "unidentifiable"}
    for row in rows:
        if row.name in untold and row.source != "prior":
            raise UnsoundResult(
                f"the result is unsound and was not written: {row.name!r} is unidentifiable, "
                "yet its draws are marked as coming from the data"
            )


def _check_untold(result: Result) -> None:
    """Other fits and intervals must not tell what the data do not."""
    untold = {row.name for row in result.parameters if row.status in ("unidentifiable", "held")}
    told = {row.name for row in result.intervals} | {row.name for row in result.budget}
    if result.robust is not None:
        told |= {row.name for row in result.robust.parameters if row.estimate is not None}
    if result.scene is not None:
        told |= {
            f"{target.name}.{axis}"
            for target in result.scene.targets
            for axis in "xyz"
            if target.at_mm is not None
        } - {row.name for row in result.parameters if row.held}
    if untold & told:
        raise UnsoundResult(
            f"the result is unsound and was not written: {', '.join(sorted(untold & told))} cannot be told,"
            " yet another interval or fit has a number for it"
        )


def _check_accuracy(result: Result) -> None:
    told = result.accuracy
    if told is not None and (told.workspace is None) != (told.reason is not None):
        raise UnsoundResult(
            "the result is unsound and was not written: accuracy needs numbers or a reason, not both"
        )


def _check_fit(name: str, fit: FitSummary) -> None:
    if not fit.available and any(
        value is not None for value in (fit.cost, fit.rms_mm, fit.chi2, fit.dof, fit.p_value)
    ):
        raise UnsoundResult(
            f"the result is unsound and was not written: the {name} fit is not available, yet it has numbers"
        )


def _plain(value: object, where: str) -> Any:
    """`value` in JSON's own types; `where` names it should it not be possible."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise UnsoundResult(
                f"the result is unsound and was not written: {where} is {value}, not a number"
            )
        return float(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: _plain(getattr(value, field.name), f"{where}.{field.name}")
            for field in dataclasses.fields(value)
        }
    if isinstance(value, dict):
        return {str(key): _plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    raise UnsoundResult(
        f"the result is unsound and was not written: {where} is a {type(value).__name__}, which JSON lacks"
    )
