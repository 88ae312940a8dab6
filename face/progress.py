"""How far an analysis is: a bar in a notebook, lines on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..model.arrays import Progress

_WHOLE = 100  # per cent


class StageLines:
    """A line on stderr as each stage begins."""

    def __init__(self) -> None:
        self._stage = ""

    def __call__(self, stage: str, share: float) -> None:
        if stage != self._stage:
            self._stage = stage
            sys.stderr.write(f"{stage} …\n")

    def close(self) -> None:
        """Nothing is left open."""


class StageBar:
    """A bar of tqdm, which a notebook draws as a widget where it can."""

    def __init__(self, tqdm: Any) -> None:
        self._bar = tqdm(total=_WHOLE, leave=False, bar_format="{desc} {percentage:3.0f} %|{bar}| {elapsed}")

    def __call__(self, stage: str, share: float) -> None:
        self._bar.set_description_str(stage, refresh=False)
        self._bar.n = round(_WHOLE * share)
        self._bar.refresh()

    def close(self) -> None:
        """Take it away."""
        self._bar.close()


@contextmanager
def shown_progress(progress: Progress | bool | None) -> Iterator[Progress | None]:
    """Where progress is reported to: `progress` itself, or a bar or lines of ours.

    True shows it, False does not; None shows it in the kernel of a notebook alone. The bar is one of tqdm if
    tqdm is installed.
    """
    if progress is None:
        progress = "ipykernel" in sys.modules
    if not isinstance(progress, bool):
        yield progress
        return
    if not progress:
        yield None
        return
    shown = _bar()
    try:
        yield shown
    finally:
        shown.close()


def _bar() -> StageBar | StageLines:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return StageLines()
    return StageBar(tqdm)
