"""Pieces on a cluster: how they travel, and what becomes of those whose worker dies, hangs or is foreign."""

import operator
import random
import threading
import time

import pytest

from zerobeam.analysis.status import versions
from zerobeam.experiments import cluster as clusters
from zerobeam.experiments.cluster import about, cluster
from zerobeam.experiments.processes import AHEAD, side_by_side
from zerobeam.experiments.studies.coverage import studied_plans
from zerobeam.model.errors import BadInput, WorkersLost

distributed = pytest.importorskip("distributed")
from dask_clusters import answers, local_workers, scheduler_elsewhere, study_bytes  # noqa: E402
from slow_work import ends_its_worker, slow_once  # noqa: E402


def collect(into, found):
    """Keep what there is up to an error."""
    for number, answer in found:
        into[number] = answer


def negative(number):
    if number == 150:
        raise BadInput("not this one", found=number)
    return -number


@pytest.fixture
def one_worker():
    """A scheduler with one worker, in threads of this process."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as local:
        yield local


def test_short_pieces_travel_together(one_worker):
    with cluster(scheduler=one_worker.scheduler_address) as traffic:
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


def test_a_worker_that_joins_later_is_looked_at_too(one_worker, monkeypatch):
    """What answers depend on is compared where each piece is worked out."""
    times = []

    def changing(threads):
        times.append(threads)
        return {**about(threads), "times": len(times)}

    def with_another_numpy(dask_worker):
        return {**about(1), "versions": {**versions(), "numpy": "0.1"}}

    with cluster(scheduler=one_worker.scheduler_address):
        monkeypatch.setattr(clusters, "about", changing)
        monkeypatch.setattr(clusters, "_about", with_another_numpy)
        with pytest.raises(BadInput, match=r"numpy 0\.1, here"):
            answers(negative, [7])


def test_without_any_worker_it_does_not_wait_for_ever(one_worker, monkeypatch):
    monkeypatch.setattr(clusters, "_COUNT_S", 0.0)
    monkeypatch.setattr(clusters, "_NO_WORKER_S", 0.1)
    monkeypatch.setattr(clusters, "_LOOK_S", 0.05)
    with cluster(scheduler=one_worker.scheduler_address):
        one_worker.scale(0)
        one_worker.sync(one_worker._correct_state)
        with pytest.raises(WorkersLost, match="has had no worker"):
            answers(negative, [7])


# --- with processes of their own --------------------------------------------------------------------


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
