"""A recorded run in, everything that can be said of it out: as one object for programs and notebooks."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..analysis.analyse import Analysis
from ..analysis.estimation.robust import Loss
from ..analysis.solution import ParameterTable
from ..model.arrays import Progress
from ..model.errors import BadInput, missing_extra
from ..model.files.run import Run
from ..reports.output.html import card, text
from ..reports.output.posterior_file import write_posterior
from ..reports.run.parameters import offsets_picture, offsets_table
from ..reports.run.posterior_summary import posterior_picture
from ..reports.run.report import ReportPaths, write_report
from ..reports.run.residuals import residuals_picture
from ..reports.run.run_scene import run_turnable
from ..reports.style.blocks import Page, Verdict
from ..words.findings import likelihood_message, posterior_message
from ..words.message import message
from ..words.next_steps import offered
from ..words.result_json import to_json
from ..words.wording import clipped, counted
from .arguments import require_choice, require_kind, require_number
from .in_app import AppView, app_of, write_run_beside
from .pictures import Figure, SceneView

if TYPE_CHECKING:
    import xarray as xr


class UnconvergedPosterior(UserWarning):
    """The sampler did not converge: its draws are no posterior."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Analysed(Analysis):
    """The answer to a recorded run, as `zerobeam.analyse` gives it; it is a `Solution`.

    `sol["delta2"]` is a row with `.estimate`, `.u` (standard uncertainty), `.interval95`, `.status` and
    `.unit`; all but the last two are None where the data do not determine the parameter.

    Attributes
    ----------
    verdict : str
        "pass", "weak" or "degenerate", over all offsets; "misfit" where the model does not describe the
        measurements: all numbers are then `unvalidated`, and `misfit` says why.
    parameters, offsets : ParameterTable
        Rows in their order: all parameters, the joint offsets alone. Offsets are in degrees (mm for prismatic
        joints) and of the arm: true position = recorded position + offset. `.to_frame()` makes a pandas
        DataFrame.
    enter : dict
        Values to enter into a controller with nominal geometry, degrees (mm) by offset; empty where nothing
        may be entered.
    covariance : Covariance
        `.matrix` (m, m) of the m parameters that the data determine, `.names` and `.units` (m,);
        `covariance["delta2", "delta3"]` is one element. It has no row for anything else.
    posterior : xarray.DataTree
        The draws, with group `posterior`: the content of `posterior.nc`.
    plot : Plots
        Figures that show themselves in a notebook.
    run : Run
        What was analysed.
    result : Result
        Everything that a report says, as data.
    draws : Draws or None
        The same draws as an array.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> x_pattern = zb.analyse(zb.read_run(demo_runs()[1].path), ess=100)
    >>> x_pattern.verdict
    'degenerate'
    >>> x_pattern["delta2"].status, x_pattern["delta2"].estimate, x_pattern["delta2"].u
    ('unidentifiable', None, None)
    >>> "delta2" in x_pattern.covariance.names
    False
    """

    @cached_property
    def parameters(self) -> ParameterTable:
        """A row for each parameter, in their order, with the paper's midpoint estimate where there is one."""
        return self.result.parameters

    @property
    def enter(self) -> dict[str, float]:
        """What to enter into a controller with nominal geometry, degrees (mm) by offset: values that make up
        for links that deviate too. Empty where nothing may be entered; `result.entered` has the error of the
        TCP to expect."""
        values = offered(self.result)
        return {} if values is None else dict(values.values)

    @property
    def posterior(self) -> xr.DataTree:
        """The draws of the posterior, `tree["posterior"]` with dimensions (chain, draw): as `posterior.nc`.

        The attribute `source` of a variable is `data`, or `prior` where the data do not determine it.

        Raises
        ------
        BadInput
            The fit did not converge, so that there are no draws; or xarray is not installed.

        Warns
        -----
        UnconvergedPosterior
            The draws may not be used.
        """
        try:
            import xarray as xr
        except ImportError:
            raise missing_extra("a posterior as a DataTree", "notebook", needed="xarray") from None
        if self.draws is None:
            raise BadInput(
                "there are no draws of the posterior",
                found=likelihood_message(self.result.likelihood) or posterior_message(self.result.posterior),
                allowed="a fit that converged, with a parameter that is identifiable",
            )
        if not self.draws.converged:
            warnings.warn(posterior_message(self.result.posterior), UnconvergedPosterior, stacklevel=2)
        with tempfile.TemporaryDirectory(prefix="zerobeam-") as folder:
            file = Path(folder) / "posterior.nc"
            write_posterior(file, self.result, self.draws)
            group = xr.load_dataset(file, group="posterior", engine="h5netcdf")
        tree = xr.DataTree(children={"posterior": xr.DataTree(group)})
        tree.attrs.update(group.attrs)
        return tree

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
        return to_json(self.result)

    def __repr__(self) -> str:
        return text(self._page(), offsets_table(self.result))

    def _repr_html_(self) -> str:
        return card(self._page(), [offsets_table(self.result)])

    def _page(self) -> Page:
        inputs = self.result.inputs
        return Page(
            f"Solution of {clipped(inputs.run, 60)}",
            f"{counted(inputs.shots, 'measurement')}, {clipped(inputs.robot)}",
            Verdict(self.verdict, "", ""),
            [],
            [],
            message=message(self.result),
        )


@dataclass(frozen=True)
class Plots:
    """The figures of an answer; each shows itself in a notebook and has `.save(path)`."""

    solution: Analysed

    def offsets(self) -> Figure:
        """The offsets with their 95 % intervals, and how wide those are."""
        return Figure(offsets_picture(self.solution.result))

    def residuals(self) -> Figure:
        """The residual of each measurement, in mm and divided by its standard deviation."""
        return Figure(residuals_picture(self.solution.result))

    def posterior(self) -> Figure:
        """Marginals and pairs of the offsets that the data determine.

        Raises
        ------
        BadInput
            There is nothing that may be drawn: the fit or the sampler did not converge, or the data determine
            no offset.
        """
        result = self.solution.result
        picture = posterior_picture(result, self.solution.draws)
        if picture is None:
            raise BadInput(
                "there is no posterior of an offset to draw",
                found=posterior_message(result.posterior),
                allowed="draws that converged, of an offset that the data determine",
            )
        return Figure(picture)

    def scene(self) -> SceneView:
        """The arm at its measurements and the targets, in 3D.

        Raises
        ------
        BadInput
            The fit did not converge.
        """
        result = self.solution.result
        scene = run_turnable(result)
        if scene is None:
            raise BadInput("there is no scene of a fit that did not converge", found=result.likelihood.reason)
        return SceneView.of(result.inputs.run, scene)


def analyse(
    run: Run,
    *,
    seed: int = 0,
    ess: float = 1000.0,
    robust: Loss | None = None,
    held_out: Sequence[str] | Run = (),
    progress: Progress | None = None,
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
        Called with the name of the present stage and its share, 0 to 1.

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
    '-1.24 deg, u = 0.08'
    """
    require_kind(run, Run, "run", "read a file with zerobeam.read_run(path)")
    require_number(seed, 0, "seed", whole=True)
    require_number(ess, 100, "ess")
    require_choice(robust, (None, "huber", "student"), "robust")
    if isinstance(held_out, str):
        held_out = (held_out,)
    return Analysed.of(run, seed=seed, ess=ess, robust=robust, held_out=held_out, progress=progress)
