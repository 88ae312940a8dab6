"""What a report says, section by section, before it is set in HTML or PDF."""

import re
from dataclasses import replace
from typing import Any

import pytest
from example_results import (
    EXAMPLES,
    FORBIDDEN,
    good,
    held_out,
    hostile,
    misfit,
    outlier,
    separate,
    uncalibrated,
    unconverged,
    x_pattern,
)
from pages import paragraphs, strings, table, tables
from study_text import texts_of

from zerobeam.analysis.answer.findings import HeldOutMisfit
from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.misfit import LackOfFit
from zerobeam.analysis.posterior.posterior import Intervals
from zerobeam.analysis.row import ParameterRow
from zerobeam.model.errors import UnsoundResult
from zerobeam.reports.run.report import report_page
from zerobeam.reports.style.blocks import Directions, Facts, Legend, Section, Table
from zerobeam.words.wording import NOT_DETERMINED, label


def section(result: Result, title: str) -> Section:
    (found,) = [own for own in report_page(result).sections if own.title == title]
    return found


def has(result: Result, title: str) -> bool:
    return title in [own.title for own in report_page(result).sections]


def facts(own: Section) -> dict[str, str]:
    (found,) = [block for block in own.all if isinstance(block, Facts)]
    return dict(found.rows)


def row_of(table: Table, name: str) -> str:
    """The cells of the row behind its name, with a line between them."""
    (row,) = [row for row in texts_of(table) if row[0] == name]
    return " | ".join(row[1:])


def everything(result: Result) -> str:
    return " ".join(strings(report_page(result)))


def test_an_identified_offset_shows_estimate_interval_and_status() -> None:
    row = row_of(table(section(good(), "Offsets")), "J2 (δ2)")
    assert row == "\u22121.222° | 0.041° | identified | 0.35°"


def test_a_held_offset_says_where_and_why() -> None:
    own = section(good(), "Offsets")
    assert row_of(table(own), "J1 (δ1)") == "held at 0° | held | —"
    (legend,) = [block for block in own.all if isinstance(block, Legend)]
    reasons = {entry.word: entry.text for entry in legend.reasons}
    assert reasons["J1 (δ1):"].startswith("joint 1 defines the base frame")


def test_no_number_stands_in_the_row_of_an_unidentifiable_parameter() -> None:
    for result in (x_pattern(), hostile()):
        count = 0
        for own in (*tables(section(result, "Offsets")), *tables(section(result, "Fit quality"))):
            for row in own.rows:
                if row.tone == "unidentifiable" and row.cells[-1].text == NOT_DETERMINED:
                    assert len(row.cells) == 4  # a distance: length and sigma as stated, nothing of the fit
                elif row.tone == "unidentifiable":
                    first, status, *rest = [cell.text for cell in row.cells[1:]]
                    assert (first, status) == (NOT_DETERMINED, "unidentifiable")
                    assert set(rest) <= {"—"}
                    count += 1
        assert count == sum(row.status == "unidentifiable" for row in result.parameters) > 0


def test_the_posterior_table_has_no_number_for_what_comes_from_the_prior() -> None:
    assert row_of(table(section(x_pattern(), "Posterior")), "J2 (δ2)") == "prior only"
    text = everything(x_pattern())
    assert f"{abs(FORBIDDEN):.2f}" not in text
    assert "4.98" not in text
    assert "9.77" not in text


def test_the_unknown_names_combination_kind_reason_and_remedy() -> None:
    unknown = section(x_pattern(), "What cannot be determined")
    assert paragraphs(unknown).startswith("J2 (δ2), psd.x")
    (directions,) = [block for block in unknown.all if isinstance(block, Directions)]
    item = directions.items[0]
    assert item.combination == "J2 (δ2) \u2212 0.32\u00a0psd.z \u2212 0.22\u00a0psd.x"
    assert item.kind.startswith("exact null-space direction")
    assert item.reason.startswith("joint 1 varies by only 0.030")
    assert item.remedy.startswith("measure again and vary joint 1 by 90°")
    assert "J6 (δ6) is as good as what is assumed" in paragraphs(section(good(), "What cannot be determined"))
    assert not has(misfit(), "What cannot be determined")  # nothing that follows from a wrong model


@pytest.mark.parametrize(
    ("changes", "finding", "words"),
    [
        ({}, None, "agree with the stated noise"),
        ({"chi2": 60.0, "p_value": 1e-9}, LackOfFit(60.0, 6, 1e-9), "Lack of fit: residuals are 3.2 times"),
        ({"chi2": 0.1, "p_value": 0.9999, "p_small": 1e-4}, None, "smaller than the stated noise"),
        ({"chi2": 0.1, "p_value": 0.9999, "p_small": 0.2}, None, "agree with the stated noise"),
        ({"chi2": 0.1, "p_value": 0.9999, "p_small": 0.2}, None, "far smaller than noise and"),
        ({"converged": False, "reason": "too many steps"}, None, "did not converge (too many steps)"),
    ],
)
def test_the_fit_is_judged_in_plain_words(
    changes: dict[str, Any], finding: LackOfFit | None, words: str
) -> None:
    likelihood = replace(good().likelihood, **changes)
    result = replace(
        good(),
        fits=replace(good().fits, likelihood=likelihood),
        findings=() if finding is None else (finding,),
    )
    assert words in paragraphs(section(result, "Fit quality"))


def test_a_fit_that_did_not_converge_is_said_first() -> None:
    result = replace(
        misfit(), fits=replace(misfit().fits, likelihood=replace(misfit().likelihood, converged=False))
    )
    said = report_page(result).message
    assert said is not None
    assert "The fit did not converge" in said.verdict


def test_all_of_a_message_is_sentences() -> None:
    for result in EXAMPLES.values():
        said = report_page(result).message
        assert said is not None
        assert report_page(result).notes == []
        assert all(
            text.endswith((".", "?", "!")) for text in (said.verdict, said.action.text, *said.cautions)
        )


def test_likelihood_and_midpoint_stand_side_by_side() -> None:
    own = section(good(), "Fit quality")
    assert row_of(table(own, "Quality"), "Residuals after, rms") == "0.149\u00a0mm | 0.278\u00a0mm"
    assert row_of(table(own, "Offsets by both costs"), "J2 (δ2)") == "\u22121.222° | \u22121.221° | 0.026"
    gone = replace(
        good().midpoint, available=False, converged=False, reason="parallel beams", cost=None, rms_mm=None
    )
    rows = tuple(replace(row, midpoint=None) for row in good().parameters)
    alone = section(
        replace(good(), fits=replace(good().fits, midpoint=gone), parameters=type(good().parameters)(rows)),
        "Fit quality",
    )
    assert not any(table.caption.startswith("Offsets by both") for table in tables(alone))
    assert "(eq. 8) is not available: parallel beams." in paragraphs(alone)
    assert len(table(alone, "Quality").columns) == 2


def test_distances_stand_next_to_what_was_stated() -> None:
    own = table(section(misfit(), "Fit quality"), "Distances")
    row = row_of(own, "left_1a and left_1b").replace("\u00a0", " ")
    assert row == "50 mm | 0.2 mm | 49.93 mm | 0.11 mm"
    (apart,) = hostile().distances
    lost = replace(hostile(), distances=(replace(apart, estimate=None, std=None),))
    assert NOT_DETERMINED in texts_of(table(section(lost, "Fit quality"), "Distances"))[0]
    assert not any(table.caption.startswith("Distances") for table in tables(section(good(), "Fit quality")))


def test_noise_factors_have_a_table_of_their_own_and_are_so_many_times_the_stated() -> None:
    own = section(separate(), "Fit quality")
    noise = table(own, "Noise")
    assert row_of(noise, "noise.joint") == "0.93\u00a0times | 0.58 to 1.51\u00a0times | identified"
    assert row_of(noise, "noise.spot") == f"{NOT_DETERMINED} | unidentifiable"
    assert row_of(table(own, "Quality"), "p-value").startswith("not defined: the noise was estimated | ")
    assert "noise" in table(section(separate(), "Posterior")).caption
    plain = section(good(), "Fit quality")
    assert not any(table.caption.startswith("Noise") for table in tables(plain))
    assert row_of(table(plain, "Quality"), "p-value").startswith("0.900 | ")


def test_against_a_fitted_noise_the_fit_is_not_said_to_agree_with_the_stated_one() -> None:
    told = replace(separate(), fits=replace(separate().fits, likelihood=good().likelihood))
    assert "agree with the fitted noise" in paragraphs(section(told, "Fit quality"))
    assert "agree with the stated noise" in paragraphs(section(good(), "Fit quality"))


def test_an_unconverged_posterior_is_not_shown() -> None:
    own = section(unconverged(), "Posterior")
    assert tables(own) == []
    assert paragraphs(own).startswith("No posterior is shown: the posterior has not converged (R-hat")


