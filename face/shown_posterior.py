"""Profiles of one and of two parameters, that show themselves, and the draws as a Dataset."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np

from ..analysis.answer.result import Result
from ..analysis.covariance import parameter_among
from ..analysis.posterior.posterior import Draws
from ..analysis.posterior.profiles import ProfileContour, ProfileCurve
from ..analysis.solution import Solution
from ..analysis.status import caveat
from ..model.arrays import Matrix
from ..model.errors import BadInput, missing_extra
from ..reports.output.posterior_file import about, variable_name
from ..reports.style.canvas import DASHES, Picture, mark_unvalidated, new_figure, style, to_svg
from ..reports.style.theme import in_font, light
from ..words import numbers
from ..words.observability import reason
from ..words.wording import label, shown
from .checked_arguments import require_axes
from .pictures import Figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Profile(ProfileCurve):
    """The profile of one parameter, as `solution.profile` gives it.

    At each value all other parameters are at their best. `deviation` says how far the posterior is from a
    normal one, in standard uncertainties: below 0.1 estimate and u describe the parameter.

    Attributes
    ----------
    name, unit, status : str
        Of the parameter.
    estimate, u : float
        The mode and the standard uncertainty there.
    values : ndarray
        (n,) where the parameter was fixed, in its unit, ascending.
    distance : ndarray
        (n,) from the mode, in standard uncertainties, negative below it: the root of twice the drop of the
        log-posterior. nan where no optimum of the other parameters was found.
    normal : ndarray
        (n,) the same of a normal posterior: (values - estimate) / u.
    deviation : float
        The largest difference between the two within two standard uncertainties.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> profile = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100).profile("J2")
    >>> profile
    <Profile of delta2: -1.204 ± 0.024 deg, deviates by 0.0... u from the normal>
    >>> low, high = profile.interval(0.95)
    >>> low < profile.estimate < high
    True
    """

    @overload
    def plot(self, ax: Axes) -> Axes: ...
    @overload
    def plot(self, ax: None = None) -> Figure: ...
    def plot(self, ax: Axes | None = None) -> Axes | Figure:
        """The square of the distance over the value, with the parabola of a normal posterior.

        Parameters
        ----------
        ax
            matplotlib axes to draw on, which are returned; None: a `Figure`, which shows itself.
        """
        title = f"Profile of {label(self.name)}, and the normal approximation (dashed)"
        alt = f"Profile of {label(self.name)}. It deviates from the normal by {_deviation(self.deviation)}."
        return _plotted(self._draw, ax, Picture("profile", title, alt, ""))

    def _draw(self, axes: Axes) -> None:
        axes.plot(self.values, self.distance**2, color=light(self.status), linewidth=1.5, label="profile")
        axes.plot(
            self.values, self.normal**2, color=light("muted"), linestyle=DASHES, linewidth=1, label="normal"
        )
        axes.plot([self.estimate], [0], "+", color=light("ink"), clip_on=False)
        axes.set_ylim(0, float(self.normal[-1] ** 2) * 1.1)
        axes.set_xlabel(_axis(self.name, self.unit))
        axes.set_ylabel("squared distance from the mode, in u²")
        axes.legend(loc="upper center")
        mark_unvalidated(axes, [self.status])

    def __repr__(self) -> str:
        digits = numbers.decimals(self.u)
        value = f"{self.estimate:.{max(digits, 0)}f} ± {self.u:.{max(digits, 0)}f} {self.unit}"
        by = f"deviates by {_deviation(self.deviation)} from the normal"
        return f"<Profile of {self.name}: {value}, {by}{caveat([self.status])}>"

    def _repr_html_(self) -> str:
        return self.plot()._repr_html_()


def require_estimated(solution: Solution, name: str, argument: str) -> None:
    """BadInput for a parameter that is held: it has no profile."""
    row = solution[parameter_among(solution.parameters.names, name, argument)]
    if row.cause is not None and row.held:
        raise BadInput(
            f"{label(row.name)} is held, and not estimated: it has no profile",
            found=f"held: {reason(row.cause, label)}",
            allowed="offsets, geometry and tool that the data determine",
            argument=argument,
        )


@dataclass(frozen=True, eq=False, repr=False)
class Contour(ProfileContour):
    """The region of two parameters, as `solution.contour` gives it.

    On its boundary all other parameters are at their best.

    Attributes
    ----------
    names, units, status : tuple of str
        (2,) of the parameters.
    estimates : tuple of float
        (2,) the mode.
    level : float
        The probability of the region.
    points : ndarray
        (n, 2) its boundary, closed, in the units of the parameters; nan where no boundary was found.
    ellipse : ndarray
        (n, 2) the boundary of a normal posterior, in the same directions from the mode.
    deviation : float
        The largest distance between the two, in standard uncertainties.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> zb.analyse(zb.read_run(demo_runs()[0].path), ess=100).contour("J2", "J3", level=0.68)
    <Contour of delta2 and delta3, 68 %: deviates by 0.0... u from the normal>
    """

    @overload
    def plot(self, ax: Axes) -> Axes: ...
    @overload
    def plot(self, ax: None = None) -> Figure: ...
    def plot(self, ax: Axes | None = None) -> Axes | Figure:
        """The boundary, with the ellipse of a normal posterior.

        Parameters
        ----------
        ax
            matplotlib axes to draw on, which are returned; None: a `Figure`, which shows itself.
        """
        both = " and ".join(map(label, self.names))
        title = f"Region of {both} that holds {100 * self.level:g} %, and the normal approximation (dashed)"
        alt = f"Contour of {both}. It deviates from the normal by {_deviation(self.deviation)}."
        return _plotted(self._draw, ax, Picture("contour", title, alt, ""))

    def _draw(self, axes: Axes) -> None:
        colour = light(min(self.status, key=("unvalidated", "assumed", "weak", "identified").index))
        axes.plot(*self.points.T, color=colour, linewidth=1.5, label=f"{100 * self.level:g} %")
        axes.plot(*self.ellipse.T, color=light("muted"), linestyle=DASHES, linewidth=1, label="normal")
        axes.plot(*self.estimates, "+", color=light("ink"))
        axes.set_xlabel(_axis(self.names[0], self.units[0]))
        axes.set_ylabel(_axis(self.names[1], self.units[1]))
        axes.legend()
        mark_unvalidated(axes, self.status)

    def __repr__(self) -> str:
        which = f"{self.names[0]} and {self.names[1]}, {100 * self.level:g} %"
        by = f"deviates by {_deviation(self.deviation)} from the normal"
        return f"<Contour of {which}: {by}{caveat(self.status)}>"

    def _repr_html_(self) -> str:
        return self.plot()._repr_html_()


def _plotted(draw: Callable[[Axes], None], ax: Axes | None, picture: Picture) -> Axes | Figure:
    """On the axes that a reader has, or on new ones as a figure of the name, title and words of `picture`."""
    with style():
        if ax is not None:
            require_axes(ax)
            draw(ax)
            return ax
        figure = new_figure(3.4)
        draw(figure.subplots())
        return Figure(Picture(picture.name, picture.title, picture.alt, to_svg(figure, picture.name)))


def _axis(name: str, unit: str) -> str:
    return in_font(f"{label(name)}, {numbers.symbol(unit)}")


def _deviation(deviation: float) -> str:
    return f"{deviation:.2f} u" if math.isfinite(deviation) else "an unknown amount"


# The draws as an xarray.Dataset, which ArviZ takes: chains are ensembles, draws are about independent.
#
# The walkers of one ensemble are proposed from each other, so that a walker is no chain. A chain here is an
# ensemble, its draws in the order of the steps. Steps are left out until about as many draws remain as the
# effective sample size: an R-hat and an effective sample size over these chains are then right.
#
# What the data do not determine is not in it: a table of ArviZ would show its prior as a result.

_CHAINS = "a chain is an ensemble, independent of the others; steps are left out until draws are independent"


def posterior_dataset(result: Result, draws: Draws) -> xr.Dataset:
    """The parameters that the data determine, with dimensions (chain, draw); BadInput without xarray."""
    try:
        import xarray as xr
    except ImportError:
        raise missing_extra("a posterior as a Dataset", "notebook", needed="xarray") from None
    values = chains_of(draws, result.posterior.ess_min)
    coordinates = {"chain": np.arange(values.shape[0]), "draw": np.arange(values.shape[1])}
    dataset = xr.Dataset(coords=coordinates, attrs={**about(result, draws), "chain_order": _CHAINS})
    for i, (name, unit) in enumerate(zip(draws.names, draws.units, strict=True)):
        unique = variable_name(name, {str(variable) for variable in dataset.variables})
        attributes = {"units": "degree" if unit == "deg" else unit, "long_name": shown(name)}
        dataset[unique] = (("chain", "draw"), values[:, :, i], attributes)
    return dataset


def chains_of(draws: Draws, worth: float | None) -> Matrix:
    """(ensembles, draws, m), thinned to at most `worth` draws in all, or one step."""
    ensembles, walkers, steps, m = draws.values.shape
    every = min(steps, math.ceil(ensembles * walkers * steps / worth)) if worth else 1
    thinned = draws.values[:, :, ::every]
    return thinned.transpose(0, 2, 1, 3).reshape(ensembles, -1, m)
