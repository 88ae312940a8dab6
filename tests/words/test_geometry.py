"""Sentences on the geometry: what u is worth, what sets it, why a rung of the ladder is kept or not."""

from dataclasses import dataclass, replace

import pytest

from zerobeam.analysis.estimation.tolerance_factors import Factors
from zerobeam.analysis.observability.geometry_result import Confounded, GeometryResult, LinkTolerances, Rung
from zerobeam.analysis.status import Status
from zerobeam.words.geometry_words import (
    confounded_sentence,
    factors_sentence,
    rung_reason,
    tolerances_words,
    worth_sentence,
)
from zerobeam.words.wording import person


@dataclass(frozen=True)
class Row:
    name: str
    unit: str
    std: float | None
    status: Status = "identified"
    tolerance_share: float | None = None


NOMINAL = GeometryResult(
    tolerance=None,
    considered_tolerance=LinkTolerances(0.3, 0.1),
    factors=None,
    ladder=(),
    consider={"delta2": 0.018, "delta3": 0.0901, "delta4": None},
    at_half={},
    at_twice={},
)
STATED = replace(
    NOMINAL,
    tolerance=NOMINAL.considered_tolerance,
    at_half={"delta2": 0.004, "delta3": 0.006},
    at_twice={"delta2": 0.02, "delta3": 0.04},
    confounded=(
        Confounded("delta3", "link6.a", -0.9),
        Confounded("delta3", "tool.z", 0.3),
        Confounded("delta2", "link2.alpha", 0.1),
    ),
)
ROWS = [Row("delta2", "deg", 0.006), Row("delta3", "deg", 0.009), Row("delta4", "deg", None)]


def test_nominal_geometry_says_what_u_is_if_the_arm_deviates() -> None:
    assert worth_sentence(NOMINAL, ROWS) == (
        "Leave out geometry: exact to estimate the links: if they deviate by 0.3\u00a0mm and 0.1°,"
        " u is 0.018° to 0.090°, not 0.0060° to 0.0090°."
    )


def test_no_range_includes_what_is_assumed() -> None:
    rows = [*ROWS, Row("delta6", "deg", 0.05, "assumed")]
    assert worth_sentence(STATED, rows) == worth_sentence(STATED, ROWS)
    assert worth_sentence(STATED, rows[-1:]) is None


def test_stated_tolerances_are_halved_and_doubled() -> None:
    said = worth_sentence(STATED, ROWS) or ""
    assert "within its tolerances (0.3\u00a0mm and 0.1°) u is 0.0060° to 0.0090°" in said
    assert "With half the tolerances it would be 0.0040° to 0.0060°, with twice 0.020° to 0.040°" in said
    assert said.endswith(
        "with nominal geometry, if the arm deviates from it by these tolerances, 0.018° to 0.090°."
    )
    with_factors = replace(STATED, factors=Factors(2.0, 0.5, None, 1.5, (0.25, 0.4, None, 0.3)))
    assert "multiplied by the factors that the data give them" in (worth_sentence(with_factors, ROWS) or "")
    assert "half the tolerances" not in (worth_sentence(with_factors, ROWS) or "")
    assert "lengths by 2.0 (relative u 25\u00a0%)" in (factors_sentence(with_factors) or "")
    assert "and harmonics by 1.5 (relative u 30\u00a0%)" in (factors_sentence(with_factors) or "")
    assert "gravity" not in (factors_sentence(with_factors) or "")
    assert factors_sentence(STATED) is None


def test_nothing_is_said_of_offsets_that_are_not_determined() -> None:
    lost = replace(NOMINAL, consider=dict.fromkeys(NOMINAL.consider))
    assert worth_sentence(lost, [replace(row, std=None) for row in ROWS]) is None


def test_degrees_and_millimetres_are_not_mixed() -> None:
    own = replace(NOMINAL, consider={"delta2": 0.018, "delta3": 0.5})
    said = worth_sentence(own, [ROWS[0], Row("delta3", "mm", 0.1)]) or ""
    assert "u is 0.018° and 0.50\u00a0mm, not 0.0060° and 0.10\u00a0mm." in said


def test_tolerances_of_each_link_are_a_range() -> None:
    own = replace(STATED, considered_tolerance=LinkTolerances((0.1, 0.5), (0.1, 0.1)))
    assert tolerances_words(own) == "0.1\u00a0mm to 0.5\u00a0mm and 0.1°"


def test_an_offset_that_the_tolerances_set_names_its_rival() -> None:
    assert confounded_sentence(STATED, "delta3", 0.92, person) == (
        "92\u00a0% of the variance of J3 (δ3) comes from how far the links may deviate: in these postures"
        " the estimate is correlated with link 6, a (\u22120.90). Other postures can separate them, the same"
        " ones again cannot."
    )
    assert (confounded_sentence(STATED, "delta2", 0.92, person) or "").endswith(
        "the estimate is not correlated with any one of them alone."
    )
    # Below a half of the variance there is nothing to explain, and for nominal geometry no share.
    assert confounded_sentence(STATED, "delta3", 0.4, person) is None
    assert confounded_sentence(NOMINAL, "delta3", None, person) is None


def test_what_is_not_known_of_one_offset_is_no_range_of_the_others() -> None:
    """The curvature at the mode does not say what u of J3 would be at twice the tolerances."""
    partly = replace(STATED, at_twice={"delta2": 0.02, "delta3": None})
    said = worth_sentence(partly, ROWS) or ""
    assert "with twice unknown;" in said
    assert "None" not in said


@pytest.mark.parametrize(
    ("held_out", "evidence", "words"),
    [
        (0.4, 10.0, "with its prior; predicts better, evidence rises"),
        (0.6, 10.0, "with its prior; predicts no better, evidence rises"),
        (0.4, -10.0, "with its prior; predicts better, evidence falls"),
        (0.6, -10.0, "with its prior; predicts no better, evidence falls"),
        (None, -10.0, "with its prior; evidence falls"),
    ],
)
def test_a_rung_counts_with_its_prior_whatever_the_measurements_say_of_it(
    held_out: float | None, evidence: float, words: str
) -> None:
    ladder = (
        Rung("offsets", 8, 1.0, -5.0, False),
        Rung("geometry", 25, 0.5, 0.0, True),
        Rung("harmonics", 30, held_out, evidence, True),
    )
    assert rung_reason(ladder, 0) == "for comparison"
    assert rung_reason(ladder, 1) == "with its prior; predicts better, evidence rises"
    assert rung_reason(ladder, 2) == words
