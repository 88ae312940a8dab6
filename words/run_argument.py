"""A run's file in a command that is printed."""

from __future__ import annotations

from pathlib import Path

from ..model.files.run import REFIT, in_no_file
from .wording import path_argument


def run_argument(name: str) -> str:
    """The run's file for a command, or of a run in memory the one to write it to."""
    if in_no_file(name):
        path = Path(name)
        made = f"{path.stem.removesuffix(REFIT)}-refit" if path.stem.endswith(REFIT) else path.name
        name = path.with_name(f"{made}.jsonl").as_posix()
    return path_argument(name, "RUN.jsonl")
