"""Pieces of work given to the workers of a Dask cluster, and their answers taken.

What travels is bytes. Short pieces travel together, in one parcel: what a task costs Dask is many times what
a short piece costs. Each piece is pickled on its own, so that no answer depends on what it travelled with.
A parcel that is lost with its worker is given again, piece by piece; one that takes far longer than the
others, at the end, is given to a second worker, and the first answer counts.
"""

from __future__ import annotations

import pickle
import secrets
import statistics
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence, Sized
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count, islice
from queue import Empty, SimpleQueue
from typing import Any

from ..analysis.status import versions
from ..interruption import obey
from ..model.errors import WorkersLost
from .processes import AHEAD, Answer, Job, worked
from .source import source_hash

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
    """What has gone through the scheduler: pieces, the parcels in which they travelled, those that were lost
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


def about(threads: int) -> dict[str, Any]:
    """What the answers of this process depend on."""
    return {"threads": threads, "versions": versions(), "source": source_hash()}


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
    given = _Given(client, traffic, require_alike, whole, pickle.dumps(work))
    left = len(jobs) if isinstance(jobs, Sized) else None
    waiting = enumerate(jobs)
    try:
        while True:
            parcels: list[_Parcel] = []
            for _ in range(given.wanted()):
                if not (pieces := given.together(waiting, left)):
                    break
                parcels.append(_Parcel(pieces))
                left = None if left is None else left - len(pieces)
            given.give(parcels)
            if not given.under_way:
                return
            for number, sound, value in given.answers():
                if not sound:
                    raise value
                yield number, value
    finally:
        given.cancel()


class _Given:
    """What the workers have at hand."""

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
        self._workers, self._counted, self._seen = 1, -_COUNT_S, time.monotonic()
        # No other client of this scheduler has the same names.
        self._names = (f"zerobeam-{secrets.token_hex(8)}-{number}" for number in count())

    def wanted(self) -> int:
        """How many more parcels the workers should have."""
        now = time.monotonic()
        if now - self._counted > _COUNT_S:
            self._counted, found = now, len(self._client.nthreads())
            self._workers = max(found, 1)
            self._whole()
            if found:
                self._seen = now
            elif now - self._seen > _NO_WORKER_S:
                raise WorkersLost(f"the scheduler has had no worker for {_NO_WORKER_S / 60:.0f} minutes")
        return min(AHEAD * self._workers, self._workers + _AT_HAND) - len(self.under_way)

    def together(self, waiting: Iterator[tuple[int, Any]], left: int | None) -> dict[int, bytes]:
        """The pieces of the next parcel; one until it is known how long they take."""
        most = 1
        if self._piece_s is not None:
            wanted = max(_PARCEL_S, self._workers / PARCELS_A_SECOND)
            most = min(max(int(wanted / max(self._piece_s, 1e-6)), 1), _PARCEL_PIECES)
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
        contents = [pickle.dumps((about(1), self._work, [*own.pieces.values()])) for own in parcels]
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
            asked = {k: own for k, (parcel, own) in enumerate(ended) if parcel in self.under_way}
            contents = self._client.gather(asked, errors="skip")
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
        if others := [own for own in parcel.futures if own is not future]:
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
                if free := [own for own in self._client.nthreads() if own not in busy]:
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
