import dataclasses
import math
import re

import pytest
from example_results import EXAMPLES, HOSTILE_NAMES
from pages import paragraphs, tables

from zerobeam.analysis.diagnostics.budget import Budget, BudgetRow, LinearCheck
from zerobeam.reports.output.html import html
from zerobeam.reports.output.pdf import pdf
from zerobeam.reports.run.inputs import traceability_section
from zerobeam.reports.run.uncertainty_budget import MOST_COLUMNS, MOST_SOURCES, budget_section
from zerobeam.reports.style.blocks import Form, Page, Verdict
from zerobeam.words.numbers import MINUS
from zerobeam.words.provenance import is_simulated

PLAIN = {("joint", "1"): 0.6, ("spot",): 0.3995, ("prior", "delta2"): 0.001, ("curvature",): -0.0005}
YES = LinearCheck(2, 0.0005, 0.0001, 0.0002, 0.00002, True)


def made(name, std, shares=PLAIN, unit="deg", dof=None, factor=1.96, check=YES):
    """A budget with these shares of the variance."""
    rows = []
    for (kind, *of), share in shares.items():
        contribution = math.copysign(math.sqrt(abs(share)), share) * std
        own = kind != "curvature"
        rows.append(
            BudgetRow(
                kind=kind,
                of=tuple(of),
                type=("B" if dof is None else "A") if own else None,
                std=0.01 if own else None,
                unit=("mm" if kind == "spot" else "deg") if own else None,
                dof=dof if own else None,
                sensitivity=contribution / 0.01 if own else None,
                contribution=contribution,
                share=share,
            )
        )
    assert sum(row.share for row in rows) == pytest.approx(1)
    return Budget(name, unit, "identified", std, tuple(rows), dof, factor, factor * std, check)


def result(example="good", budgets=None, **changes):
    """An example with budgets made by hand of all that it determines."""
    found = dataclasses.replace(EXAMPLES[example], **changes)
    if budgets is None:
        told = [row for row in found.parameters if row.group in ("offset", "tool") and row.std is not None]
        budgets = [made(row.name, row.std, unit=row.unit) for row in told]
    return dataclasses.replace(found, budget=tuple(budgets))


def cells(table):
    return {row.cells[0].text: [cell.text for cell in row.cells[1:]] for row in table.rows}


def test_a_source_a_row_and_an_offset_a_column():
    contributions, sensitivities, check = tables(budget_section(result()))
    heads = [column.text for column in contributions.columns]
    named = [f"J{i} (δ{i}) (°)" for i in range(2, 7)]
    assert heads == ["source", "its u, type", *named[:-1], f"{named[-1]}, assumed"]
    told = cells(contributions)
    # The u of δ2 is 0.020: contributions with one digit more.
    assert told["joint 1"][:2] == ["0.01°, B", "0.0158 (60\u00a0%)"]
    assert told["spot"][:2] == ["0.01\u00a0mm, B", "0.0129 (40\u00a0%)"]
    assert told["2 others, each <\u00a01\u00a0%"][:2] == ["", "0.0005 (<1\u00a0%)"]
    assert told["combined u"][1] == "0.020"
    assert told["ν effective"][1] == "∞"
    assert told["expanded U (k\u00a0=\u00a02)"][1] == "0.041"
    assert told["result"][1] == f"{MINUS}1.222 ± 0.041"
    assert cells(sensitivities)["joint 1"][:2] == ["per °", "1.6"]
    assert cells(sensitivities)["spot"][0] == "per mm"
    assert cells(check)["J2 (δ2)"] == ["0.00010°", "0.00020°", "0.00050°", "0.000040°", "yes, to 2 digits"]


def test_an_estimated_noise():
    told = cells(tables(budget_section(result(budgets=[made("delta2", 0.02, dof=6.98, factor=2.37)])))[0])
    assert told["joint 1"][0] == "0.010°, A"
    assert told["ν effective"][1] == "6"
    assert told["expanded U (k\u00a0=\u00a02)"][1] == "0.040"  # one k in a report


@pytest.mark.parametrize("count", [3, 40])
def test_many_sources_are_grouped_and_still_add_up(count):
    weights = [1 / (i + 1) for i in range(count)]
    shares = {("joint", str(i + 1)): weight / sum(weights) for i, weight in enumerate(weights)}
    told = cells(tables(budget_section(result(budgets=[made("delta2", 0.02, shares)])))[0])
    own = {name: row[1] for name, row in told.items() if "joint" in name or "others" in name}
    assert len(own) == min(count, MOST_SOURCES + 1)
    squares = [float(text.split()[0]) ** 2 for text in own.values()]
    assert math.sqrt(sum(squares)) == pytest.approx(0.02, abs=0.0002)
    if count > MOST_SOURCES:
        (name,) = (name for name in own if "others" in name)
        below = int(re.search(r"<\s(\d+)", name).group(1))
        left = sorted(shares.values())[: count - MOST_SOURCES]
        assert name.startswith(f"{count - MOST_SOURCES} others")
        assert below - 1 <= 100 * max(left) < below
        # Without the others it does not.
        assert math.sqrt(sum(squares[:-1])) < 0.019


def test_a_single_minor_source_stands_by_itself():
    shares = {("joint", "1"): 0.999, ("prior", "delta2"): 0.001}
    told = cells(tables(budget_section(result(budgets=[made("delta2", 0.02, shares)])))[0])
    assert told["prior of J2 (δ2)"][1] == "0.0006 (<1\u00a0%)"
    assert not any("others" in name for name in told)


def test_wide_tables_are_split():
    names = [f"delta{i}" for i in range(2, 7)]
    budgets = [made(name, 0.02) for name in (*names, *names)]
    widths = [len(table.columns) for table in tables(budget_section(result(budgets=budgets)))[:4:2]]
    assert widths == [2 + MOST_COLUMNS, 2 + len(budgets) - MOST_COLUMNS]


