"""The same run with parameters held or measurements left out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from ..analysis.covariance import parameter_among
from ..analysis.solution import Solution
from ..model.errors import BadInput
from ..model.files.run import REFIT, Run
from ..model.options import require_number
from .checked_arguments import require_mapping, whole_numbers

_BY_METHOD = ("first link", "free tool")  # held whatever a header states


def refit_run(solution: Solution, run: Run, hold: Mapping[str, float], drop: Iterable[int]) -> Run:
    """The run without the measurements of the numbers `drop`, its header with the parameters `hold` held.

    Raises BadInput for a name or a number that is not there, and for a value that is not nominal.
    """
    require_mapping(hold, "hold", '{"J6": 0}: the nominal value by name')
    drop = whole_numbers(drop, "drop")
    items = solution.problem.parameters.items
    held = [item.name for item in items if item.held and item.held_by not in (None, *_BY_METHOD)]
    names = []
    for name, value in hold.items():
        row = solution[parameter_among(solution.parameters.names, name, "hold")]
        item = items[solution.problem.parameters.index(row.name)]
        nominal = item.shown(item.prior_mean)
        require_number(value, -math.inf, f"hold[{name!r}]")
        if not math.isclose(value, nominal, abs_tol=1e-12):
            raise BadInput(
                f"{row.name} can be held at its nominal value only",
                found=f"{value:g} {row.unit}",
                allowed=f"{nominal:g} {row.unit}",
                remedy="state another position as guess_mm of the target, in a new run"
                if row.group == "target"
                else f"solution.profile({row.name!r}) shows the fit at other values",
                argument="hold",
            )
        names.append(row.name)
    numbers = [shot.shot for shot in run.shots]
    for number in drop:
        if number not in numbers:
            raise BadInput(
                "no measurement has this number",
                found=repr(number),
                allowed=", ".join(map(str, numbers)),
                argument="drop",
            )
    provenance = {**run.header.provenance, "refit of": f"{run.path.name} (SHA-256 {run.sha256})"}
    if names:
        provenance["refit holds"] = ", ".join(names)
    if drop:
        provenance["refit without measurements"] = ", ".join(map(str, sorted(set(drop))))
    changes: dict[str, object] = {"provenance": provenance}
    if names:
        changes["held"] = tuple(dict.fromkeys([*held, *names]))
    kept = [shot for shot in run.shots if shot.shot not in drop]
    name = f"{run.path.stem.removesuffix(REFIT)}{REFIT}{run.path.suffix}"
    made = Run.of_shots(run.header.model_copy(update=changes), run.robot, kept, name)
    return replace(made, path=run.path.with_name(name))  # what the header names is beside the run's file
