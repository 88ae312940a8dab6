"""Work that is done side by side in processes of its own, and the hash of the sources that do it."""

from __future__ import annotations

import hashlib
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence, Sized
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from functools import cache, partial
from itertools import islice
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from types import FrameType
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from ..interruption import SIGNALS
from ..model.kernel import compiled_at_once, one_thread

Job = TypeVar("Job")
Answer = TypeVar("Answer")

Engine = Callable[[Callable[[Any], Any], Iterable[Any]], Generator[tuple[int, Any], None, None]]

_engine: ContextVar[Engine | None] = ContextVar("engine", default=None)
AHEAD = 3  # jobs that are taken for each process: one under way, the others at hand


@contextmanager
def carried_out_by(engine: Engine) -> Iterator[None]:
    """Within, `side_by_side` lets this do the work, in place of processes of this machine."""
    token = _engine.set(engine)
    try:
        yield
    finally:
        _engine.reset(token)


def on_cluster(work: Callable[[Job], Answer], jobs: Sequence[Job]) -> Iterable[Answer]:
    """The answers in the order of the jobs: side by side where an engine carries work out, else one after the
    other. For what takes no longer than processes take to start."""
    if _engine.get() is None:
        return map(work, jobs)
    with closing(side_by_side(work, jobs)) as results:
        answers = dict(results)
    return [answers[number] for number in range(len(jobs))]


def side_by_side(
    work: Callable[[Job], Answer], jobs: Iterable[Job], processes: int | None = None
) -> Generator[tuple[int, Answer], None, None]:
    """The number of each job and its answer, as they come; as many `processes` as there are cores.

    `work` is a function of a module, for it is looked up there by name. Jobs are taken as they are needed, a
    few ahead, so that not all of them are in memory. What ends it early (Ctrl-C, an error, its `close`)
    breaks off the jobs that are under way. Close it: what happens between two answers does not reach it.
    Kernels are compiled at once, so that no answer depends on what its process did before.
    """
    if (engine := _engine.get()) is not None:
        yield from engine(work, jobs)
        return
    processes = processes or os.cpu_count() or 1
    if isinstance(jobs, Sized):
        processes = min(processes, max(len(jobs), 1))
    if processes == 1:
        for number, job in enumerate(jobs):
            yield number, worked(work, job)
        return
    # Spawned, not forked: a fork takes the locks of threads along, but not the threads.
    context = get_context("spawn")
    ended, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_start, initargs=(ended,))
    done: SimpleQueue[tuple[int, Future[Answer]]] = SimpleQueue()
    try:
        waiting, under_way = enumerate(jobs), 0
        while True:
            for number, job in islice(waiting, AHEAD * processes - under_way):
                with interruptions_put_off():
                    pool.submit(worked, work, job).add_done_callback(partial(_note, done, number))
                under_way += 1
            if not under_way:
                break
            number, future = done.get()
            under_way -= 1
            yield number, future.result()
    except BaseException:
        held.close()  # nobody wants the answers that are still to come
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        held.close()
        ended.close()


def worked(work: Callable[[Job], Answer], job: Job) -> Answer:
    """The answer, by one thread: for what is done side by side the numbers must not depend on what was done
    before, and no core is idle."""
    with threadpool_limits(limits=1), compiled_at_once(), one_thread():
        return work(job)


def _note(done: SimpleQueue[tuple[int, Future[Answer]]], number: int, future: Future[Answer]) -> None:
    done.put((number, future))


@contextmanager
def interruptions_put_off() -> Iterator[None]:
    """Ctrl-C and requests to end are obeyed afterwards, and Ctrl-C reaches no process that is started here.

    An exception amid the locks of the pool's queues would leave one locked, and the pool waiting for ever. A
    terminal sends Ctrl-C to all processes, to workers too that are still at their imports: they inherit that
    it is blocked. To block it is not enough here, for other threads (of linear algebra) take it.
    """
    if threading.current_thread() is not threading.main_thread():  # never interrupted
        yield
        return
    heard: list[tuple[int, FrameType | None]] = []

    def note(number: int, frame: FrameType | None) -> None:
        heard.append((number, frame))

    before = {int(number): signal.getsignal(number) for number in SIGNALS}
    handlers = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, note)
    blocked = hasattr(signal, "pthread_sigmask") and signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if blocked is not False:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in heard:
            handlers[number](number, frame)


def _start(ended: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that waits for this one
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # by it the pool ends workers, whatever the parent ignored
    threadpool_limits(limits=1)
    threading.Thread(target=_end_with_parent, args=(ended,), daemon=True).start()


def _end_with_parent(ended: Connection) -> None:
    """A worker must not outlive the wait for its answers, and would wait for work for ever after a kill.

    The other end of `ended` is the parent's alone: closed when nobody waits any more and when it ends.
    """
    with suppress(EOFError, OSError):
        ended.recv()
    os._exit(1)


_ROOMS = ("analysis", "experiments", "model", "reports", "words")


@cache
def source_hash() -> str:
    """SHA-256 of the sources by which results are computed and written."""
    root, digest = Path(__file__).resolve().parents[1], hashlib.sha256()
    for room in _ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0")
            digest.update(path.read_bytes().replace(b"\r\n", b"\n") + b"\0")
    return digest.hexdigest()
