"""What a person reads of a study in a terminal of 80 columns."""

from __future__ import annotations

from typing import Any

import pytest
from command_line import WIDTH
from example_studies import agreeing, disagreeing, hostile
from golden_files import assert_golden
from study_text import printed

Json = dict[str, Any]


@pytest.mark.parametrize("answer", [agreeing, disagreeing])
def test_a_study(answer: Any) -> None:
    assert_golden(f"study_{answer.__name__}.txt", printed(answer()))


@pytest.mark.parametrize("answer", [agreeing, disagreeing, hostile])
def test_no_line_is_wider_than_the_terminal(answer: Any) -> None:
    assert max(len(line) for line in printed(answer()).splitlines()) <= WIDTH


def test_the_standing_has_a_shape_and_a_word_besides_its_colour() -> None:
    plain, coloured = printed(disagreeing()), printed(disagreeing(), colours=True)
    assert "\x1b[" not in plain
    assert "\x1b[" in coloured
    assert plain.startswith("Does not agree. ")
    for mark in ("● agrees", "◆ does not agree", "■ control: fails, as it must", "✕ not determined: J2 (δ2)"):
        assert mark in plain
    assert "◆" not in printed(agreeing())


def test_where_nothing_is_determined_no_number_is_printed() -> None:
    answer = agreeing()
    likelihood = answer["plans"][2]["estimators"][0]
    for row in likelihood["parameters"]:
        row |= dict.fromkeys(("bias", "bias_mcse", "rmse", "predicted_std")) | {
            "status": "unidentifiable",
            "coverage": [],
        }
    lines = printed(answer).splitlines()
    row = [line for line in lines if line.startswith("likelihood")][-1]
    assert row.split() == ["likelihood", *["not", "determined"] * 4]
    assert "✕ not determined: J2 (δ2), J3 (δ3), J4 (δ4), J5 (δ5) and J6 (δ6)" in lines


def test_names_give_the_terminal_no_commands() -> None:
    answer = hostile()
    answer["notes"].append("[bold red]beware[/bold red] \x1b[2J")
    text = printed(answer)
    assert "[bold red]beware[/bold red] \\x1b[2J" in text
    for letter in ("\x00", "\x1b", "\u202e"):
        assert letter not in text
