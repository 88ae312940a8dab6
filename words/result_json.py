"""`result.json` (`zerobeam/result/1`) and what `check --json` prints (`zerobeam/check/1`): plain JSON types,
with the sentences of `words`.

JSON has no NaN or Infinity, so a float that is not finite is an error and never a quiet null.
What the data do not determine leaves here as null, or not at all.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..analysis.diagnostics.accuracy import Accuracy
from ..analysis.diagnostics.diagnosis import Explanation
from ..analysis.diagnostics.hold_out import PlacementResult
from ..analysis.misfit import LackOfFit, Misfit
from ..analysis.observability.causes import NullDirection
from ..analysis.observability.check import Check
from ..analysis.observability.geometry import GeometryResult
from ..analysis.observability.identifiability import Identifiability
from ..analysis.result import RESULT_SCHEMA, LikelihoodSummary, MidpointSummary, Result
from ..analysis.solution import ParameterResult
from ..analysis.status import UnsoundResult
from .findings import (
    accuracy_reason,
    headline,
    hold_out_message,
    likelihood_message,
    notes,
    posterior_message,
    robust_message,
    tcp_words,
)
from .misfit import criterion_sentence, explanation_sentence
from .next_steps import next_steps
from .observability import reason, remedy
from .verdict import check_headline, check_notes

CHECK_SCHEMA = "zerobeam/check/1"


def to_json(result: Result) -> dict[str, Any]:
    """The result as dicts, lists, strings, bools, ints and finite floats, keys in the design's order.

    Raises UnsoundResult if a number is not finite.
    """
    return {
        "schema": RESULT_SCHEMA,
        "verdict": result.verdict,
        "headline": headline(result),
        "parameters": [parameter_json(parameter) for parameter in result.parameters],
        "without_prior": result.without_prior and _without(result.without_prior, "without_prior", "status"),
        "identifiability": _identifiability(result.identifiability),
        "fits": {"likelihood": _likelihood(result.likelihood), "midpoint": _midpoint(result.midpoint)},
        "geometry": geometry_json(result.geometry),
        "posterior": _posterior(result),
        "shots": _plain(result.shots, "shots"),
        "distances": _plain(result.distances, "distances"),
        "intervals": [_without(row, "intervals", "status") for row in result.intervals],
        "accuracy": _accuracy(result.accuracy),
        "budget": [_without(row, "budget", "status") for row in result.budget],
        "robust": _robust(result),
        "hold_out": _hold_out(result),
        "placements": _placements(result.placements),
        "scene": _plain(result.scene, "scene"),
        "misfit": _misfit(result.misfit),
        "diagnosis": [_explanation(found) for found in result.diagnosis],
        "notes": list(notes(result)),
        "next_steps": _plain(next_steps(result), "next_steps"),
        "inputs": _plain(result.inputs, "inputs"),
    }


def check_json(check: Check) -> dict[str, Any]:
    """The answer of a check, null where there is no number."""
    return {
        "schema": CHECK_SCHEMA,
        "verdict": check.verdict,
        "headline": check_headline(check),
        "parameters": [
            {**_without(row, f"parameter {row.name!r}", "cause"), "reason": row.cause and reason(row.cause)}
            for row in check.parameters
        ],
        "identifiability": _identifiability(check.identifiability),
        "geometry": geometry_json(check.geometry),
        "postures": _plain(check.postures, "postures"),
        "curve": _plain(check.curve, "curve"),
        "over_target": _plain(check.over_target, "over_target"),
        "advice": _plain(check.advice, "advice"),
        "notes": list(check_notes(check)),
        "inputs": _plain(check.inputs, "inputs"),
    }


def dumps(answer: dict[str, Any]) -> str:
    """The text of `result.json`: keys in their given order, floats to the last digit, UTF-8 safe."""
    # One line for each item of the second level: C writes them, and with an indent Python would.
    text = _item_by_item(answer, "", lambda value: _item_by_item(value, " ", _LINE.encode))
    return _encodable(text) + "\n"


def one_line(value: object) -> str:
    """The same of a part, on one line."""
    return _encodable(_LINE.encode(value))


def _encodable(text: str) -> str:
    """A lone surrogate cannot be encoded in UTF-8, but its escape is legal JSON and says the same."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


_LINE = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def _item_by_item(value: object, margin: str, write: Callable[[Any], str]) -> str:
    """A dict or list with a line for each item behind `margin`, as `write` writes them."""
    if not value or not isinstance(value, dict | list | tuple):
        return _LINE.encode(value)
    if isinstance(value, dict):
        ends, rows = "{}", [f"{_LINE.encode(key)}: {write(item)}" for key, item in value.items()]
    else:
        ends, rows = "[]", [write(item) for item in value]
    inner = f"\n{margin} "
    return f"{ends[0]}{inner}{f',{inner}'.join(rows)}\n{margin}{ends[1]}"


def parameter_json(row: ParameterResult) -> dict[str, Any]:
    """A row of `parameters`."""
    order = ("name", "unit", "status", "held", "estimate", "std", "data_std", "interval95", "prior_std")
    where = f"parameter {row.name!r}"
    plain = {key: _plain(getattr(row, key), f"{where}, {key}") for key in (*order, "midpoint", "group")}
    share = {} if row.group != "offset" else {"tolerance_share": _plain(row.tolerance_share, where)}
    return {**plain, **share, "reason": row.cause and reason(row.cause)}


