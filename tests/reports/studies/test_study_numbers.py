"""Pages, figures and tables of the single studies: every number as in the answer, controls in plain sight."""

import csv
import dataclasses
import io
import re
from collections.abc import Callable
from typing import Any

import pytest
from example_studies import (
    agreeing,
    cell_study,
    disagreeing,
    geometry_study,
    hostile_cell,
    hostile_table2,
    table2_study,
    typed,
)
from made_once import made_once
from pages import Page
from study_text import printed, tables_of, texts_of, untrue, words

from zerobeam.experiments.studies.answer import StudyAnswer
from zerobeam.model.records import to_json
from zerobeam.reports.output.html import html
from zerobeam.reports.studies.study_blocks import NOT_DETERMINED, flat
from zerobeam.reports.studies.study_pages import study_of, study_page
from zerobeam.reports.style.blocks import Page as View
from zerobeam.reports.style.canvas import Picture
from zerobeam.words.wording import csv_text

Json = dict[str, Any]

SHARES = "Share of intervals that contain the true value, in %, with its"
ERRORS = ("bias", "bias_mcse", "rmse", "predicted_std")
PHASES = ("move", "search", "servo", "settle")


def drawn_of(answer: Json | StudyAnswer) -> dict[str, Picture]:
    return study_of(typed(answer)).pictures(typed(answer))


def page_text(answer: Json) -> str:
    return " ".join(Page(html(study_page(typed(answer)), {}, "study")).text)


def without_headings(rows: list[list[str]]) -> list[list[str]]:
    """Of a row that heads a plan or an estimator the name alone: the rest are its words."""
    return [row if "δ" in row[0] else row[:1] for row in rows]


def per_cent(share: Json) -> list[float]:
    return [100 * share[key] for key in ("share", "low", "high")]


def coverage_untruths(view: View, answer: Json) -> list[str]:
    wrong = []
    for table, plan in zip(tables_of(view, SHARES), answer["plans"], strict=True):
        expected: list[list[float | None]] = []
        for estimator in plan["estimators"]:
            expected.append([])
            for row in estimator["parameters"]:
                shares = [value for entry in row["coverage"] for value in per_cent(entry)]
                expected.append([*shares] or [None])
        wrong += untrue(without_headings(texts_of(table)), expected)
    return wrong


def cell_untruths(view: View, answer: Json) -> list[str]:
    shares: list[list[float | None]] = []
    for plan in answer["plans"]:
        shares.append([])
        for row in plan["parameters"]:
            share = row["coverage"]
            shares.append([*per_cent(share), *(row[key] for key in ERRORS)] if share else [None])
    (table,) = tables_of(view, SHARES)
    wrong = untrue(without_headings(texts_of(table)), shares)
    (table,) = tables_of(view, "Mean time")
    times = [plan["seconds"] for plan in answer["plans"]]
    expected = [[*(time[key]["mean"] for key in (*PHASES, "total")), time["total"]["max"]] for time in times]
    wrong += untrue(texts_of(table), expected)
    (table,) = tables_of(view, "Runs, and")
    assert [row[7] == "not adaptive" for row in texts_of(table)] == [True, True, False, True, True]
    runs = []
    for plan in answer["plans"]:
        used, saved = plan["shots_used"], [plan["saved"]] if plan["saved"] else []
        counts = [plan[key] for key in ("runs", "failed", "refused", "contradicted")]
        runs.append([*counts, used["mean"], used["min"], used["max"], *saved, plan["computing_s"]])
    return wrong + untrue(texts_of(table), runs)


