"""Work that is done side by side by the workers of a Dask cluster: local ones, or those of a scheduler.

What a worker gets and gives is bytes. A piece that is lost with its worker is done again by another; one that
takes far longer than the others, at the end, is given to a second worker, and the first answer counts.
"""

from __future__ import annotations

import logging
import pickle
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count, islice
from queue import Empty, SimpleQueue
from typing import Any

from ..analysis.status import versions
from ..interruption import obey
from ..model.errors import BadInput, ZerobeamError, missing_extra
from .processes import AHEAD, Answer, Job, carried_out_by, interruptions_put_off, worked
from .source import source_hash

_PATIENCE_S = 20.0  # for a scheduler to answer, and for its first worker
_MOST_LOST = 20  # workers that one piece may take along before it is taken for the reason
_SLOW, _SLOW_S = 4.0, 5.0  # times the median of the others, and at least: a piece is given to a second worker
_LOOK_S = 0.5


class ClusterLost(ZerobeamError):
    """The scheduler has gone, or a piece ends every worker that takes it."""

    exit_status = 3


@dataclass
class Traffic:
    """What has gone through the scheduler: pieces, those that were lost or given out twice, bytes."""

    pieces: int = 0
    again: int = 0
    sent: int = 0
    received: int = 0


@dataclass(eq=False)
class _UnderWay:
    """A piece: its bytes, since when, and the attempts that have not been given up."""

    payload: bytes
    since: float
    futures: list[Any] = field(default_factory=list)
    lost: int = 0


