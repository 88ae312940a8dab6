"""Numbers on the command line, and in files that only `compare` and the importers read, have bounds too."""

import json
from pathlib import Path
from typing import Any

import pytest
from command_line import zerobeam
from exact_runs import demo_runs
from recorded_logs import HEADER, moves, table
from small_results import small_result

import zerobeam as zb
from zerobeam.analysis.repeatability.repeats import read_result
from zerobeam.commands import program
from zerobeam.model.kernel import KernelWarning

RUN = demo_runs()[0].path


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("a,1e308\nb,1\n", "not an offset"),
        ("a,1\nb,-1e6\n", "not an offset"),
        (None, "the table has no rows"),
    ],
)
def test_a_table_of_offsets(tmp_path: Path, rows: str | None, told: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(",,\n,,\n" if rows is None else "run,delta2_deg\n" + rows)
    assert told in zerobeam("compare", path).refused()


@pytest.mark.parametrize(
    ("row", "fit", "told"),
    [
        ({}, {"noise_scale": 1e-300}, "noise scale"),
        ({"std": 1e308}, {}, "out of range"),
        ({"estimate": -1e9}, {}, "out of range"),
        ({"std": 1e-200, "data_std": 1e-200}, {}, "not above 0"),
        ({"tolerance_share": 1.0}, {}, "tolerance_share"),
        ({}, {"header": "text"}, "inputs.header"),
        ({"estimate": 10**400}, {}, "finite number"),
    ],
)
def test_a_result(tmp_path: Path, row: dict[str, Any], fit: dict[str, Any], told: str) -> None:
    offset = {"name": "delta2", "status": "identified", "estimate": 1.0, "std": 0.1, "data_std": 0.1}
    answer = small_result([offset | row], fit, header=fit.get("header", {}))
    path = tmp_path / "result.json"
    path.write_text(json.dumps(answer))
    with pytest.raises(zb.BadInput) as caught:
        read_result(path, "first")
    assert told in str(caught.value)


def log_of_dwells(folder: Path, rows: list[list[float]], still_s: object) -> str:
    """What an import of the log of an arm that dwells is refused with."""
    (folder / "header.yaml").write_text(HEADER)
    (folder / "log.csv").write_text(table(None, rows, ","))
    words = ["--target", "psd", "--header", folder / "header.yaml", "-o", folder / "made"]
    how = ["--still-deg", 0.05, "--still-s", still_s]
    return zerobeam("import", "log", "robodk", folder / "log.csv", *words, *how).refused()


@pytest.mark.parametrize("still", ["1e-160", "0.0001", "nan", "1e30"])
def test_the_length_of_a_dwell(tmp_path: Path, still: str) -> None:
    times, joints = moves(rate=10.0)
    told = log_of_dwells(tmp_path, [[*row, time] for row, time in zip(joints, times, strict=True)], still)
    assert "the value of --still-s is out of range" in told


def test_times_that_are_far_apart(tmp_path: Path) -> None:
    """A row of such a log counts until the next one, and is repeated for as long."""
    _, joints = moves(rate=10.0)
    told = log_of_dwells(tmp_path, [[*row, 1e9 * i] for i, row in enumerate(joints[:4])], 0.5)
    assert "too far apart" in told


@pytest.mark.parametrize(
    "words",
    [
        ("analyse", RUN, "--ess", "1e30"),
        ("analyse", RUN, "--ess", "Infinity"),
        ("analyse", RUN, "--ess", "nan"),
        ("plan", "x", "--header", "h", "--target", "1e30,0,0", "-o", "made"),
        ("plan", "x", "--header", "h", "--target", "1,0,0", "-o", "made", "--shots", "1" * 400),
        ("study", "file", "none.yaml", "-o", "made", "--runs", "1" * 400),
    ],
)
def test_an_option(words: tuple[object, ...]) -> None:
    answer = zerobeam(*words)
    assert answer.status == 2
    assert "Traceback" not in answer.err


def test_the_sample_size_in_python() -> None:
    for ess in (0.0, float("nan"), float("inf"), 1e6):
        with pytest.raises(zb.BadInput, match="argument ess"):
            zb.analyse(zb.read_run(RUN), ess=ess)


def test_a_note_is_ours(capsys: pytest.CaptureFixture[str]) -> None:
    program._warn("overflow encountered in multiply", RuntimeWarning)
    assert capsys.readouterr().err == ""
    program._warn("kernels are not kept", KernelWarning)
    assert "note: kernels are not kept" in capsys.readouterr().err
