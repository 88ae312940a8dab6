"""Work that is done side by side by the workers of a Dask cluster: local ones, or those of a scheduler.

What travels is bytes. Short pieces travel together, in one parcel: what a task costs Dask is many times what
a short piece costs. Each piece is pickled on its own, so that no answer depends on what it travelled with.
A parcel that is lost with its worker is given again, piece by piece; one that takes far longer than the
others, at the end, is given to a second worker, and the first answer counts.
"""

from __future__ import annotations

import logging
import pickle
import secrets
import shutil
import signal
import statistics
import tempfile
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count, islice
from multiprocessing import resource_tracker
from queue import Empty, SimpleQueue
from typing import Any

from ..analysis.status import versions
from ..interruption import obey
from ..model.errors import BadInput, WorkersLost, missing_extra
from .processes import AHEAD, Answer, Job, carried_out_by, interruptions_put_off, source_hash, worked

_MOST_LOST = 20  # workers that one piece may take along before it is taken for the reason
_SLOW, _SLOW_S = 4.0, 5.0  # times the median of the others, and at least: given to a second worker
_LOOK_S = 0.5
_COUNT_S = 2.0  # from one question how many workers there are to the next
_PARCEL_S = 1.0  # of work in a parcel; more where there are so many workers that
PARCELS_A_SECOND = 50  # would be exceeded: all of them pass through one client and one scheduler
_PARCEL_PIECES, PARCEL_BYTES = 64, 500_000  # at most
_AT_HAND = 50  # parcels that wait for a worker, at most
_NO_WORKER_S = 600.0  # without any worker: new ones may take a while to start
PATIENCE_S = 20.0  # for a scheduler to answer


@dataclass
class Traffic:
    """Traffic through the scheduler: pieces, the parcels in which they travelled, those that were lost
    or given out twice, bytes."""

    pieces: int = 0
    parcels: int = 0
    again: int = 0
    sent: int = 0
    received: int = 0


@dataclass(eq=False)
class _Parcel:
    """Pieces by their number, since when, the attempts that have not been given up, those that were lost."""

    pieces: dict[int, bytes]
    lost: int = 0
    since: float = 0.0
    futures: list[Any] = field(default_factory=list)


@dataclass(frozen=True)
class ProcessFacts:
    """The facts that the answers of a process depend on: threads, versions, and the hash of the sources."""

    threads: int
    versions: Mapping[str, str]
    source: str


def about(threads: int) -> ProcessFacts:
    """The facts of this process."""
    return ProcessFacts(threads, versions(), source_hash())


def by_workers(
    client: Any,
    traffic: Traffic,
    require_alike: Callable[[Any], None],
    whole: Callable[[], object],
    work: Callable[[Job], Answer],
    jobs: Iterable[Job],
) -> Generator[tuple[int, Answer], None, None]:
    """The engine of `side_by_side`: number and answer of each job as they come, by the client's workers.

    `require_alike` raises BadInput where a worker would give another answer; `whole` is called now and then,
    to replace workers that have gone. WorkersLost where the scheduler has gone, or a piece ends every worker
    that takes it.
    """
    dispatch = _Dispatch(client, traffic, require_alike, whole, pickle.dumps(work))
    left = len(jobs) if isinstance(jobs, Sized) else None
    waiting = enumerate(jobs)
    try:
        while True:
            parcels: list[_Parcel] = []
            for _ in range(dispatch.missing_parcels()):
                if not (pieces := dispatch.together(waiting, left)):
                    break
                parcels.append(_Parcel(pieces))
                left = None if left is None else left - len(pieces)
            dispatch.give(parcels)
            if not dispatch.under_way:
                return
            for number, sound, value in dispatch.answers():
                if not sound:
                    raise value
                yield number, value
    finally:
        dispatch.cancel()