def table2_untruths(view: View, answer: Json) -> list[str]:
    wrong = []
    for table, plan in zip(tables_of(view, "Plan "), answer["plans"], strict=True):
        expected: list[list[float | None]] = []
        for row in plan["parameters"]:
            paper = [row[key] for key in ("paper_std", "low", "high")]
            if row["status"] == "unidentifiable":
                expected.append([*paper, None])
                continue
            ends = [row["simulated"][key] for key in ("q2_5", "q97_5")]
            expected.append([*paper, row["predicted_std"], row["simulated_std"], *ends, row["alone_deg"]])
        rows = [[name, *texts] for name, *texts in texts_of(table)]
        wrong += untrue(rows, expected)
    (table,) = tables_of(view, "Joint offsets of three runs")
    paper = answer["paper"]
    rows = [*paper["experiments"], paper["printed_mean"], paper["mean"], paper["printed_std"], paper["std"]]
    wrong += untrue(texts_of(table), rows)
    (table,) = tables_of(view, "Standard deviation of one joint reading")
    assert {row[-1] for row in texts_of(table)} == {"agrees"}
    noises = [[plan[key] for key in ("joint_deg", "low", "high")] for plan in answer["plans"]]
    p_values = [max(plan["p_value"], 0.001) for plan in answer["plans"]]  # "below 0.001"
    return wrong + untrue(texts_of(table), [[*noise, p] for noise, p in zip(noises, p_values, strict=True)])


def geometry_untruths(view: View, answer: Json) -> list[str]:
    wrong = []
    tables = tables_of(view, "Share of intervals that contain the true value, in %, with")
    for table, plan in zip(tables, answer["plans"], strict=True):
        expected: list[list[float | None]] = []
        for estimator in plan["estimators"]:
            expected.append([])
            for row in estimator["parameters"]:
                of_z = [row[key] for key in ("z", "z_low", "z_high")]
                errors = [row[key] for key in (*ERRORS, "checked_std")]
                share = row["coverage"]
                expected.append([*per_cent(share), *of_z, *errors] if share else [None])
        wrong += untrue(without_headings(texts_of(table)), expected)
    return wrong


MADE: dict[str, Callable[[], Json]] = {
    "agreeing": agreeing,
    "disagreeing": disagreeing,
    "cell": cell_study,
    "table2": table2_study,
    "geometry": lambda: to_json(geometry_study()),
}
UNTRUTHS = {
    "agreeing": coverage_untruths,
    "disagreeing": coverage_untruths,
    "cell": cell_untruths,
    "table2": table2_untruths,
    "geometry": geometry_untruths,
}


@pytest.mark.parametrize("name", MADE)
def test_every_number_of_the_tables_is_that_of_the_answer(name: str) -> None:
    assert UNTRUTHS[name](study_page(typed(MADE[name]())), MADE[name]()) == []


@pytest.mark.parametrize(
    ("name", "change", "caught"),
    [
        (
            "agreeing",
            lambda plan: plan["estimators"][2]["parameters"][3]["coverage"][2].update(share=0.94),
            "J5 (δ5): 94.7",
        ),
        ("cell", lambda plan: plan["parameters"][1]["coverage"].update(low=0.5), "J3 (δ3): 91.0"),
        ("cell", lambda plan: plan["seconds"]["servo"].update(mean=90.0), "y-pattern: 92.4"),
        ("cell", lambda plan: plan.update(refused=4), "y-pattern: 3"),
        ("table2", lambda plan: plan["parameters"][4].update(alone_deg=0.0005), "J6 (δ6): 0.00040"),
        ("table2", lambda plan: plan["parameters"][0]["simulated"].update(q2_5=0.004), "J2 (δ2): 0.0037"),
        ("table2", lambda plan: plan.update(joint_deg=0.012), "y-pattern: 0.0112"),
        ("geometry", lambda plan: plan["estimators"][0]["parameters"][0].update(z=2.0), "J2 (δ2): 0.923"),
    ],
)
@pytest.mark.one_in(2)
def test_a_number_that_is_not_that_of_the_answer_is_caught(name: str, change: Any, caught: str) -> None:
    answer = MADE[name]()
    change(answer["plans"][0])
    assert UNTRUTHS[name](study_page(typed(MADE[name]())), answer) == [caught]


