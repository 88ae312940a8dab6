"""What the reports say, before it is set in HTML or PDF."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from typing import Any

import pytest
from example_results import EXAMPLES, FORBIDDEN, fit, good, hostile, misfit, unconverged, x_pattern

from zerobeam.analysis.result import Result
from zerobeam.analysis.result_json import to_json
from zerobeam.reports.view import NOT_DETERMINED, view


def seen(result: Result) -> dict[str, Any]:
    return view(to_json(result))


def texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from texts(item)
    elif isinstance(value, list):
        for item in value:
            yield from texts(item)


def row_of(table: dict[str, Any], name: str) -> list[str]:
    (row,) = [row for row in table["rows"] if row["cells"][0]["text"] == name]
    return [cell["text"] for cell in row["cells"]]


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
    reasons = {entry["names"]: entry["text"] for entry in said["reasons"]}
    assert reasons["δ1"] == "is the zero of the base frame itself (section 3.3)."


def test_no_number_stands_in_the_row_of_an_unidentifiable_parameter() -> None:
    for result in (x_pattern(), hostile()):
        answer, said = to_json(result), seen(result)
        count = 0
        for table in (said["offsets"], *said["others"]):
            for row in table["rows"]:
                if row["tone"] == "unidentifiable":
                    words = [cell["text"] for cell in row["cells"][1:]]
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
    (item,) = unknown["items"]
    assert item["combination"] == "δ2 \u2212 0.12\u00a0psd.z + 0.064\u00a0psd.x"
    assert item["kind"].startswith("exact")
    assert "theta1 is the same in all shots" in item["reason"]
    assert item["remedy"].endswith("or hold δ2.")
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
    assert len(alone["table"]["columns"]) == 2


def test_an_unconverged_posterior_is_not_shown() -> None:
    posterior = seen(unconverged())["posterior"]
    assert posterior["table"] is None
    assert posterior["sentence"].startswith("The posterior has not converged and is not shown.")


def test_of_many_shots_the_worst_are_shown_and_the_reader_is_told() -> None:
    result = misfit()
    said = seen(result)["shots"]
    assert len(said["table"]["rows"]) == 20
    worst = max(result.shots, key=lambda shot: shot.whitened)
    assert said["table"]["rows"][0]["cells"][0]["text"] == str(worst.shot)
    assert "Of 559 shots the table shows the 20 worst" in said["sentence"]
    assert len(seen(good())["shots"]["table"]["rows"]) == 7


def test_distances_stand_next_to_what_was_stated() -> None:
    cells = [cell["text"] for cell in seen(misfit())["distances"]["rows"][0]["cells"]]
    assert cells == ["left_1a and left_1b", "50\u00a0mm", "0.1\u00a0mm", "49.800\u00a0mm", "0.041\u00a0mm"]
    assert NOT_DETERMINED in [cell["text"] for cell in seen(hostile())["distances"]["rows"][0]["cells"]]
    assert seen(good())["distances"] is None


def test_inputs_carry_hash_seed_versions_and_provenance() -> None:
    said = seen(good())["inputs"]
    facts = {row["name"]: row["text"] for row in said["facts"]}
    assert facts["SHA-256 of the run"] == good().inputs.sha256
    assert facts["Seed"] == "20140803"
    assert "casadi 3.8.2" in facts["Versions"]
    assert {"name": "serial number", "text": "1600-500123"} in said["provenance"]
    assert {"name": "noise.joint_deg", "text": "0.01"} in said["header"]
    assert not any("provenance" in row["name"] for row in said["header"])


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_string_can_be_encoded_and_seen(name: str) -> None:
    for text in texts(seen(EXAMPLES[name])):
        text.encode()
        assert not re.search(r"[\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", text)
        assert not re.search(r"\bnan\b|\binf\b|None", text)


def test_the_same_result_gives_the_same_view() -> None:
    assert seen(hostile()) == seen(hostile())