class _Dispatch:
    """The parcels that are given out, and the answers that come back."""

    def __init__(
        self,
        client: Any,
        traffic: Traffic,
        require_alike: Callable[[Any], None],
        whole: Callable[[], object],
        work: bytes,
    ) -> None:
        self.under_way: set[_Parcel] = set()
        self._client, self._traffic, self._work = client, traffic, work
        self._require_alike, self._whole = require_alike, whole
        self._done: SimpleQueue[tuple[_Parcel, Any]] = SimpleQueue()
        self._spent: deque[float] = deque(maxlen=200)  # seconds from giving a parcel to its answer
        self._piece_s: float | None = None  # that a piece takes a worker, on average
        self._workers, self._counted, self._worker_at = 1, -_COUNT_S, time.monotonic()
        # No other client of this scheduler has the same names.
        self._names = (f"zerobeam-{secrets.token_hex(8)}-{number}" for number in count())

    def missing_parcels(self) -> int:
        """How many more parcels the workers should have."""
        now = time.monotonic()
        if now - self._counted > _COUNT_S:
            self._counted, workers = now, len(self._client.nthreads())
            self._workers = max(workers, 1)
            self._whole()
            if workers:
                self._worker_at = now
            elif now - self._worker_at > _NO_WORKER_S:
                raise WorkersLost(f"the scheduler has had no worker for {_NO_WORKER_S / 60:.0f} minutes")
        return min(AHEAD * self._workers, self._workers + _AT_HAND) - len(self.under_way)

    def together(self, waiting: Iterator[tuple[int, Any]], left: int | None) -> dict[int, bytes]:
        """The pieces of the next parcel; one until it is known how long they take."""
        most = 1
        if self._piece_s is not None:
            missing_parcels = max(_PARCEL_S, self._workers / PARCELS_A_SECOND)
            most = min(max(int(missing_parcels / max(self._piece_s, 1e-6)), 1), _PARCEL_PIECES)
        if left is not None:  # all workers end at about the same time
            most = min(most, -(-left // (2 * self._workers)))
        pieces: dict[int, bytes] = {}
        size = 0
        for number, job in islice(waiting, max(most, 1)):
            pieces[number] = pickle.dumps(job)
            size += len(pieces[number])
            if size > PARCEL_BYTES:
                break
        return pieces

    def give(self, parcels: Sequence[_Parcel], **where: Any) -> None:
        """Give these parcels to the workers."""
        if not parcels:
            return
        contents = [pickle.dumps((about(1), self._work, [*parcel.pieces.values()])) for parcel in parcels]
        names = list(islice(self._names, len(parcels)))
        futures = self._client.map(_carried, contents, key=names, pure=False, retries=0, **where)
        for parcel, content, future in zip(parcels, contents, futures, strict=True):
            self.under_way.add(parcel)
            parcel.since = parcel.since or time.monotonic()
            parcel.futures.append(future)
            future.add_done_callback(partial(_note, self._done, parcel))
            self._traffic.sent += len(content)

    def answers(self) -> Iterator[tuple[int, bool, Any]]:
        """Number, whether it is sound, and answer or error of each piece whose answer has come; none after a
        while."""
        try:
            ended = [self._done.get(timeout=_LOOK_S)]
        except Empty:
            obey()
            self._require_scheduler()
            self._twice()
            return
        with suppress(Empty):
            while True:
                ended.append(self._done.get_nowait())
        contents: dict[int, bytes] = {}
        with suppress(Exception):  # the scheduler may have gone
            futures = {k: future for k, (parcel, future) in enumerate(ended) if parcel in self.under_way}
            contents = self._client.gather(futures, errors="skip")
        for k, (parcel, future) in enumerate(ended):
            if parcel not in self.under_way:
                continue  # another attempt was first
            if content := contents.get(k):
                yield from self._opened(parcel, future, content)
            else:
                self._again(parcel, future)

    def cancel(self) -> None:
        """Nobody waits for an answer any more."""
        left = [future for parcel in self.under_way for future in parcel.futures]
        if left:
            with suppress(Exception):  # the scheduler may have gone
                self._client.cancel(left, force=True)

    def _opened(self, parcel: _Parcel, future: Any, content: bytes) -> Iterator[tuple[int, bool, Any]]:
        self._traffic.received += len(content)
        answers = pickle.loads(content)
        if answers is None:
            self._refuse("a worker has other versions than this process")
        if others := [each for each in parcel.futures if each is not future]:
            self._client.cancel(others, force=True)
        self.under_way.remove(parcel)
        self._traffic.pieces += len(answers)
        self._traffic.parcels += 1
        self._spent.append(time.monotonic() - parcel.since)
        mean = sum(seconds for *_, seconds in answers) / len(answers)
        self._piece_s = mean if self._piece_s is None else (self._piece_s + mean) / 2
        for number, (answer, _) in zip(parcel.pieces, answers, strict=False):
            yield number, *pickle.loads(answer)

    def _again(self, parcel: _Parcel, future: Any) -> None:
        """Give a parcel again that was lost with its worker, or with the connection to the scheduler."""
        from distributed.scheduler import KilledWorker

        self._require_scheduler()
        error = None if future.cancelled() else future.exception()
        if error is not None and not isinstance(error, KilledWorker):
            self._refuse(f"a worker cannot do its work: {error!r}")
        parcel.futures.remove(future)
        parcel.lost += 1 if error is None else error.allowed_failures + 1
        self._traffic.again += 1
        if parcel.lost > _MOST_LOST:
            raise WorkersLost(f"a piece of work has ended {parcel.lost} workers: they may lack memory")
        if not parcel.futures:
            self.under_way.remove(parcel)
            self.give([_Parcel({number: job}, parcel.lost) for number, job in parcel.pieces.items()])

    def _refuse(self, what: str) -> None:
        self._require_alike(self._client)
        raise WorkersLost(what)

    def _require_scheduler(self) -> None:
        """A connection that was lost may come again: WorkersLost where it does not."""
        limit = time.monotonic() + PATIENCE_S
        while self._client.status != "running":
            if self._client.status != "connecting" or time.monotonic() > limit:
                raise WorkersLost("the scheduler has gone")
            time.sleep(_LOOK_S / 5)
            obey()

    def _twice(self) -> None:
        """Give what takes far longer than the others to a second worker, if one has nothing to do."""
        if not self._spent or len(self.under_way) >= self._workers:
            return
        limit = max(_SLOW * statistics.median(self._spent), _SLOW_S)
        for parcel in self.under_way:
            if len(parcel.futures) == 1 and time.monotonic() - parcel.since > limit:
                busy = {worker for worker, keys in self._client.processing().items() if keys}
                if free := [worker for worker in self._client.nthreads() if worker not in busy]:
                    self.give([parcel], workers=free, allow_other_workers=False)
                    self._traffic.again += 1


def _note(done: SimpleQueue[tuple[_Parcel, Any]], parcel: _Parcel, future: Any) -> None:
    done.put((parcel, future))


def _carried(content: bytes) -> bytes:
    """On a worker: pieces in, their answers or errors out, each with its seconds, up to the first error; None
    in place of all where this process is not as expected."""
    from distributed import get_worker

    expected, work, jobs = pickle.loads(content)
    if about(get_worker().state.nthreads) != expected:
        return pickle.dumps(None)
    return pickle.dumps(worked(partial(_answers, work), jobs))


def _answers(work: bytes, jobs: Sequence[bytes]) -> list[tuple[bytes, float]]:
    answers: list[tuple[bytes, float]] = []
    sound = True
    for job in jobs:
        if sound:
            began = time.perf_counter()
            sound, answer = _answer(work, job)
            answers.append((answer, time.perf_counter() - began))
    return answers


def _answer(work: bytes, job: bytes) -> tuple[bool, bytes]:
    try:
        return True, pickle.dumps((True, pickle.loads(work)(pickle.loads(job))))
    except Exception as error:  # noqa: BLE001 - it is raised again where the answer is awaited
        return False, pickle.dumps((False, error))


_SETTINGS = {
    "distributed.comm.timeouts.connect": f"{PATIENCE_S:g}s",
    "distributed.scheduler.allowed-failures": 0,  # lost pieces are counted here
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.deploy.lost-worker-timeout": "60s",  # on a busy machine a worker takes long to start
    "distributed.worker.daemon": True,
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.admin.large-graph-warning-threshold": "1GB",
    # What Dask measures of itself for its own pages took 3 % of a core in each of its processes.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.admin.system-monitor.disk": False,
    "distributed.admin.system-monitor.gil.enabled": False,
}
_LIBRARIES = ("distributed", "tornado", "asyncio")


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
    whole: Callable[[], object] = bool  # a scheduler elsewhere has its own ways
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_SETTINGS))
        stack.enter_context(_quiet())
        if scheduler is None:
            folder = tempfile.mkdtemp(prefix="zerobeam-dask-")
            stack.callback(shutil.rmtree, folder, ignore_errors=True)
            if hasattr(signal, "pthread_sigmask"):
                resource_tracker.ensure_running()  # else its start would end the block of the next line
            with interruptions_put_off():  # their threads and processes must not hear Ctrl-C
                local = distributed.LocalCluster(
                    n_workers=workers or 1,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address="127.0.0.1:0",  # else a port that may be taken, for all to see
                    silence_logs=logging.CRITICAL,
                    local_directory=folder,
                    security=True,  # certificates for this cluster alone: nobody else can give it work
                )
            stack.callback(_closed, local)
            whole = partial(_replace, local, workers or 1)
        with interruptions_put_off():
            client = _client(distributed, scheduler, None if scheduler else local)
        stack.callback(_closed, client)
        _require_alike(client)
        stack.enter_context(carried_out_by(partial(by_workers, client, traffic, _require_alike, whole)))
        yield traffic


