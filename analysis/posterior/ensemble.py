"""emcee without scipy.stats, which takes longer to load than a run to analyse, for a move not made here."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import scipy


def load_emcee() -> Any:
    """The module. Its KDEMove works as ever: it loads scipy.stats when it is used."""
    if "emcee" not in sys.modules and "scipy.stats" not in sys.modules:
        stand_in = ModuleType("scipy.stats")
        vars(stand_in)["gaussian_kde"] = _gaussian_kde
        sys.modules["scipy.stats"] = stand_in
        try:
            import emcee
        finally:
            del sys.modules["scipy.stats"]
    import emcee

    return emcee


def _gaussian_kde(*arguments: Any, **options: Any) -> Any:
    return scipy.stats.gaussian_kde(*arguments, **options)