def test_what_is_not_determined_is_named_and_has_no_number():
    section = budget_section(result("x_pattern"))
    assert "J2 (δ2) (°)" not in [column.text for table in tables(section) for column in table.columns]
    (legend,) = (block for block in section.blocks if block.kind == "legend")
    (row,) = (row for row in legend.reasons if row.status == "unidentifiable")
    assert row.word == "J2 (δ2):"
    assert row.text.startswith("joint 1 varies by only 0.030° over the measurements")
    # No number that could be taken for one of the offset: that one is a range of joint 1.
    assert row.text.count("°") == 1


def test_a_fit_that_did_not_converge_has_no_budget():
    fit = dataclasses.replace(EXAMPLES["good"].likelihood, converged=False)
    assert (
        budget_section(result(fits=dataclasses.replace(EXAMPLES["good"].fits, likelihood=fit), budgets=[]))
        is None
    )
    assert budget_section(result()) is not None


def test_the_check_is_told_by_its_words():
    unsure = LinearCheck(1, 0.005, 0.002, 0.004, 0.001, None)
    failed = dataclasses.replace(YES, validated=False)
    budgets = [made("delta2", 0.02), made("delta3", 0.02, check=unsure), made("delta4", 0.02, check=failed)]
    section = budget_section(result(budgets=budgets))
    words = [row[-1] for row in cells(tables(section)[-1]).values()]
    undecided = "inconclusive: Monte Carlo error 2.0 times too large"
    assert words == ["yes, to 2 digits", undecided, "no, not to 2 digits"]
    assert "use the posterior’s interval" in paragraphs(section)
    assert f"{EXAMPLES['good'].posterior.draws} draws do not decide" in paragraphs(section)
    good = paragraphs(budget_section(result()))
    assert "use the posterior’s interval" not in good
    assert "do not decide" not in good
    section = budget_section(result(budgets=[made("delta2", 0.02, check=None)]))
    assert "not checked against the posterior" in paragraphs(section)
    assert len(tables(section)) == 2


def test_what_the_budget_leaves_out_is_said():
    assert "the robot’s geometry, the calibrated tool and J1 (δ1)" in paragraphs(budget_section(result()))


def test_a_larger_k_by_the_effective_degrees_of_freedom_is_said():
    assert "By the effective degrees of freedom" not in paragraphs(budget_section(result()))
    std = EXAMPLES["good"].parameters[1].std
    wider = made("delta2", std, dof=5.0, factor=2.57)
    assert "k would be up to 2.57" in paragraphs(budget_section(result(budgets=[wider])))


@pytest.mark.parametrize("example", ["uncalibrated", "misfit", "hostile"])
def test_it_can_be_set(example):
    """As HTML and as accessible PDF, names of all kinds included."""
    found = result(example)
    shares = {("joint", "1"): 0.5, ("target", HOSTILE_NAMES[0]): 0.3, ("distance", *HOSTILE_NAMES[1:3]): 0.2}
    found = result(example, [made(own.name, 0.01, shares) for own in found.budget])
    sections = [budget_section(found), traceability_section(found)]
    page = Page("Budget", "", Verdict("pass", "Pass", "."), [], sections)
    text = html(page, {}, "report")
    assert "<script>alert" not in text
    assert "&lt;script&gt;" in text
    assert not re.search(r"<th[^>]*>\s*(<bdi>)?\s*(</bdi>)?\s*</th>", text)
    assert pdf(page, {}).startswith(b"%PDF")


def form(kind="laser", **provenance):
    found = EXAMPLES["good"]
    header = found.inputs.header | {"provenance": provenance, "tool": {"kind": kind}}
    inputs = dataclasses.replace(found.inputs, header=header)
    section = traceability_section(dataclasses.replace(found, inputs=inputs))
    assert section is not None
    forms = (block for block in section.all if isinstance(block, Form))
    return {
        name: text for one in forms for name, text in [*one.rows, *((name, "") for name in one.to_sign)]
    }, paragraphs(section)


def test_nothing_is_filled_in_that_nobody_stated():
    blank, said = form()
    assert not any(blank.values())
    assert {"Calibrated by", "PSD, calibration certificate", "Approved by", "Signature"} < set(blank)
    assert "simulated" not in said


def test_what_the_provenance_states_is_filled_in():
    stated = {"who": "J. Doe", "Robot_Serial": "1600-501234", "laser certificate": 4711, "note": "x"}
    filled, _ = form(**stated)
    assert filled["Calibrated by"] == "J. Doe"
    assert filled["Robot, serial number"] == "1600-501234"
    assert filled["Laser, calibration certificate"] == "4711"
    assert sum(bool(entry) for entry in filled.values()) == 3


def test_what_was_simulated_has_no_form_to_sign():
    found = EXAMPLES["good"]
    assert is_simulated(found.inputs.provenance)
    assert traceability_section(found) is None


def test_an_approval_is_never_filled_in():
    stated = {
        "signature": "J. Doe",
        "approved by": "J. Doe",
        "date of approval": "today",
        "date": "2026-01-02",
    }
    filled, _ = form(**stated)
    assert (filled["Signature"], filled["Approved by"], filled["Date of approval"]) == ("", "", "")
    assert filled["Date of the measurements"] == "2026-01-02"


def test_a_probe_has_its_own_instrument():
    blank, _ = form(kind="probe")
    assert "Probe, calibration certificate" in blank
    assert not any("PSD" in name or "Laser" in name for name in blank)
    assert "\\u202e" in form(who=HOSTILE_NAMES[4])[0]["Calibrated by"]
