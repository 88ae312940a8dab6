"""Work side by side on Dask: the answers of processes to the bit, whoever dies, and no foreign worker."""

import builtins
import json
import operator
import random
import threading
import time
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from command_line import zerobeam

from zerobeam.analysis.status import versions
from zerobeam.experiments import cluster as clusters
from zerobeam.experiments.cluster import about, cluster
from zerobeam.experiments.processes import AHEAD, side_by_side, worked
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.coverage import studied_plans
from zerobeam.experiments.studies.drift_coverage import drift_study
from zerobeam.experiments.studies.geometry_coverage import PLAN_CASES, ArmsOfPlan, answer_of
from zerobeam.model.errors import BadInput, WorkersLost
from zerobeam.model.records import to_json

distributed = pytest.importorskip("distributed")
from dask_clusters import answers, local_workers, scheduler_elsewhere, study_bytes  # noqa: E402
from slow_work import ends_its_worker, slow_once  # noqa: E402


def squared(number):
    if number < 0:
        raise BadInput("a number below 0", found=number)
    return number, np.float64(number) ** 2


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
            answers(squared, [1, -1])
        assert answers(squared, [7]) == {0: squared(7)}  # the cluster goes on after an error
    assert answers(squared, [7]) == {0: squared(7)}


def with_other_sources(dask_worker):
    return replace(about(1), source="0" * 64)


def with_another_numpy(dask_worker):
    return replace(about(1), versions={**versions(), "numpy": "0.1"})


def with_another_zerobeam(dask_worker):
    return replace(about(1), versions={**versions(), "zerobeam": "0.0.1"})


def with_more_threads(dask_worker):
    return replace(about(1), threads=4)


def without_zerobeam(dask_worker):
    raise ModuleNotFoundError("No module named 'zerobeam'")


@pytest.mark.parametrize(
    ("about", "said"),
    [
        (with_other_sources, "other sources"),
        (with_another_numpy, f"numpy 0.1, here {np.__version__}"),
        (with_another_zerobeam, "zerobeam 0.0.1, here"),
        (with_more_threads, "4 threads"),
        (without_zerobeam, "zerobeam cannot be loaded"),
    ],
)
def test_a_worker_that_would_answer_otherwise_is_refused(within_this_process, monkeypatch, about, said):
    monkeypatch.setattr(clusters, "_about", about)
    with pytest.raises(BadInput, match="would not give the same answer") as refused:
        cluster(scheduler=within_this_process.scheduler_address).__enter__()
    assert said in str(refused.value)


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
    monkeypatch.setattr(clusters, "PATIENCE_S", 0.3)
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


def collect(into, found):
    """Keep what there is up to an error."""
    for number, answer in found:
        into[number] = answer


def negative(number):
    if number == 150:
        raise BadInput("not this one", found=number)
    return -number


def test_short_pieces_travel_together(within_this_process):
    with cluster(scheduler=within_this_process.scheduler_address) as traffic:
        assert answers(negative, iter(range(150))) == {k: -k for k in range(150)}
        assert traffic.pieces == 150
        assert traffic.parcels < 20
        # Of what travels with an error all that was before it is there, and the cluster goes on.
        found = {}
        with pytest.raises(BadInput, match="not this one"):
            collect(found, side_by_side(negative, iter(range(200))))
        assert set(range(150 - 64)) <= set(found)
        assert 150 not in found
        assert answers(negative, range(5)) == {k: -k for k in range(5)}


def test_a_parcel_is_of_so_many_seconds_and_bytes(monkeypatch):
    given = clusters._Dispatch(None, clusters.Traffic(), lambda client: None, bool, b"")
    assert len(given.together(enumerate(range(100)), None)) == 1  # nobody knows yet how long they take
    given._piece_s = 0.1
    assert len(given.together(enumerate(range(100)), None)) == 10
    given._piece_s = 3.0
    assert len(given.together(enumerate(range(100)), None)) == 1
    given._piece_s = 0.0
    assert len(given.together(enumerate(range(100)), None)) == 64
    assert len(given.together(enumerate([bytes(200_000)] * 9), None)) == 3
    assert len(given.together(enumerate(range(4)), 4)) == 2  # the other half for when it is done
    given._workers, given._piece_s = 1000, 1.5  # one scheduler gives out 50 parcels a second
    assert len(given.together(enumerate(range(100)), None)) == 13


def test_a_worker_that_joins_later_is_looked_at_too(within_this_process, monkeypatch):
    """What answers depend on is compared where each piece is worked out."""
    times = []

    def changing(threads):
        times.append(threads)
        return replace(about(threads), source=str(len(times)))

    with cluster(scheduler=within_this_process.scheduler_address):
        monkeypatch.setattr(clusters, "about", changing)
        monkeypatch.setattr(clusters, "_about", with_another_numpy)
        with pytest.raises(BadInput, match=r"numpy 0\.1, here"):
            answers(negative, [7])


def test_without_any_worker_it_does_not_wait_for_ever(within_this_process, monkeypatch):
    monkeypatch.setattr(clusters, "_COUNT_S", 0.0)
    monkeypatch.setattr(clusters, "_NO_WORKER_S", 0.1)
    monkeypatch.setattr(clusters, "_LOOK_S", 0.05)
    with cluster(scheduler=within_this_process.scheduler_address):
        within_this_process.scale(0)
        within_this_process.sync(within_this_process._correct_state)
        with pytest.raises(WorkersLost, match="has had no worker"):
            answers(negative, [7])


