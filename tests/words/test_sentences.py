"""result.json: plain types, no NaN, and nothing that claims more than its status: such a result cannot be
made."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from example_results import (
    EXAMPLES,
    HOSTILE_NAMES,
    good,
    held_out,
    hostile,
    outlier,
    separate,
    unconverged,
    x_pattern,
)

from zerobeam.analysis.answer.result import RESULT_SCHEMA, Result
from zerobeam.analysis.diagnostics.scene_data import SceneTarget
from zerobeam.analysis.posterior.posterior import Intervals
from zerobeam.analysis.solution import ParameterTable
from zerobeam.model.errors import UnsoundResult
from zerobeam.model.records import dumps
from zerobeam.words.sentences import to_json


def changed(result: Result, name: str, **changes: Any) -> Result:
    rows = ParameterTable(replace(row, **changes) if row.name == name else row for row in result.parameters)
    assert rows != result.parameters
    return replace(result, parameters=rows)


@pytest.mark.parametrize("name", EXAMPLES)
def test_it_survives_a_round_trip_through_strict_json(name: str) -> None:
    answer = to_json(EXAMPLES[name])

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    text = dumps(answer)
    assert json.loads(text.encode(), parse_constant=refuse) == answer
    assert text == dumps(to_json(EXAMPLES[name]))


def test_the_keys_are_those_of_the_design() -> None:
    answer = to_json(good())
    assert answer["schema"] == RESULT_SCHEMA
    assert list(answer) == [
        *("schema", "verdict", "message", "coverage_factor", "headline", "parameters", "without_prior"),
        *("identifiability", "fits"),
        *("geometry", "posterior", "shots", "distances", "angles", "intervals", "accuracy", "budget"),
        "robust",
        "hold_out",
        *(
            "placements",
            "scene",
            "null_motion",
            "misfit",
            "diagnosis",
            "enter",
            "enter_geometry",
            "conformity",
        ),
        *("region", "power", "taken_as_known", "outlook", "notes", "next_steps", "inputs"),
    ]
    assert list(answer["parameters"][0]) == [
        *("name", "unit", "status", "estimate", "std", "interval95", "group", "data_std", "prior_std"),
        *("tolerance_share", "reason", "midpoint", "trusted", "held"),
    ]
    assert list(answer["geometry"]) == [
        *("tolerance", "considered_tolerance"),
        *("factors", "ladder", "consider", "at_half", "at_twice", "confounded"),
    ]
    assert list(answer["fits"]) == ["likelihood", "midpoint"]
    assert {"converged", "iterations", "cost", "rms_mm", "chi2", "dof", "p_value"} <= set(
        answer["fits"]["likelihood"]
    )
    assert {
        "shot",
        "target",
        "miss_mm",
        "miss_deg",
        "length_mm",
        "whitened",
        "leave_one_out",
        "cooks",
    } == set(answer["shots"][0])
    assert {"rank", "size", "condition", "observability", "null_space"} == set(answer["identifiability"])
    assert {"sha256", "seed", "versions"} <= set(answer["inputs"])


def test_floats_keep_all_their_digits() -> None:
    value = 0.1 + 0.2
    text = dumps(to_json(changed(good(), "delta3", estimate=value)))
    assert json.loads(text)["parameters"][2]["estimate"] == value


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, np.float64("nan")])
def test_a_number_that_is_not_finite_is_an_error_and_never_a_quiet_null(bad: float) -> None:
    with pytest.raises(UnsoundResult, match=r"parameters\[2\]\.data_std"):
        to_json(changed(good(), "delta3", data_std=bad))
    shot = replace(good().shots[2], miss_mm=(0.0, bad))
    with pytest.raises(UnsoundResult, match=r"shots\[0\]\.miss_mm\[1\]"):
        to_json(replace(good(), shots=(shot,)))


@pytest.mark.parametrize("row", [(math.inf, -math.inf), (1, math.nan), (None, math.inf), ("a", math.inf)])
def test_a_row_of_numbers_hides_none_that_is_not_finite(row: tuple[Any, ...]) -> None:
    inputs = replace(good().inputs, header={"row": row})
    with pytest.raises(UnsoundResult, match=r"inputs\.header\.row\[\d\] is (nan|inf)"):
        to_json(replace(good(), inputs=inputs))


def test_a_row_of_finite_numbers_stays_as_it_is() -> None:
    row = (1e308, 1e308, None, 0.0, 3, True, "a", np.float64(0.1), 10**400)
    header = to_json(replace(good(), inputs=replace(good().inputs, header={"row": row})))["inputs"]["header"]
    assert header["row"] == list(row)
    assert type(header["row"][-2]) is float


def test_what_json_lacks_is_refused() -> None:
    with pytest.raises(UnsoundResult, match="set"):
        to_json(replace(good(), inputs=replace(good().inputs, header={"path": {1, 2}})))


@pytest.mark.parametrize(
    ("key", "value"),
    [("estimate", 0.1), ("std", 1e-4), ("interval95", (0.0, 0.1)), ("midpoint", 0.2)],
)
def test_an_unidentifiable_parameter_may_carry_no_number(key: str, value: object) -> None:
    with pytest.raises(UnsoundResult, match=f"'delta2' is unidentifiable, yet it has a value as {key}"):
        changed(x_pattern(), "delta2", **{key: value})


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("delta1", {"cause": None}),
        ("delta1", {"std": 0.1}),
        ("delta1", {"estimate": None}),
        ("delta3", {"estimate": None}),
        ("delta3", {"std": 0.0}),
        ("delta3", {"interval95": (1.0, 1.0)}),
    ],
)
def test_other_contradictions_are_refused(name: str, changes: dict[str, Any]) -> None:
    with pytest.raises(UnsoundResult, match=name):
        changed(good(), name, **changes)


def test_a_verdict_may_be_no_better_than_the_statuses() -> None:
    with pytest.raises(UnsoundResult, match="degenerate"):
        replace(x_pattern(), verdict="weak")
    with pytest.raises(UnsoundResult, match="'weak'"):
        changed(good(), "delta3", status="weak")
    assert replace(good(), verdict="degenerate").verdict == "degenerate"  # a graver one is allowed


def test_draws_of_an_unidentifiable_parameter_must_be_marked_as_the_priors() -> None:
    result = x_pattern()
    rows = result.posterior.parameters
    lying = tuple(replace(row, source="data") for row in rows)
    posterior = replace(result.posterior, parameters=lying)
    with pytest.raises(
        UnsoundResult, match=r"delta2, psd\.x, (psd\.y, )?psd\.z .* a posterior from the data of it"
    ):
        replace(result, posterior=posterior)


def test_an_unconverged_posterior_has_no_values() -> None:
    assert to_json(unconverged())["posterior"]["parameters"] is None
    with pytest.raises(UnsoundResult, match="unconverged"):
        replace(good().posterior, converged=False)


def test_a_fit_that_is_not_available_has_no_numbers() -> None:
    with pytest.raises(UnsoundResult, match="midpoint"):
        replace(good().midpoint, available=False)
    none = replace(good().midpoint, available=False, cost=None, rms_mm=None)
    fits = to_json(replace(good(), fits=replace(good().fits, midpoint=none)))["fits"]
    assert (fits["midpoint"]["available"], fits["midpoint"]["rms_mm"]) == (False, None)


def test_a_target_that_the_data_do_not_tell_has_no_place_in_the_scene() -> None:
    def shown(at: tuple[float, float, float] | None) -> Result:
        scene = x_pattern().scene
        return replace(x_pattern(), scene=replace(scene, targets=(SceneTarget("psd", at, None),)))

    assert to_json(shown(None))["scene"]["targets"][0]["at_mm"] is None
    with pytest.raises(UnsoundResult, match=r"psd\.x, (psd\.y, )?psd\.z cannot be determined"):
        shown((900.0, 0.0, 0.0))


def test_neither_another_interval_nor_a_robust_fit_tells_what_the_data_do_not() -> None:
    interval = Intervals("delta2", "deg", "identified", (-0.01, 0.01), None, None, True)
    with pytest.raises(UnsoundResult, match="delta2 cannot be determined"):
        replace(x_pattern(), intervals=(interval,))
    with pytest.raises(UnsoundResult, match="'delta2' is unidentifiable"):
        replace(interval, status="unidentifiable")
    # A robust fit of a good run has an estimate for all; the X-Pattern may not borrow it.
    with pytest.raises(UnsoundResult, match=r"delta2, psd\.x, (psd\.y, )?psd\.z cannot be determined"):
        replace(x_pattern(), robust=outlier().robust)
    (budget, *_) = good().budget
    with pytest.raises(UnsoundResult, match="delta2 cannot be determined, yet the result has a budget"):
        replace(x_pattern(), budget=(budget,))
    assert to_json(hostile())["robust"] is not None
    assert to_json(replace(outlier(), intervals=(interval,)))["intervals"]


def test_what_was_not_asked_for_is_null_and_what_was_is_plain() -> None:
    answer = to_json(good())
    assert (answer["intervals"], answer["robust"], answer["hold_out"]) == ([], None, None)
    assert {row["profile"] for row in to_json(separate())["intervals"]} == {None}
    told = to_json(outlier())["robust"]
    assert (told["loss"], told["outliers"], len(told["weights"])) == ("huber", [2], 12)
    assert to_json(held_out())["hold_out"]["targets"] == ["left", "right"]


def test_hostile_names_are_kept_whole() -> None:
    answer = json.loads(dumps(to_json(hostile())).encode())
    assert tuple(answer["inputs"]["targets"]) == HOSTILE_NAMES
