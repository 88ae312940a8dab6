import numpy as np
import pytest
from cells import good_plan, header, pattern_plan, plan_of
from judgements import reason_for, sentence_of, verdict

from zerobeam.analysis.observability.causes import NotResolvable, worst_direction
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.wording import listed


def judged(plan):
    problem = Problem.from_plan(plan)
    return problem, identify(problem, problem.nominal())


def test_pass_weak_degenerate():
    plan = good_plan()
    problem, identified = judged(plan)
    assert verdict(problem, identified) == "pass"
    assert sentence_of(problem, identified) == "delta2, delta3, delta4, delta5 and delta6 are identified."

    problem, identified = judged(plan_of(header(tolerance={"offset_deg": 0.02}), plan.postures))
    assert verdict(problem, identified) == "weak"
    weak = [
        name
        for name, own in zip(problem.parameters.names, identified.status, strict=True)
        if own == "weak" and name.startswith("delta")
    ]
    assert "delta2" in weak
    assert "delta6" not in weak
    sentence = sentence_of(problem, identified)
    assert f"{listed(weak)} are only weakly observable in these measurements." in sentence
    assert sentence.index("weakly") < sentence.index("identified")

    problem, identified = judged(pattern_plan("x"))
    assert verdict(problem, identified) == "degenerate"
    sentence = sentence_of(problem, identified)
    assert sentence.startswith("delta2 is unidentifiable from these measurements: joint 1 does not change")
    assert "delta2 is identified" not in sentence


def test_targets_and_held_ones_do_not_count():
    plan = good_plan()
    own = header(targets={"a": {}, "b": {}})
    problem, identified = judged(plan_of(own, plan.postures, ["a"] * 9 + ["b"]))
    assert "unidentifiable" in identified.status
    assert verdict(problem, identified) == "pass"
    every = [f"delta{i}" for i in range(1, 7)]
    problem, identified = judged(plan_of(header(held=every), plan.postures))
    assert verdict(problem, identified) == "pass"
    assert sentence_of(problem, identified) == "No offset is estimated: all are held."


def test_reasons_of_every_kind():
    problem, identified = judged(pattern_plan("x"))
    items = problem.parameters.items
    assert "base frame" in reason_for(identified, items[0], "held")
    assert "joint 1 does not change" in reason_for(identified, items[1], "unidentifiable")
    assert reason_for(identified, items[3], "identified") is None
    # The targets x takes part in delta2's gauge and in weaker things: the gauge is the reason.
    x = items[problem.parameters.index("psd.x")]
    assert "joint 1 does not change" in reason_for(identified, x, "unidentifiable")
    assert worst_direction(identified.facts.null_space, "psd.x").kind == "exact"


def test_without_a_direction_of_its_own_it_is_the_noise():
    _, identified = judged(good_plan())
    found = worst_direction(identified.facts.null_space, "delta2")
    assert found.cause == NotResolvable()
    assert found.combination == {"delta2": 1.0}
    assert np.isfinite(identified.data_std[1])


@pytest.mark.parametrize(
    ("names", "text"), [(["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_lists_in_words(names, text):
    assert listed(names) == text
