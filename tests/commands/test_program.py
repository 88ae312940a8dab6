"""What comes late is whole when it comes, for whoever asks for it first."""

import subprocess
import sys

import pytest

START = """
import sys, numpy
from zerobeam.commands.program import when_used
when_used("numpy.testing", "numpy.f2py")
import numpy.testing, scipy.special
assert "unittest" not in sys.modules and "numpy.f2py.f2py2e" not in sys.modules
"""
ATTRIBUTE = "numpy.testing.assert_allclose(1.0, 1.0)"
NAME = "from numpy.testing import assert_allclose as close; close(1.0, 1.0)"
SUBMODULE = "import numpy.f2py.crackfortran; numpy.f2py.crackfortran.crackfortran"
THREADS = """
from concurrent.futures import ThreadPoolExecutor
with ThreadPoolExecutor(8) as pool:
    list(pool.map(lambda k: numpy.testing.assert_allclose(k, k), range(64)))
"""
REAL = """
first = numpy.testing
first.assert_allclose(1.0, 1.0)
assert sys.modules["numpy.testing"] is numpy.testing is not first and numpy.testing.__file__
when_used("numpy.testing")
import numpy.testing
assert numpy.testing.__file__
"""


@pytest.mark.parametrize("program", [ATTRIBUTE, NAME, SUBMODULE, THREADS, REAL])
@pytest.mark.one_in(5)
def test_a_module_comes_when_it_is_used(program: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", START + program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
