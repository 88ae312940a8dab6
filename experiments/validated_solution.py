"""The solution of a run that may be relied on, as `analyse` has it: what is entered or tested begins so."""

from __future__ import annotations

from ..analysis.ladder import solve_run
from ..analysis.observability.changes import Displacement
from ..analysis.recordings.steps import RecordingStep
from ..analysis.solution import Solution, require_noise_data
from ..analysis.status import NOT_DESCRIBED
from ..model.errors import BadInput, FitFailed
from ..model.files.run import Run
from ..model.likelihood.problem import Problem
from ..words.misfit_words import criterion_sentence, misfit_headline

SEED = 0  # of the fit's starts, as of `analyse` unless asked for otherwise


class NotValidated(BadInput):
    """The model does not describe the run (verdict misfit): it is not written for a controller unasked."""

    exit_status = 1


def converged_solution(run: Run, so: str) -> Solution:
    """The solution of a run as `analyse` finds it; FitFailed, which says what follows (`so`), where the fit
    did not converge."""
    run.require_analysable()
    problem = Problem.from_run(run)
    require_noise_data(problem)
    solution = solve_run(problem, run.header, seed=SEED)
    if not solution.converged:
        raise FitFailed(
            f"{run.path}: the fit did not converge ({solution.fit.reason}): {so}\n"
            "  to do:   look at the run with zerobeam analyse; record more measurements, in varied postures"
        )
    return solution


def require_validated(solution: Solution, allow_displaced: bool = False) -> None:
    """NotValidated where the model does not describe the measurements: then no status means anything.

    Nothing but a target that seems to have moved may be allowed: an arm that deviates from its geometry can
    look like that too, and no new run would mend it.
    """
    against = solution.contradictions
    moved = [criterion_sentence(one) for one in against if isinstance(one, Displacement | RecordingStep)]
    displaced = len(moved) == len(against)
    if solution.misfit is None or (allow_displaced and displaced):
        return
    if displaced:
        raise NotValidated(
            "the measurements contradict the model, so no offset can be relied on (misfit)",
            found="; ".join(moved),
            remedy="give the target another name in the measurements after it was moved, or record again; or"
            " --allow-displaced, if it was not moved: the file then says so",
        )
    raise NotValidated(
        f"{NOT_DESCRIBED}, so no offset can be relied on (misfit)",
        found=" ".join([misfit_headline(solution.misfit), *(f"{sentence}." for sentence in moved)]),
        allowed="a run without a misfit; as data (json, csv) the offsets are written, marked unvalidated",
        remedy="look for the cause with zerobeam report (joint columns, signs, zeros, units, a target or"
        " placement, geometry); or --unvalidated, if you want the numbers all the same: the file says so",
    )
