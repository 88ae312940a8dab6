"""The report's folder: its files; that it is whole or not at all is tested in output/test_whole_folder.py."""

import dataclasses
import json
import math
from pathlib import Path

import pytest
from example_results import drawn, draws, good, unconverged

from zerobeam.model.errors import UnsoundResult
from zerobeam.reports.run import report
from zerobeam.reports.run.report import write_report
from zerobeam.words.sentences import to_json


@pytest.fixture(autouse=True)
def drawn_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn once for all tests of the folder, which are about its files."""
    monkeypatch.setattr(report, "pictures", lambda result, of: dict(drawn(result)))


WHOLE = {
    "report.html",
    "report.pdf",
    "result.json",
    "posterior.nc",
    "figures",
    "figures/offsets.svg",
    "figures/posterior.svg",
    "figures/misses.svg",
    "figures/residual_map.svg",
    "figures/postures.svg",
    "figures/tool_accuracy.svg",
}


def everything(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*")}


@pytest.mark.long
def test_all_files_are_there_and_nothing_else(tmp_path: Path) -> None:
    paths = write_report(str(tmp_path / "out"), good(), draws(good()))  # a name as a string will do
    assert paths.posterior is not None
    written = (paths.html, paths.pdf, paths.result, paths.posterior, *paths.figures)
    assert {str(path.relative_to(tmp_path / "out")) for path in written} == WHOLE - {"figures"}
    assert everything(tmp_path / "out") == WHOLE
    assert json.loads(paths.result.read_text(encoding="utf-8")) == to_json(good())
    assert paths.pdf.read_bytes().startswith(b"%PDF")
    assert paths.html.read_text(encoding="utf-8").startswith("<!doctype html>")
    # Over it: unconverged draws are not drawn, and without draws there is no posterior file.
    write_report(tmp_path / "out", unconverged(), draws(unconverged()))
    assert everything(tmp_path / "out") == WHOLE - {"figures/posterior.svg"}
    assert write_report(tmp_path / "out", good(), None).posterior is None
    assert everything(tmp_path / "out") == WHOLE - {"posterior.nc"}
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_a_number_that_is_not_finite_leaves_what_was_there(tmp_path: Path) -> None:
    """It is found when it is written."""
    write_report(tmp_path / "out", good(), None)
    before = (tmp_path / "out" / "report.html").read_bytes()
    unsound = dataclasses.replace(
        good(),
        fits=dataclasses.replace(
            good().fits, likelihood=dataclasses.replace(good().likelihood, chi2=math.nan)
        ),
    )
    for folder in (tmp_path / "out", tmp_path / "new" / "deeper"):
        with pytest.raises(UnsoundResult):
            write_report(folder, unsound, None)
    assert (tmp_path / "out" / "report.html").read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"out"}
