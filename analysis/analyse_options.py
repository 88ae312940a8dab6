"""How a run is analysed, as it is stated to `analyse` and `report`."""

from dataclasses import dataclass
from typing import Annotated, Literal

from ..model.options import Option, Seed

Ess = Annotated[
    float, Option("Effective sample size of the posterior, for every parameter.", least=100, most=1e5)
]
# Of the posterior; "where needed": where the profile likelihood shows that the curvature at the mode does not
# describe it.
Sampling = Literal["always", "where needed", "never"]


@dataclass(frozen=True)
class AnalyseOptions:
    """How a run is analysed: with which seed, how long it is sampled, and what is left out or held out."""

    seed: Seed = 0
    ess: Ess = 1000.0
    robust: Annotated[
        Literal["huber", "student"] | None,
        Option("Fit once more with this robust loss: large residuals weigh less, outliers are named."),
    ] = None
    hold_out: Annotated[
        list[str] | None,
        Option(
            "Validate on this placement, with a fit of the others; repeatable, * and ? match."
            " Or predict another run (.jsonl) of the same header.",
            metavar="NAME|FILE",
            names="run or name",
        ),
    ] = None
    drop: Annotated[
        list[str] | None,
        Option(
            "Leave out these measurements: by number, or FILE:LINE of the imported file or the run;"
            " repeatable, with commas.",
            metavar="NUMBER|FILE:LINE",
            app=False,
        ),
    ] = None
