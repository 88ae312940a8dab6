"""What objects show of themselves, and the tables and figures that are asked of them."""

import copy
import dataclasses
import inspect
import pickle
from collections.abc import Iterator

import numpy as np
import pytest

import zerobeam as zb
from zerobeam.analysis.observability.check import CheckedParameter
from zerobeam.analysis.solution import ParameterResult
from zerobeam.analysis.status import UNVALIDATED


@pytest.mark.long
def test_parts_of_an_answer_have_one_line(good: zb.Analysed, best: zb.OptimalPlan) -> None:
    assert [name for name in dir(good.plot) if name[0] != "_"] == [
        "offsets",
        "posterior",
        "residuals",
        "scene",
    ]
    for part in (
        good.plot,
        best.check.plot,
        good.result,
        good.draws,
        good.fit,
        good.problem,
        good.identified,
        best.made,
        good["J2"],
    ):
        assert len(repr(part)) < 120
        assert repr(part).startswith("<")
    row = good["J2"]
    assert repr(row) == f"<delta2: {row.estimate:.3f} deg, u {row.u:.3f} deg, identified>"
    assert repr(best["J2"]) == f"<delta2: u {best['J2'].u:.3f} deg, identified>"


def test_units_are_shown_with_numbers(good: zb.Analysed) -> None:
    for values, count in ((good.enter, 4), (good.offset_std, 5), (good.offset_expanded, 5)):
        assert repr(values).count(" deg") == count
        assert repr(pickle.loads(pickle.dumps(values))) == repr(copy.deepcopy(values)) == repr(values)
        assert values == dict(values)
        assert values.units["delta2"] == "deg"
        assert type(values)(values.items()) == values  # as dataclasses.asdict makes another one
    assert "delta2 [deg]" in repr(good.covariance)
    assert good.covariance.to_frame().attrs["units"]["psd.x"] == "mm"
    assert good.predict([10, -20, 30, 5, 40, 0], "deg").attrs["units"]["u_x_mm"] == "mm"
    misfit = good.refit(hold={"J2": 0}, ess=100)
    assert UNVALIDATED in repr(misfit.offset_std)
    assert misfit.covariance.correlation.attrs["status"] == UNVALIDATED


def test_a_covariance_is_an_array(good: zb.Analysed) -> None:
    np.testing.assert_array_equal(np.array(good.covariance), good.covariance.matrix)
    assert np.asarray(good.covariance, dtype=np.float32).dtype == np.float32
    np.array(good.covariance)[0, 0] = -1.0
    assert good.covariance.matrix[0, 0] > 0


def test_a_check_has_the_tables_of_a_solution(best: zb.OptimalPlan) -> None:
    check = best.check
    assert (
        list(check.parameters.to_frame().index) == list(check.to_frame().index) == [row.name for row in check]
    )
    assert check.worst == max(row.u for row in check.offsets if not row.held)
    assert "J2" in check
    assert "J9" not in check
    assert best["J2"] is check["delta2"]
    assert "J2" in best
    assert best.verdict == check.verdict
    assert copy.deepcopy(best) == best


def numpy_numbers(value: object, path: str = "") -> Iterator[str]:
    """Where in an answer a number is one of numpy's."""
    if isinstance(value, np.generic):
        yield path
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            if field.name != "aimed":
                yield from numpy_numbers(getattr(value, field.name), f"{path}.{field.name}")
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from numpy_numbers(item, f"{path}[{key!r}]")
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from numpy_numbers(item, f"{path}[{i}]")


def test_numbers_of_an_answer_are_pythons(good: zb.Analysed, best: zb.OptimalPlan) -> None:
    assert list(numpy_numbers(good.result)) == list(numpy_numbers(best.check)) == []
    for values in (good["J2"].interval(0.68), good.profile("J2", size=9).interval(0.68), good.worst):
        assert list(numpy_numbers(values)) == []


def test_what_can_be_read_has_a_docstring() -> None:
    """The methods and properties of every public class and of the rows of a table."""
    silent = []
    for one in [*(getattr(zb, name) for name in zb.__all__), ParameterResult, CheckedParameter]:
        if not isinstance(one, type) or issubclass(one, Exception):
            continue
        for name in dir(one):
            member = inspect.getattr_static(one, name)
            function = getattr(member, "fget", None) or getattr(member, "func", None) or member
            function = getattr(function, "__func__", function)
            if not name.startswith("_") and callable(function) and not function.__doc__:
                silent.append(f"{one.__name__}.{name}")
    assert silent == []


def test_a_posterior_of_chosen_parameters(good: zb.Analysed) -> None:
    figure = good.plot.posterior(names=["J2", "psd.x"])
    assert figure.alt.startswith("Corner plot of J2 (δ2), psd.x.")
    assert good.plot.posterior(names="J2").alt.startswith("Corner plot of J2 (δ2).")
    with pytest.raises(zb.BadInput) as caught:
        good.plot.posterior(names=["J1"])
    assert caught.value.argument == "names"


@pytest.mark.long
def test_a_report_without_draws_has_no_posterior(good: zb.Analysed, tmp_path) -> None:
    assert zb.write_report(tmp_path / "out", good.result).posterior is None
