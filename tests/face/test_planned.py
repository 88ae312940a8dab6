"""Check, optimal plan and simulation through the Python face."""

import re

import numpy as np
import pytest

import zerobeam as zb
from zerobeam.words.message import message
from zerobeam.words.sentences import to_json

HEADER = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
}
TARGET = (900, 0, 0)


def in_a_row(**changes) -> zb.Plan:
    """Joint 1 at rest: nothing says what joint 2 does."""
    postures = [[0, 10 * k, 20 - 5 * k, 0, 50 - 5 * k, 0] for k in range(5)]
    header = {**HEADER, "target_priors": {"psd": {"guess_mm": TARGET}}, **changes}
    return zb.Plan.from_arrays(postures=postures, unit="deg", **header)


def test_the_best_plan_is_checked(best: zb.OptimalPlan) -> None:
    assert best.plan.postures.shape == (22, 6)  # two of them again
    assert isinstance(best.check, zb.Check)
    assert best.check.verdict == "pass"
    assert to_json(zb.check(best.plan)) == best.check.to_json()
    assert repr(best) == repr(best.check)
    assert best.check._repr_html_() == best._repr_html_()


@pytest.mark.long
def test_a_header_file_says_the_same(best: zb.OptimalPlan, tmp_path) -> None:
    (tmp_path / "header.yaml").write_text(
        "robot: irb1600\ntool: {kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\n"
    )
    again = zb.optimal_plan(tmp_path / "header.yaml", TARGET, candidates=300)
    np.testing.assert_array_equal(again.plan.postures, best.plan.postures)


def test_a_check_has_rows_a_table_and_a_scene(best: zb.OptimalPlan) -> None:
    row = best.check["delta2"]
    assert row.u == row.std
    frame = best.check.offsets.to_frame()
    assert frame.loc["delta2", "u"] == row.u
    assert np.isnan(frame.loc["delta1", "u"])
    assert best.check.plot.scene().page.count("<canvas") == 1
    assert len(repr(best.check).splitlines()) < 20


def test_a_degenerate_plan_has_no_number_where_there_is_none() -> None:
    found = zb.check(in_a_row())
    assert found.verdict == "degenerate"
    assert (found["delta2"].status, found["delta2"].u) == ("unidentifiable", None)
    (line,) = (line for line in repr(found).splitlines() if line.startswith("  J2  "))
    assert not any(letter.isdigit() for letter in line.replace("J2", ""))
    assert np.isnan(found.offsets.to_frame().loc["delta2", "u"])
    assert "<script" not in found._repr_html_()


def test_a_check_says_it_all_and_what_to_change(best: zb.OptimalPlan) -> None:
    """The message of the command, whole; of a pass that nothing needs to change."""
    found = zb.check(in_a_row())
    content = message(found)
    for shown in (" ".join(repr(found).split()), re.sub(r"<[^>]+>", "", found._repr_html_())):
        assert "…" not in shown
        for sentence in (content.verdict, content.cause, content.action.text):
            assert " ".join(sentence.split()) in " ".join(shown.split())
    assert "predicted U: J2 (δ2) not determined →" in " ".join(repr(found).split())
    assert "To do: Nothing needs to change." in repr(best)


@pytest.mark.long
def test_a_simulated_run_has_the_offsets_that_were_stated(best: zb.OptimalPlan) -> None:
    run = zb.simulate(best.plan, {"delta2": 0.3, "delta4": -0.2}, seed=1)
    assert run.header.provenance["true delta2 (deg)"] == 0.3
    sol = zb.analyse(run, ess=100)
    for name, true in {"delta2": 0.3, "delta3": 0, "delta4": -0.2, "delta5": 0, "delta6": 0}.items():
        # Five offsets of one simulated run: beyond five standard uncertainties by chance once in 300 000.
        assert abs(sol[name].estimate - true) < 5 * sol[name].u
    assert zb.simulate(best.plan, {"delta2": 0.3, "delta4": -0.2}, seed=1).sha256 == run.sha256
    assert zb.simulate(best.plan, {"delta2": 0.3, "delta4": -0.2}, seed=2).sha256 != run.sha256


def test_without_offsets_they_are_random(best: zb.OptimalPlan) -> None:
    true = [zb.simulate(best.plan, seed=seed).header.provenance["true delta2 (deg)"] for seed in range(2)]
    assert true[0] != true[1]


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"header": 3}, "header"),
        ({"header": {**HEADER, "robt": 1}}, "header['robt']"),
        ({"header": {**HEADER, "tool": {"kind": "laser"}}}, "header['tool']"),
        ({"target": (900, 0)}, "target"),
        ({"target": (900, 0, "x")}, "target"),
        ({"shots": 1}, "shots"),
        ({"shots": 2.5}, "shots"),
        ({"candidates": 1}, "candidates"),
        ({"criterion": "B"}, "criterion"),
        ({"facing": (0, 0, 0)}, "facing"),
        ({"acceptance_deg": 120}, "acceptance_deg"),
        ({"beam_mm": (500, 400)}, "beam_mm"),
        ({"margin_deg": -1}, "margin_deg"),
        ({"tolerance": -1}, "tolerance"),
        ({"tolerance": 1e-9, "max_shots": 8}, "tolerance"),
    ],
)
@pytest.mark.at_length(r"^changes14")
def test_a_bad_argument_of_an_optimal_plan_is_named(changes, argument) -> None:
    with pytest.raises(zb.BadInput) as caught:
        zb.optimal_plan(**{"header": HEADER, "target": TARGET, "candidates": 100, **changes})
    assert caught.value.argument == argument


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("offsets", "argument"),
    [
        ({"delta22": 1}, "offsets"),
        ({"delta2": float("inf")}, "offsets['delta2']"),
        ({"delta2": "1"}, "offsets['delta2']"),
    ],
)
def test_a_bad_offset_is_named(best: zb.OptimalPlan, offsets, argument) -> None:
    with pytest.raises(zb.BadInput) as caught:
        zb.simulate(best.plan, offsets)
    assert caught.value.argument == argument


@pytest.mark.parametrize("function", ["check", "simulate"])
def test_what_is_no_plan_is_refused(function: str) -> None:
    with pytest.raises(zb.BadInput, match="read_plan"):
        getattr(zb, function)("plan.yaml")
