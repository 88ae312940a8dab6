"""What would make an answer better, in words: of a weak plan, of what is required, of the floor."""

from dataclasses import replace

import pytest
from cells import good_plan

from zerobeam.analysis.observability.outlook import Outlook, OutlookRow
from zerobeam.analysis.tcp_region import TcpRegion
from zerobeam.commands.judging import exit_status_of_plan
from zerobeam.experiments.plans.constraints import check_plan
from zerobeam.words.message import message
from zerobeam.words.outlook_words import best_remedies, outlook_notes, plan_command, remedy_words


def row(remedy: str, shots: int, u: float | None, tcp: float, links: float, gain: float) -> OutlookRow:
    options = ("--shots", str(shots)) if remedy in ("postures", "more") else ()
    errors = (tcp / 2, tcp, links / 2, links)
    return OutlookRow(remedy, shots, {"delta2": u}, *errors, shots, gain, options)  # type: ignore[arg-type]


def outlook(required: float | None = None) -> Outlook:
    rows = (row("more", 12, 0.03, 4.5, 2.4, 0.8), row("postures", 7, 0.05, 4.6, 3.4, 0.6))
    repeat = row("repeat", 9, 0.159, 4.9, 3.9, 0.01)
    now = row("none", 7, 0.16, 5.0, 4.0, 0.0)
    return Outlook(now, (*rows, repeat), TcpRegion("central"), 2.0, measured=False, required_mm=required)


def test_a_weak_plan_that_others_make_a_pass_is_planned_anew_with_the_command() -> None:
    """It was said that no posture helps: to measure arm and tool, and state smaller tolerances."""
    action = message(check_plan(good_plan(7, seed=0, geometry=None))).action
    assert action.text.startswith("Plan 7 better postures: largest U 0.")
    assert action.command == "zerobeam plan optimal --header plan.yaml --shots 7 -o new-plan.yaml"


def test_remedies_that_gain_nothing_are_not_shown_first() -> None:
    what = outlook()
    shown = [remedy_words(row, what.now, {"delta2": "deg"}) for row in best_remedies(what)]
    assert [each.remedy for each in shown] == [
        "12 best postures, 2 again",
        "7 better postures, 2 again",
    ]
    assert shown[0].largest == "0.030°"
    assert best_remedies(replace(what, remedies=what.remedies[2:])) == []


@pytest.mark.parametrize(
    ("required", "text"),
    [
        (1.0, "None of these remedies reaches the required 1\u00a0mm (95 %)"),
        (4.55, "within reach: 12 best postures, 2 again."),
        (3.9, "within reach: 7 better postures, 2 again, and the links entered as well."),
    ],
)
def test_whether_what_is_required_can_be_reached(required: float, text: str) -> None:
    (note,) = [note for note in outlook_notes(outlook(required)) if "required" in note]
    assert note.endswith(f"{text}.".replace("..", "."))


@pytest.mark.parametrize(
    ("share", "text", "command"),
    [
        (1e-3, "Do not measure by this plan for 0.", None),
        (0.95, " is within reach by ", "--shots"),
        (1.05, "Nothing needs to change. Measure by this plan.", None),
    ],
)
def test_a_plan_that_falls_short_of_what_is_required_is_no_plain_pass(
    share: float, text: str, command: str | None
) -> None:
    """It was "Pass … Nothing needs to change. Measure by this plan" whatever was required."""
    check = check_plan(good_plan(10, geometry="exact"))
    assert check.outlook is not None
    error = check.outlook.now.tcp_95_mm
    assert error is not None
    judged = replace(check, outlook=replace(check.outlook, required_mm=share * error))
    content, short = message(judged), share < 1
    assert content.verdict.startswith("Pass; predicted not to meet the required " if short else "Pass. ")
    assert ("more than the required" in str(content.cause)) == short
    assert text in content.action.text
    assert (content.action.command is None) == (command is None)
    assert command is None or command in str(content.action.command)
    assert content.grade == ("weak" if short else "pass")
    assert exit_status_of_plan(judged) == int(short)


def test_the_floor_of_offsets_alone_is_said() -> None:
    assert outlook_notes(outlook())[1].replace("\u00a0", " ") == (
        "With 12 measurements the TCP is off by 2.2 mm (median) with offsets alone, by 1.2 mm where the links"
        " are entered as well."
    )


def test_a_remedy_without_a_plan_has_no_command() -> None:
    assert plan_command("zerobeam plan optimal --header a.yaml", outlook().remedies[2]) is None
    assert plan_command(None, outlook().remedies[0]) is None
