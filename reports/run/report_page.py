"""The report of a run as a page of sections, in their order, and its figures."""

from __future__ import annotations

from dataclasses import replace

from ...analysis.answer.result import Result
from ...analysis.posterior.posterior import Draws
from ...words.findings import finding_sentence, headline
from ...words.verdict import VERDICT_WORDS
from ...words.wording import clipped, counted, ended, person, sentence
from ..style.blocks import Page, Verdict
from ..style.canvas import Picture
from .diagnostics.diagnosis import diagnosis_section
from .diagnostics.fit_quality import fit_section, not_converged
from .diagnostics.placements import placements_picture, placements_section
from .diagnostics.residuals import residuals_picture, residuals_section
from .diagnostics.second_opinions import hold_out_section, intervals_section, robust_section
from .first_page.next_steps import next_steps_section
from .first_page.rehearsal import rehearsal_section
from .geometry import geometry_section
from .inputs import head_facts, inputs_sections, traceability_section
from .ladder_figure import ladder_picture
from .offsets_figure import offsets_picture
from .parameters import offsets_section
from .posterior_summary import posterior_picture, posterior_section
from .run_scene import scene_section
from .uncertainty_budget import budget_section
from .unobservable import unobservable_section
from .workspace import workspace_section
from .workspace_figure import workspace_picture


def report_page(result: Result) -> Page:
    """All that a report shows."""
    inputs = result.inputs
    sections = [
        diagnosis_section(result),
        offsets_section(result),
        next_steps_section(result),
        rehearsal_section(result),
        unobservable_section(result.parameters, result.identifiability),
        workspace_section(result),
        scene_section(result),
    ]
    details = [
        fit_section(result),
        budget_section(result),
        geometry_section(result),
        robust_section(result),
        hold_out_section(result),
        placements_section(result),
        posterior_section(result),
        intervals_section(result),
        residuals_section(result),
        *inputs_sections(inputs),
        traceability_section(result),
    ]
    sections += [None if section is None else replace(section, folded=True) for section in details]
    return Page(
        f"Joint offsets of {clipped(inputs.robot)}",
        f"from {counted(inputs.shots, 'measurement')} in {clipped(inputs.run, 60)}",
        Verdict(result.verdict, VERDICT_WORDS[result.verdict], sentence(headline(result, person))),
        report_notes(result),
        [section for section in sections if section is not None],
        head_facts(result),
    )


def report_notes(result: Result) -> list[str]:
    """What a reader must see, the gravest first; what the headline has said is not said again."""
    told = None if result.misfit is None else result.misfit.criteria[0]
    notes = [ended(sentence(finding_sentence(own, person))) for own in result.findings if own != told]
    return not_converged(result.likelihood) + notes


def pictures(result: Result, draws: Draws | None) -> dict[str, Picture]:
    """The figures of a report by name; one that may not be drawn is left out."""
    drawn = (
        offsets_picture(result),
        ladder_picture(result),
        workspace_picture(result),
        posterior_picture(result, draws),
        residuals_picture(result),
        placements_picture(result),
    )
    return {picture.name: picture for picture in drawn if picture is not None}
