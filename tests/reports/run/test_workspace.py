"""The figure and the section on the tool point's accuracy: what they show is what the result says."""

from __future__ import annotations

import dataclasses
import json
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import pytest
from cells import PROBE, irb1600
from made_fit import by_hand
from numpy import diag, radians

from zerobeam.analysis.diagnostics.accuracy import accuracy
from zerobeam.reports.run.workspace import accuracy_section
from zerobeam.reports.run.workspace_figure import class_of, tool_accuracy_picture
from zerobeam.reports.style.canvas import themed
from zerobeam.reports.style.palette import PALETTE

FITTING = {"likelihood": {"p_value": 0.4, "chi2": 6.0, "dof": 6, "rms_mm": 0.13}}
MISFIT = {"likelihood": {"p_value": 1e-9, "chi2": 96.0, "dof": 6, "rms_mm": 0.95}}


def answered(status: dict[int, str] | None = None) -> dict[str, Any]:
    delta = radians([0, -1.2, -0.7, 0.1, 0.05, 0.02])
    covariance = diag(radians([0, 0.01, 0.01, 0.03, 0.02, 0.02]) ** 2)
    found = accuracy(by_hand(irb1600(), PROBE, delta, covariance, status or {}))
    return {"accuracy": json.loads(json.dumps(dataclasses.asdict(found))), "fits": FITTING}


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return answered()


@pytest.fixture(scope="module")
def withheld() -> dict[str, Any]:
    return answered({1: "unidentifiable"})


def words(svg: str) -> str:
    return " ".join("".join(element.itertext()) for element in ElementTree.fromstring(svg))


def texts(section: dict[str, Any]) -> str:
    blocks = section.all
    return " ".join(block.text for block in blocks if block.kind == "text")


def table(section: dict[str, Any]) -> list[list[str]]:
    (found,) = (block for block in section.blocks if block.kind == "table")
    return [[cell.text for cell in row.cells] for row in found.rows]


def test_the_figure_has_both_planes_units_and_the_base(result: dict[str, Any]) -> None:
    picture = tool_accuracy_picture(result)
    assert picture is not None
    shown = words(picture.svg)
    for text in ("without the offsets: error, mm", "with them: 95 % within, mm", "distance from axis 1, mm"):
        assert shown.count(text) >= 1
    for text in ("height, mm", "x, mm", "y, mm"):
        assert text in shown
    assert shown.count("base") == 4
    assert re.search(r"\d to \d", shown)
    assert "<image" not in picture.svg
    # Colours follow the page's light and dark form.
    left = {found.lower() for found in re.findall(r"#[0-9a-fA-F]{6}\b", themed(picture.svg))}
    assert not left & {colour.light for colour in PALETTE.values()}


def test_every_cell_is_drawn_in_its_class(result: dict[str, Any]) -> None:
    """Areas of the shapes of one shade against the cells counted by hand, in the first panel."""
    picture = tool_accuracy_picture(result)
    assert picture is not None
    own = result["accuracy"]["maps"][0]
    values = [value for row in own["before_mm"]["median"] for value in row if value is not None]
    legend = re.findall(r"([\d.]+) to ([\d.]+)", words(picture.svg))
    edges = [float(legend[0][0])]
    for low, high in legend:
        if float(low) != edges[-1]:
            break
        edges.append(float(high))
    assert edges[0] <= min(values)
    assert max(values) <= edges[-1]
    counted = [0] * (len(edges) - 1)
    for value in values:
        counted[class_of(value, edges)] += 1
        low = edges[class_of(value, edges)]
        assert low <= value <= edges[class_of(value, edges) + 1]
    drawn = [area(path) for path in first_panel(picture.svg)]
    told = [count for count in counted if count]
    assert len(drawn) == len(told) > 2
    for found, count in zip(drawn, told, strict=True):
        assert found / sum(drawn) == pytest.approx(count / sum(told), rel=1e-3)


