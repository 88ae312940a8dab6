"""The acceptance test of a corrected robot in the terminal: its plan, and its answer."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from ...analysis.acceptance.acceptance_test import (
    FALSE_ALARM,
    POWER,
    Acceptance,
    AcceptanceResult,
    EnteredOffset,
    VerificationPlan,
)
from ...words import numbers
from ...words.wording import counted, label, listed
from ..style.blocks import Table, row_of, table_of
from ..style.console import rich_table

_HEAD: dict[Acceptance, tuple[str, str]] = {
    "pass": ("Pass", "bold green"),
    "fail": ("Fail", "bold red"),
    "inconclusive": ("Inconclusive", "bold yellow"),
}
_STEPS = (
    "Enter the values, bring the target back to about its place, and record these postures with the"
    " corrected robot, as the run was recorded."
)
_ENTERED = {"not entered": "left at the old value", "wrong sign": "entered with the wrong sign"}


def print_verification(console: Console, plan: VerificationPlan) -> None:
    """What the planned test would notice."""
    count = counted(len(plan.rows), "posture")
    console.print(Text(f"{count} of the run: measurements {listed([str(row) for row in plan.rows], 20)}."))
    console.print(rich_table(_table(plan.offsets)))
    console.print(Text(_about(plan.offsets)))
    console.print(Text(_STEPS))


def print_acceptance(console: Console, answer: AcceptanceResult) -> None:
    """The verdict, its reason, and what the test could notice."""
    word, style = _HEAD[answer.verdict]
    console.print(Text(f"{word}. ", style=style) + Text(reason(answer)))
    console.print(rich_table(_table(answer.offsets)))
    console.print(Text(_about(answer.offsets)))
    for mistake in answer.mistakes[:3]:
        names = listed([label(name) for name in mistake.offsets])
        p_value = numbers.p_words(mistake.p_value)
        console.print(Text(f"It would fit if {names} had been {_ENTERED[mistake.kind]} ({p_value})."))


def reason(answer: AcceptanceResult) -> str:
    """Why the verdict is what it is, in a sentence."""
    rms = f"{numbers.significant(answer.rms_mm, 2, 'mm')} rms"
    expected = numbers.significant(answer.expected_mm, 2, "mm")
    if answer.p_value is None or answer.statistic is None:
        count = counted(answer.measurements, "measurement")
        return f"{count} leave no degree of freedom: record more postures."
    chi2 = numbers.significant(answer.statistic * answer.dof)
    measure = f"χ² {chi2}, {answer.dof} dof, {numbers.p_words(answer.p_value)}"
    if answer.verdict == "fail":
        return (
            f"The corrected robot is not where its calibration says: residuals {rms}, where {expected} were"
            f" predicted ({measure}). Do not use it; a false alarm has a probability of {FALSE_ALARM:.0%}."
        )
    agrees = f"Residuals {rms} agree with the prediction ({measure})"
    if answer.verdict == "pass":
        return (
            f"{agrees}, and an error of the tolerance in any offset would have been noticed with a"
            f" probability of at least {POWER:.0%}."
        )
    names = listed([label(offset.name) for offset in answer.unnoticed])
    return (
        f"{agrees}, but an error of the tolerance in {names} might have gone unnoticed: record more postures"
        " (zerobeam plan verify RUN -o PLAN --shots N)."
    )


def _about(offsets: Sequence[EnteredOffset]) -> str:
    lacking = any(offset.power < POWER for offset in offsets)
    return (
        "Probability of noticing an error. A correct calibration fails with a probability of"
        f" {FALSE_ALARM:.0%}. To pass, the test needs {POWER:.0%} against an error of the tolerance in each"
        " offset"
        f"{': here it can only fail. Record more postures.' if lacking else '.'}"
    )


def _table(offsets: Sequence[EnteredOffset]) -> Table:
    rows = [
        row_of(
            label(offset.name),
            numbers.estimate(offset.entered, offset.std, offset.unit),
            f"{numbers.exact(offset.tolerance, offset.unit)}: {_percent(offset.power)}",
            _percent(offset.power_not_entered),
        )
        for offset in offsets
    ]
    heads = ("entered", "error of the tolerance", "not entered")
    columns = [("name", "left"), *((head, "right") for head in heads)]
    return table_of("What the test notices", columns, rows)


def _percent(share: float) -> str:
    """Rounded down: what is less than enough never looks like enough."""
    return "over 99 %" if share > 0.99 else f"{int(100 * share)} %"
