"""Whatever stands in a file: each reader gives what it reads, or refuses it in one message."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from documents import FILE_PAGES, blocks, read
from exact_runs import demo_runs
from export_runs import ARM, TURNING
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from import_files import positions_of
from ruamel.yaml import YAML
from small_results import small_result

from zerobeam.analysis.repeatability.repeats import read_result, read_table
from zerobeam.experiments.plans.make import read_obstacles
from zerobeam.experiments.rigs.simulated.cell_file import read_cell
from zerobeam.experiments.sensors.sensors_file import read_calibration, read_sensors_file
from zerobeam.experiments.studies.sweeps.study_file import read_study
from zerobeam.model.errors import BadInput
from zerobeam.model.files import text_tables as table
from zerobeam.model.files.measurements import read_header
from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.robot_file import read_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.parsing.reading import read_text

Reader = Callable[[Path], object]

FILES = {
    block.title: block.text
    for page in (*FILE_PAGES, "docs/studies.md")
    for block in blocks(read(page))
    if block.title
}
SENSORS = {
    block.text.split()[1].split("/")[1]: block.text
    for block in blocks(read("docs/sensors.md"))
    if block.text.startswith("schema:")
}
RESULT = small_result(
    [{"name": "delta2", "status": "identified", "estimate": 1.0, "std": 0.1, "data_std": 0.1}]
)
# The content of a whole file, and what reads it.
VALUES: dict[str, tuple[str, Reader]] = {
    "header": (FILES["header.yaml"], read_header),
    "plan": (FILES["x-pattern.yaml"], read_plan),
    "robot": (FILES["arm.yaml"], read_robot),
    "obstacles": ("floor_mm: 0\nboxes: [{name: a, min_mm: [0, 0, 0], max_mm: [1, 1, 1]}]\n", read_obstacles),
    "cell": (FILES["cell.yaml"], read_cell),
    "sensors": (SENSORS["sensors"], read_sensors_file),
    "psd-calibration": (SENSORS["psd-calibration"], read_calibration),
    "study": (FILES["study.yaml"], read_study),
    "result": (json.dumps(RESULT), lambda path: read_result(path, "first")),
}
GOOD = demo_runs()[0].path.read_text(encoding="utf-8")
TEXTS: dict[str, tuple[str, Reader]] = {
    "run": (GOOD, read_run),
    "urdf": (ARM.format(name="arm", joint="j4", **TURNING), lambda path: read_urdf(path, "base", "tool")),
    "offsets": (FILES["table2.csv"], lambda path: list(read_table(path))),
    "csv": (
        FILES["first.csv"],
        lambda path: table.read_table(path, header_row=True, delimiter=",", decimal=".", joints_of=None),
    ),
    "fanuc": (FILES["shots.ls"], lambda path: positions_of("fanuc", read_text(path)[0], path)),
    "kuka": (FILES["shots.dat"], lambda path: positions_of("krl", read_text(path)[0], path)),
}

_leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-3, 12),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=12),
    st.sampled_from(["psd", "tool", "delta2", "irb1600", "panda", "auto", "estimated", "probe", "prismatic"]),
)
anything = st.recursive(
    _leaves,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
)


@st.composite
def changed(draw: st.DrawFn, content: Any) -> Any:
    """A document in which a few values are exchanged, left out or added."""
    content = copy.deepcopy(content)
    for _ in range(draw(st.integers(1, 3))):
        inside: Any = content
        while True:
            keys = list(inside) if isinstance(inside, dict) else list(range(len(inside)))
            if not keys:
                break
            key = draw(st.sampled_from(keys))
            if isinstance(inside[key], dict | list) and inside[key] and draw(st.booleans()):
                inside = inside[key]
                continue
            how = draw(st.sampled_from(["other", "out", "more"]))
            if how == "out":
                del inside[key]
            elif how == "other" or isinstance(inside, list):
                inside[key] = draw(anything)
            else:
                inside[draw(st.text(max_size=8))] = draw(anything)
            break
    return content


@st.composite
def spliced(draw: st.DrawFn, text: str) -> str:
    """A text in which a part gives way to another part of it, or to anything."""
    start = draw(st.integers(0, len(text)))
    end = draw(st.integers(start, min(len(text), start + 30)))
    other = draw(st.integers(0, len(text)))
    between = draw(
        st.text(max_size=10) | st.just(text[other : other + 40]) | st.from_regex(r"-?[0-9]+e?[0-9]+")
    )
    return text[:start] + between + text[end:]


def reads_or_refuses(reader: Reader, path: Path, content: bytes) -> None:
    path.write_bytes(content)
    told = ""
    try:
        reader(path)
    except BadInput as error:
        told = str(error)
    assert "pydantic" not in told


often = settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.mark.parametrize("kind", VALUES)
@pytest.mark.one_in(3)
def test_any_value_in_a_document(kind: str, tmp_path: Path) -> None:
    text, reader = VALUES[kind]
    whole = YAML(typ="safe", pure=True).load(text)
    path = tmp_path / "file.yaml"
    path.write_text(json.dumps(whole), encoding="utf-8")
    reader(path)  # what is changed is whole

    @often
    @given(changed(whole))
    def holds(content: Any) -> None:
        reads_or_refuses(reader, path, json.dumps(content).encode())

    holds()


@pytest.mark.parametrize("kind", [*TEXTS, *VALUES])
@pytest.mark.one_in(3)
def test_any_text_in_a_file(kind: str, tmp_path: Path) -> None:
    text, reader = (TEXTS | VALUES)[kind]
    path = tmp_path / "file"
    path.write_text(text, encoding="utf-8")
    reader(path)

    @often
    @given(spliced(text))
    def holds(content: str) -> None:
        reads_or_refuses(reader, path, content.encode("utf-8", "surrogatepass"))

    holds()
