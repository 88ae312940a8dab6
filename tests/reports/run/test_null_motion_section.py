"""The picture of a null-space motion on pages: both ends, the posture that ends it, and nothing as known."""

import dataclasses
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from cells import good_plan, pattern_plan
from chromium import SIZES, chromium
from example_results import drawn, good, x_pattern
from pages import paragraphs

from zerobeam.analysis.observability.aim import aim_plan
from zerobeam.analysis.observability.check import check
from zerobeam.reports.output.html import html
from zerobeam.reports.plan.plan_page import plan_page
from zerobeam.reports.run.report import report_page
from zerobeam.reports.run.unobservable import (
    NAME,
    motion_picture,
    null_motion_picture_of,
    null_motion_section,
)
from zerobeam.reports.style.blocks import FigureBlock
from zerobeam.reports.style.canvas import MovingPicture

_SVG = "{http://www.w3.org/2000/svg}"


def picture() -> MovingPicture:
    made = null_motion_picture_of(x_pattern())
    assert made is not None
    return made


def lines(svg: str) -> list[str]:
    return [each.attrib["points"] for each in ElementTree.fromstring(svg).iter(f"{_SVG}polyline")]


def test_a_well_determined_run_has_no_such_picture() -> None:
    assert null_motion_section(good()) is None
    assert null_motion_picture_of(good()) is None
    assert NAME not in drawn(good())
    plan = aim_plan(good_plan(16))
    assert "null-space motion" not in plan_page(plan, check(plan.plan))


def test_the_stills_are_both_ends_and_the_posture_that_ends_it() -> None:
    stills, moving = picture().stills, picture().moving
    assert len(stills) == 3
    assert len(moving) == 2
    assert not any("<animate" in still for still in (*stills, picture().svg))
    assert all("<animate" in panel for panel in moving)
    assert not set(lines(stills[0])) & set(lines(stills[1])) - set(lines(moving[0]))  # but for what stays
    for still, title in zip(stills, ("J2 −20°", "J2 +20°", "A posture that ends it"), strict=True):
        assert title in still
        assert title in picture().svg


def test_what_moves_comes_to_both_ends() -> None:
    """Each still's arm is one of the places of the moving arm."""
    places = set(re.findall(r'values="([^"]*)"', picture().moving[0]))
    for still in picture().stills[:2]:
        arm = max(lines(still), key=len)
        assert any(arm in each.split(";") for each in places)


def test_the_words_say_that_both_fit_and_that_neither_is_known() -> None:
    section = null_motion_section(x_pattern())
    assert section is not None
    text = paragraphs(section)
    assert (
        "Both ends fit the readings equally: at the same joints J2 (δ2) may be 20° less or 20° more" in text
    )
    assert "psd moves with it. Every beam still meets its target." in text
    assert "A posture that ends it: J1 " in text
    assert "both ends fit the readings equally; no position here is an estimate" in picture().title
    page = report_page(x_pattern())
    assert section in page.sections
    assert FigureBlock(NAME) in page.front


def test_what_is_drawn_larger_says_so() -> None:
    motion = x_pattern().null_motion
    assert motion is not None
    larger = dataclasses.replace(motion, amount=0.5, drawn=40.0, off_mm=0.012)
    made = motion_picture(larger, x_pattern().identifiability.null_space, 7)
    assert made is not None
    assert "drawn 40 times larger" in made.title
    assert "to within 0.012\u00a0mm, less than the noise" in made.alt


def page_of_x_pattern() -> str:
    return html(report_page(x_pattern()), drawn(x_pattern()), "report")


def test_the_page_of_a_degenerate_plan_has_the_picture() -> None:
    plan = aim_plan(pattern_plan("x"))
    page = plan_page(plan, check(plan.plan))
    assert page.count('class="panels') == 2
    assert "3 of 7 postures are drawn" in page


@pytest.mark.long
@pytest.mark.browser
@pytest.mark.parametrize("size", SIZES)
def test_it_moves_or_stands_still_as_its_reader_wants(size: str, tmp_path: Path) -> None:
    file = tmp_path / "report.html"
    file.write_text(page_of_x_pattern(), encoding="utf-8")
    seen = "getComputedStyle(document.querySelector('.panels.{}')).display".format
    with chromium().opened(file, SIZES[size]) as tab:
        still = SIZES[size].print
        assert (tab.value(seen("moving")) == "none") is still
        assert (tab.value(seen("stills")) == "none") is not still
        if not still:
            tab.on(lambda page: page.click("figure.motion label"))
            assert tab.value(seen("moving")) == "none"
            assert tab.value(seen("stills")) == "grid"
            tab.on(lambda page: page.click("figure.motion label"))
            tab.on(lambda page: page.page.emulate_media(reduced_motion="reduce"))
            assert tab.value(seen("moving")) == "none"
            assert tab.value(seen("stills")) == "grid"
        assert tab.value("document.documentElement.scrollWidth <= innerWidth")
        right = (
            "[...document.querySelectorAll('.motion svg')].map((svg) => svg.getBoundingClientRect().right)"
        )
        assert tab.value(f"Math.max(...{right}) <= innerWidth")
        assert tab.console == []
        assert tab.accessibility() == []