def test_bias_and_rmse_are_rounded_by_their_own_uncertainty() -> None:
    answer = agreeing()
    table, *_ = tables_of(study_page(typed(answer)), "Bias and root")
    rows = texts_of(table)[1:6]
    for texts, row in zip(rows, answer["plans"][0]["estimators"][0]["parameters"], strict=True):
        values = [float(text.replace("\u2212", "-").removesuffix("°")) for text in texts[1:]]
        about = row["rmse"] / (2 * 1000) ** 0.5
        for value, key, unit in zip(values, ERRORS, [row["bias_mcse"]] * 2 + [about] * 2, strict=True):
            assert abs(value - row[key]) <= 0.05 * unit


def test_the_table_of_predictions_of_geometry() -> None:
    (table,) = tables_of(study_page(geometry_study()), "Predicted u")
    rows = [
        ["7, nominal", "0.3\u00a0mm, 0.1°", "0.0061 to 0.0089°", "0.021 to 0.083°", "0.011 to 0.031°"],
        ["12, nominal", "0.3\u00a0mm, 0.1°", "0.0052 to 0.0068°", "0.026 to 0.061°", "0.0066 to 0.015°"],
    ]
    ranges = ("0.0029 to 0.0064°", "0.024 to 0.12°", "0.0043 to 0.017°")
    probe = ["probe", "0.3\u00a0mm, 0.1°", *(f"{text}; 1 {NOT_DETERMINED}" for text in ranges)]
    assert texts_of(table) == [*rows, probe]


# By table: rows, and values of the first by their columns, as ways into the answer's JSON.
TABLES: dict[tuple[str, str], tuple[int, str]] = {
    ("agreeing", "coverage.csv"): (3 * 5 * 5 * 4, "estimators.0.parameters.0.coverage.0"),
    ("agreeing", "ranks.csv"): (3 * 2 * 5 * 20, "sbc.0"),
    ("cell", "parameters.csv"): (5 * 5, "parameters.0"),
    ("cell", "time.csv"): (5 * 5, ""),
    ("cell", "plans.csv"): (5, ""),
    ("table2", "scatter.csv"): (3 * 5, "parameters.0"),
    ("table2", "plans.csv"): (3, ""),
    ("table2", "paper.csv"): (5, ""),
    ("geometry", "parameters.csv"): (3 * 4 * 5, "estimators.0.parameters.0"),
    ("geometry", "plans.csv"): (3 * 5, "checked.0"),
}


@pytest.mark.parametrize(("name", "file"), TABLES)
def test_a_plain_table_says_what_the_answer_says(name: str, file: str) -> None:
    content, (count, way) = MADE[name](), TABLES[name, file]
    tables = study_of(typed(content)).tables
    rows = list(csv.DictReader(io.StringIO(csv_text(tables[file](typed(content))))))
    assert len(rows) == count
    part = content["plans"][0]
    assert rows[0].get("plan", "y-pattern") in (part["name"], "y-pattern")
    for step in filter(None, way.split(".")):
        part = part[int(step) if step.isdigit() else step]
    same = [key for key, value in part.items() if key in rows[0] and not isinstance(value, list | dict)]
    assert file in ("time.csv", "paper.csv", "ranks.csv") or len(same) >= 1 + len(rows[0]) // 5
    for key in same:
        expected = "" if part[key] is None else str(part[key])
        assert rows[0][key] in (expected, f"{expected}.0"), (file, key)


def test_the_columns_are_ways_into_the_answer() -> None:
    """Of a part that is None a row with what is above it, and names joined."""
    answer = typed(hostile_cell())
    (first, *_) = flat("plans parameters coverage", "a=1.refused b=2.name c=2.coverage.of d=0.study level")(
        answer
    )
    assert (first["a"], first["c"], first["d"], first["level"]) == (3, None, "cell", None)
    assert next(flat("plans", "failures")(answer))["failures"].startswith("the beam is lost <script>")
    phases = [row["phase"] for row in flat("plans seconds", "phase=2.0 mean=2.1.mean")(answer)]
    assert phases[:5] == [*PHASES, "total"]