@contextmanager
def cluster(workers: int | None = None, scheduler: str | None = None) -> Iterator[Traffic]:
    """Within, work side by side is done by so many local `workers`, or by those of the `scheduler` at this
    address.

    BadInput without the extra `cluster`, where no scheduler answers, or where a worker has another version of
    zerobeam or of the libraries, or several threads.
    """
    try:
        import cryptography  # noqa: F401 - Dask asks for it where the certificates are made
        import dask
        import distributed
    except ImportError as error:
        raise missing_extra("work on a cluster", "cluster", needed=error.name) from None
    traffic = Traffic()
    settings = {
        "distributed.comm.timeouts.connect": f"{_PATIENCE_S:g}s",
        "distributed.scheduler.allowed-failures": _MOST_LOST,
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.worker.daemon": True,
        "distributed.admin.large-graph-warning-threshold": "1GB",
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        stack.enter_context(_quiet())
        if scheduler is None:
            place = tempfile.mkdtemp(prefix="zerobeam-dask-")
            stack.callback(shutil.rmtree, place, ignore_errors=True)
            with interruptions_put_off():  # their threads and processes must not hear Ctrl-C
                local = distributed.LocalCluster(
                    n_workers=workers or 1,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address="127.0.0.1:0",  # else a port that may be taken, for all to see
                    silence_logs=logging.CRITICAL,
                    local_directory=place,
                    security=True,  # certificates for this cluster alone: nobody else can give it work
                )
            stack.callback(_closed, local)
        with interruptions_put_off():
            client = _client(distributed, scheduler, None if scheduler else local)
        stack.callback(_closed, client)
        _require_alike(client)
        stack.enter_context(carried_out_by(partial(_side_by_side, client, traffic)))
        yield traffic


def _client(distributed: Any, address: str | None, local: Any) -> Any:
    try:
        client = distributed.Client(address or local, set_as_default=False, timeout=_PATIENCE_S)
    except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
        raise BadInput(
            "no Dask scheduler answers at this address",
            found=f"{address}: {error}" if str(error) else address,
            allowed="the address that `dask scheduler` prints, such as tcp://10.0.0.1:8786",
            argument="--scheduler",
        ) from None
    try:
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except TimeoutError:
        _closed(client)
        raise BadInput(
            "the scheduler has no worker",
            found=address,
            remedy="start some: `dask worker --nthreads 1 --nworkers N ADDRESS`",
            argument="--scheduler",
        ) from None
    return client


def _require_alike(client: Any) -> None:
    """BadInput where a worker would give other bytes than this process."""

    for address, found in client.run(_about, on_error="return").items():
        if isinstance(found, ImportError):
            found = {"missing": str(found)}
        elif isinstance(found, Exception):
            continue  # it has just gone
        differs = _difference(found)
        if differs is not None:
            raise BadInput(
                "a worker of this cluster cannot be used: it would not give the same answer",
                found=f"{address}: {differs}",
                allowed="the same zerobeam and the same libraries on every worker, one thread each",
                remedy="install them there and start it with `dask worker --nthreads 1`, or stop that worker",
                argument="--scheduler",
            )


def _about(dask_worker: Any) -> dict[str, Any]:
    """On a worker: what its answers depend on."""
    return {"threads": dask_worker.state.nthreads, "versions": versions(), "source": source_hash()}


def _difference(found: dict[str, Any]) -> str | None:
    if "missing" in found:
        return f"zerobeam cannot be loaded ({found['missing']})"
    own = versions()
    differing = [
        f"{name} {found['versions'].get(name, 'is missing')}, here {at}"
        for name, at in own.items()
        if found["versions"].get(name) != at
    ]
    if differing:
        return "; ".join(differing)
    if found["source"] != source_hash():
        theirs, ours = found["source"][:12], source_hash()[:12]
        return f"zerobeam {own['zerobeam']} with other sources ({theirs}, here {ours})"
    return None if found["threads"] == 1 else f"{found['threads']} threads"


def _carried(source: str, payload: bytes) -> bytes:
    """On a worker: a piece in, its answer out; None in place of both where the sources differ."""
    if source_hash() != source:
        return pickle.dumps(None)
    try:
        work, job = pickle.loads(payload)
        return pickle.dumps((True, worked(work, job)))
    except Exception as error:  # noqa: BLE001 - it is raised again where the answer is awaited
        return pickle.dumps((False, error))


def _side_by_side(
    client: Any, traffic: Traffic, work: Callable[[Job], Answer], jobs: Iterable[Job]
) -> Generator[tuple[int, Answer], None, None]:
    done: SimpleQueue[tuple[int, Any]] = SimpleQueue()
    under_way: dict[int, _UnderWay] = {}
    spent: list[float] = []
    names = count()

    def give(number: int, **where: Any) -> None:
        piece = under_way[number]
        key = f"zerobeam-{source_hash()[:8]}-{id(done):x}-{next(names)}"
        future = client.submit(
            _carried, source_hash(), piece.payload, key=key, pure=False, retries=0, **where
        )
        piece.futures.append(future)
        future.add_done_callback(partial(_note, done, number))
        traffic.sent += len(piece.payload)

    waiting = enumerate(jobs)
    cores, asked = 1, -_LOOK_S
    try:
        while True:
            if time.monotonic() - asked > _LOOK_S:  # it is a question to the scheduler
                cores = max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)
                asked = time.monotonic()
            for number, job in islice(waiting, max(AHEAD * cores - len(under_way), 0)):
                under_way[number] = _UnderWay(pickle.dumps((work, job)), time.monotonic())
                give(number)
            if not under_way:
                return
            try:
                number, future = done.get(timeout=_LOOK_S)
            except Empty:
                obey()
                if client.status != "running":
                    raise ClusterLost("the scheduler has gone") from None
                _twice(client, under_way, spent, cores, give, traffic)
                continue
            piece = under_way.get(number)
            if piece is None or future not in piece.futures:
                continue  # of a piece that another worker has finished
            content = _content(future)
            if content is None:
                piece.futures.remove(future)
                piece.lost += 1
                traffic.again += 1
                if piece.lost > _MOST_LOST:
                    raise ClusterLost(f"a piece of work has ended {piece.lost} workers: they may lack memory")
                if not piece.futures:
                    give(number)
                continue
            traffic.received += len(content)
            answer = pickle.loads(content)
            if answer is None:
                _require_alike(client)
                raise ClusterLost("a worker has other sources of zerobeam than this process")
            sound, value = answer
            if not sound:
                raise value
            if others := [own for own in piece.futures if own is not future]:
                client.cancel(others, force=True)
            del under_way[number]
            traffic.pieces += 1
            spent.append(time.monotonic() - piece.since)
            yield number, value
    finally:
        left = [future for piece in under_way.values() for future in piece.futures]
        with suppress(Exception):  # the scheduler may have gone
            client.cancel(left, force=True)


def _note(done: SimpleQueue[tuple[int, Any]], number: int, future: Any) -> None:
    done.put((number, future))


def _content(future: Any) -> bytes | None:
    """The answer of a worker; None where it was lost with it."""
    try:
        found = future.result(timeout=600)
    except Exception as error:  # noqa: BLE001 - all errors of the work itself are in the answer
        logging.getLogger(__name__).info("a piece is done again: %r", error)
        return None
    return bytes(found)


def _twice(
    client: Any,
    under_way: dict[int, _UnderWay],
    spent: list[float],
    cores: int,
    give: Callable[..., None],
    traffic: Traffic,
) -> None:
    """Give what takes far longer than the others to a second worker, if one has nothing to do."""
    if not spent or len(under_way) >= cores:
        return
    limit = max(_SLOW * statistics.median(spent), _SLOW_S)
    for number, piece in under_way.items():
        if len(piece.futures) == 1 and time.monotonic() - piece.since > limit:
            busy = {worker for worker, keys in client.processing().items() if keys}
            free = [own for own in client.scheduler_info(n_workers=-1)["workers"] if own not in busy]
            if free:
                give(number, workers=free, allow_other_workers=False)
                traffic.again += 1


def _closed(closing: Any) -> None:
    with suppress(Exception):
        closing.close(timeout=5)


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask's own words about workers that come and go are not for a person who reads zerobeam's."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
