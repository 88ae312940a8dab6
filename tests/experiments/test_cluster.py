"""Work side by side on Dask: the answers of processes to the bit, whoever dies, and no foreign worker."""

import builtins
import contextlib
import json
import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing

import numpy as np
import pytest
from command_line import zerobeam
from slow_work import slow_once

from zerobeam.analysis.status import versions
from zerobeam.experiments import cluster as clusters
from zerobeam.experiments.cluster import cluster
from zerobeam.experiments.processes import AHEAD, side_by_side
from zerobeam.experiments.source import source_hash
from zerobeam.experiments.studies import coverage
from zerobeam.experiments.studies.answer import to_json
from zerobeam.experiments.studies.coverage import coverage_study, studied_plans
from zerobeam.model.errors import BadInput

distributed = pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")  # distributed's own


def squared(number):
    if number < 0:
        raise BadInput("a number below 0", found=number)
    return number, np.float64(number) ** 2


def answers(jobs, work=squared):
    with closing(side_by_side(work, jobs)) as found:
        return dict(found)


@pytest.fixture
def within_this_process():
    """A scheduler with one worker, in threads of this process."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as local:
        yield local


def test_the_answers_are_those_of_processes(within_this_process):
    expected = {k: squared(k) for k in range(20)}
    with cluster(scheduler=within_this_process.scheduler_address) as traffic:
        taken = []
        jobs = (taken.append(k) or k for k in range(20))
        with closing(side_by_side(squared, jobs)) as found:
            first = next(found)
            assert len(taken) == AHEAD  # no more jobs are in memory than are needed
            assert {**dict([first]), **dict(found)} == expected
        assert traffic.pieces == 20
        assert traffic.sent > 20 * 20
        assert traffic.received > 20 * 20
        with pytest.raises(BadInput, match="a number below 0"):
            answers([1, -1])
        assert answers([7]) == {0: squared(7)}  # the cluster goes on after an error
    assert answers([7]) == {0: squared(7)}


def with_other_sources(dask_worker):
    return {"threads": 1, "versions": versions(), "source": "0" * 64}


def with_another_numpy(dask_worker):
    return {"threads": 1, "versions": {**versions(), "numpy": "0.1"}, "source": source_hash()}


def without_zerobeam(dask_worker):
    raise ModuleNotFoundError("No module named 'zerobeam'")


@pytest.mark.parametrize(
    ("about", "said"),
    [
        (with_other_sources, "other sources"),
        (with_another_numpy, f"numpy 0.1, here {np.__version__}"),
        (without_zerobeam, "zerobeam cannot be loaded"),
    ],
)
def test_a_worker_that_would_answer_otherwise_is_refused(within_this_process, monkeypatch, about, said):
    monkeypatch.setattr(clusters, "_about", about)
    with pytest.raises(BadInput, match="would not give the same answer") as refused:
        cluster(scheduler=within_this_process.scheduler_address).__enter__()
    assert said in str(refused.value)


def test_what_makes_a_worker_foreign():
    own = {"threads": 1, "versions": versions(), "source": source_hash()}
    assert clusters._difference(own) is None
    assert "4 threads" in clusters._difference({**own, "threads": 4})
    older = {**versions(), "zerobeam": "0.0.1"}
    assert "zerobeam 0.0.1, here" in clusters._difference({**own, "versions": older})
    assert "No module" in clusters._difference({"missing": "No module named 'zerobeam'"})


def test_a_worker_that_joins_later_is_looked_at_too():
    """Sources are compared where each piece is worked out."""
    assert clusters.pickle.loads(clusters._carried("0" * 64, b"")) is None


@pytest.mark.parametrize("missing", ["cryptography", "distributed"])
def test_an_extra_that_is_not_whole_is_said(tmp_path, monkeypatch, missing):
    real = builtins.__import__

    def without(name, *rest, **how):
        if name == missing:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *rest, **how)

    monkeypatch.setattr(builtins, "__import__", without)
    told = zerobeam("study", "coverage", "-o", tmp_path / "study", "--workers", 2).refused()
    assert f"{missing}, which is not installed" in told
    assert 'pip install "zerobeam[cluster]"' in told
    assert not list(tmp_path.iterdir())


def test_no_scheduler_and_two_clusters_are_said(tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_PATIENCE_S", 0.3)
    study = ("study", "coverage", "-o", tmp_path / "study", "--data-sets", 100)
    told = zerobeam(*study, "--scheduler", "tcp://127.0.0.1:9").refused()
    assert "no Dask scheduler answers at this address" in told
    assert "exclude each other" in zerobeam(*study, "--scheduler", "tcp://x:1", "--workers", 2).refused()
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_an_optimal_plan_is_the_same_by_a_cluster(within_this_process, tmp_path):
    header = tmp_path / "header.yaml"
    header.write_text(
        "robot: irb1600\ntool: {kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\n"
    )
    asked = ["--target", "950,150,100", "--candidates", 300, "--criterion", "E"]
    how = ["plan", "optimal", "--header", header, *asked]
    assert zerobeam(*how, "-o", tmp_path / "own.yaml").status == 0
    address = within_this_process.scheduler_address
    told = zerobeam(*how, "-o", tmp_path / "on.yaml", "--scheduler", address)
    assert told.status == 0, told.err
    assert (tmp_path / "on.yaml").read_bytes() == (tmp_path / "own.yaml").read_bytes()


# --- with processes of their own --------------------------------------------------------------------


def study_bytes(plans, **how):
    """The answer of a small coverage study without its clock, as text."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "studied_plans", lambda seed: plans)
        answer = to_json(coverage_study(200, 5, lambda *_: None, **how))
    answer.pop("seconds")
    return json.dumps(answer)


