"""Placements: the targets that stay together while the measurements of one setup are taken.

A placement is a set of targets tied by stated distances or angles (the sockets of one plate, the faces of one
cube), or one target alone.
What is wrong with a model shows between placements: an arm that is not its drawing hits each place
consistently, and each a little differently.
"""

from __future__ import annotations

from dataclasses import dataclass
from os.path import commonprefix

import numpy as np

from ..model.arrays import Index
from ..model.likelihood.problem import Problem


@dataclass(frozen=True, eq=False)
class Placement:
    """One placement: what it is called, its targets, and the places of its measurements in the problem."""

    name: str
    targets: tuple[str, ...]
    rows: Index


def placements(problem: Problem) -> tuple[Placement, ...]:
    """All placements with measurements, in the order of their first target; none of a run with a station,
    whose frame belongs to all.

    A placement of several targets is called by what their names begin with alike (`front` of `front_0` and
    `front_1`), by all of their names where that is nothing or names two.
    """
    if problem.stations:
        return ()
    label = np.arange(len(problem.targets))
    for tie in problem.ties:
        label[label == label[tie.second]] = label[tie.first]
    groups = [np.flatnonzero(label == k) for k in dict.fromkeys(label.tolist())]
    members = [tuple(problem.targets[i] for i in group) for group in groups]
    # names, not paths
    short = [
        commonprefix(names).rstrip("_-. ") if len(names) > 1 else names[0]  # noqa: RUF071
        for names in members
    ]
    return tuple(
        Placement(
            shared if shared and short.count(shared) == 1 else ", ".join(names),
            names,
            np.flatnonzero(np.isin(problem.target_index, group)),
        )
        for shared, names, group in zip(short, members, groups, strict=True)
        if np.isin(problem.target_index, group).any()
    )
