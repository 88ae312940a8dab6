"""What the reports say, before it is set in HTML or PDF."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from typing import Any

import pytest
from example_results import (
    EXAMPLES,
    FORBIDDEN,
    fit,
    good,
    held_out,
    hostile,
    misfit,
    outlier,
    robust,
    separate,
    uncalibrated,
    unconverged,
    x_pattern,
)

from zerobeam.analysis.result import Result
from zerobeam.reports.run.parameters import NOT_DETERMINED
from zerobeam.reports.run.view import view
from zerobeam.reports.words.result_json import to_json


def seen(result: Result) -> dict[str, Any]:
    return view(to_json(result))


def texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from texts(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from texts(item)
    elif dataclasses.is_dataclass(value):
        yield from texts(vars(value))


def row_of(table: dict[str, Any], name: str) -> list[str]:
    (row,) = [row for row in table.rows if row.cells[0].text == name]
    return [cell.text for cell in row.cells]


def test_an_identified_offset_shows_estimate_interval_and_status() -> None:
    assert row_of(seen(good())["offsets"], "δ2") == [
        "δ2",
        "\u22120.512°",
        "\u22120.567 to \u22120.457°",
        "identified",
    ]


def test_a_held_offset_says_where_and_why() -> None:
    said = seen(good())
    assert row_of(said["offsets"], "δ1") == ["δ1", "held at 0°", "held"]
    reasons = {entry.names: entry.text for entry in said["reasons"]}
    assert reasons["δ1"] == "is the zero of the base frame itself (section 3.3)."


def test_no_number_stands_in_the_row_of_an_unidentifiable_parameter() -> None:
    for result in (x_pattern(), hostile()):
        answer, said = to_json(result), seen(result)
        count = 0
        for table in (said["offsets"], *said["others"]):
            for row in table.rows:
                if row.tone == "unidentifiable":
                    words = [cell.text for cell in row.cells[1:]]
                    assert words == [NOT_DETERMINED, "unidentifiable"]
                    count += 1
        assert count == sum(row["status"] == "unidentifiable" for row in answer["parameters"]) > 0


def test_the_posterior_table_has_no_number_for_what_comes_from_the_prior() -> None:
    said = seen(x_pattern())
    assert row_of(said["posterior"]["table"], "δ2") == ["δ2", "drawn from the prior: the data have no say"]
    everything = " ".join(texts(said))
    assert f"{abs(FORBIDDEN):.2f}" not in everything
    assert "4.98" not in everything
    assert "9.77" not in everything


def test_the_unknown_names_combination_kind_reason_and_remedy() -> None:
    unknown = seen(x_pattern())["unknown"]
    assert unknown["sentence"].startswith("δ2, psd.x and psd.z are not determined by these data")
    (item,) = unknown["directions"].items
    assert item.combination == "δ2 \u2212 0.12\u00a0psd.z + 0.064\u00a0psd.x"
    assert item.kind.startswith("exact")
    assert "theta1 is the same in all shots" in item.reason
    assert item.remedy.endswith("or hold δ2.")
    assert "Nothing that was asked for" in seen(good())["unknown"]["sentence"]
    assert "weakly, beyond the tolerance: δ7" in seen(misfit())["unknown"]["sentence"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "as large as the stated noise"),
        ({"chi2": 60.0, "p_value": 1e-9}, "Lack of fit: the misses are some 3.2 times"),
        ({"chi2": 0.1, "p_value": 0.9999}, "smaller than the stated noise"),
        ({"converged": False, "reason": "too many steps"}, "did not converge (too many steps)"),
    ],
)
def test_the_fit_is_judged_in_plain_words(changes: dict[str, Any], words: str) -> None:
    result = dataclasses.replace(good(), likelihood=fit(**changes))
    assert words in " ".join(seen(result)["fit"]["sentences"])


def test_a_fit_that_did_not_converge_is_the_first_note() -> None:
    result = dataclasses.replace(misfit(), likelihood=fit(converged=False))
    assert seen(result)["notes"][0].startswith("The fit did not converge")


def test_likelihood_and_midpoint_stand_side_by_side() -> None:
    said = seen(good())["fit"]
    assert row_of(said["table"], "Miss after, rms") == ["Miss after, rms", "0.131\u00a0mm", "0.211\u00a0mm"]
    assert row_of(said["estimates"], "δ2") == ["δ2", "\u22120.512°", "\u22120.492°", "0.70"]
    alone = seen(misfit())["fit"]
    assert alone["estimates"] is None
    assert any("a probe has no beams" in sentence for sentence in alone["sentences"])
    assert len(alone["table"].columns) == 2


def test_an_unconverged_posterior_is_not_shown() -> None:
    posterior = seen(unconverged())["posterior"]
    assert posterior["table"] is None
    assert posterior["sentence"].startswith("The posterior has not converged and is not shown.")


def test_of_many_shots_the_worst_are_shown_and_the_reader_is_told() -> None:
    result = misfit()
    said = seen(result)["shots"]
    assert len(said["table"].rows) == 21  # and the most influential
    worst = max(result.shots, key=lambda shot: shot.whitened)
    assert said["table"].rows[0].cells[0].text == str(worst.shot)
    assert "Of 559 shots the table shows the 20 worst" in said["sentence"]
    assert len(seen(good())["shots"]["table"].rows) == 7


def test_the_shot_that_the_answer_hangs_on_is_named_and_shown() -> None:
    few = seen(good())["shots"]["sentence"]
    heaviest = max(good().shots, key=lambda shot: shot.cooks or 0.0)
    assert f"hangs most on shot {heaviest.shot} (Cook" in few
    many = misfit()
    least = min(range(len(many.shots)), key=lambda i: many.shots[i].whitened)
    heavy = dataclasses.replace(many.shots[least], cooks=99.0)
    shots = (*many.shots[:least], heavy, *many.shots[least + 1 :])
    table = seen(dataclasses.replace(many, shots=shots))["shots"]["table"]
    assert table.rows[-1].cells[0].text == str(heavy.shot)
    assert len(table.rows) == 21
    assert table.caption.endswith("and the most influential")


def test_distances_stand_next_to_what_was_stated() -> None:
    cells = [cell.text for cell in seen(misfit())["distances"].rows[0].cells]
    assert cells == ["left_1a and left_1b", "50\u00a0mm", "0.1\u00a0mm", "49.800\u00a0mm", "0.041\u00a0mm"]
    assert NOT_DETERMINED in [cell.text for cell in seen(hostile())["distances"].rows[0].cells]
    assert seen(good())["distances"] is None


def test_noise_factors_have_a_table_of_their_own_and_are_so_many_times_the_stated() -> None:
    said = seen(separate())
    (table,) = [table for table in said["others"] if table.caption.startswith("Noise")]
    assert row_of(table, "noise.joint") == [
        "noise.joint",
        "0.82\u00a0times",
        "0.41 to 1.67\u00a0times",
        "weak",
    ]
    assert row_of(table, "noise.spot") == ["noise.spot", NOT_DETERMINED, "unidentifiable"]
    assert row_of(said["fit"]["table"], "p-value")[1] == "not defined: the noise was estimated"
    assert "noise" in said["posterior"]["table"].caption
    assert not [table for table in seen(good())["others"] if table.caption.startswith("Noise")]
    assert row_of(seen(good())["fit"]["table"], "p-value")[1] == "0.44"


def test_against_a_fitted_noise_the_fit_is_not_said_to_agree_with_the_stated_one() -> None:
    told = dataclasses.replace(separate(), likelihood=fit())
    assert "the fitted noise makes them" in " ".join(seen(told)["fit"]["sentences"])
    assert "the stated noise makes them" in " ".join(seen(good())["fit"]["sentences"])


def test_intervals_stand_side_by_side_only_where_there_is_something_to_compare() -> None:
    said = seen(uncalibrated())["intervals"]
    assert row_of(said["table"], "tool.tilt2") == [
        "tool.tilt2",
        "\u22121.64 to \u22120.50°",
        "\u22122.21 to \u22120.56°",
        "\u22122.04 to \u22120.55°",
    ]
    assert row_of(said["table"], "tool.shift2")[2] == "no end found"
    assert "for tool.tilt2 and tool.shift2: do not rely on one" in said["sentence"]
    assert seen(good())["intervals"] is None
    result = dataclasses.replace(
        uncalibrated(),
        intervals=(dataclasses.replace(uncalibrated().intervals[0], posterior=None, differ=False),),
    )
    said = seen(result)["intervals"]
    assert row_of(said["table"], "tool.tilt2")[3] == "not sampled"
    assert said["sentence"].endswith("They agree.")


def test_a_robust_fit_names_its_outliers_and_weighs_every_shot() -> None:
    said = seen(outlier())
    (words,) = said["robust"]["sentences"]
    assert "Huber’s loss: a miss beyond 2.45 of its own σ" in words
    assert "Too far off for chance: shot 2 (weight 0.11)." in words
    assert row_of(said["robust"]["table"], "δ3") == ["δ3", "0.283°", "0.288°", "0.243 to 0.332°", "0.33"]
    assert not any("psd" in row.cells[0].text for row in said["robust"]["table"].rows)
    table = said["shots"]["table"]
    assert [column.text for column in table.columns][-2:] == ["weight", "outlier"]
    ends = [[cell.text for cell in row.cells[-2:]] for row in table.rows]
    assert ends == [["0.11", "yes"] if i == 2 else ["1.00", "no"] for i in range(7)]
    assert "weight" not in [column.text for column in seen(good())["shots"]["table"].columns]
    assert seen(good())["robust"] is None


def test_a_robust_fit_without_outliers_says_so() -> None:
    said = seen(dataclasses.replace(good(), robust=robust(good(), loss="student", tuning=4.0)))
    (words,) = said["robust"]["sentences"]
    assert "Student’s loss with 4 degrees of freedom" in words
    assert "No shot is too far off for chance." in words
    assert [column.text for column in said["shots"]["table"].columns][-1] == "weight"


def test_a_robust_fit_without_a_covariance_has_no_interval() -> None:
    told = robust(good())
    bare = tuple(dataclasses.replace(row, std=None, interval95=None) for row in told.parameters)
    said = seen(dataclasses.replace(good(), robust=dataclasses.replace(told, parameters=bare)))["robust"]
    assert "It has no uncertainty" in said["sentences"][0]
    assert row_of(said["table"], "δ3") == ["δ3", "0.283°", "0.288°", "none", "0.33"]


def test_an_unconverged_robust_fit_is_not_shown() -> None:
    told = robust(good(), (2,), converged=False, reason="the weights did not settle")
    said = seen(dataclasses.replace(good(), robust=told))
    assert said["robust"]["table"] is None
    assert said["robust"]["sentences"] == [
        "The robust fit did not converge (the weights did not settle) and is not shown."
    ]
    assert "weight" not in [column.text for column in said["shots"]["table"].columns]


def test_a_robust_fit_tells_nothing_that_the_data_do_not() -> None:
    """Even where a robust fit claims a number for it: the status of the parameter decides."""
    answer = to_json(dataclasses.replace(x_pattern(), robust=robust(x_pattern())))
    (row,) = [row for row in answer["robust"]["parameters"] if row["name"] == "delta2"]
    assert row["estimate"] is None
    row |= {"estimate": FORBIDDEN, "std": 0.001, "interval95": [FORBIDDEN - 0.002, FORBIDDEN + 0.002]}
    assert row_of(view(answer)["robust"]["table"], "δ2") == ["δ2", NOT_DETERMINED]
    ends = {"linear": [1.0, 2.0], "profile": None, "posterior": None}
    answer["intervals"] = [{"name": "delta2", "unit": "deg", **ends, "differ": True}]
    assert view(answer)["intervals"] is None
    assert f"{abs(FORBIDDEN):.2f}" not in " ".join(texts(view(answer)))


def test_an_outlier_of_the_robust_fit_is_among_the_worst_of_many_shots() -> None:
    result = misfit()
    best = min(result.shots, key=lambda shot: shot.whitened).shot
    said = seen(dataclasses.replace(result, robust=robust(result, (best,))))["shots"]
    assert said["table"].rows[0].cells[0].text == str(best)
    first = seen(result)["shots"]["table"].rows
    assert str(best) not in [row.cells[0].text for row in first]


def test_held_out_targets_are_judged_in_plain_words() -> None:
    said = seen(held_out())["hold_out"]
    facts = dict(said["facts"].rows)
    assert facts["Targets"] == "2: left and right"
    assert facts["Miss with them, rms"] == "0.142\u00a0mm"
    assert "the offsets hold there too" in said["sentences"][-1]
    assert seen(good())["hold_out"] is None
    hold_out = held_out().hold_out
    assert hold_out is not None
    bad = dataclasses.replace(hold_out, chi2=90.0, p_value=5e-15)
    words = seen(dataclasses.replace(held_out(), hold_out=bad))["hold_out"]["sentences"][-1]
    assert "some 3.0 times as large as noise and fit explain: the offsets do not" in words
    none = dataclasses.replace(hold_out, chi2=None, dof=0, p_value=None, message="they always hit")
    said = seen(dataclasses.replace(held_out(), hold_out=none))["hold_out"]
    assert said["sentences"][1:] == ["No judgement: they always hit."]
    assert dict(said["facts"].rows)["p-value"] == "not available"


def test_inputs_carry_hash_seed_versions_and_provenance() -> None:
    said = seen(good())["inputs"]
    facts = dict(said["facts"].rows)
    assert facts["SHA-256 of the run"] == good().inputs.sha256
    assert facts["Seed"] == "20140803"
    assert "casadi 3.8.2" in facts["Versions"]
    assert ("serial number", "1600-500123") in said["provenance"].rows
    assert ("noise.joint_deg", "0.01") in said["header"].rows
    assert not any("provenance" in name for name, _ in said["header"].rows)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_string_can_be_encoded_and_seen(name: str) -> None:
    for text in texts(seen(EXAMPLES[name])):
        text.encode()
        assert not re.search(r"[\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", text)
        assert not re.search(r"\bnan\b|\binf\b|None", text)


def test_the_same_result_gives_the_same_view() -> None:
    assert seen(hostile()) == seen(hostile())
