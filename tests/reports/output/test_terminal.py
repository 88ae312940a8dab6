"""What a person reads in a terminal of 80 columns: golden prints of good and bad results."""

import io
import shlex
from dataclasses import replace
from typing import Any

import pytest
from cells import good_plan, pattern_plan
from command_line import WIDTH
from example_results import EXAMPLES, FORBIDDEN, good, hostile, uncalibrated, x_pattern
from golden_files import assert_golden, without_draws
from rich.console import Console
from run_events import event_of

from zerobeam.analysis.answer.findings import FileWarning
from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.observability.check import OutsideLimits, check
from zerobeam.analysis.observability.outlook import Outlook, OutlookRow
from zerobeam.analysis.observability.predictions import OverTarget
from zerobeam.analysis.tcp_region import TcpRegion
from zerobeam.experiments.procedure.events import Ended
from zerobeam.reports.output.terminal import print_blocks, print_page, table_lines
from zerobeam.reports.plan.check_page import check_page
from zerobeam.reports.run.brief_page import brief_page, ended_page, side_by_side
from zerobeam.reports.style.blocks import Cell, Commands, row_of, table_of
from zerobeam.words.run_argument import run_argument

SHOWN = ("misfit", "unconverged", "separate", "geometry")


def console(colours: bool = False) -> tuple[Console, io.StringIO]:
    text = io.StringIO()
    kind: Any = "truecolor" if colours else None
    return Console(
        file=text, width=WIDTH, highlight=False, color_system=kind, force_terminal=colours, no_color=False
    ), text


def printed(result: Result, colours: bool = False) -> str:
    to, text = console(colours)
    print_page(to, brief_page(result))
    return text.getvalue()


@pytest.mark.parametrize("name", SHOWN)
def test_a_result(name: str) -> None:
    """Good and degenerate ones are in tests/system/test_printed.py."""
    text = printed(EXAMPLES[name])
    assert_golden(f"result_{name}.txt", without_draws(text))
    assert max(len(line) for line in text.splitlines()) <= WIDTH


def better() -> Outlook:
    now = OutlookRow("none", 7, {"delta2": None, "delta3": 0.0831}, None, None, None, None, 0.0, 0.0)
    errors = (2.31, 5.62, 1.18, 2.49)
    more = OutlookRow(
        "more",
        12,
        {"delta2": 0.0312, "delta3": 0.0264},
        *errors,
        12.0,
        0.99,
        ("--shots", "12", "--facing=any"),
    )
    return Outlook(now, (more,), TcpRegion("central"), 1.0, measured=False)


def test_a_check_that_is_degenerate_with_notes() -> None:
    to, text = console()
    found = replace(
        check(pattern_plan("x")),
        findings=(OutsideLimits(3, 5, 118.0, "deg", (-115.0, 115.0)),),
        outlook=better(),
        over_target=OverTarget(16, 0.964, {"delta2": 4.99, "delta3": 0.61}),
    )
    print_page(to, check_page(found, full=True))
    assert_golden("check_x_pattern.txt", text.getvalue())


def test_a_check_of_noise_factors_is_in_multiples_of_the_stated() -> None:
    to, text = console()
    checked = check(good_plan(14, joint_deg=0.05, noise={"scale": "separate"}))
    print_page(to, check_page(checked, full=True))
    (row,) = [line for line in text.getvalue().splitlines() if line.startswith("noise.joint")]
    assert row.split("\u00a0times")[0].split()[-1] == "1.0"
    assert row.count("\u00a0times") == 3


def test_three_results_side_by_side() -> None:
    to, text = console()
    titles = ["good run", "X-Pattern", "uncalibrated tool"]
    provenance = {"true delta2 (deg)": -0.5, "true delta6 (deg)": -0.32}
    inputs = replace(good().inputs, header={**good().inputs.header, "provenance": provenance})
    results = [replace(good(), inputs=inputs), x_pattern(), uncalibrated()]
    print_blocks(to, [side_by_side(titles, results)])
    assert_golden("side_by_side.txt", text.getvalue())


def test_what_is_not_determined_has_no_number() -> None:
    (row,) = [line for line in printed(x_pattern()).splitlines() if line.startswith("J2 (δ2) ")]
    assert " ".join(row.split()) == "J2 (δ2) not determined by these data ✕ unidentifiable —"
    assert f"{FORBIDDEN:.2f}"[1:] not in printed(x_pattern())


