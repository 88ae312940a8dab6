"""Sentences of values to enter and of conformity: what is claimed, and that nothing more is."""

from dataclasses import replace
from functools import cache
from typing import Literal

import pytest
from analysed_once import analysed_once
from exact_runs import demo_runs

import zerobeam as zb
from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.diagnostics.values_to_enter import Conformity, Entered, TcpError
from zerobeam.reports.run.front import front
from zerobeam.reports.style.blocks import Table
from zerobeam.words import numbers
from zerobeam.words.controllers import POSITIONS
from zerobeam.words.enter import (
    NO_REQUIREMENT,
    NOT_CLAIMED,
    beyond_offsets_sentence,
    conformity_sentence,
    enter_sentence,
    floor_sentence,
    links_step,
)
from zerobeam.words.message import message, next_steps, offered

BEFORE, AFTER, LESS = (
    TcpError(3.02, 5.5, (2.9, 3.1)),
    TcpError(0.61, 1.04, (0.4, 0.9)),
    TcpError(0.3, 0.52, (0.2, 0.4)),
)
NAMES = [f"delta{i}" for i in range(2, 7)]


@cache
def passed() -> Result:
    return analysed_once(zb.read_run(demo_runs()[0].path), ess=100).result


def values(before: TcpError | None = BEFORE, after: TcpError | None = AFTER) -> Result:
    u = dict.fromkeys(NAMES, 0.021)
    entered = Entered("nominal", dict.fromkeys(NAMES, 0.5), u, before, after)
    return replace(passed(), entered=entered, entered_geometry=None)


def test_a_value_has_the_status_of_its_own_u() -> None:
    """An offset may be identified and the value to enter weak: it makes up for links too."""
    entered, within = passed().entered, zb.read_run(demo_runs()[0].path).header.tolerance.offset_deg
    assert entered is not None
    assert entered.status == {name: "identified" if u <= within else "weak" for name, u in entered.u.items()}
    (weak,) = (name for name, status in entered.status.items() if status == "weak")
    assert passed().parameters.named(weak).status == "identified"
    advice = next_steps(passed(), message(passed()))
    assert {row.name: row.status for row in advice.enter} == entered.status
    table = next(block for block in front(passed(), message(passed())) if isinstance(block, Table))
    marks = {row.cells[0].text: row.cells[-1].mark for row in table.rows}
    assert [marks[f"J{row.name.removeprefix('delta')}"] for row in advice.enter] == [
        row.status for row in advice.enter
    ]


@pytest.mark.long
def test_the_error_is_stated_with_what_it_was() -> None:
    sentence = (enter_sentence(values()) or "").replace("\u00a0", " ")
    assert "0.61 mm instead of 3.0 mm" in sentence
    assert "1.0 mm instead of 5.5 mm" in sentence
    assert enter_sentence(values(None, None)) == NOT_CLAIMED
    assert enter_sentence(replace(passed(), entered=None)) is None


def test_links_are_spoken_of_where_they_are_estimated() -> None:
    assert links_step(values()) is None
    result = replace(values(), entered_geometry=Entered("geometry", {}, {}, BEFORE, LESS))
    text, command = links_step(result) or ("", "")
    assert "0.30\u00a0mm is left" in text
    assert command.startswith("zerobeam export robot ")
    ur = replace(result, inputs=replace(result.inputs, vendor="universal-robots"))
    assert (links_step(ur) or ("", ""))[1].startswith("zerobeam export ur-calibration ")
    urdf = {"urdf": "arm.urdf", "base": "base", "tip": "tip"}
    described = replace(result.inputs, header={**result.inputs.header, "robot": urdf})
    assert (links_step(replace(result, inputs=described)) or ("", ""))[1].startswith("zerobeam export urdf ")
    # Links that leave more than the offsets alone are no remedy.
    worse = replace(values(after=LESS), entered_geometry=Entered("geometry", {}, {}, BEFORE, AFTER))
    assert links_step(worse) is None


