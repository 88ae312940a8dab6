"""The figure and the section on the accuracy of the TCP: what they show is what the result says."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest
from cells import PROBE, irb1600
from example_results import good, misfit
from made_fit import by_hand
from numpy import diag, radians
from pages import paragraphs, table
from study_text import texts_of, words

from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.diagnostics.accuracy import accuracy
from zerobeam.analysis.diagnostics.values_to_enter import Entered, TcpError
from zerobeam.analysis.status import Status
from zerobeam.model.errors import UnsoundResult
from zerobeam.reports.run.front import MAP, front
from zerobeam.reports.run.report import report_page
from zerobeam.reports.run.workspace import class_edges, class_of, workspace_picture, workspace_section
from zerobeam.reports.style.blocks import FigureBlock, Paragraph
from zerobeam.reports.style.canvas import themed
from zerobeam.reports.style.theme import PALETTE
from zerobeam.words.enter import enter_sentence
from zerobeam.words.message import message
from zerobeam.words.wording import sentence


def answered(status: dict[int, Status] | None = None) -> Result:
    delta = radians([0, -1.2, -0.7, 0.1, 0.05, 0.02])
    covariance = diag(radians([0, 0.01, 0.01, 0.03, 0.02, 0.02]) ** 2)
    by_offsets = accuracy(by_hand(irb1600(), PROBE, delta, covariance, status or {}))
    return replace(good(), accuracy=by_offsets, entered=None, entered_geometry=None)


@pytest.fixture(scope="module")
def result() -> Result:
    return answered()


@pytest.fixture(scope="module")
def withheld() -> Result:
    return answered({1: "unidentifiable"})


def test_the_figure_has_both_planes_units_and_the_base(result: Result) -> None:
    picture = workspace_picture(result)
    assert picture is not None
    shown = words(picture.svg)
    for text in ("from the side", "from above", "95 % below, mm", "measurement"):
        assert shown.count(text) == 1
    for text in ("distance from axis 1, mm", "height, mm", "x, mm", "y, mm"):
        assert text in shown
    assert shown.count("base") == 2
    assert re.search(r"\d to \d", shown)
    assert "<image" not in picture.svg
    # Colours follow the page's light and dark form.
    left = {found.lower() for found in re.findall(r"#[0-9a-fA-F]{6}\b", themed(picture.svg))}
    assert not left & {colour.light for colour in PALETTE.values()}


def test_the_next_postures_are_marked_and_listed(result: Result) -> None:
    outlook = result.outlook
    assert outlook is not None
    assert len(outlook.next_postures) == 3
    picture = workspace_picture(result)
    assert picture is not None
    assert "next posture" in words(picture.svg)
    rows = texts_of(table(workspace_section(result), "Where one more measurement helps the TCP most"))
    assert [row[0] for row in rows] == ["1", "2", "3"]
    for row, posture in zip(rows, outlook.next_postures, strict=True):
        shown = [float(cell.replace("−", "-")) for cell in row[2:-1]]
        assert shown == pytest.approx(posture.joints, abs=0.05)
        assert float(row[-1].removesuffix("\u00a0mm")) == pytest.approx(posture.u_mm, rel=0.06)
    none = replace(result, outlook=replace(outlook, next_postures=()))
    without = workspace_picture(none)
    assert without is not None
    assert "next posture" not in words(without.svg)


def test_every_cell_is_drawn_in_its_class(result: Result) -> None:
    """Areas of the shapes of one shade against the cells counted by hand, in the first panel."""
    picture = workspace_picture(result)
    assert picture is not None
    grids = [plane.after_p95_mm for plane in result.accuracy.maps]
    values, every = (
        [value for grid in some for row in grid or () for value in row if value is not None]
        for some in (grids[:1], grids)
    )
    legend = re.findall(r"([\d.]+) to ([\d.]+)", words(picture.svg))
    edges = [float(legend[0][0]), *(float(high) for _, high in legend)]
    assert [float(low) for low, _ in legend] == edges[:-1]  # one scale for both panels
    assert edges[0] <= min(every)
    assert max(every) <= edges[-1]
    counted = [0] * (len(edges) - 1)
    for value in values:
        counted[class_of(value, edges)] += 1
        assert edges[class_of(value, edges)] <= value <= edges[class_of(value, edges) + 1]
    drawn = [area(path) for path in first_panel(picture.svg)]
    told = [count for count in counted if count]
    assert len(drawn) == len(told) > 1
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


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ([1.2, 24.0], [1, 2, 5, 10, 20, 50]),
        ([1.0, 5.0], [1, 2, 5, 10]),
        ([0.02, 900.0], [0.01, 0.1, 1, 10, 100, 1000]),
        ([0.3, 80.0], [0.2, 0.5, 1, 2, 5, 10, 20, 50, 100]),
        ([0.0, 3.0], [0, 0.001, 0.01, 0.1, 1, 10]),
        ([0.0], [0, 1]),
        ([3.1, 5.3], [3, 3.5, 4, 4.5, 5, 5.5]),
        ([12.0, 40.0], [10, 15, 20, 25, 30, 35, 40, 45]),
    ],
    ids=str,
)
def test_classes_are_round_and_hold_all(values: list[float], found: list[float]) -> None:
    assert class_edges(values) == pytest.approx(found)


@pytest.mark.parametrize(("value", "found"), [(0.5, 0), (1.0, 1), (1.5, 1), (2.0, 1), (0.0, 0)], ids=str)
def test_classes_begin_at_their_lower_edge(value: float, found: int) -> None:
    assert class_of(value, [0.0, 1.0, 2.0]) == found


def test_without_a_claim_there_is_no_number_anywhere(withheld: Result) -> None:
    assert workspace_picture(withheld) is None
    (block,) = workspace_section(withheld).all
    assert isinstance(block, Paragraph)
    assert block.text.startswith(
        "No accuracy is claimed: the TCP depends on J2 (δ2), which is unidentifiable: not resolvable at this"
        " noise level. "
    )
    before_place = block.text.split("The TCP is")[0]
    assert not re.search(r"\d", before_place.replace("J2 (δ2)", ""))


def test_a_claim_that_depends_on_what_is_not_determined_cannot_be_made(
    result: Result, withheld: Result
) -> None:
    claimed = {key: getattr(result.accuracy, key) for key in ("workspace", "near_shots", "maps")}
    for key, value in claimed.items():
        with pytest.raises(UnsoundResult, match="accuracy is claimed"):
            replace(withheld.accuracy, **{key: value})
        with pytest.raises(UnsoundResult, match="accuracy is claimed"):
            replace(result.accuracy, converged=False)


def level_of(result: Result, region: str, key: str, level: str) -> float:
    value = getattr(getattr(getattr(result.accuracy, region), key), level)
    assert isinstance(value, float)
    return value


def test_the_section_tells_the_numbers_of_the_result(result: Result) -> None:
    section = workspace_section(result)
    assert FigureBlock(MAP) not in front(result, message(result))  # its values are not to be entered
    rows = texts_of(table(section, "Accuracy before"))
    columns = [(region, level) for region in ("workspace", "near_shots") for level in ("median", "worst")]
    keys = ("before_mm", "before_std_mm", "after95_mm", "after_rms_mm")
    for row, key in zip(rows, keys, strict=True):
        for cell, (region, level) in zip(row[1:], columns, strict=True):
            value = level_of(result, region, key, level)
            assert cell.endswith("\u00a0mm")
            # Before: to the last digit of its std's two; the others to two significant digits.
            std = level_of(result, region, "before_std_mm", level) if key == "before_mm" else value
            assert float(cell.removesuffix("\u00a0mm")) == pytest.approx(value, abs=0.05 * std)
    said = paragraphs(section)
    assert rows[2][1] in said
    assert rows[2][2] in said
    for level in ("median", "worst"):
        assert f"{level_of(result, 'workspace', 'before_mm', level):.2g}\u00a0mm" in said
    assert "4096 postures" in said
    assert "1024 over the ranges" in said
    assert "(60, 20, 150\u00a0mm in the flange frame)" in said
    assert "does not fit" not in said
    assert "weakly" not in said


def test_values_to_enter_bring_their_figures(result: Result) -> None:
    """The error of the first page, and no other median beside it."""
    before, after = TcpError(3.02, 5.5, (2.9, 3.1)), TcpError(0.61, 1.04, (0.4, 0.9))
    whole = TcpError(0.3, 0.52, (0.2, 0.4))
    entered = replace(
        result,
        entered=Entered("nominal", {}, {}, before, after),
        entered_geometry=Entered("geometry", {}, {}, before, whole),
    )
    section = workspace_section(entered)
    assert sentence(enter_sentence(entered) or "") in paragraphs(section)
    rows = [
        [cell.replace("\u00a0", " ") for cell in row] for row in texts_of(table(section, "Accuracy before"))
    ]
    assert [row[:3] for row in rows] == [
        ["nothing entered", "3.0 mm", "5.5 mm"],
        ["values entered", "0.61 mm", "1.0 mm"],
        ["links entered too", "0.30 mm", "0.52 mm"],
    ]
    worst = level_of(result, "workspace", "after95_mm", "worst")
    assert rows[1][3] == f"{worst:.2g} mm"


def test_doubts_stand_before_the_maps(result: Result) -> None:
    bad = replace(result, accuracy=replace(result.accuracy, weak=("delta4", "delta5")))
    said = [block.text for block in workspace_section(bad).all if isinstance(block, Paragraph)]
    assert said[1] == (
        "J4 (δ4) and J5 (δ5) are only weakly determined and enter with their large standard uncertainty."
    )


def test_a_misfit_claims_no_accuracy() -> None:
    assert "Accuracy of the TCP" not in [section.title for section in report_page(misfit()).sections]
    assert workspace_picture(misfit()) is None
