"""A recorded run in, everything that can be said of it out: as one object for programs and notebooks."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from numpy.typing import ArrayLike, NDArray

from ..analysis.analyse import Analysis
from ..analysis.covariance import ValuesByName, frame
from ..analysis.diagnostics.outliers import Loss
from ..analysis.status import UNVALIDATED, caveat
from ..model.arrays import Progress
from ..model.errors import BadInput
from ..model.files.run import Run
from ..model.options import AnalyseOptions, checked_options, require_number
from ..reports.run.brief_page import front_page
from ..reports.run.parameter_section import draw_offsets, offsets_picture, offsets_table, parameter_table
from ..reports.run.posterior_summary import draw_posterior, posterior_picture
from ..reports.run.report import ReportPaths, write_report
from ..reports.run.residuals import draw_residuals, residuals_picture
from ..reports.run.run_scene import run_turnable
from ..reports.style.blocks import Page
from ..words.finding_words import likelihood_message, posterior_message
from ..words.message import message, offered
from ..words.sentences import to_json
from ..words.wording import clipped, counted
from .checked_arguments import require_axes, require_kind, require_progress
from .notebook import AppView, app_of, shown_progress, write_run_beside
from .pictures import Figure, SceneView, scene_view
from .predicted import predicted_positions, refit_run
from .shown_posterior import Contour, Profile, posterior_dataset, require_estimated
from .tables import ShownPage, ShownParameters, data_frame, residual_frame

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes


class UnconvergedPosterior(UserWarning):
    """The sampler did not converge: its draws are no posterior."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Analysed(ShownPage, Analysis):
    """The answer to a recorded run, as `zerobeam.analyse` gives it; it is a `Solution`.

    `sol["J2"]` or `sol["delta2"]` is a row with `.estimate`, `.u` (standard uncertainty), `.interval(0.68)`,
    `.status` and `.unit`. All but the last two are None where the data do not determine the parameter.
    Solutions can be pickled and copied. They are equal if run, options and versions of the libraries are.

    Attributes
    ----------
    verdict : str
        "pass", "weak" or "degenerate", over all offsets; "misfit" where the model does not describe the
        measurements: all numbers are then `unvalidated`, and `misfit` says why.
    parameters, offsets : ParameterTable
        Rows in their order: all parameters, the joint offsets alone. Each shows itself as a table. Offsets
        are in degrees (mm for prismatic joints) and of the arm: true position = recorded position + offset.
        `.to_frame()` makes a pandas DataFrame.
    enter : dict
        Values to enter into a controller with nominal geometry, degrees (mm) by offset; empty where nothing
        may be entered.
    covariance : Covariance
        `.matrix` (m, m) of the m parameters that the data determine, `.names` and `.units` (m,);
        `covariance["J2", "J3"]` is one element, `covariance.correlation` a DataFrame of the correlations. It
        has no row for anything else.
    data, residuals : pandas.DataFrame
        What was recorded and what the fit leaves, a row for each measurement.
    posterior : xarray.Dataset
        The draws of what the data determine, as ArviZ takes them; `to_arviz()` has them as InferenceData.
    jacobian, rank, condition
        The whitened Jacobian at the estimate, its rank, its condition number.
    plot : Plots
        Figures that show themselves in a notebook.
    run : Run
        What was analysed.
    result : Result
        Everything that a report says, as data.
    draws : Draws or None
        All draws, as an array.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> x_pattern = zb.analyse(zb.read_run(demo_runs()[1].path), ess=100)
    >>> x_pattern.verdict
    'degenerate'
    >>> x_pattern["J2"].status, x_pattern["J2"].estimate, x_pattern["J2"].interval(0.68)
    ('unidentifiable', None, None)
    >>> "delta2" in x_pattern.covariance.names
    False
    >>> x_pattern.profile("J2")
    Traceback (most recent call last):
    zerobeam.model.errors.BadInput: there is no profile of delta2
    ...
    """

    @cached_property
    def parameters(self) -> ShownParameters:
        """A row for each parameter, in their order, with the paper's midpoint estimate where there is one."""
        rows = self.result.parameters
        k = self.result.coverage_factor
        caption = f"Parameters{caveat(row.status for row in rows)}"
        return ShownParameters(rows).with_table(parameter_table(caption, rows, k, f"U (k = {k:.3g})"))

    @cached_property
    def offsets(self) -> ShownParameters:
        """The rows of the joint offsets."""
        rows = (row for row in self.result.parameters if row.group == "offset")
        return ShownParameters(rows).with_table(offsets_table(self.result))

    @property
    def data(self) -> pd.DataFrame:
        """What was recorded: a row for each measurement, by its number. BadInput without pandas."""
        return data_frame(self.run)

    @property
    def residuals(self) -> pd.DataFrame:
        """What the fit leaves: a row for each measurement, by its number. BadInput without pandas.

        `residual_mm_1`, … are the components, `length_mm` their length and `normalised` the length in its own
        standard deviations. `leave_one_out_mm` is the residual under the fit to all others.
        """
        return residual_frame(self.result)

    @property
    def enter(self) -> dict[str, float]:
        """What to enter into a controller with nominal geometry, degrees (mm) by offset: values that make up
        for links that deviate too. Empty where nothing may be entered; `result.entered` has the error of the
        TCP to expect."""
        values = offered(self.result, message(self.result))
        units = {row.name: row.unit for row in self.offsets}
        return ValuesByName({} if values is None else values.values, units, self.status)

    @property
    def posterior(self) -> xr.Dataset:
        """The draws of what the data determine, with dimensions (chain, draw), as ArviZ takes them.

        `az.summary(solution.posterior)` and `az.plot_pair(solution.posterior)` work with ArviZ 0.23 and 1.x.
        A chain is an ensemble of walkers, independent of the others. It has about as many draws as it is
        worth; `draws` and `posterior.nc` have all of them. Units are in the attributes of each variable.

        Raises
        ------
        BadInput
            The fit did not converge, so that there are no draws; or xarray is not installed.

        Warns
        -----
        UnconvergedPosterior
            The draws may not be used.
        """
        if self.draws is None:
            raise BadInput(
                "there are no draws of the posterior",
                found=likelihood_message(self.result.likelihood) or posterior_message(self.result.posterior),
                allowed="a fit that converged, with a parameter that is identifiable",
            )
        dataset = posterior_dataset(self.result, self.draws)
        if not self.draws.converged:
            warnings.warn(posterior_message(self.result.posterior), UnconvergedPosterior, stacklevel=2)
        return dataset

    def to_arviz(self) -> xr.DataTree:
        """The draws as ArviZ's InferenceData: a tree with `posterior` as its group.

        Raises
        ------
        BadInput
            As for `posterior`.

        Examples
        --------
        >>> import zerobeam as zb
        >>> from zerobeam.experiments.demos import demo_runs
        >>> sol = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100)
        >>> list(sol.to_arviz().posterior.data_vars)[:2]
        ['delta2', 'delta3']
        """
        dataset = self.posterior
        import xarray as xr

        return xr.DataTree.from_dict({"posterior": dataset})

    @property
    def rank(self) -> int:
        """How many directions the data determine better than their priors, what has a tolerance counted in
        (`identifiability.rank`)."""
        return self.result.identifiability.rank

    @property
    def condition(self) -> float | None:
        """The condition number of `jacobian`, what has a tolerance eliminated; None where it is singular."""
        return self.result.identifiability.condition

    @property
    def jacobian(self) -> pd.DataFrame:
        """The whitened Jacobian at the estimate (M, p): residuals in their standard deviations, measurement
        by measurement, by the free parameters in units of their priors' standard deviations. BadInput
        without pandas.

        Exact, from the symbolic model. A direction whose singular value is below 1 is known better by its
        priors than by the measurements.

        Examples
        --------
        >>> import numpy as np
        >>> import zerobeam as zb
        >>> from zerobeam.experiments.demos import demo_runs
        >>> sol = zb.analyse(zb.read_run(demo_runs()[1].path), ess=100)
        >>> sol.rank < sol.jacobian.shape[1], sol.condition is None
        (True, True)
        """
        problem, free = self.problem, self.problem.parameters.free
        whitened = problem.whiten(self.fit.x).jacobian[:, free]
        names = [item.name for item, is_free in zip(problem.parameters.items, free, strict=True) if is_free]
        return frame({name: whitened[:, k] for k, name in enumerate(names)})

    def profile(self, name: str, *, size: int = 31, width: float = 3.0) -> Profile:
        """The profile of a parameter: how the posterior falls while all others are at their best.

        Parameters
        ----------
        name
            Of the parameter, such as "J2", "delta2" or "tool.tilt1".
        size
            Number of values.
        width
            How far from the mode, in standard uncertainties.

        Returns
        -------
        Profile
            Values and distances from the mode; `.deviation` from the normal, `.plot()`.

        Raises
        ------
        BadInput
            The data do not determine the parameter, or it is held or a target's coordinate.
        """
        require_number(size, 3, "size", whole=True)
        require_number(width, 0.1, "width")
        require_estimated(self, name, "name")
        return Profile.of(self, name, size=int(size), width=float(width))

    def contour(self, first: str, second: str, *, level: float = 0.95, size: int = 36) -> Contour:
        """The region of two parameters that holds `level` of their joint probability, by the profile.

        Parameters
        ----------
        first, second
            Names of the parameters, as for `profile`.
        level
            The probability of the region, such as 0.68.
        size
            Number of points of its boundary.

        Returns
        -------
        Contour
            The boundary, and the ellipse of a normal posterior; `.deviation`, `.plot()`.

        Raises
        ------
        BadInput
            As `profile`.
        """
        require_number(size, 8, "size", whole=True)
        require_estimated(self, first, "first")
        require_estimated(self, second, "second")
        return Contour.of(self, first, second, level=level, size=int(size))

    def refit(
        self,
        *,
        hold: Mapping[str, float] | None = None,
        drop: Iterable[int] = (),
        ess: float = 1000.0,
        progress: Progress | bool | None = None,
    ) -> Analysed:
        """The same run analysed with some parameters held, or without some measurements.

        Parameters
        ----------
        hold
            Values of parameters that are not estimated, {"delta6": 0}: the nominal ones. They are held
            besides those that are held already.
        drop
            Numbers of measurements that are left out, as `data` has them.
        ess, progress
            As for `analyse`; the seed is that of this solution.

        Returns
        -------
        Analysed
            A new solution; this one is left as it is.

        Raises
        ------
        BadInput
            There is no such parameter or measurement, the value is not nominal, or too little is left.

        Examples
        --------
        >>> import zerobeam as zb
        >>> from zerobeam.experiments.demos import demo_runs
        >>> sol = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100)
        >>> held = sol.refit(hold={"J6": 0}, drop=[3], ess=100)
        >>> held["J6"].status, len(held.data), len(sol.data)
        ('held', 8, 9)
        """
        run = refit_run(self, self.run, {} if hold is None else hold, drop)
        return analyse(run, seed=self.result.inputs.seed, ess=ess, progress=progress)

    def predict(
        self,
        joints: ArrayLike,
        unit: Literal["deg", "rad"] | None = None,
        *,
        point_mm: Sequence[float] | None = None,
    ) -> pd.DataFrame:
        """Where the TCP is at recorded joint positions, by the estimated arm.

        Parameters
        ----------
        joints
            (N, n) or (n,) recorded positions; those of prismatic joints in mm.
        unit
            Of the revolute joints: "deg" or "rad". It is required: no unit is assumed.
        point_mm
            (3,) a point of the flange, in its frame; None: the tool's stated point.

        Returns
        -------
        pandas.DataFrame
            `x_mm`, `y_mm`, `z_mm` in the base frame of joint 1's own encoder, and their standard
            uncertainties `u_x_mm`, …: those of the arm, without the noise of the readings. A row is nan where
            the position depends on an offset that the data do not determine.

        Raises
        ------
        BadInput
            A misfit or a fit that did not converge predicts nothing; or an argument cannot be used.

        Warns
        -----
        DoubtfulJoints
            A joint is outside its limits, or all are like radians.

        Examples
        --------
        >>> import zerobeam as zb
        >>> from zerobeam.experiments.demos import demo_runs
        >>> sol = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100)
        >>> sol.predict([10, -20, 30, 5, 40, 0], unit="deg").loc[0, ["x_mm", "u_x_mm"]].round(1).tolist()
        [525.7, 0.6]
        """
        return predicted_positions(self, joints, unit, point_mm)

    @property
    def plot(self) -> Plots:
        """Figures of this answer."""
        return Plots(self)

    def report(self, folder: Path | str) -> ReportPaths:
        """Write the report: HTML, PDF, result.json, posterior.nc and figures.

        Parameters
        ----------
        folder
            Where to; a report that zerobeam wrote there before is replaced, anything else is not.

        Returns
        -------
        ReportPaths
            The files.

        Raises
        ------
        BadInput
            `folder` is a file, is not ours, or cannot be written.
        """
        return write_report(folder, self.result, self.draws)

    def app(self) -> AppView:
        """The app's page on this answer, in the notebook: report, posterior, leave-one-out, comparison.

        It is served by this process to this machine alone, until the process ends; the report is written
        into a temporary folder.

        Raises
        ------
        BadInput
            The extra `app` is not installed.
        """
        return app_of(self, "result", self._write_files)

    def _write_files(self, folder: Path) -> str:
        write_run_beside(self.run, folder)
        return self.report(folder / "report").result.relative_to(folder).as_posix()

    def to_json(self) -> dict[str, Any]:
        """The content of `result.json` (docs/files-results.md) as plain dicts, lists, numbers and text."""
        answer: dict[str, Any] = to_json(self.result)
        return answer

    def _page(self) -> Page:
        inputs = self.result.inputs
        subtitle = f"{counted(inputs.shots, 'measurement')}, {clipped(inputs.robot)}"
        return front_page(self.result, f"Solution of {clipped(inputs.run, 60)}", subtitle)


