"""Threads of the linear algebra: one within, as many as before afterwards, in libraries loaded later too."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import sys
import scipy.special
before = "scipy.linalg" in sys.modules  # of older versions
from threadpoolctl import threadpool_info, threadpool_limits
from zerobeam.analysis.estimation.threads import one_blas_thread

def counts():
    return {own["filepath"]: own["num_threads"] for own in threadpool_info() if own["user_api"] == "blas"}

assert ("scipy.linalg" in sys.modules) == before
with threadpool_limits(limits=3, user_api="blas"):
    with one_blas_thread():
        assert set(counts().values()) == {1}
    import scipy.linalg
    threadpool_limits(limits=3, user_api="blas")
    assert set(counts().values()) == {3}
    with one_blas_thread():
        assert set(counts().values()) == {1}
    assert set(counts().values()) == {3}
"""


@pytest.mark.long
def test_one_thread_within_in_every_library_that_is_loaded() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
