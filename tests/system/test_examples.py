"""The examples in the docstrings of the public names run and print what they say."""

import doctest
import inspect

import pytest

import zerobeam


def examples(name: str) -> list[doctest.DocTest]:
    found = getattr(zerobeam, name)
    if not (inspect.isclass(found) or inspect.isfunction(found)):
        return []
    return [test for test in doctest.DocTestFinder(recurse=True).find(found, name) if test.examples]


@pytest.mark.parametrize("name", [name for name in zerobeam.__all__ if examples(name)])
@pytest.mark.at_length(
    r"^(Analysed|Result|CheckedPlan|write_report|OptimalPlan|optimal_plan|Figure|Contour|SceneView|Profile)$"
)
def test_the_examples_of(name: str) -> None:
    for test in examples(name):
        assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test).failed == 0


@pytest.mark.parametrize("name", [name for name in zerobeam.__all__ if name != "__version__"])
def test_there_are_examples_of(name: str) -> None:
    assert examples(name)
