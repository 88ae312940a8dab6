"""Work that is done side by side by the workers of a Dask cluster: local ones, or those of a scheduler."""

from __future__ import annotations

import logging
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from typing import Any

from ..analysis.status import versions
from ..model.errors import BadInput, missing_extra
from .cluster_pieces import PATIENCE_S, Traffic, about, by_workers
from .processes import carried_out_by, interruptions_put_off
from .source import source_hash

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
            place = tempfile.mkdtemp(prefix="zerobeam-dask-")
            stack.callback(shutil.rmtree, place, ignore_errors=True)
            if hasattr(signal, "pthread_sigmask"):
                resource_tracker.ensure_running()  # else its start would end the block of the next line
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
        for name, own in list(local.workers.items()):
            if own.status.name in ("failed", "closed"):
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
    return about(dask_worker.state.nthreads)


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