@pytest.mark.long
def test_controls_stand_outside_in_the_figure_and_estimators_do_not() -> None:
    """A share beyond its panel is written as a number, and only such a one."""
    drawn = made_once("figures of a study agreeing", lambda: drawn_of(agreeing()))
    for i, plan in enumerate(agreeing()["plans"], start=1):
        entries = [
            (estimator["control"], entry)
            for estimator in plan["estimators"]
            for row in estimator["parameters"]
            for entry in row["coverage"]
        ]
        far = [
            f"{100 * entry['share']:.1f}"
            for _, entry in entries
            if abs(entry["share"] - entry["level"])
            > 6 * (entry["level"] * (1 - entry["level"]) / 1000) ** 0.5
        ]
        picture = drawn[f"coverage_{i}"]
        assert sorted(re.findall(r"\d+\.\d", words(picture.svg))) == sorted(far)
        assert len(far) == sum(control for control, _ in entries) >= 36
        assert picture.alt.count("control: fails, as it must") == 2


def test_each_estimator_says_in_words_whether_it_agrees() -> None:
    (overview,) = tables_of(
        study_page(typed(disagreeing())), "Share of intervals that contain the true value, in %:"
    )
    verdicts = [row[1] for row in texts_of(overview) if not row[0].startswith("Plan ")]
    control = "control: fails, as it must"
    fine = ["agrees", "agrees", "agrees", control, control]
    assert verdicts == [*fine, "agrees", "does not agree", "agrees", control, control, *fine]
    assert "Does not agree." in page_text(disagreeing())


def test_a_control_that_passes_is_no_agreement() -> None:
    answer = agreeing()
    answer["plans"][0]["estimators"][3]["agrees"] = True
    assert "control: passes, but must not" in page_text(answer)
    assert "control: passes, but must not" not in page_text(agreeing())


def test_the_overview_names_the_parameter_that_is_farthest_off() -> None:
    answer = agreeing()
    entry = answer["plans"][0]["estimators"][0]["parameters"][3]["coverage"][1]
    entry |= {"share": 0.871, "held": 871}
    (overview,) = tables_of(
        study_page(typed(answer)), "Share of intervals that contain the true value, in %:"
    )
    row = texts_of(overview)[1]
    assert (row[0], row[3]) == ("likelihood", "J5: 87.1")


def test_truths_that_were_not_met_and_the_cost_of_the_midpoint_fit_are_said() -> None:
    text = page_text(agreeing())
    assert text.count("3 (others drawn in their place)") == 1
    assert text.count("Above 1 the midpoint fit is the worse.") == 1


def test_a_control_may_show_that_its_claim_is_wrong() -> None:
    """The pseudo-inverse claims to know the offset that no data determine; its intervals never hold the
    truth."""
    rows = texts_of(tables_of(study_page(typed(agreeing())), SHARES)[2])
    claimed = [row for row in rows if row[0] == "J2 (δ2)"][-1]
    assert [float(text.split(" ")[0]) < 1 for text in claimed[1:]] == [True] * 4


def test_where_nothing_is_determined_no_number_is_printed() -> None:
    answer = agreeing()
    for row in answer["plans"][2]["estimators"][0]["parameters"]:
        row |= dict.fromkeys(ERRORS) | {"status": "unidentifiable", "coverage": []}
    lines = printed(answer).splitlines()
    rows = texts_of(
        tables_of(study_page(typed(answer)), "Share of intervals that contain the true value, in %:")[0]
    )
    assert [row[2:] for row in rows if row[0] == "likelihood"][-1] == [NOT_DETERMINED] * 4
    assert "not determined: J2 (δ2), J3 (δ3), J4 (δ4), J5 (δ5) and J6 (δ6)" in lines


