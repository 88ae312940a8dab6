"""Ctrl-C, a request to end and a lost scheduler while a cluster works: nothing half written, nothing lost."""

import json
import os
import signal
import sys
import time

import pytest
from child import ZEROBEAM, child
from command_line import zerobeam

distributed = pytest.importorskip("distributed")
import psutil  # noqa: E402
from dask_clusters import local_workers, scheduler_elsewhere  # noqa: E402

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals to a group of processes")


def answer_of(folder):
    answer = json.loads((folder / "study.json").read_text())
    answer.pop("seconds")
    return answer


def stopped(folder, how, *where, cases=1):
    """Start a study, let `how` stop it once some pieces are there: exit status, messages, processes left."""
    store = folder.with_name(f"{folder.name}.cases.jsonl")
    command = [*ZEROBEAM, "study", "coverage", "-o", str(folder), "--data-sets", "100", *where]
    with child(command, stderr=-1, start_new_session=True) as process:
        while process.poll() is None and (not store.exists() or store.read_bytes().count(b"\n") <= cases):
            time.sleep(0.05)
        workers = local_workers(process.pid)
        how(process.pid)
        _, err = process.communicate(timeout=100)
    _, left = psutil.wait_procs(workers, timeout=30)
    assert left == []
    assert sorted(folder.parent.iterdir()) == [store]
    assert store.read_bytes().endswith(b"\n")
    assert store.read_bytes().count(b"\n") > cases
    return process.returncode, err, len(workers)


KEPT = "The finished cases are kept in {}.cases.jsonl: the same command goes on with them."


@pytest.mark.long
def test_local_workers_end_and_the_study_goes_on(tmp_path):
    """Ctrl-C of a terminal reaches all processes of the group; a request to end only one, and a kill too."""
    folder = tmp_path / "here" / "study"
    folder.parent.mkdir()
    for cases, how in enumerate((signal.SIGINT, signal.SIGTERM, signal.SIGKILL), start=0):
        send = os.kill if how == signal.SIGKILL else os.killpg
        status, err, workers = stopped(
            folder, lambda pid, send=send, how=how: send(pid, how), "--workers", "2", cases=1 + 2 * cases
        )
        assert workers == 2
        if how != signal.SIGKILL:
            assert (status, err.splitlines()) == (130, [KEPT.format(folder), "stopped"])
    status = zerobeam("study", "coverage", "-o", folder, "--data-sets", 100, "--workers", 2).status
    assert zerobeam("study", "coverage", "-o", tmp_path / "own", "--data-sets", 100).status == status
    assert answer_of(folder) == answer_of(tmp_path / "own")


@pytest.mark.long
def test_a_scheduler_elsewhere_is_left_alone(tmp_path):
    folder = tmp_path / "here" / "study"
    folder.parent.mkdir()
    with scheduler_elsewhere(tmp_path, 2) as (address, started):
        status, err, _ = stopped(folder, lambda pid: os.killpg(pid, signal.SIGINT), "--scheduler", address)
        assert (status, err.splitlines()) == (130, [KEPT.format(folder), "stopped"])
        with distributed.Client(address, set_as_default=False) as client:
            assert client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)) == 0
            assert len(client.nthreads()) == 2
            assert client.submit(sum, [1, 2]).result(60) == 3

        def kill(pid):
            started[0].kill()

        status, err, _ = stopped(folder, kill, "--scheduler", address, cases=3)
        assert status == 3
        assert err.splitlines() == [KEPT.format(folder), "error: the scheduler has gone"]
