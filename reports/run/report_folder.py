"""The report's folder: report.html, report.pdf, result.json, posterior.nc, figures; whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...analysis.answer.result import RESULT_SCHEMA, Result
from ...analysis.posterior.posterior import Draws
from ...words.result_json import dumps, to_json
from ..output import whole_folder
from ..output.whole_folder import Kind, write_folder

RESULT = "result.json"
REPORT_NAMES = frozenset({"report.html", "report.pdf", RESULT, "posterior.nc", "figures"})
REPORT = Kind(
    noun="report",
    names=REPORT_NAMES,
    mark=RESULT,
    schema=RESULT_SCHEMA,
)


@dataclass(frozen=True)
class ReportPaths:
    """The files of a report; `posterior` is None if there were no draws."""

    folder: Path
    html: Path
    pdf: Path
    result: Path
    posterior: Path | None
    figures: tuple[Path, ...]


def write_report(folder: Path | str, result: Result, draws: Draws | None) -> ReportPaths:
    """Write the whole report, or nothing: HTML, PDF, result.json, posterior.nc and figures.

    Parameters
    ----------
    folder
        Where to; a report that zerobeam wrote there before is replaced, anything else is not.
    result, draws
        Of `analyse`; without draws there is no posterior.nc.

    Returns
    -------
    ReportPaths
        The files.

    Raises
    ------
    BadInput
        `folder` is a file, is not ours, or cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> sol = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     paths = zb.write_report(f"{folder}/report", sol.result, sol.draws)
    >>> paths.html.name, paths.posterior.name
    ('report.html', 'posterior.nc')
    """
    folder = Path(folder)
    names = write_folder(folder, REPORT, lambda aside: _write_files(aside, result, draws))
    return ReportPaths(
        folder=folder,
        html=folder / "report.html",
        pdf=folder / "report.pdf",
        result=folder / RESULT,
        posterior=None if draws is None else folder / "posterior.nc",
        figures=tuple(folder / "figures" / name for name in names),
    )


def check_target(folder: Path | str) -> None:
    """Raise BadInput unless a report may be written to `folder`: absent, empty, or a report of ours."""
    whole_folder.check_target(folder, REPORT)


def _write_files(folder: Path, result: Result, draws: Draws | None) -> list[str]:
    """All files of the report into an empty folder; the names of the figures."""
    # The heavy libraries (matplotlib, xarray) are loaded only once it is known that they are needed.
    text = dumps(to_json(result))

    from ..output.page_files import write_page
    from ..output.posterior_file import write_posterior
    from ..scenes.turnable import STILL, still_picture
    from .report_page import pictures, report_page
    from .run_scene import run_turnable

    if draws is not None:
        write_posterior(folder / "posterior.nc", result, draws)
    turnable, drawn = run_turnable(result), pictures(result, draws)
    if turnable is not None:
        drawn[STILL] = still_picture(turnable)
    return write_page(
        folder, "report", report_page(result), drawn, "report", answer=(RESULT, text), turnable=turnable
    )
