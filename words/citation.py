"""How a result is cited."""

from __future__ import annotations

from .wording import shown

PAPER = (
    "B. Gao, Y. Liu, N. Xi, Y. Shen: Developing an Efficient Calibration System for Joint Offset of"
    " Industrial Robots, Journal of Applied Mathematics 2014, 769343, doi:10.1155/2014/769343"
)


def study_citation(study: str, seed: str | None, version: str, *, by_the_paper: bool) -> str:
    """What to write of a study: program, version, study, seed; the article where its method is studied."""
    of_seed = "" if seed is None else f", seed {seed}"
    text = f"The zerobeam contributors: zerobeam {shown(version)}, study {shown(study)}{of_seed}."
    return f"{text} Method: {PAPER}." if by_the_paper else text
