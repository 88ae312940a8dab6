"""Do repeated runs agree? As one object for programs and notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..analysis.analyse import Analysis
from ..analysis.repeatability.compare import Comparison
from ..model.errors import BadInput
from ..model.files.run import Run
from ..model.options import require_number
from ..reports.comparison_page import comparison_page, write_comparison
from ..reports.output.whole_folder import Written
from ..reports.style.blocks import Page, Table, section_of
from ..words.sentences import to_json
from .tables import ShownPage


@dataclass(frozen=True, eq=False, repr=False)
class ComparedRuns(ShownPage, Comparison):
    """The answer of `zerobeam.compare`; it is a `Comparison`.

    Attributes
    ----------
    verdict : str
        "agrees", "does not agree" or "not tested".
    odd_run : str or None
        The run that alone disagrees.
    differing, drifting : tuple of str
        Names of offsets that scatter more than predicted, or drift.
    offsets : tuple
        Mean, scatter and prediction of each offset, degrees (mm for prismatic joints).
    runs : tuple
        Each run, with its offsets without any prior.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> good = zb.read_run(demo_runs()[0].path)
    >>> plan = zb.Plan.from_arrays(
    ...     robot="irb1600",
    ...     tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     postures=good.joints,
    ...     unit="rad",
    ...     noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ...     target_priors={"psd": {"guess_mm": (950, 150, 100)}},
    ... )
    >>> zb.compare([zb.simulate(plan, seed=k, offsets={"delta2": 0.3}) for k in range(3)]).verdict
    'agrees'
    """

    def report(self, folder: Path | str) -> Written:
        """Write the comparison: HTML, PDF, compare.json, offsets.csv and the figure.

        Raises
        ------
        BadInput
            `folder` is a file, is not ours, or cannot be written.
        """
        return write_comparison(folder, self)

    def to_json(self) -> dict[str, Any]:
        """The content of `compare.json` (docs/compare.md) as plain dicts, lists, numbers and text."""
        answer: dict[str, Any] = to_json(self)
        return answer

    def _page(self) -> Page:
        page = comparison_page(self)
        means = next(block for block in page.sections[0].all if isinstance(block, Table))
        return replace(page, sections=[section_of("", means)])


def compare(runs: Sequence[Run | Analysis | Path | str], *, seed: int = 0) -> ComparedRuns:
    """Compare repeated runs: their scatter against the prediction, drift, and the run that is an outlier.

    Parameters
    ----------
    runs
        Two or more: runs, solutions (their runs are compared), paths of run files (.jsonl) or of results
        (.json); or one path of a table of published offsets (.csv).
    seed
        Of the fits.

    Returns
    -------
    ComparedRuns
        The verdict with the numbers behind it.

    Raises
    ------
    BadInput
        There are fewer than two runs, one is given twice, or they cannot be compared.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> good = zb.read_run(demo_runs()[0].path)
    >>> zb.compare([good, good])
    Traceback (most recent call last):
    zerobeam.model.errors.BadInput: the same run is given twice: it would agree with itself
    ...
    """
    if isinstance(runs, str | Path) or not isinstance(runs, Sequence):
        raise BadInput(
            "this is not a list of runs",
            found=type(runs).__name__,
            allowed="a list of runs or of paths",
            argument="runs",
        )
    named: list[Run | Path | str] = []
    for k, one in enumerate(runs):
        if not isinstance(one, Run | Analysis | Path | str):
            raise BadInput(
                "this is not a run",
                found=type(one).__name__,
                allowed="zerobeam.Run, a solution, or the path of a run file or result",
                argument=f"runs[{k}]",
            )
        named.append(one.run if isinstance(one, Analysis) else one)
    require_number(seed, 0, "seed", whole=True)
    return ComparedRuns.of(named, seed=seed)
