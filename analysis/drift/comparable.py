"""Which instruments may be compared: by their changes on the arms that they measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from ...model.arrays import Matrix
from .series import Series

Groups = tuple[tuple[str, ...], ...]


def changes(series: Series, instruments: Sequence[str], allowed: Matrix) -> Iterator[tuple[str, str, str]]:
    """Offset, and the instruments of two results that follow each other and determine it, where these differ
    and no jump of the offset is `allowed` (T - 1, m) in between."""
    observed = series.observed
    for j, offset in enumerate(series.names):
        for t, later in pairwise(np.flatnonzero(observed[:, j]).tolist()):
            pair = instruments[t], instruments[later]
            if pair[0] != pair[1] and not allowed[t:later, j].any():
                yield offset, *pair


def change_at(series: Series, instruments: Sequence[str], after: int, offset: str) -> tuple[str, str] | None:
    """The instruments before and after a jump between the results `after` and `after` + 1, of the nearest
    results that determine the offset; None where they are the same."""
    seen = np.flatnonzero(series.observed[:, series.names.index(offset)])
    pair = instruments[seen[seen <= after][-1]], instruments[seen[seen > after][0]]
    return None if pair[0] == pair[1] else pair


def comparable_groups(changes: Iterable[tuple[str, str]]) -> Groups:
    """Instruments that are connected by `changes` from one to another without any one of these."""
    number = Counter(tuple(sorted(own)) for own in changes)
    pairs = list(number)
    bridges = [
        own for own in pairs if number[own] == 1 and not _joined(own, [one for one in pairs if one != own])
    ]
    return connected([own for own in pairs if own not in bridges])


def connected(pairs: Sequence[tuple[str, ...]]) -> Groups:
    """The groups that the pairs connect, by name."""
    groups: list[set[str]] = []
    for pair in pairs:
        touched = [own for own in groups if own & set(pair)]
        groups = [own for own in groups if not own & set(pair)]
        groups.append(set(pair).union(*touched))
    return tuple(sorted(tuple(sorted(own)) for own in groups))


def _joined(pair: tuple[str, ...], others: Sequence[tuple[str, ...]]) -> bool:
    return any(set(pair) <= set(own) for own in connected(others))