@pytest.fixture(scope="module")
def plans():
    return studied_plans(5)[::3]  # the best, and one with a gauge


@pytest.fixture(scope="module")
def expected(plans):
    return study_bytes(plans, processes=1)


@contextlib.contextmanager
def scheduler_elsewhere(tmp_path, workers):
    """A scheduler and workers as `dask scheduler` and `dask worker` start them."""
    file = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    dask = [sys.executable, "-m", "dask"]
    where = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file]
    started = [subprocess.Popen([*dask, "scheduler", *where], **quiet)]
    try:
        limit = time.monotonic() + 60
        while not file.exists() or not file.read_text().rstrip().endswith("}"):
            assert time.monotonic() < limit
            time.sleep(0.2)
        address = json.loads(file.read_text())["address"]
        started.append(
            subprocess.Popen(
                [*dask, "worker", address, "--nworkers", str(workers), "--nthreads", "1", "--no-dashboard"],
                **quiet,
            )
        )
        yield address
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGTERM)
        for process in started:
            process.wait(60)


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_a_study_has_the_same_bytes_on_any_number_of_workers(workers, plans, expected):
    with cluster(workers=workers) as traffic:
        assert study_bytes(plans) == expected
    assert traffic.pieces == 8


@pytest.mark.long
def test_a_study_has_the_same_bytes_by_a_scheduler_elsewhere(tmp_path, plans, expected):
    with scheduler_elsewhere(tmp_path, 2) as address, cluster(scheduler=address):
        assert study_bytes(plans) == expected


@pytest.mark.long
def test_workers_that_are_killed_change_no_byte(plans, expected):
    over, killed = threading.Event(), []

    def kill():
        while len(killed) < 4 and not over.wait(6.0):  # for ever, on a busy machine none would get to its end
            found = [
                child
                for child in psutil.Process().children(recursive=True)
                if "spawn_main" in " ".join(child.cmdline())
            ]
            if found:
                one = random.choice(found)
                one.kill()
                killed.append(one.pid)

    with cluster(workers=2):
        killer = threading.Thread(target=kill)
        killer.start()
        try:
            assert study_bytes(plans) == expected
        finally:
            over.set()
            killer.join()
    assert killed


@pytest.mark.long
def test_a_piece_on_a_slow_worker_is_given_to_another(tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_SLOW_S", 0.5)
    with cluster(workers=2) as traffic:
        jobs = [(k, str(tmp_path / "mark")) for k in range(6)]
        assert answers(jobs, slow_once) == {k: k for k in range(6)}
        assert traffic.again >= 1


@pytest.mark.long
def test_a_batch_has_the_same_bytes_on_workers(tmp_path):
    from zerobeam.experiments.demos import demo_runs

    runs = [run.path for run in demo_runs()]
    how = [*runs, "--no-posterior"]
    assert zerobeam("batch", *how, "-o", tmp_path / "own").status == 1
    assert zerobeam("batch", *how, "-o", tmp_path / "on", "--workers", 2).status == 1
    for path in (tmp_path / "own").rglob("*"):
        other = tmp_path / "on" / path.relative_to(tmp_path / "own")
        assert path.is_dir() or path.read_bytes() == other.read_bytes()
