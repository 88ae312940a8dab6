"""What many tests start from."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from zerobeam.model.errors import BadInput


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of recordings that the project does not ship; without it the test is skipped."""
    stated = os.environ.get("ZEROBEAM_SHARED_DATA")
    folder = Path(stated) if stated else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not (folder / "mukca").is_dir():
        pytest.skip(f"no recordings at {folder}; name their folder in ZEROBEAM_SHARED_DATA")
    return folder


@pytest.fixture(scope="session", autouse=True)
def kernel_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder of compiled kernels for all tests of one session, and not the user's own.

    The workers of pytest-xdist share it: a kernel is compiled once (or, in a race, twice), not once a worker.
    """
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "kernels"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ZEROBEAM_CACHE", str(folder))
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
