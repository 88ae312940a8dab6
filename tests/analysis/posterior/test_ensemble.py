"""What a process that samples by emcee loads, and what is left of emcee for who uses it beside us."""

import subprocess
import sys

PROGRAM = """
import sys
from zerobeam.analysis.posterior.ensemble import load_emcee
emcee = load_emcee()
assert emcee.EnsembleSampler and "scipy.stats" not in sys.modules
import numpy as np
sampler = emcee.EnsembleSampler(20, 2, lambda x: -(x**2).sum() / 2, moves=emcee.moves.KDEMove())
sampler.run_mcmc(np.random.default_rng(1).normal(size=(20, 2)), 10)
assert sampler.acceptance_fraction.mean() > 0.1
import scipy.stats
assert scipy.stats.norm.cdf(0.0) == 0.5 and sys.modules["scipy.stats"].__file__
assert load_emcee() is emcee
"""


def test_emcee_is_loaded_without_scipy_stats_and_its_kde_move_works():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
