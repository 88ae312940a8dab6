"""What a person reads in a terminal of 80 columns: golden prints of good and bad results."""

from __future__ import annotations

import io
from typing import Any

import pytest
from command_line import WIDTH
from example_results import EXAMPLES, FORBIDDEN, good, hostile, separate, uncalibrated, x_pattern
from golden_files import assert_golden
from rich.console import Console

from zerobeam.analysis.result import Result
from zerobeam.analysis.result_json import to_json
from zerobeam.reports.terminal import print_check, print_result, print_side_by_side

SHOWN = [name for name in EXAMPLES if name != "hostile"]


def console(colours: bool = False) -> tuple[Console, io.StringIO]:
    text = io.StringIO()
    kind: Any = "truecolor" if colours else None
    return Console(
        file=text, width=WIDTH, highlight=False, color_system=kind, force_terminal=colours, no_color=False
    ), text


def printed(result: Result, colours: bool = False) -> str:
    to, text = console(colours)
    print_result(to, to_json(result))
    return text.getvalue()


def check_of(result: Result, **changes: Any) -> dict[str, Any]:
    """What `check` would say of the plan of such a run."""
    answer = to_json(result)
    keys = ("name", "unit", "group", "status", "held", "data_std", "std", "prior_std", "reason")
    return {
        "schema": "zerobeam/check/1",
        "verdict": answer["verdict"],
        "headline": answer["headline"],
        "parameters": [{key: row[key] for key in keys} for row in answer["parameters"]],
        "identifiability": answer["identifiability"],
        "postures": [{"posture": i, "target": "psd", "off_mm": 12.3 * i, "hit": True} for i in range(7)],
        "curve": [{"shots": 7, "worst_std": 0.02}],
        "over_target": None,
        "advice": None,
        "notes": [],
        "inputs": {"plan": "plan.yaml", "robot": "irb1600", "sha256": "0" * 64, "versions": {}},
        **changes,
    }


@pytest.mark.parametrize("name", SHOWN)
def test_a_result(name: str) -> None:
    assert_golden(f"result_{name}.txt", printed(EXAMPLES[name]))


def test_a_check_that_passes() -> None:
    to, text = console()
    print_check(to, check_of(good()))
    assert_golden("check_good.txt", text.getvalue())


def test_a_check_that_is_degenerate_with_notes() -> None:
    to, text = console()
    notes = ["Posture 3: turned onto the target, joint 5 stands at 118.0 deg, outside -115 to 115."]
    advice = {
        "posture": 6,
        "joint": 1,
        "change_deg": 30.0,
        "unit": "deg",
        "add": True,
        "worst_std_before": 4.9998,
        "worst_std_after": 0.6308,
    }
    over = {"draws": 16, "hit": 0.964, "worst_std": {"delta2": 4.99, "delta3": 0.61}}
    print_check(to, check_of(x_pattern(), notes=notes, advice=advice, over_target=over))
    assert_golden("check_x_pattern.txt", text.getvalue())


def test_a_check_of_noise_factors_is_in_multiples_of_the_stated() -> None:
    to, text = console()
    print_check(to, check_of(separate()))
    (row,) = [line for line in text.getvalue().splitlines() if line.startswith("noise.joint")]
    assert row.split("\u00a0times")[0].split() == ["noise.joint", "0.30"]
    assert row.count("\u00a0times") == 3


def test_three_results_side_by_side() -> None:
    to, text = console()
    titles = ["good run", "X-Pattern", "uncalibrated tool"]
    answers = [to_json(result) for result in (good(), x_pattern(), uncalibrated())]
    answers[0]["inputs"]["header"]["provenance"] = {"true delta2 (deg)": -0.5, "true delta6 (deg)": -0.32}
    print_side_by_side(to, titles, answers)
    assert_golden("side_by_side.txt", text.getvalue())


@pytest.mark.parametrize("name", SHOWN)
def test_no_line_is_wider_than_the_terminal(name: str) -> None:
    assert max(len(line) for line in printed(EXAMPLES[name]).splitlines()) <= WIDTH


def test_what_is_not_determined_has_no_number() -> None:
    rows = [line for line in printed(x_pattern()).splitlines() if line.startswith("δ2 ")]
    assert len(rows) == 1
    assert rows[0].split() == ["δ2", "not", "determined", "by", "these", "data", "✕", "unidentifiable"]
    assert f"{FORBIDDEN:.2f}"[1:] not in printed(x_pattern())


def test_a_status_has_a_shape_and_a_word_besides_its_colour() -> None:
    plain, coloured = printed(x_pattern()), printed(x_pattern(), colours=True)
    assert "\x1b[" not in plain
    assert "\x1b[" in coloured
    for mark in ("● identified", "✕ unidentifiable", "■ held"):
        assert mark in plain


def test_names_in_a_run_give_the_terminal_no_commands() -> None:
    """Neither escape sequences nor rich's own markup get through, and no letter turns the line around."""
    text = printed(hostile())
    assert "\x00" not in text
    assert "\u202e" not in text
    to, caught = console()
    answer = to_json(good())
    answer["notes"] = ["[bold red]beware[/bold red] \x1b[2J"]
    print_result(to, answer)
    assert "[bold red]beware[/bold red] \\x1b[2J" in caught.getvalue()
    assert "\x1b" not in caught.getvalue()