def test_intervals_stand_side_by_side_only_where_there_is_something_to_compare() -> None:
    title = "Intervals by three methods"
    own = section(uncalibrated(), title)
    assert row_of(table(own), "tool.tilt2").startswith("\u22120.09 to 0.33° | \u22120.09 to 0.33° | ")
    assert paragraphs(own).endswith("They agree.")
    assert not has(good(), title)
    first = uncalibrated().intervals[0]
    lost = replace(first, profile=None, posterior=None, differ=True)
    own = section(replace(uncalibrated(), intervals=(lost,)), title)
    assert row_of(table(own), "J2 (δ2)").endswith(" | no end found | not sampled")
    assert "for J2 (δ2): do not rely on one" in paragraphs(own)


def test_with_noise_factors_the_profile_is_not_defined_and_the_rest_is_compared() -> None:
    own = section(separate(), "Intervals by three methods")
    assert row_of(table(own), "noise.joint").startswith("0.58 to 1.51\u00a0times | not defined | ")
    assert "noise.joint: do not rely on one" in paragraphs(own)


def test_of_many_measurements_the_worst_are_shown_and_the_reader_is_told() -> None:
    result = misfit()
    own = section(result, "Residuals")
    heaviest = max(result.shots, key=lambda shot: shot.cooks or 0.0)
    ranked = sorted(result.shots, key=lambda shot: -shot.whitened)
    shown = [row[0] for row in texts_of(table(own))]
    assert shown[:20] == [str(shot.shot) for shot in ranked[:20]]
    assert len(shown) == (20 if heaviest in ranked[:20] else 21)
    assert "Of 96 measurements the table shows the 20 worst" in paragraphs(own)
    assert len(table(section(good(), "Residuals")).rows) == 7


def test_the_measurement_of_the_most_influence_is_named_and_shown() -> None:
    heaviest = max(good().shots, key=lambda shot: shot.cooks or 0.0)
    few = paragraphs(section(good(), "Residuals"))
    assert f"Most influential measurement: {heaviest.shot} (Cook’s distance" in few
    many = misfit()
    least = min(range(len(many.shots)), key=lambda i: many.shots[i].whitened)
    heavy = replace(many.shots[least], cooks=99.0)
    shots = (*many.shots[:least], heavy, *many.shots[least + 1 :])
    own = table(section(replace(many, shots=shots), "Residuals"))
    assert own.rows[-1].cells[0].text == str(heavy.shot)
    assert len(own.rows) == 21
    assert own.caption.endswith("and the most influential measurement")


def test_a_robust_fit_names_its_outliers_and_weighs_every_measurement() -> None:
    own = section(outlier(), "Robust fit")
    assert "Huber’s loss: the weight of a normalised residual r above 2.45 is 2.45/r" in paragraphs(own)
    assert "Outlier: 2 (weight 0.19)." in paragraphs(own)
    assert tables(own) == []  # a misfit: no agreement of estimators is shown
    of_a_pass = replace(outlier().robust, weights=(1.0,) * 7, outliers=())
    compared = table(section(replace(good(), robust=of_a_pass), "Robust fit"))
    row = row_of(compared, "J3 (δ3)").split(" | ")
    assert row[:2] == ["\u22120.686°", "\u22120.664°"]
    assert float(row[2].rstrip("°")) == pytest.approx(0.042, abs=0.002)  # 2 u
    assert not any("psd" in row[0] for row in texts_of(compared))
    residuals = table(section(outlier(), "Residuals"))
    assert [column.text for column in residuals.columns][-2:] == ["weight", "outlier"]
    ends = [row[-2:] for row in texts_of(residuals)]
    assert ends == [["0.19", "yes"] if i == 2 else ["1.00", "no"] for i in range(12)]
    plain = table(section(good(), "Residuals"))
    assert "weight" not in [column.text for column in plain.columns]
    assert not has(good(), "Robust fit")


def test_a_robust_fit_without_outliers_says_so() -> None:
    told = replace(outlier().robust, loss="student", tuning=4.0, outliers=())
    result = replace(outlier(), robust=told)
    words = paragraphs(section(result, "Robust fit"))
    assert "Student’s loss with 4 degrees of freedom" in words
    assert "No outlier." in words
    assert [column.text for column in table(section(result, "Residuals")).columns][-1] == "weight"


def test_a_robust_fit_without_a_covariance_has_no_interval() -> None:
    told = outlier().robust
    assert told is not None
    bare = tuple(replace(row, std=None, interval95=None) for row in told.parameters)
    plain = replace(told, parameters=bare, with_uncertainty=False, weights=(1.0,) * 7, outliers=())
    result = replace(good(), robust=plain)
    own = section(result, "Robust fit")
    assert "It has no uncertainty" in paragraphs(own)
    assert row_of(table(own), "J3 (δ3)").split(" | ")[2] == "none"
    # As it comes out where a measurement has leverage 1.
    assert "It has no uncertainty" in paragraphs(section(hostile(), "Robust fit"))
    assert "It has no uncertainty" not in paragraphs(section(outlier(), "Robust fit"))