def test_a_status_has_a_shape_and_a_word_besides_its_colour() -> None:
    plain = printed(x_pattern())
    for coloured in (printed(x_pattern(), colours=True), end_of(carried_badly(), colours=True)):
        assert "\x1b[" in coloured
    assert "\x1b[" not in plain + end_of(carried_badly())
    for mark in ("● identified", "✕ unidentifiable", "■ held"):
        assert mark in plain


def test_names_in_a_run_give_the_terminal_no_commands() -> None:
    """Neither escape sequences nor rich's own markup get through, and no letter turns the line around."""
    text = printed(hostile())
    assert "\x00" not in text
    assert "\u202e" not in text
    to, caught = console()
    warned = replace(good(), findings=(FileWarning("[bold red]beware[/bold red] \x1b[2J"),))
    print_page(to, brief_page(warned))
    assert "[bold red]beware[/bold red] \\x1b[2J" in caught.getvalue()
    assert "\x1b" not in caught.getvalue()


def carried(**changes: Any) -> dict[str, Any]:
    """The end of a run that went well."""
    names = ("delta2", "delta3", "delta4", "delta5", "delta6")
    rows = [
        {"name": name, "unit": "deg", "status": "identified", "estimate": 0.5 - i, "std": 0.0123 * (i + 1)}
        for i, name in enumerate(names)
    ]
    return {
        "event": "end",
        "schema": "zerobeam/carried/1",
        "file": "run.jsonl",
        "verdict": "pass",
        "headline": "J2 (δ2), J3 (δ3), J4 (δ4), J5 (δ5) and J6 (δ6) are identified.",
        "parameters": rows,
        "p_value": 0.1753,
        "consistent": True,
        "shots": [0, 1, 2, 3, 4, 5, 6],
        "refused": [],
        "saved": None,
        "why": None,
        "seconds": {"move": 20.69, "search": 8.81, "servo": 4.78, "settle": 7.0},
        "notes": [],
        **changes,
    }


def carried_badly() -> dict[str, Any]:
    """One that tells little: an offset lost, a target that moved, shots refused."""
    answer = carried(
        verdict="degenerate",
        headline="J2 (δ2) is unidentifiable from these measurements: not resolvable at this noise level.",
        p_value=1e-9,
        consistent=False,
        shots=[0, 2, 3, 5, 6],
        refused=[
            {"shot": 1, "reason": "no signal", "found": "no sample of the PSD arrives"},
            {"shot": 4, "reason": "too weak", "found": "12\u00a0% of the laser's light arrives"},
        ],
        saved=0,
        why="all postures of the plan are measured",
        notes=[
            "Measurement 1 was refused (no signal): no sample of the PSD arrives",
            "Measurement 4 was refused (too weak): 12\u00a0% of the laser's light arrives",
        ],
    )
    answer["parameters"][0] |= {"status": "unidentifiable", "estimate": None, "std": None}
    answer["parameters"][1] |= {"status": "weak", "std": 0.31}
    return answer


def end_of(answer: dict[str, Any], colours: bool = False) -> str:
    to, text = console(colours)
    ended = event_of(answer)
    assert isinstance(ended, Ended)
    print_page(to, ended_page(ended))
    return text.getvalue()


@pytest.mark.parametrize("answer", [carried, carried_badly])
def test_the_end_of_a_run(answer: Any) -> None:
    assert_golden(f"{answer.__name__}.txt", end_of(answer()))
    assert max(len(line) for line in end_of(answer()).splitlines()) <= WIDTH


def test_the_end_of_a_run_has_no_number_for_what_is_not_determined() -> None:
    """An answer that has one by mistake cannot be made."""
    for claim in ({"estimate": FORBIDDEN}, {"std": 0.01}):
        lying = carried_badly()
        lying["parameters"][0] |= claim
        with pytest.raises(ValueError, match="delta2"):
            end_of(lying)


def test_the_end_of_a_run_says_what_u_is_worth_unless_it_is_a_misfit() -> None:
    to, text = console()
    ended = event_of(carried())
    assert isinstance(ended, Ended)
    print_page(to, ended_page(replace(ended, geometry=good().geometry)))
    said = " ".join(text.getvalue().split())
    assert "Leave out geometry: exact to estimate the links" in said
    to, text = console()
    print_page(to, ended_page(replace(ended, geometry=good().geometry, verdict="misfit")))
    assert "Leave out geometry" not in text.getvalue()


