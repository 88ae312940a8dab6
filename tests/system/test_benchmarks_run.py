"""Every script of `benchmarks/` runs, with a size of seconds and without peers, and prints its figures. The
figures are not judged."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from scripts import BENCHMARKS, ROOT, load_script

# Each script: how it is made small, and a line that it then prints (a regular expression).
SMALL = {
    "analyse_time": (["experiments/demos/good.jsonl", "--repeat", "1"], r"one more, split .* outlook \d"),
    "app_latency": ([], r"in the browser, 100 postures: from slider to number median \d+ ms"),
    "batch_time": (["--runs", "8"], r"8 runs again, all done: .* exit status [01];"),
    "cluster_scaling": (
        ["--data-sets", "20", "--runs", "4", "--pieces", "50"],
        r"scaling of 2 against 1: \d.*same bytes: True",
    ),
    "fit_time": (["--repeat", "3", "--batch", "10"], r"10 runs in one call .* 10 converged"),
    "growth": (["--shots", "7", "--joints", "6", "--runs", "2"], r"compare, 2 runs +\d"),
    "history_time": (
        ["--results", "20", "--arms", "4", "--times", "1"],
        r"the drift of all arms: \d+\.\d s of CPU",
    ),
    "league": (["--only", "A"], r"\| UR10, series A \| 249 \| 248 \| 0\.8"),
    "outlook_time": (["--shots", "7", "--repeat", "1"], r" 7 +\d.*\d"),
    "pattern_table": ([], r"\| X \| 0\.0 \| 0\.0 \| none \| 0\.3"),
    "plan_choice": (["--candidates", "400"], r"E: .* certified efficiency 0\.\d+"),
    "plan_clearance": (
        ["--arms", "irb1600", "--shots", "7", "--candidates", "100"],
        r"2 plans: median \d.*; 0 above",
    ),
    "posterior_time": (
        ["--ess", "500", "--seconds", "1", "--only", "uncalibrated"],
        r"zerobeam: ESS [\d,]+ of",
    ),
    "start_time": (["--repeat", "1"], r"report +\d.* times the yardstick"),
    "tracker_table": (["--sets", "1"], r"zerobeam +\| \d"),
    "wrong_passes": (["--arms", "2"], r"\| 20, the first 2 again \| 0 of \d"),
}
# Those that run in the environment of the peers: tests/system/test_benchmarks.py has what of them runs here.
OF_PEERS = {"fit_peers", "posterior_peer", "tracker_peers"}


def test_each_script_has_a_small_size() -> None:
    assert {path.stem for path in BENCHMARKS.glob("*.py")} == {*SMALL, *OF_PEERS, "same_answers"}


@pytest.mark.long
@pytest.mark.parametrize("name", SMALL)
def test_a_benchmark_prints_its_figures(name: str) -> None:
    arguments, line = SMALL[name]
    command = [sys.executable, str(BENCHMARKS / f"{name}.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    assert re.search(line, done.stdout), done.stdout


@pytest.mark.long
def test_answers_are_the_same_as_before_or_they_are_not(tmp_path: Path) -> None:
    same_answers = load_script(BENCHMARKS, "same_answers")
    name, answer = next(same_answers.answers(tmp_path))
    assert same_answers.compare(name, answer, answer)
    row = next(row for row in answer["parameters"] if row["std"])
    other = row | {"estimate": row["estimate"] + 1e-5 * row["std"]}
    rows = [other if one is row else one for one in answer["parameters"]]
    assert not same_answers.compare(name, answer, answer | {"parameters": rows})
