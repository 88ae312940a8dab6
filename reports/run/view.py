"""What a reader is told: `result.json` turned into the display strings that terminal, HTML and PDF all print.

Every number is rounded on the way, by `numbers`, so that no two of them can differ.
"""

from __future__ import annotations

from typing import Any

from ..style.blocks import Verdict
from ..words.wording import clipped, counted, sentence
from .view_fit import distances_part, fit_part, not_converged
from .view_inputs import inputs_part
from .view_opinions import hold_out_part, intervals_part, robust_part
from .view_parameters import legend, parameter_table, reasons
from .view_posterior import posterior_part
from .view_shots import shots_part
from .view_unknown import unknown

Json = dict[str, Any]

VERDICT_WORDS = {"pass": "Pass", "weak": "Weak", "degenerate": "Degenerate"}


def view(result: Json) -> Json:
    """The parts of a whole report, from the dict of a `result.json`."""
    parameters = result["parameters"]
    offsets = [row for row in parameters if row["group"] == "offset"]
    inputs = result["inputs"]
    return {
        "title": f"Joint offsets of {clipped(inputs['robot'])}",
        "subtitle": f"from {counted(inputs['shots'], 'shot')} in {clipped(inputs['run'], 60)}",
        "verdict": Verdict(result["verdict"], VERDICT_WORDS[result["verdict"]], sentence(result["headline"])),
        "notes": not_converged(result["fits"]["likelihood"]) + [sentence(note) for note in result["notes"]],
        "offsets": parameter_table("Joint offsets, to be added to the recorded joint positions", offsets),
        "legend": legend(parameters, inputs["header"]),
        "reasons": reasons(parameters),
        "others": [
            parameter_table(caption, rows)
            for caption, group in (
                ("Targets in the base frame", "target"),
                ("Tool in the flange frame", "tool"),
                ("Noise, as a multiple of the stated", "noise"),
            )
            if (rows := [row for row in parameters if row["group"] == group])
        ],
        "unknown": unknown(result),
        "fit": fit_part(result),
        "distances": distances_part(result["distances"]),
        "robust": robust_part(result),
        "hold_out": hold_out_part(result["hold_out"]),
        "posterior": posterior_part(result),
        "intervals": intervals_part(result),
        "shots": shots_part(result),
        "inputs": inputs_part(inputs),
    }
