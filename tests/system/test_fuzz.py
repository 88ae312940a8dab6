"""Damaged inputs through all commands: an answer or one message, and nothing else, whatever the damage.

`make test` tries a few of them, `make test-long` thousands. A fault is repeated by the number in its message.
"""

import random
import shlex
import shutil
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from fuzzing import WHOLE, Damaged, Files, damaged, draw, judged, whole_files

from zerobeam.model import kernel
from zerobeam.model.likelihood import constraint

# As for a person: libraries' warnings are no errors. And without a compiler, since each damaged arm would be
# compiled for a few evaluations.
pytestmark = [
    pytest.mark.filterwarnings("default", "ignore::zerobeam.model.kernel.KernelWarning"),
]
QUICK = [one for one in WHOLE if one.quick]
LONG, PARTS = 5_200, 26


@pytest.fixture(autouse=True, scope="module")
def without_compiler() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel, "_compiler", lambda: None)
        patch.setattr(constraint, "_made", {})  # what is made in here stays in here
        yield


@pytest.fixture(scope="module")
def quick_files(tmp_path_factory: pytest.TempPathFactory, without_compiler: None) -> Files:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return whole_files(tmp_path_factory.mktemp("whole"), recorded=False)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, without_compiler: None) -> Files:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return whole_files(tmp_path_factory.mktemp("whole"), recorded=True)


def tried(numbers: range, files: Files, folder: Path, quick: bool) -> tuple[list[str], Counter[int]]:
    """What is wrong with the answers to the damaged inputs of these numbers, and how often each status."""
    found: list[str] = []
    status: Counter[int] = Counter()
    for number in numbers:
        chance = random.Random(number)
        one = damaged(chance, files, draw(chance, QUICK if quick else WHOLE))
        place = folder / str(number)
        place.mkdir()
        answer, wrong = judged(one, place)
        status[answer.status] += 1
        if wrong:
            found.append(
                f"{number}: {shlex.join(one.words)[:300]} ({one.how}): {wrong}\n{answer.err[-2000:]}"
            )
        shutil.rmtree(place)
    return found, status


def test_damaged_files_and_options_are_refused_or_judged(quick_files: Files, tmp_path: Path) -> None:
    found, status = tried(range(20), quick_files, tmp_path, quick=True)
    assert found == []
    assert status[2] > 8
    assert status[0] + status[1] > 1  # not every damage matters


@pytest.mark.long
@pytest.mark.parametrize("part", range(PARTS))
def test_thousands_of_damaged_inputs_of_every_command(part: int, files: Files, tmp_path: Path) -> None:
    size = LONG // PARTS
    found, _ = tried(range(1000 + part * size, 1000 + (part + 1) * size), files, tmp_path, quick=False)
    assert found == []


@pytest.mark.long
@pytest.mark.parametrize("whole", WHOLE, ids=lambda one: one.command[:60])
def test_what_is_damaged_was_whole(whole, files: Files, tmp_path: Path) -> None:
    """Else most damages would be refused for another reason."""
    words = tuple(shlex.split(whole.command))
    answer, wrong = judged(Damaged(words, {name: files[name] for name in whole.needs}, ""), tmp_path)
    assert wrong == []
    expected = (0, 1)
    if "--sensors" in words:
        expected = (3,)
    assert answer.status in expected, answer.err


def test_a_fault_is_seen(quick_files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: a reader that trips over what it reads."""

    def trips(*_: object) -> None:
        raise ZeroDivisionError

    one = damaged(random.Random(1), quick_files, WHOLE[0])
    monkeypatch.setattr("zerobeam.model.files.plan.read_yaml", trips)
    assert "Traceback" in judged(one, tmp_path)[1]
