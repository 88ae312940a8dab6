"""Which posture comes next: in the plan's order, and closing shots; `adaptive` has what saves shots."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

from ...analysis.so_far import SoFar
from ...model.files.run import Shot


class Order(Protocol):
    """Which posture comes next."""

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: SoFar | None
    ) -> int | None:
        """The number of the next shot, that of its posture in the plan; None: it is enough.

        Decided from what is recorded, and from which postures were refused, alone.
        """
        ...


class InTurn:
    """All postures of a plan of `count`, one after another."""

    def __init__(self, count: int) -> None:
        self._count = count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: SoFar | None
    ) -> int | None:
        done = {shot.shot for shot in recorded}.union(refused)
        return next((number for number in range(self._count) if number not in done), None)


class Closing:
    """What `order` says, and in the end the first recorded posture of each target once more: the shot that
    tells most of whether a target has moved. Its number is that of the posture plus `count`, the plan's."""

    def __init__(self, order: Order, count: int) -> None:
        self._order, self._count = order, count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: SoFar | None
    ) -> int | None:
        number = self._order.following(recorded, refused, state)
        if number is not None:
            return number
        done = {shot.shot for shot in recorded}.union(refused)
        first: dict[str, int] = {}
        for shot in recorded:
            first.setdefault(shot.target, shot.shot + self._count)
        return next((closing for closing in first.values() if closing not in done), None)
