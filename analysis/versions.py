"""What a result was made with."""

from __future__ import annotations

import platform
from importlib.metadata import version


def versions() -> dict[str, str]:
    """Versions that a result depends on."""
    names = ("zerobeam", "numpy", "scipy", "casadi", "emcee", "arviz-stats")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}
