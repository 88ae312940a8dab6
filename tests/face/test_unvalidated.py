"""A misfit: whatever shows a number of it says that the number is unvalidated."""

import pickle
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure as PlainFigure

import zerobeam as zb
from zerobeam.analysis.status import UNVALIDATED


@pytest.fixture(scope="module")
def misfit(good: zb.Analysed) -> zb.Analysed:
    """An offset of 1.2 degrees, held at zero."""
    solution = good.refit(hold={"J2": 0}, ess=100)
    assert solution.verdict == "misfit"
    return solution


SHOWN = {
    "row": lambda solution: solution["J3"],
    "covariance": lambda solution: solution.covariance,
    "part of it": lambda solution: solution.covariance.select(["J3", "J4"]),
    "profile": lambda solution: solution.profile("J3", size=5),
    "contour": lambda solution: solution.contour("J3", "J4", size=8),
    "result": lambda solution: solution.result,
    "offsets": lambda solution: solution.offsets,
    "parameters": lambda solution: solution.parameters,
    "uncertainties": lambda solution: solution.offset_std,
}


@pytest.mark.parametrize("name", SHOWN)
def test_every_repr_says_so(good: zb.Analysed, misfit: zb.Analysed, name: str) -> None:
    assert UNVALIDATED in repr(SHOWN[name](misfit))
    assert "unvalidated" not in repr(SHOWN[name](good))


DRAWN = {
    "offsets": lambda solution, ax: solution.plot.offsets(ax),
    "residuals": lambda solution, ax: solution.plot.residuals(ax),
    "profile": lambda solution, ax: solution.profile("J3", size=5).plot(ax),
    "contour": lambda solution, ax: solution.contour("J3", "J4", size=8).plot(ax),
}


@pytest.mark.parametrize("name", DRAWN)
def test_all_axes_say_so(good: zb.Analysed, misfit: zb.Analysed, name: str) -> None:
    axes = DRAWN[name](misfit, PlainFigure().subplots())
    assert axes.get_title(loc="left").replace("\n", " ") == UNVALIDATED
    assert DRAWN[name](good, PlainFigure().subplots()).get_title(loc="left") == ""
    figure = DRAWN[name](misfit, None)
    assert "unvalidated:" in "".join(ElementTree.fromstring(figure.svg).itertext())


def test_a_figure_of_its_offsets_is_none_of_a_result(good: zb.Analysed, misfit: zb.Analysed) -> None:
    """No bars, no U, and its words have no ±."""
    assert "±" not in misfit.plot.offsets().alt + misfit.plot.offsets().svg
    assert "±" in good.plot.offsets().alt
    bars = [len(line.get_xdata()) for line in misfit.plot.offsets(PlainFigure().subplots()).lines[:-1]]
    assert set(bars) == {1}


def test_there_is_no_scene_of_it_and_the_reason_is_right(misfit: zb.Analysed) -> None:
    for solution in (misfit, pickle.loads(pickle.dumps(misfit))):
        with pytest.raises(zb.BadInput, match=UNVALIDATED) as caught:
            solution.plot.scene()
        assert "converge" not in str(caught.value)
