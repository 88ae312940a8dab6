"""The figures: valid SVG, side by side on one page, silent about what the data do not tell."""

import dataclasses
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from example_results import EXAMPLES, drawn, draws, good, misfit, unconverged, x_pattern
from study_text import words

from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.status import known
from zerobeam.model.errors import UnsoundResult
from zerobeam.reports.run.parameter_section import offsets_picture
from zerobeam.reports.run.posterior_summary import posterior_picture
from zerobeam.reports.run.residuals import drawn_of, residuals_picture
from zerobeam.reports.style.canvas import themed
from zerobeam.reports.style.theme import PALETTE


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.at_length(r"^(held_out|uncalibrated|separate|misfit|outlier|unconverged)$")
def test_every_figure_is_svg_with_a_text_for_those_who_do_not_see_it(name: str) -> None:
    for key, picture in drawn(EXAMPLES[name]).items():
        root = ElementTree.fromstring(picture.svg)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert picture.name == key
        assert len(picture.alt) > 20
        assert picture.title
        assert "<image" not in picture.svg


def test_ids_of_several_figures_on_one_page_do_not_clash_and_all_links_lead_somewhere() -> None:
    every: list[str] = []
    for picture in drawn(misfit()).values():
        ids = re.findall(r'\bid="([^"]+)"', picture.svg)
        links = set(re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', picture.svg))
        assert {one or other for one, other in links} == set(ids)
        every += ids
    assert len(every) == len(set(every)) > 0


@pytest.mark.long
def test_the_same_result_gives_the_same_bytes() -> None:
    assert drawn(good()) == drawn(good(), draws(good()))


def test_the_ground_is_transparent_and_the_colours_follow_the_page() -> None:
    for picture in drawn(x_pattern()).values():
        inside = themed(picture.svg)
        assert "var(--ink)" in inside
        left = {found.lower() for found in re.findall(r"#[0-9a-fA-F]{6}\b", inside)}
        assert not left & {colour.light for colour in PALETTE.values()}
        assert left <= {"#000000"}


def test_a_target_named_like_a_colour_keeps_its_name() -> None:
    ink = PALETTE["ink"].light
    shots = tuple(dataclasses.replace(shot, target=ink if shot.shot < 3 else "psd") for shot in good().shots)
    picture = residuals_picture(dataclasses.replace(good(), shots=shots))
    assert ink in words(themed(picture.svg))


@pytest.mark.long
def test_an_unidentifiable_offset_has_a_band_and_no_dot() -> None:
    def dots(result: Result) -> int:
        svg = themed(offsets_picture(result).svg)
        return len(re.findall(r"<use [^>]*var\(--(?:identified|weak)\)", svg))

    assert "not determined by these data" in words(offsets_picture(x_pattern()).svg)
    assert "not determined" not in words(offsets_picture(good()).svg)
    # A dot in each of the two panels of what is known; what is assumed is grey.
    for result in (good(), x_pattern()):
        known_rows = [row for row in result.parameters if row.group == "offset" and known(row.status)]
        assert dots(result) == 2 * len(known_rows)
    assert dots(x_pattern()) < dots(good()) == 8
    assert "J2 (δ2) not determined by these data" in offsets_picture(x_pattern()).alt


def test_the_posterior_leaves_out_what_comes_from_the_prior() -> None:
    text = words(drawn(x_pattern())["posterior"].svg)
    assert "δ2" not in text
    assert "δ3" in text
    assert "δ2" in words(drawn(good())["posterior"].svg)


def test_draws_of_an_unidentifiable_offset_cannot_be_made_and_so_not_be_drawn() -> None:
    of = draws(x_pattern())
    assert "delta2" not in of.names
    with pytest.raises(UnsoundResult, match="delta2"):
        dataclasses.replace(of, names=("delta2", *of.names[1:]), status=("unidentifiable", *of.status[1:]))


def test_an_unconverged_or_missing_posterior_is_not_drawn() -> None:
    assert "posterior" not in drawn(unconverged())
    assert posterior_picture(good(), None) is None
    assert posterior_picture(good(), dataclasses.replace(draws(good()), converged=False)) is None


def test_a_posterior_of_one_offset_and_one_of_many() -> None:
    result = good()
    of = draws(result)
    at = of.names.index("delta2")
    one = dataclasses.replace(
        of, names=("delta2",), units=("deg",), status=(of.status[at],), values=of.values[..., at : at + 1]
    )
    picture = posterior_picture(result, one)
    assert picture is not None
    assert "δ2" in words(picture.svg)
    assert "δ3" not in words(picture.svg)
    many = drawn(good())["posterior"]
    assert "δ6" in words(many.svg)


def test_draws_that_do_not_move_are_still_drawn_without_a_warning() -> None:
    still = draws(good())
    values = np.repeat(still.values[:, :1, :1, :], 60, axis=1)
    assert posterior_picture(good(), dataclasses.replace(still, values=values)) is not None


def test_of_thousands_of_measurements_some_are_drawn() -> None:
    """A thousand, the largest among them; the caption and the counts say what there is."""
    shots = misfit().shots
    many = [dataclasses.replace(shots[i % len(shots)], shot=i, whitened=0.1 + i % 7 / 7) for i in range(3000)]
    for i in range(50):
        many[13 * i] = dataclasses.replace(many[13 * i], whitened=9.0)
    order = sorted(many, key=lambda shot: shot.target)
    chosen = drawn_of(order)
    assert len(chosen) == 1000
    assert all(order[i] is shot for i, shot in chosen.items())
    assert sum(shot.whitened == 9.0 for shot in chosen.values()) == 50
    assert np.diff(list(chosen)).max() <= 5  # evenly over the run
    picture = residuals_picture(dataclasses.replace(misfit(), shots=tuple(many)))
    assert len(picture.svg) < 400_000
    assert "1000 of 3000 are drawn" in picture.title
    assert "50 lie beyond" in picture.alt
    assert len(drawn_of(order[:1000])) == 1000
