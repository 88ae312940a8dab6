"""scipy.stats takes longer to load than a sampling: emcee comes without it, and is whole for all that."""

import subprocess
import sys

import pytest

START = """
import sys
from zerobeam.analysis.posterior.lean_emcee import lean_emcee
finders = list(sys.meta_path)
emcee = lean_emcee()
assert sys.modules["emcee"] is emcee and lean_emcee() is emcee
assert sys.meta_path == finders
assert not any(name.startswith("scipy.stats") for name in sys.modules)
"""
KDE_MOVE = """
import numpy as np
np.random.seed(1)
sampler = emcee.EnsembleSampler(40, 2, lambda x: -(x**2).sum() / 2, moves=emcee.moves.KDEMove(bw_method=0.5))
sampler.run_mcmc(np.random.standard_normal((40, 2)), 400)
draws = sampler.get_chain(discard=50, flat=True)
assert abs(draws.mean()) < 0.1 and abs(draws.std() - 1) < 0.1, (draws.mean(), draws.std())
assert "scipy.stats" in sys.modules
"""
LATER = """
import scipy.stats
from scipy.stats import gaussian_kde
assert scipy.stats.gaussian_kde is gaussian_kde and isinstance(gaussian_kde, type)
assert scipy.stats.norm.cdf(0) == 0.5
"""
EARLIER = """
import emcee, sys
from zerobeam.analysis.posterior.lean_emcee import lean_emcee
assert lean_emcee() is emcee and emcee.moves.kde.gaussian_kde is sys.modules["scipy.stats"].gaussian_kde
"""
AT_ONCE = """
import threading
def load():
    import scipy.stats
    seen.append(scipy.stats.gaussian_kde)
seen, others = [], [threading.Thread(target=load) for _ in range(4)]
[other.start() for other in others]
from zerobeam.analysis.posterior.lean_emcee import lean_emcee
emcee = lean_emcee()
[other.join() for other in others]
import scipy.stats
assert seen == [scipy.stats.gaussian_kde] * 4
emcee.moves.KDEMove()
"""


@pytest.mark.parametrize(
    "program",
    [START + KDE_MOVE, START + LATER, EARLIER, AT_ONCE],
    ids=["move", "later", "earlier", "threads"],
)
@pytest.mark.long
def test_the_whole_of_emcee_and_of_scipy_stats_is_there(program: str) -> None:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
