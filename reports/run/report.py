"""The report of a run: its page of sections, its figures, and its folder, written whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ...analysis.answer.result import RESULT_SCHEMA, Result
from ...analysis.posterior.posterior import Draws
from ...words.message import message, offered
from ...words.sentences import to_json
from ...words.wording import clipped, counted
from ..output.posterior_file import write_posterior
from ..output.whole_folder import FolderContents, Kind, Written, write_answer
from ..scene import still_picture
from ..style.blocks import Page
from ..style.canvas import Picture
from .brief_page import next_steps_section, page_of
from .fit_section import (
    diagnosis_section,
    fit_section,
    hold_out_section,
    intervals_section,
    robust_section,
)
from .front import outlook_section, shows_scene
from .geometry_section import geometry_section, ladder_picture
from .inputs import head_facts, inputs_sections, traceability_section
from .parameter_section import offsets_picture, offsets_section, rehearsal_section
from .placement_section import (
    placements_picture,
    placements_section,
    predicted_run_picture,
    predicted_run_section,
)
from .posterior_summary import posterior_picture, posterior_section
from .residuals import residual_map_picture, residuals_picture, residuals_section
from .run_scene import run_turnable, scene_section
from .uncertainty_budget import budget_section
from .unobservable import null_motion_picture_of, null_motion_section, unobservable_section
from .workspace import workspace_picture, workspace_section


def report_page(result: Result) -> Page:
    """All that a report shows."""
    inputs, wrong = result.inputs, result.misfit is not None  # what follows from a wrong model is not shown
    drawn_first = shows_scene(result, offered(result, message(result)))
    sections = [
        diagnosis_section(result),
        None if wrong else unobservable_section(result.parameters, result.identifiability),
        null_motion_section(result),
        next_steps_section(result),
        outlook_section(result),
        rehearsal_section(result),
        None if wrong else scene_section(result, drawn=not drawn_first),
        None if wrong else workspace_section(result),
    ]
    details = [
        # Is it true?
        fit_section(result),
        residuals_section(result),
        placements_section(result),
        robust_section(result),
        hold_out_section(result),
        predicted_run_section(result),
        # What is it made of?
        offsets_section(result),
        None if wrong else budget_section(result),
        None if wrong else geometry_section(result),
        None if wrong else posterior_section(result),
        None if wrong else intervals_section(result),
        # What was put in?
        *inputs_sections(inputs),
        traceability_section(result),
    ]
    folded = [None if section is None else replace(section, folded=True) for section in details]
    title = f"Joint offsets of {clipped(inputs.robot)}"
    subtitle = f"from {counted(inputs.shots, 'measurement')} in {clipped(inputs.run, 60)}"
    return replace(page_of(title, subtitle, result, [*sections, *folded]), facts=head_facts(result))


def pictures(result: Result, draws: Draws | None) -> dict[str, Picture]:
    """The figures of a report by name; one that may not be drawn is left out."""
    drawn = (
        offsets_picture(result) if result.misfit is None else None,
        ladder_picture(result) if result.misfit is None else None,
        null_motion_picture_of(result),
        workspace_picture(result),
        posterior_picture(result, draws),
        residuals_picture(result),
        residual_map_picture(result),
        placements_picture(result),
        predicted_run_picture(result),
    )
    return {picture.name: picture for picture in drawn if picture is not None}


RESULT = "result.json"
_DRAWS = "posterior.nc"
REPORT = Kind.of_answer("report", RESULT, RESULT_SCHEMA, _DRAWS, pages="report", shown_as="report")


@dataclass(frozen=True)
class ReportPaths(Written):
    """The files of a report; `posterior` is None if there were no draws."""

    posterior: Path | None


def write_report(folder: Path | str, result: Result, draws: Draws | None = None) -> ReportPaths:
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
    answer, turnable = to_json(result), run_turnable(result)
    still = None if turnable is None else still_picture(turnable)
    contents = FolderContents(
        answer,
        report_page(result),
        [*pictures(result, draws).values(), still],
        turnable=turnable,
        others=lambda new: None if draws is None else write_posterior(new / _DRAWS, result, draws),
    )
    written = write_answer(folder, REPORT, contents)
    return ReportPaths(**vars(written), posterior=None if draws is None else written.folder / _DRAWS)
