"""The placements of a run, under the name by which diagnostics import them."""

from __future__ import annotations

from ..placements import Placement, placements

__all__ = ["Placement", "placements"]
