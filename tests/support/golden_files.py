"""Golden files: printed text that changes on purpose only.

After a change that is meant, write them anew with ZEROBEAM_WRITE_GOLDEN=1 and look at the difference.
"""

import os
import re
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "golden"


def assert_golden(name: str, text: str) -> None:
    """`text` is what stands in the golden file of this name."""
    file = FOLDER / name
    # Spaces at the ends of lines are no part of what a person sees, and editors take them away.
    text = "\n".join(line.rstrip() for line in text.splitlines()).rstrip() + "\n"
    if os.environ.get("ZEROBEAM_WRITE_GOLDEN"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    assert file.is_file(), f"there is no golden file {name}; ZEROBEAM_WRITE_GOLDEN=1 writes it"
    assert text == file.read_text(encoding="utf-8"), f"{name} is not what was printed"


def without_draws(text: str) -> str:
    """The text without what depends on the sampler's draws."""
    text = re.sub(r"R-hat\s+[\d.]+,\s+at\s+least\s+\d+\s+effective\s+draws", "R-hat …", text)
    confirmed = r"\s+Importance\s+sampling\s+agrees\s+with\s+them\s+\(Pareto\s+k̂\s+[\d.−]+\)"
    text = re.sub(confirmed, " Importance sampling agrees with them (Pareto k̂ …)", text)
    text = re.sub(r"R-hat\s+[\d.]+,\s+smallest\s+effective\s+sample\s+size\s+\d+", "R-hat …", text)
    before, heading, after = text.partition("95 % intervals by three methods\n")
    table, end, after = after.partition("Posterior:")
    table = re.sub(r" {2,}(\S+ to \S+(\u00a0\w+)?|posterior) *$", "  …", table, flags=re.MULTILINE)
    return before + heading + table + end + after
