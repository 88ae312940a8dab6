"""The acceptance test of a corrected robot in the terminal: its plan, and its answer."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from ...analysis.acceptance.acceptance import Acceptance, AcceptancePlan
from ...experiments.acceptance_files import Verified
from ...words.acceptance_words import (
    ACCEPTANCE_WORDS,
    acceptance_reason,
    measured_sentence,
    mistake_sentence,
    narrow_sentence,
    noticed_sentence,
)
from ...words.controllers import no_offsets_words, taken_by
from ...words.wording import counted, listed
from ..acceptance.acceptance_page import noticed_table
from ..style.rich_console import rich_table

_STYLE: dict[Acceptance, str] = {
    "pass": "bold green",
    "fail": "bold red",
    "inconclusive": "bold yellow",
}
_STEPS = (
    "Enter the values, bring targets back to about their places, and record these postures with the"
    " corrected robot, as the run was recorded."
)


_NOTHING_ENTERED = (
    "This plan and zerobeam verify are for a robot into which the values were entered; with corrected"
    " programs or a corrected model the arm moves otherwise. To test the calibration there, measure a second"
    " run with the same header: zerobeam analyse RUN --hold-out NEW.jsonl."
)


def print_acceptance_plan(console: Console, plan: AcceptancePlan, vendor: str | None) -> None:
    """What the planned test would notice, and what to do at a controller of this vendor."""
    count = counted(len(plan.rows), "posture")
    console.print(Text(f"{count} of the run: measurements {listed([str(row) for row in plan.rows], 20)}."))
    console.print(rich_table(noticed_table(plan.offsets)))
    console.print(Text(noticed_sentence(plan.offsets)))
    if plan.narrow:
        console.print(Text(narrow_sentence()))
    caution = f"Caution: {no_offsets_words(vendor)}. {_NOTHING_ENTERED}"
    console.print(Text(_STEPS if taken_by(vendor) == "offsets" else caution))


def print_acceptance(console: Console, verified: Verified) -> None:
    """The verdict, its reason, what was measured, and what the test could notice."""
    word = Text(f"{ACCEPTANCE_WORDS[verified.verdict]}. ", style=_STYLE[verified.verdict])
    console.print(word + Text(acceptance_reason(verified)))
    console.print(Text(measured_sentence(verified.measured)))
    console.print(rich_table(noticed_table(verified.offsets)))
    console.print(Text(noticed_sentence(verified.offsets)))
    for mistake in verified.mistakes[:3]:
        console.print(Text(mistake_sentence(mistake)))