def _replace(local: Any, workers: int) -> None:
    """Start workers anew that Dask has given up, since they took long to start again or ended as they did."""

    async def replaced() -> None:
        for name, worker in list(local.workers.items()):
            if worker.status.name in ("failed", "closed"):
                del local.workers[name]
        local.scale(workers)

    local.loop.add_callback(replaced)


def _client(distributed: Any, address: str | None, local: Any) -> Any:
    try:
        client = distributed.Client(address or local, set_as_default=False, timeout=PATIENCE_S)
    except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
        raise BadInput(
            "no Dask scheduler answers at this address",
            found=f"{address}: {error}" if str(error) else address,
            allowed="the address that `dask scheduler` prints, such as tcp://10.0.0.1:8786",
            argument="--scheduler",
        ) from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
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

    for address, facts in client.run(_about, on_error="return").items():
        if isinstance(facts, Exception) and not isinstance(facts, ImportError):
            continue  # it has just gone
        differs = _difference(facts)
        if differs is not None:
            raise BadInput(
                "a worker of this cluster cannot be used: it would not give the same answer",
                found=f"{address}: {differs}",
                allowed="the same zerobeam and the same libraries on every worker, one thread each",
                remedy="install them there and start it with `dask worker --nthreads 1`, or stop that worker",
                argument="--scheduler",
            )


def _about(dask_worker: Any) -> ProcessFacts:
    """On a worker: what its answers depend on."""
    return about(dask_worker.state.nthreads)


def _difference(facts: ProcessFacts | ImportError) -> str | None:
    """The first difference of a worker's facts from this process's, in words."""
    if isinstance(facts, ImportError):
        return f"zerobeam cannot be loaded ({facts})"
    installed, source = versions(), source_hash()
    differing = [
        f"{name} {facts.versions.get(name, 'is missing')}, here {version}"
        for name, version in installed.items()
        if facts.versions.get(name) != version
    ]
    if differing:
        return "; ".join(differing)
    if facts.source != source:
        return (
            f"zerobeam {installed['zerobeam']} with other sources ({facts.source[:12]}, here {source[:12]})"
        )
    return None if facts.threads == 1 else f"{facts.threads} threads"


def _closed(closing: Any) -> None:
    with suppress(Exception):
        closing.close(timeout=5)


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask's own words about workers that come and go are not for a person who reads zerobeam's."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in _LIBRARIES]
    loggers = [logging.getLogger(name) for name in names]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
