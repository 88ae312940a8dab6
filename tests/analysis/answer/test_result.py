"""What is written of a result is read back; what contradicts itself is refused."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import pytest
from command_line import zerobeam
from exact_runs import demo_runs
from example_results import EXAMPLES
from small_results import small_result

from zerobeam.analysis.answer.result import parse_result
from zerobeam.analysis.solution import ParameterResult
from zerobeam.model.kinematics.plausible import DoubtfulRobot
from zerobeam.model.records import dumps, schema
from zerobeam.words.sentences import to_json

OFFSET = {"name": "delta2", "status": "identified", "estimate": 1.0, "std": 0.1, "data_std": 0.1}


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.at_length(r"^(misfit|hostile|geometry|separate|uncalibrated|held_out|outlier)$")
def test_what_is_written_is_read_back(name: str) -> None:
    result, text = EXAMPLES[name], dumps(to_json(EXAMPLES[name]))
    document = parse_result(text)
    assert (document.verdict, document.fits.likelihood.chi2) == (result.verdict, result.likelihood.chi2)
    assert [(row.status, row.estimate, row.std, row.interval95) for row in document.parameters] == [
        (row.status, row.estimate, row.std, row.interval95) for row in result.parameters
    ]
    assert document.shots == result.shots or name == "hostile"
    assert [row.sentence for row in document.diagnosis] == [
        row["sentence"] for row in json.loads(text)["diagnosis"]
    ]
    assert document.offsets == tuple(row for row in document.parameters if row.group == "offset")
    assert all("tolerance_share" in to_json(row) for row in document.offsets)


def test_half_a_surrogate_pair_is_read_as_a_replacement() -> None:
    document = parse_result(dumps(to_json(EXAMPLES["hostile"])))
    assert "lone\ufffdsurrogate" in document.inputs.targets


def test_a_result_of_before_a_key_is_read_without_it() -> None:
    """Those that came later than the schema: none of them is needed."""
    document = parse_result(json.dumps(small_result([OFFSET])))
    assert (document.without_prior, document.misfit, document.next_steps) == (None, None, None)
    assert (document.diagnosis, document.accuracy) == ((), None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": "zerobeam/result/2"}, "schema"),
        ({"schema": 7}, "schema"),
        ({"verdict": "misfit"}, "but misfit is None"),
        (
            {
                "verdict": "weak",
                "next_steps": {"enter": [{"name": "d", "value": "1", "expanded_u": "1"}], "steps": []},
            },
            "values to enter",
        ),
        ({"parameters": [{**OFFSET, "status": "unidentifiable"}]}, "yet it has a value as"),
        ({"parameters": [{**OFFSET, "std": None}]}, "lacks estimate, std or interval95"),
        ({"parameters": [{**OFFSET, "std": True}]}, "parameters.0.std"),
        ({"notes": [3]}, "notes.0"),
    ],
)
def test_a_contradiction_is_refused(changes: dict[str, Any], message: str) -> None:
    answer = small_result(changes.pop("parameters", [OFFSET])) | changes
    with pytest.raises(ValueError, match=message):
        parse_result(json.dumps(answer))


def test_only_an_offset_has_a_share_of_the_tolerances() -> None:
    answer = to_json(EXAMPLES["good"])
    assert {row["group"] for row in answer["parameters"] if "tolerance_share" not in row} == {"target"}
    assert "tolerance_share" in schema(ParameterResult)["properties"]


@pytest.mark.long
@pytest.mark.at_length(r"pass")
@pytest.mark.parametrize(("alpha_deg", "verdict"), [(-90.0, "pass"), (-math.degrees(1.57), "weak")])
def test_no_run_of_rounded_angles_passes(alpha_deg: float, verdict: str, tmp_path: Path) -> None:
    assert zerobeam("robot", "irb1600", "-o", tmp_path / "arm.yaml").status == 0
    text = (tmp_path / "arm.yaml").read_text()
    assert text.count("alpha_deg: -90") > 1
    (tmp_path / "arm.yaml").write_text(text.replace("alpha_deg: -90", f"alpha_deg: {alpha_deg:.7f}", 1))
    header, *shots = demo_runs()[0].path.read_text().splitlines()
    content = {k: v for k, v in json.loads(header).items() if k != "provenance"}
    run = tmp_path / "run.jsonl"
    run.write_text("\n".join([json.dumps(content | {"robot": "arm.yaml"}), *shots]) + "\n")
    with warnings.catch_warnings(action="ignore", category=DoubtfulRobot):
        answer = zerobeam("analyse", run, "--ess", 100, "--json").json
        printed = zerobeam("analyse", run, "--ess", 100).out
        exported = zerobeam("export", "rapid", run, "-o", tmp_path / "offsets.mod")
    assert answer["verdict"] == verdict
    assert answer["message"]["may"]["enter"] == answer["message"]["may"]["export"] == (verdict == "pass")
    assert (exported.status == 0) == (verdict == "pass")
    assert ("● yes" in printed) == (verdict == "pass")
    assert ("◆ no: see what is to be done" in printed) == (verdict == "weak")
    if verdict == "weak":
        (said,) = (note for note in answer["notes"] if "alpha_deg of joint" in note)
        assert "correct these angles" in answer["message"]["action"]["text"]
        assert said[1:] in answer["message"]["cause"]
        assert all(row["status"] == "identified" for row in answer["parameters"] if row["name"] == "delta2")