def test_a_run_beyond_the_limit_and_a_plan_without_a_result_are_said() -> None:
    (table,) = tables_of(
        study_page(typed(hostile_cell())), "Share of intervals that contain the true value, in %: "
    )
    rows = texts_of(table)
    assert rows[0][1:] == ["does not agree", NOT_DETERMINED, "not given", "not given", "not given"]
    assert rows[1][-2:] == ["402\u00a0s", "exceeded"]
    assert rows[2][-1] == "kept"
    assert rows[4][1] == "control: passes, but must not"
    text = page_text(hostile_cell())
    reason = "runs without a result: the beam is lost and <script>alert('x')</script>."
    assert text.count(reason) == text.count("runs without a result") == 1


def test_a_simulated_set_that_is_not_as_predicted_and_one_without_a_result_are_said() -> None:
    (table,) = tables_of(study_page(typed(hostile_table2())), "Standard deviation of one joint reading")
    rows = texts_of(table)
    assert rows[0][1:] == [*["not given"] * 3, "no result"]
    assert rows[1][1:] == ["0.0214°", "0 to 0.037°", "0.002", "does not agree"]
    assert rows[2][-1] == "agrees"
    text = page_text(hostile_table2())
    assert text.count("A run of the simulated set has no result.") == 1
    assert text.count("The simulated set: χ² 9.82 for 10 degrees of freedom, p 0.912.") == 2


@pytest.mark.long
def test_the_figures_of_the_cell() -> None:
    """The time has each mean, the longest run and the limit; a plan without a result has no bar, and does not
    widen the figure of the shares. The control lies beyond its panel and is written there as numbers."""
    drawn, hostile = drawn_of(cell_study()), drawn_of(hostile_cell())
    text = words(drawn["time"].svg)
    for plan in cell_study()["plans"]:
        total = plan["seconds"]["total"]
        bar = f"{plan['name']}: {total['mean']:.0f}\u00a0s, longest {total['max']:.0f}\u00a0s"
        assert bar in text
        assert bar in drawn["time"].alt
    assert "360\u00a0s" in text
    assert words(hostile["time"].svg).count("longest") == 4
    far = [f"{100 * row['coverage']['share']:.1f}" for row in cell_study()["plans"][4]["parameters"]]
    for pictures in (drawn, hostile):
        assert sorted(re.findall(r"\d+\.\d", words(pictures["coverage"].svg))) == sorted(far)
    # Without runs there is still a figure, of bands alone, and none of the time.
    answer = cell_study()
    for plan in answer["plans"]:
        plan["failed"] = plan["runs"]
        plan["seconds"]["total"] = {"mean": None, "max": None}
        for row in plan["parameters"]:
            row["coverage"] = None
    (picture,) = drawn_of(answer).values()
    assert words(picture.svg).count(NOT_DETERMINED) == 25
    assert "Time against the limit" in page_text(answer)


def test_the_figure_of_the_scatter_writes_the_papers_numbers_for_every_plan() -> None:
    text = words(drawn_of(table2_study())["scatter"].svg)
    for std in ("0.080°", "0.041°", "0.022°", "0.066°", "0.0035°"):
        assert text.count(std) == 3
    assert text.count(NOT_DETERMINED) == 1
    assert "joint noise 0.0112°" in text


@pytest.mark.long
def test_the_figures_of_geometry() -> None:
    drawn = drawn_of(geometry_study())
    assert "by measurements noise only 0.0061 to 0.0089 at 7" in drawn["uncertainty"].alt
    assert drawn["z"].alt.count(NOT_DETERMINED) == 4
    assert words(drawn["z"].svg).count("nominal") >= 3
    assert NOT_DETERMINED in words(drawn["coverage"].svg)
    # With a single number of measurements there is no figure over them.
    alone = dataclasses.replace(geometry_study(), plans=geometry_study().plans[1:])
    assert set(drawn_of(alone)) == {"z", "coverage"}
