import importlib
import json
import re
from pathlib import Path

import pytest
from cells import good_plan, simulated
from command_line import plan_file, zerobeam
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from zerobeam.experiments.plans.make import write_obstacles
from zerobeam.experiments.schema import FILE_SCHEMAS, SCHEMA_NAMES, json_schema
from zerobeam.model.files.header import write_header
from zerobeam.model.files.plan import Box, Obstacles
from zerobeam.model.files.run import write_run

UNITS = {
    "_mm": r"millimetres|\bmm\b",
    "_deg": r"degrees|\bdeg\b",
    "_s": "second",
    "_deg_s": "degrees a second",
    "_mm_s": "millimetres a second",
}


def properties(schema):
    """(name, property) of every object in the schema."""
    for part in (schema, *schema.get("$defs", {}).values()):
        yield from part.get("properties", {}).items()


@pytest.mark.parametrize("name", FILE_SCHEMAS)
def test_every_key_is_described_with_its_unit_and_no_other_is_allowed(name):
    schema = json_schema(name)
    json.dumps(schema, allow_nan=False)
    for part in (schema, *schema.get("$defs", {}).values()):
        assert part["additionalProperties"] is False
    for key, content in properties(schema):
        assert content.get("description"), key
        suffix = next((end for end in sorted(UNITS, key=len, reverse=True) if key.endswith(end)), None)
        if suffix:
            assert re.search(UNITS[suffix], content["description"]), key


def test_the_kinds_of_file_are_told_by_their_schema_key():
    assert (
        *("run-header", "run-shot", "plan", "header", "tolerances", "robot", "obstacles", "cell"),
        *("sensors", "psd-calibration", "study-file", "result", "check", "compare", "batch"),
        *("history", "history-arm", "history-fleet", "drift", "arm", "proposal", "offsets", "positions"),
    ) == SCHEMA_NAMES
    for name in (
        "run",
        "plan",
        "robot",
        "result",
        "check",
        "compare",
        "batch",
        "history",
        "history-arm",
        "drift",
        "arm",
        "proposal",
        "offsets",
    ):
        content = json_schema("run-header" if name == "run" else name)
        assert content["properties"]["schema"]["const"] == f"zerobeam/{name}/1"
        assert "schema" in content["required"]
    assert set(json_schema("header")["required"]) == {"robot", "noise"}
    assert json_schema("run-shot")["required"] == ["shot", "joints_deg"]


def test_the_examples_of_the_design_have_only_keys_of_the_schema():
    header = json_schema("run-header")["properties"]
    wanted = (
        "schema robot tool instruments noise prior targets distances angles held limits tolerance geometry"
        " required workspace provenance"
    )
    assert set(header) == set(wanted.split())
    assert set(json_schema("plan")["properties"]) == {*header, "constraints", "postures_deg"}
    shot = "shot posture instrument reflector target joints_deg spot_mm measured_mm measured_quat sigma_mm"
    shot += " time_s source comment again"
    assert set(json_schema("run-shot")["properties"]) == set(shot.split())


def test_a_schema_that_is_not_there(refused):
    assert "did you mean 'plan'?" in refused(json_schema, "plans").remedy


@pytest.fixture
def tables(monkeypatch):
    """The script that makes the tables of the pages."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs"))
    return importlib.import_module("file_tables")


@pytest.mark.parametrize("name", ["result", "check"])
def test_every_key_of_an_answer_has_a_meaning_or_is_named_in_that_of_the_key_above(name, tables):
    listed = {row.key: row.meaning for row in tables.rows(name, "-misfit")}
    assert len(listed) > 20
    assert not [key for key, meaning in listed.items() if not meaning]
    schema = json_schema(name)
    for part in schema["$defs"].values():
        keys = part["properties"]
        if "kind" in keys and "sentence" in keys:  # the criteria of a misfit, in a table of their own
            continue
        described = [key for key, content in keys.items() if content.get("description")]
        assert described in ([], list(keys)), part["title"]


def test_the_tables_of_the_page_are_those_of_the_models(tables):
    """`python docs/file_tables.py` writes them."""
    for path in tables.PAGES:
        page = path.read_text(encoding="utf-8")
        assert page.count("<!-- keys ") == page.count("<!-- end -->") > 0
        assert tables.written(page) == page, f"{path.name}: run python docs/file_tables.py"
    assert "| standard deviation of random offsets" in tables.table("cell")


WRITTEN = ("plan", "header", "obstacles", "robot")


def write_each(folder):
    """A YAML file of every kind that zerobeam writes, NAME.yaml."""
    plan = good_plan()
    plan_file(folder / "plan.yaml", plan)
    write_header(folder / "header.yaml", plan.header)
    table = Box(name="table", min_mm=(600, -400, -50), max_mm=(1300, 400, -10))
    write_obstacles(folder / "obstacles.yaml", Obstacles(boxes=[table]))
    _, run = simulated(plan)
    write_run(folder / "run.jsonl", run.header, run.shots)
    zerobeam("export", "robot", folder / "run.jsonl", "-o", folder / "robot.yaml")


def test_what_is_written_beside_its_schema_names_it_and_keeps_to_it(tmp_path):
    for name in WRITTEN:
        schema = tmp_path / f"{name}.schema.json"
        schema.write_text(zerobeam("schema", name).out, encoding="utf-8")
    write_each(tmp_path)
    for name in WRITTEN:
        path = tmp_path / f"{name}.yaml"
        text = path.read_text(encoding="utf-8")
        modeline = text.splitlines()[0].removeprefix("# yaml-language-server: $schema=")
        schema = json.loads((path.parent / modeline).read_text(encoding="utf-8"))
        Draft202012Validator.check_schema(schema)
        content = YAML(typ="safe").load(text)
        assert Draft202012Validator(schema).is_valid(content), name
        assert not Draft202012Validator(schema).is_valid({**content, "colour": "red"}), name


def test_what_is_written_elsewhere_names_no_schema(tmp_path):
    write_each(tmp_path)
    for name in WRITTEN:
        assert "yaml-language-server" not in (tmp_path / f"{name}.yaml").read_text(encoding="utf-8"), name
