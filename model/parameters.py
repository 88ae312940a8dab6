"""Everything that is unknown, by name: offsets, targets, what is open of the tool, and of the noise.

Inside, values are rad and mm; `display` turns them into the degrees and millimetres that people read. A
noise factor is its logarithm inside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from .errors import BadInput
from .noise import Noise
from .robot import Matrix, Robot
from .tool import Tool

if TYPE_CHECKING:
    from .files.header import Header

Group = Literal["offset", "target", "tool", "noise"]
Unit = Literal["deg", "mm", "1"]

BASE_FRAME = (
    "joint 1 defines the base frame: turning it and every target together changes no shot (section 3.3)"
)
TOOL_TURN = "the last joint and an uncalibrated laser turn together (section 3.1)"
_NOISE_PRIOR = 1.0  # of the logarithm of a noise factor: 95 % between 1/7 and 7 times what is stated
_NOISE_TOLERANCE = 0.25  # a noise factor counts as identified if it is known to about a quarter
_DEGREES = float(np.degrees(1.0))


@dataclass(frozen=True)
class Parameter:
    """One unknown. Prior mean, std and tolerance are in internal units (rad, mm, or the logarithm)."""

    name: str
    group: Group
    unit: Unit
    prior_mean: float
    prior_std: float
    tolerance: float
    held: bool
    held_reason: str | None

    @property
    def display(self) -> float:
        """Units that people read per internal unit (of a noise factor: near 1)."""
        return _DEGREES if self.unit == "deg" else 1.0

    def shown(self, value: float) -> float:
        """An internal value as people read it: deg, mm, or the factor of which it is the logarithm."""
        return math.exp(value) if self.group == "noise" else value * self.display

    @property
    def shown_prior(self) -> tuple[float, float]:
        """Mean and std of the prior as people read them (of a noise factor: log-normal)."""
        if self.group != "noise":
            return self.prior_mean * self.display, self.prior_std * self.display
        spread = math.exp(self.prior_std**2)
        mean = math.exp(self.prior_mean) * math.sqrt(spread)
        return mean, mean * math.sqrt(spread - 1)

    def shown_std(self, value: float, std: float) -> float:
        """The std, as people read it, of what has the internal `std` at the internal `value`."""
        return self.display * std * (math.exp(value) if self.group == "noise" else 1.0)


@dataclass(frozen=True)
class Parameters:
    """The unknowns in their one order: offsets 1…n, each target's x, y, z, the tool's, the noise factors."""

    items: tuple[Parameter, ...]

    @classmethod
    def build(
        cls, robot: Robot, tool: Tool, noise: Noise, header: Header, targets: Sequence[str]
    ) -> Parameters:
        """Name every unknown of these shots; raises BadInput for a held name that is none of them."""
        open_items: list[Parameter] = []

        def add(name: str, group: Group, unit: Unit, mean: float, std: float, tol: float) -> None:
            open_items.append(Parameter(name, group, unit, mean, std, tol, False, None))

        tolerance, prior = header.tolerance, header.prior
        for i, joint in enumerate(robot.joints, start=1):
            if joint.kind == "revolute":
                std, tol = np.radians([prior.offset_deg, tolerance.offset_deg])
                add(f"delta{i}", "offset", "deg", 0.0, float(std), float(tol))
            else:
                add(f"delta{i}", "offset", "mm", 0.0, prior.offset_mm, tolerance.length_mm)
        for target in targets:
            stated = header.targets.get(target)
            guess = (0.0, 0.0, 0.0) if stated is None or stated.guess_mm is None else stated.guess_mm
            sigma = 10_000.0 if stated is None else stated.sigma_mm
            for axis, value in zip("xyz", guess, strict=True):
                add(f"{target}.{axis}", "target", "mm", value, sigma, tolerance.length_mm)
        nominal = dict(zip("xyz", tool.point, strict=True))
        for name in tool.parameter_names:
            if ".tilt" in name:
                add(name, "tool", "deg", 0.0, tool.tilt_std, float(np.radians(tolerance.tilt_deg)))
            else:
                mean = float(nominal.get(name[-1], 0.0)) if tool.kind == "probe" else 0.0
                add(name, "tool", "mm", mean, tool.shift_std, tolerance.length_mm)

        if noise.separate:
            add("noise.joint", "noise", "1", 0.0, _NOISE_PRIOR, _NOISE_TOLERANCE)
            add("noise.spot", "noise", "1", 0.0, _NOISE_PRIOR, _NOISE_TOLERANCE)

        held = _held(header.held, robot, tool, [item.name for item in open_items])
        return cls(
            tuple(
                Parameter(
                    p.name,
                    p.group,
                    p.unit,
                    p.prior_mean,
                    p.prior_std,
                    p.tolerance,
                    p.name in held,
                    held.get(p.name),
                )
                for p in open_items
            )
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(item.name for item in self.items)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(p,) True where the parameter is estimated."""
        return np.array([not item.held for item in self.items])

    @cached_property
    def among_free(self) -> NDArray[np.int64]:
        """(p,) where each free parameter stands among the free ones."""
        return np.cumsum(self.free) - 1

    @cached_property
    def prior_mean(self) -> Matrix:
        return np.array([item.prior_mean for item in self.items])

    @cached_property
    def prior_std(self) -> Matrix:
        return np.array([item.prior_std for item in self.items])

    @cached_property
    def tolerance(self) -> Matrix:
        return np.array([item.tolerance for item in self.items])

    @cached_property
    def display(self) -> Matrix:
        return np.array([item.display for item in self.items])

    def shown(self, x: Matrix) -> Matrix:
        """Parameter vectors (..., p) as people read them: deg, mm, noise factors."""
        noise = self.group("noise")
        shown = x * self.display
        shown[..., noise] = np.exp(x[..., noise])
        return np.asarray(shown)

    def unscaled(self, std: Matrix) -> Matrix:
        """(p,) stds in internal units from those of the free ones (f,), scaled by priors; nan if held."""
        result = np.full(len(self), np.nan)
        result[self.free] = std * self.prior_std[self.free]
        return result

    def group(self, group: Group) -> NDArray[np.bool_]:
        """(p,) True for the parameters of one group."""
        return np.asarray(self._groups == group)

    @cached_property
    def _groups(self) -> NDArray[np.str_]:
        return np.array([item.group for item in self.items])

    def index(self, name: str) -> int:
        return self.names.index(name)

    def __len__(self) -> int:
        return len(self.items)


def _held(stated: Sequence[str] | None, robot: Robot, tool: Tool, names: Sequence[str]) -> dict[str, str]:
    """What is held, with the reason: the method's own choice unless the header states a list."""
    method = {"delta1": BASE_FRAME}
    if tool.kind == "laser" and not tool.calibrated:
        method[f"delta{robot.n}"] = TOOL_TURN
    if stated is None:
        return method
    for name in stated:
        if name not in names:
            raise BadInput(
                "held names a parameter that is not there",
                found=name,
                allowed=", ".join(names),
                remedy="correct the name in `held`, or leave `held` out to hold what the method defines",
            )
    if set(stated) == set(names):
        raise BadInput(
            "everything is held: there is nothing to estimate",
            found=", ".join(stated),
            remedy="leave out of `held` what is to be estimated",
        )
    return {name: method.get(name, "held by the header") for name in stated}
