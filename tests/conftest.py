"""What many tests start from."""

import argparse
import gc
import os
import re
import sys
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from zerobeam.model.errors import BadInput

BEGAN = time.monotonic()

# As the command line does (`cli.main`): by default the collector takes a good part of the time.
gc.set_threshold(50_000, 20, 20)


def pytest_xdist_auto_num_workers() -> int:
    """Half as many again as cores: some tests wait for a browser, a server or a clock."""
    cores = os.cpu_count() or 1
    return cores + cores // 2


def pytest_collection_finish() -> None:
    """What has been collected stays to the end, and need not be looked at again by the garbage collector."""
    gc.freeze()


def pytest_unconfigure() -> None:
    if "chromium" in sys.modules:
        sys.modules["chromium"].close_browser()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--shard", type=_shard, metavar="K/N", help="the tests of the K-th of N parts alone")
    parser.addoption("--minutes", type=float, metavar="M", help="no test begins later than this")


def _shard(stated: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", stated)
    if not found or int(found[1]) > int(found[2]):
        raise argparse.ArgumentTypeError(f"{stated!r} is no part, such as 1/4")
    return int(found[1]), int(found[2])


@pytest.hookimpl(tryfirst=True)  # before `-m` chooses
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    cases = Counter[str]()
    for item in items:
        function, _, parameters = item.nodeid.removesuffix("]").partition("[")
        at_length = any(re.search(marker.args[0], parameters) for marker in item.iter_markers("at_length"))
        between = any(cases[function] % marker.args[0] for marker in item.iter_markers("one_in"))
        cases[function] += 1
        if at_length or between:
            item.add_marker(pytest.mark.long)
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.timeout(3600))
    if shard := config.getoption("--shard"):
        others = [item for item in items if zlib.crc32(item.nodeid.encode()) % shard[1] != shard[0] - 1]
        config.hook.pytest_deselected(items=others)
        left_out = set(others)
        items[:] = [item for item in items if item not in left_out]


def pytest_runtest_setup(item: pytest.Item) -> None:
    minutes = item.config.getoption("--minutes")
    if minutes is not None and time.monotonic() - BEGAN > 60 * minutes:
        pytest.skip(f"not begun within {minutes:g} minutes")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of recordings that the project does not ship; without it the test is skipped."""
    stated = os.environ.get("ZEROBEAM_SHARED_DATA")
    folder = Path(stated) if stated else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not (folder / "mukca").is_dir():
        pytest.skip(f"no recordings at {folder}; name their folder in ZEROBEAM_SHARED_DATA")
    return folder


@pytest.fixture(scope="session", autouse=True)
def kernel_cache(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder of compiled kernels for all tests, and not the user's own: a kernel is compiled again only when
    its source, the compiler or its flags have changed, all of which its name has.

    What `tests/support/made_once.py` keeps is kept for one session; the workers of pytest-xdist share it.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder, made = pytestconfig.rootpath / "build" / "kernels", shared / "made"
    with pytest.MonkeyPatch.context() as patch:
        for name, path in (("ZEROBEAM_CACHE", folder), ("ZEROBEAM_TESTS_MADE", made)):
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            patch.setenv(name, str(path))
        yield folder


@pytest.fixture
def refused() -> Callable[..., BadInput]:
    """Call something that must raise BadInput, and give the error for a closer look."""

    def call(function: Callable[..., object], *args: object, **kwargs: object) -> BadInput:
        with pytest.raises(BadInput) as caught:
            function(*args, **kwargs)
        return caught.value

    return call


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_linear_algebra() -> Iterator[None]:
    """Matrices are small here: with more threads than idle cores the tests take many times as long."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield
