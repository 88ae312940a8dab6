"""A network on which packets are lost, late, reordered and sent twice, as often as is asked for."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass

import numpy as np

from ...model.errors import BadInput


@dataclass(frozen=True)
class PacketFaults:
    """Shares of the packets, each way: `lost`, `duplicated`, `late` by `late_s` seconds, `reordered`
    (behind the packet that was sent next)."""

    lost: float = 0.0
    duplicated: float = 0.0
    late: float = 0.0
    reordered: float = 0.0
    late_s: float = 0.02

    def __post_init__(self) -> None:
        for name in ("lost", "duplicated", "late", "reordered"):
            share = getattr(self, name)
            if not 0 <= share <= 1:
                raise BadInput(f"{name} is a share of the packets", found=share, allowed="0 to 1")


class PacketLine:
    """One direction. What is sent comes out of `arrived` when its time has come; times are seconds."""

    def __init__(self, faults: PacketFaults, rng: np.random.Generator) -> None:
        self._faults, self._rng = faults, rng
        self._under_way: list[tuple[float, int, bytes]] = []
        self._held: list[bytes] = []
        self._count = itertools.count()

    def send(self, packet: bytes, now: float) -> None:
        faults = self._faults
        # Four draws for each packet, whatever becomes of it: one fault does not move the draws of another.
        lost, duplicated, late, reordered = self._rng.random(4)
        behind, self._held = self._held, []
        if lost >= faults.lost:
            copies = 2 if duplicated < faults.duplicated else 1
            if reordered < faults.reordered:
                self._held = [packet] * copies
            else:
                due = now + (faults.late_s if late < faults.late else 0.0)
                self._push([packet] * copies, due)
        self._push(behind, now)

    def arrived(self, now: float) -> list[bytes]:
        """What has come by now, in the order of arrival."""
        packets = []
        while self._under_way and self._under_way[0][0] <= now:
            packets.append(heapq.heappop(self._under_way)[2])
        return packets

    def _push(self, packets: list[bytes], due: float) -> None:
        for packet in packets:
            heapq.heappush(self._under_way, (due, next(self._count), packet))
