"""result.json: plain types, no NaN, and nothing that claims more than its status: such a result cannot be
made."""

import json
import math
from collections.abc import Callable
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


PLACE = r"delta2, psd\.x, (psd\.y, )?psd\.z"


def lying() -> Result:
    """The X-Pattern's draws of what the prior alone says are called those of the data."""
    posterior = x_pattern().posterior
    rows = tuple(replace(row, source="data") for row in posterior.parameters)
    return replace(x_pattern(), posterior=replace(posterior, parameters=rows))


def placed(at: tuple[float, float, float] | None) -> Result:
    """The X-Pattern with a target there in its scene."""
    scene = x_pattern().scene
    return replace(x_pattern(), scene=replace(scene, targets=(SceneTarget("psd", at, None),)))


def interval() -> Intervals:
    return Intervals("delta2", "deg", "identified", (-0.01, 0.01), None, None, True)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        *(
            (
                lambda key=key, value=value: changed(x_pattern(), "delta2", **{key: value}),
                f"'delta2' is unidentifiable, yet it has a value as {key}",
            )
            for key, value in (
                *(("estimate", 0.1), ("std", 1e-4), ("interval95", (0.0, 0.1)), ("midpoint", 0.2)),
            )
        ),
        (lambda: changed(good(), "delta1", cause=None), "delta1"),
        (lambda: changed(good(), "delta1", std=0.1), "delta1"),
        (lambda: changed(good(), "delta1", estimate=None), "delta1"),
        (lambda: changed(good(), "delta3", estimate=None), "delta3"),
        (lambda: changed(good(), "delta3", std=0.0), "delta3"),
        (lambda: changed(good(), "delta3", interval95=(1.0, 1.0)), "delta3"),
        (lambda: changed(good(), "delta3", status="weak"), "'weak'"),
        (lambda: replace(x_pattern(), verdict="weak"), "degenerate"),
        (lying, rf"{PLACE} .* a posterior from the data of it"),
        (lambda: replace(good().posterior, converged=False), "unconverged"),
        (lambda: replace(good().midpoint, available=False), "midpoint"),
        (lambda: placed((900.0, 0.0, 0.0)), r"psd\.x, (psd\.y, )?psd\.z cannot be determined"),
        (lambda: replace(x_pattern(), intervals=(interval(),)), "delta2 cannot be determined"),
        (lambda: replace(interval(), status="unidentifiable"), "'delta2' is unidentifiable"),
        # A robust fit of a good run has an estimate for all; the X-Pattern may not borrow it.
        (lambda: replace(x_pattern(), robust=outlier().robust), rf"{PLACE} cannot be determined"),
        (
            lambda: replace(x_pattern(), budget=good().budget[:1]),
            "delta2 cannot be determined, yet the result has a budget",
        ),
    ],
)
def test_what_contradicts_its_status_is_refused(made: Callable[[], Any], said: str) -> None:
    with pytest.raises(UnsoundResult, match=said):
        made()


def test_what_claims_no_more_than_its_status_is_taken() -> None:
    assert replace(good(), verdict="degenerate").verdict == "degenerate"  # a graver one is allowed
    assert to_json(unconverged())["posterior"]["parameters"] is None
    none = replace(good().midpoint, available=False, cost=None, rms_mm=None)
    fits = to_json(replace(good(), fits=replace(good().fits, midpoint=none)))["fits"]
    assert (fits["midpoint"]["available"], fits["midpoint"]["rms_mm"]) == (False, None)
    assert to_json(placed(None))["scene"]["targets"][0]["at_mm"] is None
    assert to_json(hostile())["robust"] is not None
    assert to_json(replace(outlier(), intervals=(interval(),)))["intervals"]


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