def first_panel(svg: str) -> list[str]:
    """The `d` of the filled shapes of the first panel, in the order they are drawn."""
    shapes = [
        (element.attrib["d"], element.attrib.get("style", ""))
        for element in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}path")
    ]
    blue = PALETTE["identified"].light
    found, last = [], -1.0
    for d, css in shapes:
        if f"fill: {blue}" not in css:
            continue
        shade = float(opacity.group(1)) if (opacity := re.search(r"opacity: ([\d.]+)", css)) else 1.0
        if shade <= last:
            break
        last = shade
        found.append(d)
    return found


def area(d: str) -> float:
    """Of the rectangles of a path, by the shoelace formula."""
    total = 0.0
    for part in d.split("M")[1:]:
        at = [float(number) for number in re.findall(r"-?[\d.]+(?:e-?\d+)?", part)]
        xs, ys = at[::2], at[1::2]
        ring = list(zip(xs, ys, strict=True))
        total += (
            abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, ring[1:] + ring[:1], strict=True))) / 2
        )
    return total


@pytest.mark.parametrize(("value", "found"), [(0.5, 0), (1.0, 1), (1.5, 1), (2.0, 1), (0.0, 0)], ids=str)
def test_classes_begin_at_their_lower_edge(value: float, found: int) -> None:
    assert class_of(value, [0.0, 1.0, 2.0]) == found


def test_without_a_claim_there_is_no_number_anywhere(withheld: dict[str, Any]) -> None:
    assert tool_accuracy_picture(withheld) is None
    section = accuracy_section(withheld)
    assert section is not None
    (block,) = section.all
    assert block.text.startswith(
        "No accuracy is claimed: the tool point depends on δ2, which is not determined: the noise hides it."
    )
    before_place = block.text.split("The tool point is")[0]
    assert not re.search(r"\d", before_place.replace("δ2", ""))


def test_nothing_at_all_where_the_result_has_no_such_part() -> None:
    assert tool_accuracy_picture({"accuracy": None}) is None
    assert accuracy_section({"accuracy": None}) is None


def test_the_section_tells_the_numbers_of_the_result(result: dict[str, Any]) -> None:
    section = accuracy_section(result)
    assert section is not None
    assert [block.kind for block in section.lead] == ["text", "figure"]
    rows = table(section)
    columns = [(region, level) for region in ("workspace", "near_shots") for level in ("median", "worst")]
    keys = ("before_mm", "before_std_mm", "after95_mm", "after_rms_mm")
    for row, key in zip(rows, keys, strict=True):
        for cell, (region, level) in zip(row[1:], columns, strict=True):
            value = result["accuracy"][region][key][level]
            assert cell.endswith("\u00a0mm")
            # Before: to the last digit of its std's two; the others to two significant digits.
            std = result["accuracy"][region]["before_std_mm"][level] if key == "before_mm" else value
            assert float(cell.removesuffix("\u00a0mm")) == pytest.approx(value, abs=0.05 * std)
    said = texts(section)
    assert rows[2][1] in said
    assert rows[2][2] in said
    for level in ("median", "worst"):
        assert f"{result['accuracy']['workspace']['before_mm'][level]:.2g}\u00a0mm" in said
    assert "4096 postures" in said
    assert "1024 over the ranges" in said
    assert "(60, 20, 150\u00a0mm in the flange frame)" in said
    assert "does not fit" not in said
    assert "weakly" not in said


def test_doubts_stand_before_the_maps(result: dict[str, Any]) -> None:
    weak = {**result["accuracy"], "weak": ["delta4", "delta5"]}
    section = accuracy_section({"accuracy": weak, "fits": MISFIT})
    assert section is not None
    said = [block.text for block in section.lead if block.kind == "text"]
    assert said[1] == ("δ4 and δ5 are only weakly determined and enter with their large standard deviation.")
    assert "The model does not fit: the misses of the shots, 0.95\u00a0mm rms, are some 4.0 times" in said[2]
    assert "the error is larger than told here" in said[2]
