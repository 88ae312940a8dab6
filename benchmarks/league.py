"""What is left at measurements of real arms that a fit has not seen, and did it say so?

Every public recording that may be used, each by one way: some of its measurements are fitted, the others
predicted. Of arms that were measured by a ball in sockets, each placement is predicted by all others; of a
robot that a tracker followed, a sixth of a series by another sixth. A row has the rms error of nominal links,
of offsets alone, of the peers where they take such data, and of zerobeam; and the forecast: the error over
the one that zerobeam expects (1: as uncertain as stated). A misfit is marked: nothing of it is claimed.

    python3 -m venv /tmp/peers && /tmp/peers/bin/pip install --only-binary :all: pyceres pybotics robotkinecal
    .venv/bin/python benchmarks/league.py --peers /tmp/peers/bin/python      # the table of docs/real-arms.md
    .venv/bin/python benchmarks/league.py --only kuka_14
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tracker_peers
import tracker_table as tracker
from analyse_time import BALLS, ball_run
from threadpoolctl import threadpool_limits

from zerobeam.analysis.diagnostics.hold_out import LeaveOneOut, fits_without, leave_one_out, pooled
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.prediction import PredictedRun, predict_problem
from zerobeam.analysis.solution import Solution
from zerobeam.model.files.header import EXACT, Header
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.likelihood.problem import Problem

SERIES = {"A": "grid_every_eighth.csv", "B": "joint_configurations.csv"}
SIXTH, OTHERS = slice(0, None, 6), slice(3, None, 6)
LEFT = ("nominal", "offsets alone", *tracker_peers.PEERS, "zerobeam")
HEAD = ("arm", "fitted", "predicted", *LEFT, "forecast")


@dataclass(frozen=True)
class Row:
    """What is left, mm rms: of nominal links, of offsets alone, of peers by name (None, or no entry: none
    such), of zerobeam, and what zerobeam expects; None where a fit did not converge."""

    name: str
    fitted: int
    predicted: str
    nominal: float | None
    offsets_alone: float | None
    ours: float | None
    expected: float | None
    misfit: bool
    peers: dict[str, float | None] = field(default_factory=dict)

    def __str__(self) -> str:
        """A row of the table of `HEAD`."""
        ratio = None if self.ours is None or self.expected is None else self.ours / self.expected
        left = (self.nominal, self.offsets_alone, *map(self.peers.get, tracker_peers.PEERS), self.ours)
        lengths = ["–" if one is None else f"{one:.3f}" for one in left]
        forecast = ("none" if ratio is None else f"{ratio:.2f}") + ", misfit" * self.misfit
        return f"| {' | '.join([self.name, str(self.fitted), self.predicted, *lengths, forecast])} |"


def on_nominal_links(header: Header) -> Header:
    """The same with offsets alone."""
    return header.model_copy(update={"geometry": EXACT})


def of_ball(data: Path, name: str, folder: Path) -> Row:
    """An arm of `BALLS`: each placement of the plate by all others."""
    run = read_run(ball_run(data, name, folder, geometry=None))
    noise = run.header.noise.model_copy(update={"scale": "estimated"})  # nobody measured it
    run = replace(run, header=run.header.model_copy(update={"noise": noise}))
    found, ours = by_others(run)
    _, exact = by_others(replace(run, header=on_nominal_links(run.header)))
    return Row(
        name,
        found.problem.shots,
        f"{len(ours.rows)} placements in turn",
        pooled([(row.shots, row.rms_before_mm) for row in exact.rows]),
        exact.rms_mm,
        ours.rms_mm,
        ours.expected_mm,
        found.verdict == "misfit",
    )


def by_others(run: Run) -> tuple[Solution, LeaveOneOut]:
    """A run solved as its header asks, and each of its placements by the others."""
    found = solve_run(Problem.from_run(run), run.header)
    left = leave_one_out(found, fits_without(found))
    return found, left or LeaveOneOut((), None, None)


def of_tracker(data: Path, series: str, folder: Path, python: Path | None) -> Row:
    """The UR10: a sixth of a series by another sixth of it, each program in the frame that it has fitted."""
    run = read_run(tracker.imported(data, folder, SERIES[series]))
    positions = np.array([one.measured["measured_mm"] for one in run.measurements])
    joints, measured, held, truth = run.joints[SIXTH], positions[SIXTH], run.joints[OTHERS], positions[OTHERS]
    noise = float(np.radians(tracker.UR10_NOISE)), tracker.UR10_SIGMA

    def solved(header: Header) -> tuple[bool, PredictedRun]:
        found = solve_run(tracker.problem_of(header, run.robot, joints, measured), header)
        recorded = tracker.problem_of(header, run.robot, held, truth)
        return found.verdict == "misfit", predict_problem(found, recorded, run.path.name, run.sha256)

    misfit, ours = solved(run.header)
    _, exact = solved(on_nominal_links(run.header))
    start = tracker_peers.started(tracker.UR10, joints, measured, held, np.array(noise))
    peers: dict[str, float | None] = {}
    for peer in tracker_peers.PEERS if python else ():
        answers = tracker.theirs(python, peer, tracker.UR10, [(joints, measured, held)], noise)
        peers[peer] = None if answers is None else tracker.rms(answers[0].positions - truth)
    return Row(
        f"UR10, series {series}",
        len(joints),
        str(len(held)),
        tracker.rms(start.model.positions(held, start.start) - truth),
        exact.rms_mm,
        ours.rms_mm,
        ours.expected_mm,
        misfit,
        peers,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peers", type=Path, help="the python of an environment with the peers")
    parser.add_argument("--only", action="append", metavar="ARM", help="panda_1, …, A or B (default: all)")
    wanted = parser.parse_args()
    if wanted.peers is None:
        print("the peers are left out: name the python of their environment by --peers")
    data = Path(os.environ.get("ZEROBEAM_SHARED_DATA", tracker.ROOT.parent / "shared" / "data")).resolve()
    print(f"| {' | '.join(HEAD)} |", f"|---|{'---:|' * (len(HEAD) - 1)}", sep="\n")
    with threadpool_limits(limits=1, user_api="blas"), tempfile.TemporaryDirectory() as name:
        for arm in wanted.only or (*BALLS, *SERIES):
            where = data / "ipa" if arm in SERIES else data / "mukca" / arm
            if not where.is_dir():
                print(f"{arm} left out: there is no {where.relative_to(data)} in {data}")
            elif arm in SERIES:
                print(of_tracker(data, arm, Path(name), wanted.peers), flush=True)
            else:
                print(of_ball(data, arm, Path(name)), flush=True)


if __name__ == "__main__":
    main()
