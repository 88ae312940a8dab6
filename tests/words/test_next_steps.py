"""What to do with an answer, as data: values only where they may be entered."""

from __future__ import annotations

import pytest

import zerobeam as zb
from zerobeam.experiments.demos import demo_runs
from zerobeam.words.message import message, next_steps


@pytest.mark.parametrize(("number", "verdict"), [(0, "pass"), (1, "degenerate")])
@pytest.mark.one_in(2)
def test_values_are_offered_of_a_pass_alone(number: int, verdict: str) -> None:
    found = zb.analyse(zb.read_run(demo_runs()[number].path), ess=100)
    assert found.verdict == verdict
    steps = next_steps(found.result, message(found.result))
    known = [row.name for row in found.offsets if row.status == "identified"]
    assert [own.name for own in steps.enter] == (known if verdict == "pass" else [])
    assert any(step.commands for step in steps.steps)
    stated = found.to_json()["next_steps"]
    assert [own["text"] for own in stated["steps"]] == [own.text for own in steps.steps]
    assert stated["enter"] == [vars(own) for own in steps.enter]
