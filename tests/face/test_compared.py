"""Comparing runs through the Python face."""

import json

import pytest
from exact_runs import demo_runs

import zerobeam as zb
from zerobeam.model.files.run import write_run


@pytest.fixture(scope="module")
def runs() -> list[zb.Run]:
    plan = zb.Plan.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        postures=zb.read_run(demo_runs()[0].path).joints,
        unit="rad",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        target_priors={"psd": {"guess_mm": (950, 150, 100)}},
    )
    return [zb.simulate(plan, {"delta2": 0.3}, seed=seed) for seed in range(3)]


def test_runs_and_their_files_compare_the_same(runs, tmp_path) -> None:
    files = [tmp_path / f"run{k}.jsonl" for k in range(3)]
    for run, file in zip(runs, files, strict=True):
        write_run(file, run.header, run.shots)
    mine, theirs = zb.compare(runs), zb.compare(files)
    assert mine.verdict == theirs.verdict == "agrees"
    for row, same in zip(mine.offsets, theirs.offsets, strict=True):  # the first fit has no kernels yet
        assert same.name == row.name
        assert same.drift.interval95 == pytest.approx(row.drift.interval95)
        assert same.mean.interval95 == pytest.approx(row.mean.interval95)
    assert [run.name for run in mine.runs] == ["simulated (1)", "simulated (2)", "simulated (3)"]


@pytest.mark.long
def test_it_shows_and_writes_itself(runs, tmp_path) -> None:
    found = zb.compare(runs)
    assert len(repr(found).splitlines()) < 15
    assert "Agrees." in repr(found)
    assert "<script" not in found._repr_html_()
    paths = found.report(tmp_path / "out")
    assert json.loads(paths.result.read_text(encoding="utf-8")) == found.to_json()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda runs: "run.jsonl", "argument runs: this is not a list"),
        (lambda runs: runs[:1], "one run cannot be compared"),
        (lambda runs: [runs[0], 3], r"argument runs\[1\]: this is not a run"),
        (lambda runs: [runs[0], runs[0]], "the same run is given twice"),
    ],
)
def test_what_cannot_be_compared_is_refused(runs, given, said) -> None:
    with pytest.raises(zb.BadInput, match=said):
        zb.compare(given(runs))
