import importlib
import json
import sys
from pathlib import Path

import pytest

from zerobeam.experiments.schema import FILE_SCHEMAS, SCHEMA_NAMES, json_schema

UNITS = {
    "_mm": "millimetres",
    "_deg": "degrees",
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
            assert UNITS[suffix] in content["description"], key


def test_the_kinds_of_file_are_told_by_their_schema_key():
    assert (
        *("run-header", "run-shot", "plan", "header", "robot", "obstacles", "cell"),
        *("sensors", "psd-calibration", "study-file", "result", "check", "compare", "batch"),
        "history",
    ) == SCHEMA_NAMES
    for name in ("run", "plan", "robot", "result", "check", "compare", "batch", "history"):
        content = json_schema("run-header" if name == "run" else name)
        assert content["properties"]["schema"]["const"] == f"zerobeam/{name}/1"
        assert "schema" in content["required"]
    assert set(json_schema("header")["required"]) == {"robot", "tool", "noise"}
    assert json_schema("run-shot")["required"] == ["shot", "target", "joints_deg"]


def test_the_examples_of_the_design_have_only_keys_of_the_schema():
    header = json_schema("run-header")["properties"]
    wanted = "schema robot tool noise prior targets distances held limits tolerance geometry provenance"
    assert set(header) == set(wanted.split())
    assert set(json_schema("plan")["properties"]) == {*header, "constraints", "postures_deg"}
    shot = "shot target joints_deg spot_mm time_s comment"
    assert set(json_schema("run-shot")["properties"]) == set(shot.split())


def test_a_schema_that_is_not_there(refused):
    assert "did you mean 'plan'?" in refused(json_schema, "plans").remedy


def test_the_tables_of_the_page_are_those_of_the_models():
    """`python docs/file_tables.py` writes them."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
    try:
        tables = importlib.import_module("file_tables")
    finally:
        del sys.path[0]
    for path in tables.PAGES:
        page = path.read_text(encoding="utf-8")
        assert page.count("<!-- keys ") == page.count("<!-- end -->") > 0
        assert tables.written(page) == page, f"{path.name}: run python docs/file_tables.py"
    assert "| std of random offsets" in tables.table("cell")
