"""The arm of a simulated run after the offsets of that run were entered at its controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..model.errors import BadInput
from ..model.files.plan import Plan
from ..model.files.run import read_run
from ..model.kinematics.robot import same_arm
from ..words.provenance import true_values
from .exporters.verification import offsets_to_enter
from .rigs.simulated.cell_file import Cell


@dataclass(frozen=True)
class CorrectedArm:
    """`values` are true values by parameter (deg, mm): the offsets less those that were entered, the tool and
    the geometry as they were. `run` and `sha256` are of the run's file."""

    run: str
    sha256: str
    values: Mapping[str, float]

    def provenance(self) -> dict[str, str]:
        """For the header of a run of this arm."""
        return {"arm": self.run, "arm sha256": self.sha256}


def corrected_arm(path: Path, plan: Plan, cell: Cell | None) -> CorrectedArm:
    """The arm of the simulated run at `path`, for a plan of the same robot in the same cell.

    BadInput for a run that is not simulated, of another robot, from another cell (which has the arm's
    backlash, geometry and encoders), or that does not determine all its offsets: nothing would be entered.
    """
    run = read_run(path)
    true = true_values(run.header.provenance)
    if not true:
        raise BadInput(
            "the run is not simulated: what its arm truly is, nobody knows",
            allowed="a run of zerobeam run --rig simulated",
            remedy="run the plan on the robot",
            file=path,
            line=run.header_line,
        )
    if not same_arm(run.robot, plan.robot):
        raise BadInput(
            "the plan is for another robot than the run's",
            found=f"the plan's {plan.robot.name}",
            allowed=run.robot.name,
            file=path,
            line=run.header_line,
        )
    stated, given = run.header.provenance.get("cell sha256"), None if cell is None else cell.sha256
    if stated != given:
        raise BadInput(
            "the arm of the run belongs to another cell",
            found="no --cell" if given is None else f"a cell with SHA-256 {given[:12]}",
            allowed="no --cell" if stated is None else f"the cell with SHA-256 {str(stated)[:12]}",
            remedy="state the cell that the run was simulated in, and no other",
            file=path,
            line=run.header_line,
        )
    entered = offsets_to_enter(run)
    values = {name: value - entered.get(name, 0.0) for name, value in true.items()}
    return CorrectedArm(path.name, run.sha256, values)
