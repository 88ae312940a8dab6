"""Files of obstacles."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

from ruamel.yaml import YAML

from ...model.files.plan import Obstacles
from ...model.files.whole_file import refuse_existing, schema_line, write_whole
from ...model.parsing.validation import read_model


def read_obstacles(path: Path) -> Obstacles:
    """An obstacles file (YAML)."""
    return read_model(Obstacles, path)


def write_obstacles(path: Path, obstacles: Obstacles, *, force: bool = False) -> None:
    """Write an obstacles file (YAML), whole or not at all; over another one with `force` only."""
    refuse_existing(path, force=force)
    text = StringIO()
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.dump(obstacles.model_dump(mode="json"), text)
    write_whole(path, schema_line(path, "obstacles") + text.getvalue(), force=force)
