"""The report's folder: whole or not at all, and never over what is not ours."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from example_results import draws, good, hostile, unconverged, x_pattern

from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.posterior.posterior import Draws
from zerobeam.analysis.status import UnsoundResult
from zerobeam.model.errors import BadInput
from zerobeam.reports.output import whole_folder
from zerobeam.reports.run import report as report_page
from zerobeam.reports.run.report import pictures as pictures_of
from zerobeam.reports.run.report import write_report
from zerobeam.reports.style.canvas import Picture
from zerobeam.words.result_json import to_json

Refused = Callable[..., BadInput]


@pytest.fixture(autouse=True)
def drawn_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn once for all tests of the folder, which are about its files."""
    monkeypatch.setattr(report_page, "pictures", pictures_once)


_DRAWN: list[tuple[Result, Draws | None, dict[str, Picture]]] = []


def pictures_once(result: Result, of: Draws | None) -> dict[str, Picture]:
    for own, own_draws, pictures in _DRAWN:
        if own is result and own_draws is of:
            return pictures
    _DRAWN.append((result, of, pictures_of(result, of)))
    return _DRAWN[-1][2]


def everything(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*")}


WHOLE = {
    "report.html",
    "report.pdf",
    "result.json",
    "posterior.nc",
    "figures",
    "figures/offsets.svg",
    "figures/posterior.svg",
    "figures/misses.svg",
    "figures/postures.svg",
    "figures/tool_accuracy.svg",
}


def test_all_files_are_there_and_nothing_else(tmp_path: Path) -> None:
    paths = write_report(tmp_path / "out", good(), draws(good()))
    assert everything(tmp_path / "out") == WHOLE
    assert everything(tmp_path) == {"out"} | {f"out/{name}" for name in WHOLE}
    assert json.loads(paths.result.read_text(encoding="utf-8")) == to_json(good())
    assert paths.pdf.read_bytes().startswith(b"%PDF")
    assert paths.html.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert paths.posterior is not None
    assert paths.posterior.exists()
    assert all(path.exists() for path in paths.figures)


def test_a_name_as_a_string_is_as_good_as_a_path(tmp_path: Path) -> None:
    """Before, all was written and a TypeError raised at the end."""
    paths = write_report(str(tmp_path / "out"), good(), None)
    assert paths == write_report(tmp_path / "out", good(), None)


@pytest.mark.skipif(os.name == "nt", reason="POSIX rights")
def test_others_may_read_it_as_any_new_folder(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    write_report(tmp_path / "out", good(), None)
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_without_draws_there_is_no_posterior_file_and_unconverged_ones_are_not_drawn(tmp_path: Path) -> None:
    assert write_report(tmp_path / "none", good(), None).posterior is None
    assert "posterior.nc" not in everything(tmp_path / "none")
    write_report(tmp_path / "bad", unconverged(), draws(unconverged()))
    assert everything(tmp_path / "bad") == WHOLE - {"figures/posterior.svg"}


def test_a_report_of_ours_is_replaced_and_leaves_nothing_behind(tmp_path: Path) -> None:
    write_report(tmp_path / "out", good(), draws(good()))
    (tmp_path / "out" / ".DS_Store").write_bytes(b"")
    write_report(tmp_path / "out", unconverged(), None)
    assert everything(tmp_path / "out") == WHOLE - {"figures/posterior.svg", "posterior.nc"}
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_an_empty_folder_is_used_and_missing_parents_are_made(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    write_report(tmp_path / "empty", good(), None)
    write_report(tmp_path / "a" / "b" / "out", good(), None)
    assert (tmp_path / "empty" / "report.html").exists()
    assert (tmp_path / "a" / "b" / "out" / "report.html").exists()


def test_what_is_not_ours_is_refused_and_left_alone(tmp_path: Path, refused: Refused) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    assert "is a file" in str(refused(write_report, file, good(), None))
    assert file.read_text() == "mine"

    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("mine")
    assert "thesis.tex" in str(refused(write_report, other, good(), None))

    alike = tmp_path / "alike"
    alike.mkdir()
    (alike / "result.json").write_text('{"schema": "someone/else/1"}')
    assert "not written by zerobeam" in str(refused(write_report, alike, good(), None))
    assert everything(tmp_path) == {"file", "other", "other/thesis.tex", "alike", "alike/result.json"}


def test_a_report_that_someone_put_files_into_is_not_thrown_away(tmp_path: Path, refused: Refused) -> None:
    write_report(tmp_path / "out", good(), None)
    (tmp_path / "out" / "notes.txt").write_text("mine")
    assert "notes.txt" in str(refused(write_report, tmp_path / "out", good(), None))
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_a_fault_leaves_what_was_there_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_report(tmp_path / "out", good(), None)
    before = (tmp_path / "out" / "report.html").read_bytes()
    # A number that is not finite is found when it is written.
    unsound = dataclasses.replace(good(), likelihood=dataclasses.replace(good().likelihood, chi2=math.nan))
    with pytest.raises(UnsoundResult):
        write_report(tmp_path / "out", unsound, None)
    with pytest.raises(UnsoundResult):
        write_report(tmp_path / "new" / "deeper", unsound, None)

    def fail(self: Path, target: Path) -> Path:
        if self.name.startswith(".zerobeam-new"):
            raise OSError(28, "No space left on device")
        return rename(self, target)

    rename = Path.rename
    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(BadInput, match="No space left"):
        write_report(tmp_path / "out", x_pattern(), None)
    assert (tmp_path / "out" / "report.html").read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_an_interruption_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(whole_folder, "_swap", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_report(tmp_path / "a" / "out", good(), None)
    assert everything(tmp_path) == set()


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written_to_is_bad_input(tmp_path: Path, refused: Refused) -> None:
    tmp_path.chmod(0o500)
    assert "cannot be written" in str(refused(write_report, tmp_path / "out", good(), None))


def test_a_parent_that_is_a_file_is_bad_input(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "file").write_text("mine")
    refused(write_report, tmp_path / "file" / "out", good(), None)


def test_hostile_names_make_no_file_names(tmp_path: Path) -> None:
    write_report(tmp_path / "out", hostile(), draws(hostile()))
    # Without a claim on accuracy there is no map of it; two targets are two placements.
    wanted = WHOLE - {"figures/tool_accuracy.svg"} | {"figures/placements.svg"}
    assert everything(tmp_path / "out") == wanted