@dataclass(frozen=True)
class Plots:
    """The figures of an answer.

    All but `scene` draw on matplotlib axes of yours, `plot.residuals(ax=ax)`, and return them. Without `ax`
    each gives a `Figure`, which shows itself in a notebook and has `.savefig(path)`. `scene()` gives a
    `SceneView`, a page in 3D, which has `.save(path)`.
    """

    _solution: Analysed

    def __repr__(self) -> str:
        return "<Plots: offsets, residuals, posterior, scene>"

    @overload
    def offsets(self, ax: Axes) -> Axes: ...
    @overload
    def offsets(self, ax: None = None) -> Figure: ...
    def offsets(self, ax: Axes | None = None) -> Axes | Figure:
        """The offsets with their expanded uncertainties; as a figure also how wide those are."""
        if ax is None:
            return Figure(offsets_picture(self._solution.result))
        require_axes(ax)
        draw_offsets(ax, self._solution.result)
        return ax

    @overload
    def residuals(self, ax: Axes) -> Axes: ...
    @overload
    def residuals(self, ax: None = None) -> Figure: ...
    def residuals(self, ax: Axes | None = None) -> Axes | Figure:
        """The residual of each measurement divided by its standard deviation; as a figure also in mm."""
        if ax is None:
            return Figure(residuals_picture(self._solution.result))
        require_axes(ax)
        draw_residuals(ax, self._solution.result)
        return ax

    @overload
    def posterior(
        self, ax: NDArray[np.object_], *, names: Sequence[str] | None = None
    ) -> NDArray[np.object_]: ...
    @overload
    def posterior(self, ax: None = None, *, names: Sequence[str] | None = None) -> Figure: ...
    def posterior(
        self, ax: NDArray[np.object_] | None = None, *, names: Sequence[str] | None = None
    ) -> NDArray[np.object_] | Figure:
        """Marginals and pairs of the offsets that the data determine, at most six.

        Parameters
        ----------
        ax
            (m, m) axes, one for each pair of the m parameters, as `subplots(m, m)` gives them.
        names
            Of other parameters that the data determine, such as ["J2", "psd.x"].

        Raises
        ------
        BadInput
            There is nothing that may be drawn: the fit or the sampler did not converge, or the data determine
            no offset. Or `ax` has another shape.
        """
        result, draws = self._solution.result, self._solution.draws
        names = [names] if isinstance(names, str) else names
        picture = posterior_picture(result, draws, names)
        if picture is None:
            raise BadInput(
                "there is no posterior of an offset to draw",
                found=posterior_message(result.posterior),
                allowed="draws that converged, of an offset that the data determine",
            )
        if ax is None:
            return Figure(picture)
        draw_posterior(ax, result, draws, names)
        return ax

    def scene(self) -> SceneView:
        """The arm at its measurements and the targets, in 3D.

        Raises
        ------
        BadInput
            The fit did not converge, or its model does not describe the measurements.
        """
        result = self._solution.result
        scene = run_turnable(result)
        if scene is None:
            why = "the fit did not converge" if result.misfit is None else UNVALIDATED
            raise BadInput(
                "there is no scene of this answer", found=why, allowed="a fit that describes its measurements"
            )
        return scene_view(result.inputs.run, scene)