def test_the_end_of_a_run_has_a_p_value_where_nothing_contradicts_the_model() -> None:
    assert "under the stated noise: 0.18." in end_of(carried())
    assert "under the stated noise" not in end_of(carried(consistent=False, p_value=1e-9))
    assert "under the stated noise" not in end_of(carried(p_value=None))


def test_the_end_of_an_adaptive_run_says_what_it_saved_and_why_it_ended() -> None:
    assert "Adaptive" not in end_of(carried())
    text = end_of(carried(saved=1, why="the largest standard uncertainty is 0.0188, within 0.05"))
    told = "Adaptive: 1 measurement saved; the largest standard uncertainty is 0.0188, within 0.05."
    assert told in " ".join(text.split())
    assert "Adaptive: 0 measurements saved; all postures of the plan are measured." in end_of(carried_badly())


def test_the_end_of_a_run_accounts_for_its_time_where_there_is_any() -> None:
    assert "This session took 41\u00a0s: move 21, search 8.8, servo 4.8, settle 7.0." in end_of(carried())
    for seconds in ({}, {"move": 0.0, "search": 0.0}):
        assert "took" not in end_of(carried(seconds=seconds))


def test_names_at_the_end_of_a_run_give_the_terminal_no_commands() -> None:
    hostile = "[bold red]beware[/bold red] \x1b[2J\u202e"
    refused = [{"shot": 0, "reason": "camera", "found": hostile}]
    text = end_of(carried(notes=[hostile], headline=hostile, why=hostile, saved=1, refused=refused))
    assert text.count("[bold red]beware[/bold red] \\x1b[2J\\u202e") == 3
    assert "\x1b" not in text
    assert "\u202e" not in text


def test_a_table_keeps_to_its_width_and_texts_give_way_before_numbers() -> None:
    rows = [
        row_of(Cell("identified", mark="identified"), "a text that is too long for its column", "−0.123 mm"),
        row_of(Cell("held", mark="held"), Cell("it runs on to the end of the line", span=2)),
        row_of("x", Cell("spanned", span=1), "1"),
    ]
    lines = table_lines(table_of("", ["status", "what it says", "largest measured value"], rows, "llr"), 40)
    assert [line.plain for line in lines] == [
        "                                 largest",
        "                                measured",
        "status        what it says         value",
        "● identified  a text that is   −0.123 mm",
        "              too long for",
        "              its column",
        "■ held        it runs on to the end of",
        "              the line",
        "x             spanned                  1",
    ]


def test_a_span_in_the_middle_has_the_room_of_its_words() -> None:
    rows = [row_of("J1", "1.0°", "0.1°", "ok"), row_of("J2", Cell("not determined by these", span=2), "lost")]
    first, _, last = (line.plain for line in table_lines(table_of("", ["", "v", "U", "s"], rows, "lrrl"), 80))
    assert last == "J2  not determined by these  lost"
    assert first.rstrip().endswith("s")


def test_of_a_long_table_the_first_rows_are_printed() -> None:
    to, text = console()
    print_blocks(to, [table_of("Many", ["n"], [row_of(str(k)) for k in range(50)])])
    assert text.getvalue().splitlines()[-2:] == ["19", "… 30 more: see --json or the report"]


@pytest.mark.parametrize(
    "name",
    ["my run.jsonl", "sp ace/run.jsonl", "it's my run.jsonl", "mü.jsonl", "-a.jsonl", 'a$(b);"c d".jsonl'],
)
def test_a_command_for_any_file_name_can_be_pasted(name: str) -> None:
    """All said RUN.jsonl, and -a.jsonl was an option."""
    out, text = console()
    line = f"zerobeam analyse {run_argument(name)} --full --hold-out {run_argument(f'other/{name}')} --seed 1"
    print_blocks(out, [Commands([line])])
    words = shlex.split(text.getvalue().replace("\\\n", " "))
    typed = f"./{name}" if name.startswith("-") else name
    assert words == ["zerobeam", "analyse", typed, "--full", "--hold-out", f"other/{name}", "--seed", "1"]
    assert run_argument(f"a\u202e{name}") == "RUN.jsonl"
    ended = end_of(carried() | {"file": name}).replace("\\\n", " ")
    assert f"   zerobeam report {shlex.quote(typed)} -o report" in " ".join(ended.split("\n"))
