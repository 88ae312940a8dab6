"""The finished cases on the disk: gone on with, torn, of something else, in use."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from command_line import zerobeam

from zerobeam.experiments.studies import cases
from zerobeam.experiments.studies.cases import CaseStore, Engine, any_kept
from zerobeam.experiments.studies.cell import cell_study
from zerobeam.experiments.studies.coverage import coverage_study
from zerobeam.experiments.studies.drift_coverage import drift_study
from zerobeam.experiments.studies.geometry_coverage import geometry_study
from zerobeam.experiments.studies.instrument_choice import instruments_study
from zerobeam.experiments.studies.wrong_models import wrong_models_study
from zerobeam.model.errors import BadInput
from zerobeam.model.records import read, to_json

WORKED: list[int] = []
HEADING = {"study": "own", "seed": 1, "settings": "abc", "versions": {"numpy": "2"}}


def kept(path: Path) -> dict[int, dict[str, object]]:
    with CaseStore(path, HEADING, dict) as store:
        return store.done


def test_cases_are_on_the_disk_at_once_and_come_back_to_the_bit(tmp_path: Path) -> None:
    path = tmp_path / "new" / "own.jsonl"
    answer = {"std": 0.1 + 0.2, "none": None, "words": "é"}
    assert not any_kept(path)
    with CaseStore(path, HEADING, dict) as store:
        assert store.done == {}
        assert not any_kept(path)
        store.add(3, answer)
        assert any_kept(path)
        assert len(path.read_text(encoding="utf-8").splitlines()) == 2
        store.add(0, {})
    assert kept(path) == {3: answer, 0: {}}
    with CaseStore(path, HEADING, dict) as store:
        store.add(1, {})
    assert sorted(kept(path)) == [0, 1, 3]


@pytest.mark.parametrize("cut", [1, 5, 20])
def test_a_torn_last_line_is_taken_out(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "own.jsonl"
    with CaseStore(path, HEADING, dict) as store:
        store.add(0, {"a": 1})
        store.add(1, {"b": 2})
    path.write_bytes(path.read_bytes()[:-cut])
    assert kept(path) == {0: {"a": 1}}
    with CaseStore(path, HEADING, dict) as store:
        store.add(1, {"b": 3})
    assert kept(path) == {0: {"a": 1}, 1: {"b": 3}}


@pytest.mark.parametrize("length", [0, 1, 40])
def test_a_torn_first_line_is_begun_anew(tmp_path: Path, length: int) -> None:
    path = tmp_path / "own.jsonl"
    with CaseStore(path, HEADING, dict):
        pass
    whole = path.read_bytes()
    path.write_bytes(whole[:length])
    assert kept(path) == {}
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("key", "value"), [("seed", 2), ("settings", "x"), ("study", "other"), ("versions", {"numpy": "3"})]
)
def test_cases_of_something_else_are_refused_and_left_alone(tmp_path: Path, key: str, value: object) -> None:
    path = tmp_path / "own.jsonl"
    with CaseStore(path, HEADING, dict) as store:
        store.add(0, {})
    before = path.read_bytes()
    with pytest.raises(BadInput, match=f"{key} differs"):
        CaseStore(path, {**HEADING, key: value}, dict)
    assert path.read_bytes() == before
    assert kept(path) == {0: {}}  # and the lock was given back


@pytest.mark.parametrize("content", ["mine\n", '{"schema": "zerobeam/run/1"}\n', "mine", "[]\n", "\n"])
def test_a_file_of_somebody_else_is_refused_and_left_alone(tmp_path: Path, content: str) -> None:
    path = tmp_path / "own.jsonl"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(BadInput, match="not written by a study"):
        CaseStore(path, HEADING, dict)
    assert path.read_text(encoding="utf-8") == content


def test_a_spoilt_case_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "own.jsonl"
    with CaseStore(path, HEADING, dict) as store:
        store.add(0, {})
    path.write_text(path.read_text(encoding="utf-8") + json.dumps({"case": "a"}) + "\n", encoding="utf-8")
    with pytest.raises(BadInput) as caught:
        CaseStore(path, HEADING, dict)
    assert caught.value.line == 3


def test_two_at_once_are_kept_apart(tmp_path: Path) -> None:
    path = tmp_path / "own.jsonl"
    with CaseStore(path, HEADING, dict), pytest.raises(BadInput, match="another process"):
        CaseStore(path, HEADING, dict)
    assert kept(path) == {}


def test_what_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(BadInput, match="cannot be kept"):
        CaseStore(tmp_path / "file" / "own.jsonl", HEADING, dict)


def squared(piece: int) -> dict[str, object]:
    WORKED.append(piece)
    if WORKED.count(3) == 1 and piece == 3:
        raise KeyboardInterrupt
    return {"square": piece**2}


def test_a_stopped_study_goes_on_with_the_piece_under_way_to_the_same_answer(tmp_path: Path) -> None:
    """The one engine of all studies: each piece is kept at once, and told; none is worked out twice."""
    told: list[tuple[str, float]] = []

    def carried_out() -> list[dict[str, object]]:
        engine = Engine(1, lambda *now: told.append(now), tmp_path / "own.jsonl", processes=1)
        return engine.each("own", dict, squared, [2, 3, 4], called="arm", settings="abc")

    WORKED.clear()
    with pytest.raises(KeyboardInterrupt):
        carried_out()
    assert (tmp_path / "own.jsonl").read_text(encoding="utf-8").count("\n") == 2
    assert told == [("arm 0/3", 0.0), ("arm 1/3", 1 / 3)]
    assert carried_out() == [{"square": 4}, {"square": 9}, {"square": 16}]
    assert WORKED == [2, 3, 3, 4]
    assert told[2:] == [("arm 1/3", 1 / 3), ("arm 2/3", 2 / 3), ("arm 3/3", 1.0)]
    assert carried_out()[2] == {"square": 16}
    assert len(WORKED) == 4


class _FirstPiece(Exception):
    """Ends a study behind its first piece."""


STUDIES: dict[str, Callable[[Engine], object]] = {
    "coverage": lambda engine: coverage_study(100, engine),
    "cell": lambda engine: cell_study(20, engine, camera=False),
    "drift": lambda engine: drift_study(20, engine),
    "geometry": lambda engine: geometry_study(20, engine),
    "instruments": lambda engine: instruments_study(None, engine),
    "wrong-models": lambda engine: wrong_models_study(2, engine, measurements=(7,)),
}


@pytest.mark.long
@pytest.mark.parametrize("study", STUDIES)
def test_what_became_of_a_piece_is_read_back(study: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def each(
        _: Engine, study: str, kind: type, work: Callable[[Any], Any], pieces: Any, **about: Any
    ) -> None:
        written = to_json(work(pieces[0]))
        assert written
        assert to_json(read(kind, written)) == written
        raise _FirstPiece

    monkeypatch.setattr(Engine, "each", each)
    with pytest.raises(_FirstPiece):
        STUDIES[study](Engine(0, processes=1))


def test_a_stopped_study_promises_to_go_on_with_what_it_kept_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(work: object, jobs: list[object], processes: object) -> Iterator[tuple[int, object]]:
        yield from ((number, work(job)) for number, job in enumerate(jobs[:answered]))
        raise KeyboardInterrupt

    monkeypatch.setattr(cases, "side_by_side", stopped)
    asked = ("study", "drift", "--arms", "20", "-o", tmp_path / "out")
    answered = 0
    assert "kept" not in zerobeam(*asked).err
    answered = 1
    assert "The finished cases are kept in" in zerobeam(*asked).err