def analyse(
    run: Run,
    *,
    seed: int = 0,
    ess: float = 1000.0,
    robust: Loss | None = None,
    held_out: Sequence[str] | Run = (),
    progress: Progress | bool | None = None,
) -> Analysed:
    """Everything that can be said of a recorded run: fits, identifiability, posterior, influence, verdict.

    Parameters
    ----------
    run
        From `read_run`, `Run.from_arrays` or `simulate`.
    seed
        Of all random numbers; the same seed gives the same answer.
    ess
        Effective sample size of the posterior that is asked of every parameter, 100 or more.
    robust
        "huber" or "student": one more fit with this loss, in which outlying measurements weigh less.
    held_out
        Names of placements or targets (* and ? as in file names): one more fit without these placements,
        each taken whole, to see how it does there. Or another run of the same header: everything is estimated
        from `run`, and the other one is predicted (`result.hold_out`).
    progress
        True shows a bar (of tqdm where it is installed, else a line for each stage), False shows nothing.
        None shows it in a notebook only. Or a function, which is called with the name of the present stage
        and its share, 0 to 1.

    Returns
    -------
    Analysed
        A `Solution` with everything around it.

    Raises
    ------
    BadInput
        The run cannot be analysed, or an argument cannot be used.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> sol = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100)
    >>> sol.verdict
    'pass'
    >>> row = sol["delta2"]
    >>> f"{row.estimate:.2f} {row.unit}, u = {row.u:.1g}"
    '-1.20 deg, u = 0.02'
    """
    remedy = "zerobeam.read_run(path) reads a file, zerobeam.Run.from_arrays(…) takes joint positions"
    require_kind(run, Run, "run", remedy)
    checked_options(AnalyseOptions, seed=seed, ess=ess, robust=robust)
    if isinstance(held_out, str):
        held_out = (held_out,)
    require_progress(progress)
    with shown_progress(progress) as report:
        return Analysed.of(run, seed=seed, ess=ess, robust=robust, held_out=held_out, progress=report)