def geometry_json(own: GeometryResult) -> dict[str, Any]:
    """What an answer says of the geometry."""
    tolerance = {"length_mm": own.length_mm, "angle_deg": own.angle_deg}
    return {
        "tolerance": _plain(tolerance, "geometry.tolerance") if own.stated else None,
        "considered_tolerance": _plain(tolerance, "geometry.considered_tolerance"),
        "factors": _plain(own.factors, "geometry.factors"),
        "ladder": _plain(own.ladder, "geometry.ladder"),
        "consider": _plain(own.consider, "geometry.consider"),
        "at_half": _plain(own.at_half, "geometry.at_half"),
        "at_twice": _plain(own.at_twice, "geometry.at_twice"),
        "confounded": _plain(own.confounded, "geometry.confounded"),
    }


def _identifiability(facts: Identifiability) -> dict[str, Any]:
    return {
        **_without(facts, "identifiability", "null_space"),
        "null_space": [direction_json(direction) for direction in facts.null_space],
    }


def direction_json(direction: NullDirection) -> dict[str, Any]:
    """A null-space direction in words."""
    return {
        "combination": _plain(direction.combination, "combination"),
        "kind": direction.kind,
        "reason": reason(direction.cause),
        "remedy": remedy(direction.cause),
        "data_std": _plain(direction.data_std, "data_std"),
    }


def _likelihood(fit: LikelihoodSummary) -> dict[str, Any]:
    own = _without(fit, "fits.likelihood", "noise_known", "other_basins")
    return {"available": True, **own, "other_basins": fit.other_basins, "message": likelihood_message(fit)}


def _midpoint(fit: MidpointSummary) -> dict[str, Any]:
    own = _without(fit, "fits.midpoint", "message")
    nothing = dict.fromkeys(("rms_before_mm", "chi2", "dof", "p_value", "noise_scale"))
    return {**own, **nothing, "other_basins": 0, "message": fit.message}


def _posterior(result: Result) -> dict[str, Any]:
    own = _without(result.posterior, "posterior", "drifts", "nothing_known", "omitted")
    return {"converged": own.pop("converged"), "message": posterior_message(result.posterior), **own}


def _accuracy(accuracy: Accuracy) -> dict[str, Any]:
    own = _without(accuracy, "accuracy", "held", "causes", "joints", "converged")
    return {**own, "place": tcp_words(accuracy), "reason": accuracy_reason(accuracy)}


def _misfit(misfit: Misfit | None) -> dict[str, Any] | None:
    if misfit is None:
        return None
    return {
        "criteria": [
            {
                "kind": criterion.kind,
                **_plain(criterion, "misfit"),
                **({"factor": criterion.factor} if isinstance(criterion, LackOfFit) else {}),
                "sentence": criterion_sentence(criterion),
            }
            for criterion in misfit.criteria
        ]
    }


def _robust(result: Result) -> dict[str, Any] | None:
    if result.robust is None:
        return None
    own = _without(result.robust, "robust", "with_uncertainty")
    rows = [_without(row, "robust.parameters", "status") for row in result.robust.parameters]
    return {**own, "parameters": rows, "message": robust_message(result.robust)}


def _hold_out(result: Result) -> dict[str, Any] | None:
    if result.hold_out is None:
        return None
    own = _without(result.hold_out, "hold_out", "failure")
    return {**own, "message": hold_out_message(result.hold_out)}


def _placements(own: PlacementResult) -> dict[str, Any]:
    left_out, knife = own.leave_one_out, own.jackknife
    rows = () if left_out is None else left_out.rows
    shown = ("shots", "rms_mm", "expected_mm", "factor", "chi2", "dof", "p_value")
    where = "placements"
    return {
        "names": list(own.names),
        "leave_one_out": [
            {
                "placement": ", ".join(row.placements),
                **{key: _plain(getattr(row, key), f"{where}.leave_one_out.{key}") for key in shown},
                "message": hold_out_message(row),
            }
            for row in rows
        ],
        "leave_one_out_rms_mm": _plain(left_out and left_out.rms_mm, where),
        "leave_one_out_expected_mm": _plain(left_out and left_out.expected_mm, where),
        "jackknife": knife
        and {row.name: _plain(row.u, f"{where}.jackknife.{row.name}") for row in knife.offsets},
        "jackknife_dof": knife and knife.dof,
        "jackknife_needs": knife and {row.name: list(row.needs) for row in knife.offsets if row.needs},
        "effective": {**_without(own.effective, f"{where}.effective"), "number": own.effective.number},
        "steps": _plain(own.steps.rows, f"{where}.steps"),
        "steps_tested": own.steps.tested,
    }


def _explanation(found: Explanation) -> dict[str, Any]:
    own = _without(found, "diagnosis")
    keys = ("cause", "joints", "targets", "measurements", "factor", "agrees")
    return {**{key: own[key] for key in keys}, "sentence": explanation_sentence(found)}


def _without(value: Any, where: str, *left_out: str) -> dict[str, Any]:
    """A dataclass as a dict, without some of its fields."""
    found = {name: getattr(value, name) for name in _fields(value.__class__) if name not in left_out}
    for name, item in found.items():
        if type(item) not in _SAME:
            found[name] = _plain(item, f"{where}.{name}")
    return found


@cache
def _fields(kind: Any) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(kind))


_SAME = {type(None), bool, int, str}  # in Python and in JSON
_NUMBERS = {type(None), float}


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
    if isinstance(value, list | tuple):
        # Of the thousands of numbers of a result nearly all are in such rows: a sum finds what is not finite.
        kinds = set(map(type, value))
        if kinds <= _SAME or (kinds <= _NUMBERS and math.isfinite(sum(filter(None, value)))):
            return list(value)
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _without(value, where)
    if isinstance(value, dict):
        return {str(key): _plain(item, f"{where}.{key}") for key, item in value.items()}
    raise UnsoundResult(
        f"the result is unsound and was not written: {where} is a {type(value).__name__}, which JSON lacks"
    )