@pytest.fixture(scope="module")
def plans():
    return studied_plans(5)[::3]  # the best, and one with a gauge


@pytest.fixture(scope="module")
def expected(plans):
    return study_bytes(plans, processes=1)


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_a_study_has_the_same_bytes_on_any_number_of_workers(workers, plans, expected):
    with cluster(workers=workers) as traffic:
        assert study_bytes(plans) == expected
    assert traffic.pieces == 8


@pytest.mark.long
def test_a_study_has_the_same_bytes_by_a_scheduler_elsewhere(tmp_path, plans, expected):
    with scheduler_elsewhere(tmp_path, 2) as (address, _), cluster(scheduler=address):
        assert study_bytes(plans) == expected


@pytest.mark.long
def test_the_studies_of_drift_and_geometry_have_the_same_bytes_on_workers(tmp_path):
    pieces = [ArmsOfPlan(case, 20, 0, 300) for case in (PLAN_CASES[0], PLAN_CASES[-1])]

    def answered(name, **how):
        answer = to_json(drift_study(12, Engine(0, store=tmp_path / name, **how)))
        answer.pop("seconds")
        return json.dumps(answer), sorted((tmp_path / name).read_text().splitlines())

    own = answered("own", processes=2), {k: worked(answer_of, piece) for k, piece in enumerate(pieces)}
    with cluster(workers=2):
        assert (answered("on"), answers(answer_of, pieces)) == own


@pytest.mark.long
def test_a_batch_has_the_same_bytes_on_workers(tmp_path):
    from exact_runs import demo_runs

    runs = [run.path for run in demo_runs()]
    how = [*runs, "--no-posterior"]
    assert zerobeam("batch", *how, "-o", tmp_path / "own").status == 1
    assert zerobeam("batch", *how, "-o", tmp_path / "on", "--workers", 2).status == 1
    for path in (tmp_path / "own").rglob("*"):
        other = tmp_path / "on" / path.relative_to(tmp_path / "own")
        assert path.is_dir() or path.read_bytes() == other.read_bytes()


@pytest.mark.long
def test_workers_that_are_killed_all_the_time_change_no_byte():
    """One is killed every ten seconds until the study has ended, as long as that takes."""
    plans, data_sets = studied_plans(5)[::3], 2000  # the best, and one with a gauge
    expected = study_bytes(plans, data_sets, processes=2)
    over, killed = threading.Event(), []

    def kill():
        while not over.wait(10.0):
            if found := local_workers():
                one = random.choice(found)
                one.kill()
                killed.append(one.pid)

    with cluster(workers=2) as traffic:
        killer = threading.Thread(target=kill)
        killer.start()
        try:
            assert study_bytes(plans, data_sets) == expected
        finally:
            over.set()
            killer.join()
    assert len(killed) >= 3
    assert traffic.again >= 1


@pytest.mark.long
def test_a_worker_that_dask_gives_up_is_replaced(monkeypatch):
    """As on a busy machine: what was killed takes longer to start again than Dask waits."""
    monkeypatch.setitem(clusters._SETTINGS, "distributed.deploy.lost-worker-timeout", "100ms")
    monkeypatch.setattr(clusters, "_NO_WORKER_S", 45.0)
    with cluster(workers=1):
        assert answers(operator.neg, range(3)) == {k: -k for k in range(3)}
        local_workers()[0].kill()
        time.sleep(2.0)
        assert answers(operator.neg, range(3)) == {k: -k for k in range(3)}


@pytest.mark.long
@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_piece_that_ends_every_worker_is_said(elsewhere, tmp_path, monkeypatch):
    """What travelled with it is worked out; a scheduler elsewhere tries four workers before it says so."""
    monkeypatch.setattr(clusters, "_MOST_LOST", 7 if elsewhere else 3)
    found = {}

    def carried_out(**where):
        with cluster(**where), pytest.raises(WorkersLost, match=r"a piece of work has ended \d workers"):
            collect(found, side_by_side(ends_its_worker, range(60)))

    if elsewhere:
        with scheduler_elsewhere(tmp_path, 1) as (address, _):
            carried_out(scheduler=address)
    else:
        carried_out(workers=1)
    assert set(range(30)) <= set(found)
    assert 30 not in found


@pytest.mark.long
def test_a_scheduler_that_goes_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "PATIENCE_S", 2.0)

    def kill(found):
        for number, answer in found:
            yield number, answer
            if number == AHEAD:
                scheduler.kill()

    with (
        scheduler_elsewhere(tmp_path, 1) as (address, (scheduler, _)),
        cluster(scheduler=address),
        pytest.raises(WorkersLost, match="the scheduler has gone"),
    ):
        collect({}, kill(side_by_side(operator.neg, range(1_000_000))))


@pytest.mark.long
def test_a_piece_on_a_slow_worker_is_given_to_another(tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_SLOW_S", 0.5)
    with cluster(workers=2) as traffic:
        jobs = [(k, str(tmp_path / "mark")) for k in range(6)]
        assert answers(slow_once, jobs) == {k: k for k in range(6)}
        assert traffic.again >= 1
