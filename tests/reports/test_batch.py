"""A batch of runs: results as `analyse` gives them, failures named, nothing done twice."""

import csv
import json
import shutil
from dataclasses import replace

import pytest
from cells import exact_copy, header, plan_of, simulated, varied_postures
from command_line import zerobeam
from exact_runs import demo_runs
from export_runs import STATED, TRUTH, saved

from zerobeam.analysis.analyse import analyse
from zerobeam.experiments.batch import Batch, BatchOffset, BatchRow
from zerobeam.experiments.command_options import BatchSettings
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.records import dumps
from zerobeam.reports import carried_out
from zerobeam.reports.batch_page import batch_page, uncertainty_picture
from zerobeam.reports.carried_out import batch
from zerobeam.words.sentences import to_json

GOOD, X_PATTERN, UNCALIBRATED = (run.path for run in demo_runs())
SETTINGS = BatchSettings(seed=0, ess=100.0, sampling="never", report=False)


@pytest.fixture
def runs(tmp_path):
    return with_runs(tmp_path)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The folder of a batch that is done, and what it came to."""
    runs = with_runs(tmp_path_factory.mktemp("done"))
    return runs / "out", carried(runs)


def with_runs(tmp_path):
    """Two folders with runs of equal names, one that is no run, one whose model is wrong."""
    for folder in ("monday", "tuesday"):
        (tmp_path / folder).mkdir()
        exact_copy(GOOD, tmp_path / folder / "arm.jsonl")
    exact_copy(X_PATTERN, tmp_path / "monday" / "pattern.jsonl")
    (tmp_path / "tuesday" / "torn.jsonl").write_text("{not json\n")
    text = GOOD.read_text().replace('"joint_deg":0.01', '"joint_deg":0.0002')
    text = text.replace('"robot":', '"geometry":"exact","robot":', 1)
    (tmp_path / "tuesday" / "misfit.jsonl").write_text(text)
    return tmp_path


def table(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def carried(runs, **how):
    files = sorted(runs.glob("*day/*.jsonl"))
    told = []
    how = {"processes": 1, **how}
    found = batch(files, runs / "out", SETTINGS, lambda stage, share: told.append(share), **how)
    assert told == sorted(told)
    return found


def test_each_run_has_its_result_and_a_bad_file_stops_no_other(done):
    out, found = done
    assert [(row.name, row.outcome) for row in found.rows] == [
        ("monday-arm", "pass"),
        ("pattern", "degenerate"),
        ("tuesday-arm", "pass"),
        ("misfit", "misfit"),
        ("torn", "failed"),
    ]
    assert not found.passed
    assert "the line is not JSON" in found.rows[-1].message
    assert not (out / "torn").exists()
    answer = json.loads((out / "monday-arm" / "result.json").read_text())
    assert answer["schema"] == "zerobeam/result/1"
    assert answer["posterior"]["message"].startswith("not sampled: the curvature at the mode describes it")
    assert answer["posterior"]["parameters"] is None
    # What the data cannot determine has no number in any table.
    rows = table(out / "offsets.csv")
    unknown = [row for row in rows if row["status"] == "unidentifiable"]
    assert unknown
    assert all(not row[key] for row in unknown for key in ("estimate", "u", "low95", "high95"))
    summary = {row["run"]: row for row in table(out / "runs.csv")}
    assert summary["pattern"]["worst_u"] == ""
    assert float(summary["monday-arm"]["worst_u"]) > 0
    assert json.loads((out / "batch.json").read_text())["outcomes"] == {
        "failed": 1, "misfit": 1, "degenerate": 1, "weak": 0, "pass": 2
    }  # fmt: skip
    page = (out / "batch.html").read_text()
    for said in ("2 of 5 runs are a pass", "Failures", "torn.jsonl", "Lack of fit", "undetermined"):
        assert said in page


def test_a_result_is_that_of_analyse_without_the_posterior(done):
    alone = analyse(read_run(done[0].parent / "monday" / "pattern.jsonl"), sampling="where needed").result
    answer = json.loads((done[0] / "pattern" / "result.json").read_text())
    expected = json.loads(dumps(to_json(alone)))
    for key in ("verdict", "headline", "misfit", "posterior"):
        assert answer[key] == expected[key]
    assert answer["identifiability"]["rank"] == expected["identifiability"]["rank"]
    stds = {row["name"]: row["std"] for row in answer["parameters"] if row["std"] is not None}
    known = {row.name: row.std for row in alone.parameters if row.std is not None}
    assert stds == pytest.approx(known, rel=1e-9)


def test_what_is_done_is_read_back_and_not_done_again(done, monkeypatch):
    out, found = done
    solved = []
    monkeypatch.setattr(carried_out, "solved", lambda one, settings: solved.append(one))
    assert to_json(carried(out.parent)) == to_json(found)
    assert solved == []


def count_solved(monkeypatch, names):
    """The name of each run that is solved goes to `names`."""
    solve = carried_out.solved

    def counted(one, settings):
        names.append(one.name)
        return solve(one, settings)

    monkeypatch.setattr(carried_out, "solved", counted)


def test_a_run_is_kept_as_soon_as_it_is_solved(runs, monkeypatch):
    """They were kept sixteen at a time, and Ctrl-C promised to go on with what was lost."""
    solve = carried_out.solved

    def stopped(one, settings):
        if one.name == stops_at:
            raise KeyboardInterrupt
        return solve(one, settings)

    monkeypatch.setattr(carried_out, "solved", stopped)
    asked = ("batch", runs / "monday", "-o", runs / "out", "--no-posterior")
    stops_at = "arm"
    assert "kept" not in zerobeam(*asked).err
    stops_at = "pattern"
    assert "The finished runs are kept in" in zerobeam(*asked).err
    names: list[str] = []
    stops_at = ""
    count_solved(monkeypatch, names)
    zerobeam(*asked)
    assert names == ["pattern"]


@pytest.mark.long
def test_a_report_stays_where_the_same_result_is_asked_for_without(runs, monkeypatch):
    solved = []
    count_solved(monkeypatch, solved)
    asked = ("batch", runs / "monday" / "pattern.jsonl", "-o", runs / "out", "--no-posterior")
    zerobeam(*asked, "--report")
    report = runs / "out" / "pattern" / "report.html"
    before = report.read_bytes()
    zerobeam(*asked)
    assert solved == ["pattern"]
    assert report.read_bytes() == before
    # What is missing is made.
    report.unlink()
    zerobeam(*asked, "--report")
    assert report.is_file()


@pytest.mark.long
def test_what_is_done_is_not_done_again_and_what_changed_is(runs, monkeypatch):
    (runs / "tuesday" / "misfit.jsonl").unlink()
    solved = []
    count_solved(monkeypatch, solved)
    first = carried(runs)
    assert len(solved) == 3
    again = carried(runs)
    assert len(solved) == 3
    assert to_json(again) == to_json(first)
    # A file that changed, and a result that somebody removed.
    shutil.copy(UNCALIBRATED, runs / "monday" / "arm.jsonl")
    shutil.rmtree(runs / "out" / "pattern")
    solved.clear()
    third = carried(runs)
    assert sorted(solved) == ["monday-arm", "pattern"]
    assert [row.name for row in third.rows] == [row.name for row in first.rows]
    # Another seed is another result.
    solved.clear()
    files = [runs / "tuesday" / "arm.jsonl"]
    batch(files, runs / "out", replace(SETTINGS, seed=1), lambda stage, share: None, processes=1)
    assert solved == ["tuesday-arm"]


@pytest.mark.long
def test_a_fault_of_the_program_is_one_failure_among_the_others(runs, monkeypatch):
    def broken(run, **how):
        if run.path.name == "pattern.jsonl":
            raise RuntimeError("no such thing")
        return analyse(run, **how)

    monkeypatch.setattr(carried_out, "analyse", broken)
    rows = {row.name: row for row in carried(runs).rows}
    assert rows["pattern"].outcome == "failed"
    assert "a fault of zerobeam itself" in rows["pattern"].message
    assert rows["monday-arm"].outcome == "pass"


def test_a_folder_with_other_things_is_left_alone(runs):
    (runs / "out").mkdir()
    (runs / "out" / "diary.txt").write_text("mine")
    with pytest.raises(BadInput, match="holds other things"):
        carried(runs)
    assert [path.name for path in (runs / "out").iterdir()] == ["diary.txt"]


@pytest.mark.long
def test_the_tables_as_parquet(runs):
    parquet = pytest.importorskip("pyarrow.parquet")
    shutil.rmtree(runs / "tuesday")
    carried(runs, parquet=True)
    found = parquet.read_table(runs / "out" / "offsets.parquet")
    assert found.num_rows == len(table(runs / "out" / "offsets.csv"))
    assert str(found.schema.field("u").type) == "double"
    carried(runs)
    assert not (runs / "out" / "offsets.parquet").exists()


def test_the_command(runs):
    told = zerobeam("batch", runs / "monday", "-o", runs / "out", "--no-posterior")
    assert told.status == 1, told.err
    assert told.out.startswith("Not all pass. 1 of 2 runs is a pass (1 simulated): 1 degenerate.")
    good = zerobeam("batch", runs / "monday" / "arm.jsonl", "-o", runs / "good", "--json")
    assert good.status == 0
    assert good.json["schema"] == "zerobeam/batch/1"
    assert good.json["settings"]["sampling"] == "where needed"


@pytest.mark.long
def test_a_row_says_what_page_one_of_its_run_says(tmp_path):
    """Of a pass by which nothing is to be entered why; of a simulated run that it is one."""
    target = (500.0, 100.0, 200.0)
    own = header(STATED, target=target, robot="ur5e", geometry="exact")
    arm = load_robot("ur5e")
    plan = plan_of(own, varied_postures(own, arm, target, 12, 5), robot=arm)
    nominal = saved(tmp_path, own, simulated(plan, TRUTH, 2)[1]).path
    demo = exact_copy(GOOD, tmp_path / "demo.jsonl")
    found = batch([nominal, demo], tmp_path / "out", SETTINGS, lambda *_: None, processes=1)
    rows = {row.name: row for row in found.rows}
    assert (rows["run"].outcome, rows["run"].contradicted, rows["run"].simulated) == ("weak", True, False)
    assert "apply that calibration twice" in rows["run"].message
    assert (rows["demo"].outcome, rows["demo"].contradicted, rows["demo"].simulated) == ("pass", False, True)
    assert "nter nothing" not in rows["demo"].message
    assert [row["simulated"] for row in table(tmp_path / "out" / "runs.csv")] == ["False", "True"]
    page = (tmp_path / "out" / "batch.html").read_text()
    for said in ("1 of 2 runs is a pass (1 simulated): 1 with nothing to enter", "Simulated: pass"):
        assert said in page
    assert "eakly observable" not in page


def test_a_pass_of_a_robot_that_does_not_meet_what_is_required_is_not_one_to_rely_on(tmp_path):
    arm = exact_copy(GOOD, tmp_path / "arm.jsonl")
    header, _, shots = arm.read_text().partition("\n")
    stated = json.loads(header) | {"required": {"tcp_mm": 0.01}, "provenance": {"origin": "by hand"}}
    arm.write_text(f"{json.dumps(stated)}\n{shots}")
    told = zerobeam("batch", arm, "-o", tmp_path / "out", "--no-posterior")
    assert told.status == zerobeam("analyse", arm).status == 1
    assert told.out.startswith("Not all pass. 1 of 1 run is a pass")
    assert "1 with requirement not shown to be met" in " ".join(told.out.split())
    (found,) = json.loads((tmp_path / "out" / "batch.json").read_text())["runs"]
    assert (found["outcome"], found["falls_short"]) == ("pass", True)
    assert "required 0.01" in found["message"]


def row(name, estimate, u=0.02):
    """Of one offset; without an estimate it is unidentifiable."""
    offset = BatchOffset("delta2", "deg", "unidentifiable", None, None, None)
    if estimate is not None:
        offset = BatchOffset("delta2", "deg", "identified", estimate, u, (estimate - 0.04, estimate + 0.04))
    return BatchRow(name, f"{name}.jsonl", "pass", "", robot="irb1600", serial=f"S{name}", offsets=(offset,))


def test_an_odd_arm_is_named_and_one_without_a_number_is_not_asked():
    rows = [row(str(k), 0.01 * ((7 * k) % 20 - 10)) for k in range(40)]
    assert Batch(tuple(rows), SETTINGS, {}).outliers == ()
    odd = Batch((*rows, row("odd", 2.0), row("none", None)), SETTINGS, {})
    assert [own.run for own in odd.outliers] == ["odd"]
    section = next(own for own in batch_page(odd).sections if own.title == "Outlying arms")
    assert "Sodd" in str(section.all)
    assert odd.rows[-1].worst is None


def test_a_row_that_claims_too_much_is_refused():
    with pytest.raises(Exception, match="unidentifiable"):
        BatchOffset("delta2", "deg", "unidentifiable", 1.0, None, None)
    with pytest.raises(Exception, match="failed, yet"):
        replace(row("a", 0.1), outcome="failed")


@pytest.mark.parametrize(
    ("uncertainties", "ticks"),
    [((0.004, 0.03), ["0.005", "0.01", "0.02"]), ((0.02, 0.02), ["0.02"]), ((1e-4, 5.0), ["0.01", "1"])],
)
def test_the_axis_of_uncertainties_has_plain_numbers(uncertainties, ticks):
    svg = uncertainty_picture([row("a", 0.1, u) for u in uncertainties]).svg
    assert "mathdefault" not in svg
    for tick in ticks:
        assert f">{tick}<" in svg


@pytest.mark.long
def test_what_a_killed_batch_left_in_the_folder_of_a_run_is_in_nobodys_way(runs):
    """It was killed while it wrote a result.json, and refused its own folder ever after."""
    shutil.rmtree(runs / "tuesday")
    carried(runs)
    folder = runs / "out" / "pattern"
    (folder / "result.json").rename(folder / ".result.json.00000000-4194305-abcd1234.part")
    found = carried(runs)
    assert [row.outcome for row in found.rows] == ["pass", "degenerate"]
    assert (folder / "result.json").is_file()