def test_an_unconverged_robust_fit_is_not_shown() -> None:
    told = replace(outlier().robust, converged=False, reason="the weights did not settle")
    result = replace(outlier(), robust=told)
    own = section(result, "Robust fit")
    assert tables(own) == []
    assert paragraphs(own) == "The robust fit did not converge (the weights did not settle) and is not shown."
    assert "weight" not in [column.text for column in table(section(result, "Residuals")).columns]


def test_neither_a_robust_fit_nor_an_interval_tells_what_the_data_do_not() -> None:
    assert row_of(table(section(hostile(), "Robust fit")), "J2 (δ2)") == NOT_DETERMINED
    ends = (FORBIDDEN - 0.002, FORBIDDEN + 0.002)
    with pytest.raises(UnsoundResult, match="delta2"):
        ParameterRow("delta2", "deg", "unidentifiable", FORBIDDEN, 0.001, ends)
    with pytest.raises(UnsoundResult, match="delta2"):
        Intervals("delta2", "deg", "unidentifiable", ends, None, None, True)
    assert f"{abs(FORBIDDEN):.2f}" not in everything(hostile())


def test_an_outlier_of_the_robust_fit_is_among_the_worst_of_many_measurements() -> None:
    result = misfit()
    best = min(result.shots, key=lambda shot: shot.whitened).shot
    robust = outlier().robust
    assert robust is not None
    told = replace(robust, parameters=(), weights=(1.0,) * len(result.shots), outliers=(best,))
    shown = texts_of(table(section(replace(result, robust=told), "Residuals")))
    assert shown[0][0] == str(best)
    assert str(best) not in [row[0] for row in texts_of(table(section(result, "Residuals")))]


def test_held_out_targets_are_judged_in_plain_words() -> None:
    title = "Held-out targets"
    own = section(held_out(), title)
    assert facts(own)["Targets"] == "2: left and right"
    assert facts(own)["Residuals with them, rms"] == "0.517\u00a0mm"
    assert "they do not contradict the offsets" in paragraphs(own)
    assert not has(good(), title)
    hold_out = held_out().hold_out
    assert hold_out is not None
    bad = replace(held_out(), findings=(HeldOutMisfit(("left", "right"), 0.5, 3.0),))
    words = paragraphs(section(bad, title))
    assert "The residuals are 3.0 times what noise and fit explain: the offsets do not carry over" in words
    assert "contradict" not in words
    none = replace(hold_out, chi2=None, dof=0, p_value=None)
    own = section(replace(held_out(), hold_out=none), title)
    assert "No judgement: zero degrees of freedom" in paragraphs(own)
    assert facts(own)["p-value"] == "not available"
    lost = replace(hold_out, **dict.fromkeys(("chi2", "dof", "p_value", "rms_mm")), failure="too many steps")
    own = section(replace(held_out(), hold_out=lost), title)
    assert "No judgement: the fit without them did not converge: too many steps." in paragraphs(own)


def test_inputs_carry_hash_seed_versions_and_provenance() -> None:
    inputs = facts(section(good(), "Inputs"))
    assert inputs["SHA-256 of the run"] == good().inputs.sha256
    assert inputs["Seed"] == "20140803"
    assert f"casadi {good().inputs.versions['casadi']}" in inputs["Versions"]
    assert facts(section(good(), "Provenance"))["serial number"] == "1600-500123"
    settings = facts(section(good(), "Settings of the run"))
    assert settings["noise.joint_deg"] == "0.01"
    assert not any("provenance" in name for name in settings)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_string_can_be_encoded_and_seen(name: str) -> None:
    for text in strings(report_page(EXAMPLES[name])):
        text.encode()
        assert not re.search(r"[\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", text)
        assert not re.search(r"\bnan\b|\binf\b|None", text)


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name != "hostile"])
def test_offsets_are_called_as_the_pendant_does(name: str) -> None:
    """In sentences and tables alike; only what is copied from the file keeps its keys."""
    page = report_page(EXAMPLES[name])
    copied = ("Provenance", "Settings of the run", "What to do next")  # commands to copy name offsets by keys
    own = [section for section in page.sections if section.title not in copied]
    text = " ".join((*strings(page.verdict), *page.notes, *strings(own)))
    assert "delta" not in text
    assert label("delta2") in text