def test_what_offsets_alone_cannot_do_is_said_with_the_region() -> None:
    assert floor_sentence(values()) is None
    entered = values().entered
    assert entered is not None
    result = replace(values(), entered=replace(entered, tcp_best=LESS))
    said = (floor_sentence(result) or "").replace("\u00a0", " ")
    assert "leave 0.30 mm (median, in the central 70 % of the joints\u2019 ranges)" in said
    assert "0.61 mm is reached" in said
    # A requirement below the floor is met by no offsets.
    for required_mm, impossible in ((0.5, True), (0.6, False)):
        judged = replace(result, conformity=Conformity(required_mm, 1.0, 0.0, "does not conform"))
        assert (beyond_offsets_sentence(judged) is not None) == impossible


@pytest.mark.parametrize("vendor", ["doosan", "franka"])
def test_a_controller_that_takes_no_offsets_is_offered_what_it_takes(vendor: str) -> None:
    result = values()
    measured = {**result.inputs.header, "provenance": {}}
    result = replace(result, inputs=replace(result.inputs, vendor=vendor, header=measured))
    words = message(result)
    assert words.action.text.startswith("Enter nothing: how this controller takes offsets is not worked out")
    assert ("zerobeam positions reach" in words.action.text) == (vendor in POSITIONS)
    assert "corrected robot model" in words.action.text
    assert " -o corrected.yaml" in (words.action.command or "")
    advice = next_steps(result, words)
    assert advice.enter == ()
    sentences = " ".join(step.text for step in advice.steps).replace("\u00a0", " ")
    assert "0.61 mm instead of 3.0 mm" in sentences
    assert "values" not in sentences


def test_a_table_has_the_value_and_the_offset_of_the_arm() -> None:
    row = next_steps(values(), message(values())).enter[0]
    estimate = passed().parameters.named("delta2").estimate
    assert estimate is not None
    assert (row.name, row.value, row.expanded_u) == (
        "delta2",
        "0.500°",
        numbers.spread(passed().coverage_factor * 0.021, "deg"),
    )
    assert row.estimate is not None
    assert row.estimate.startswith(f"\u2212{abs(estimate):.2f}"[:4])
    assert offered(replace(values(), entered=None), message(values())) is None


@pytest.mark.parametrize(
    ("decision", "words"),
    [
        ("conforms", "the robot conforms"),
        ("does not conform", "the robot does not conform"),
        ("undecided", "do not decide"),
    ],
)
def test_conformity_is_said_with_its_rule(
    decision: Literal["conforms", "does not conform", "undecided"], words: str
) -> None:
    result = replace(values(), conformity=Conformity(0.5, 0.62, 0.03, decision))
    sentence = conformity_sentence(result).replace("\u00a0", " ")
    assert words in sentence
    assert "JCGM 106" in sentence
    assert "3 %" in sentence


@pytest.mark.parametrize(("p", "words"), [(1.0, "above 99 %"), (0.995, "above 99 %"), (0.004, "below 1 %")])
def test_a_probability_is_never_said_to_be_certain(p: float, words: str) -> None:
    """It was "100 %" of 199 drawn arms in 200."""
    judged = Conformity(0.5, 0.62, p, "conforms" if p > 0.5 else "does not conform")
    assert f"a probability {words}" in conformity_sentence(replace(values(), conformity=judged))


def test_without_a_requirement_nothing_is_called_accurate_enough() -> None:
    assert conformity_sentence(values()) == NO_REQUIREMENT
    assert NO_REQUIREMENT in " ".join(step.text for step in next_steps(values(), message(values())).steps)
    header = {**passed().inputs.header, "required": {"tcp_mm": 0.5}}
    asked = replace(values(None, None), inputs=replace(passed().inputs, header=header))
    assert "cannot be said" in conformity_sentence(asked)
