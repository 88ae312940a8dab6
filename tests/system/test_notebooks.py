"""The notebooks of the docs run as plain scripts, and become pages that show what their cells give."""

import ast
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest
from scripts import DOCS, load_script

import zerobeam as zb
from zerobeam.model.instruments import registry

CARD = """class Card:
    def _repr_html_(self):
        return '<b>\\n\\n</b>'


Card()"""
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.py"))


@pytest.fixture
def notebook_page():
    return load_script(DOCS, "notebook_page")


def carried_out(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a notebook defines, run as a script in `folder`."""
    monkeypatch.chdir(folder)
    monkeypatch.setitem(sys.modules, "IPython", None)
    return runpy.run_path(str(DOCS / "notebooks" / f"{name}.py"))


def near(solution: zb.Analysed, true: dict[str, float]) -> bool:
    """Whether the simulated arm's offsets come back: beyond five standard uncertainties once in a million."""
    rows = [solution[name] for name in true]
    return all(abs(row.estimate - true[row.name]) < 5 * row.u for row in rows)


@pytest.mark.long
def test_from_arrays_to_a_report(tmp_path, monkeypatch, capsys) -> None:
    names = carried_out("from_arrays_to_report", tmp_path, monkeypatch)
    assert names["degenerate"]["delta2"].estimate is None
    assert names["solution"].verdict == "pass"
    assert near(names["solution"], {"delta2": 0.3, "delta5": -0.1})
    assert (tmp_path / "report" / "report.html").is_file()
    assert "degenerate unidentifiable None None\nFalse\n" in capsys.readouterr().out


@pytest.mark.long
def test_a_plan_for_my_arm(tmp_path, monkeypatch) -> None:
    names = carried_out("plan_for_my_arm", tmp_path, monkeypatch)
    assert names["best"].check.verdict == "pass"
    assert zb.check(names["still"])["J2"].status == "unidentifiable"


@pytest.mark.long
def test_tracker_and_psd_together(tmp_path, monkeypatch, capsys) -> None:
    names = carried_out("tracker_and_psd", tmp_path, monkeypatch)
    assert near(names["solution"], {"delta2": 0.3, "delta6": -0.2})
    assert "held alone; identified together" in capsys.readouterr().out


@pytest.mark.long
def test_my_own_instrument(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(registry, "KINDS", dict(registry.KINDS))
    names = carried_out("my_own_instrument", tmp_path, monkeypatch)
    assert names["solution"].verdict == "pass"
    assert near(names["solution"], {"delta2": 0.3, "delta5": -0.1})


@pytest.mark.long
def test_many_arms(tmp_path, monkeypatch, capsys) -> None:
    names = carried_out("many_arms", tmp_path, monkeypatch)
    assert [(serial, name) for serial, name, _ in names["large"]] == [("16-103", "delta3")]
    assert capsys.readouterr().out == "True\n"


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_its_cells_are_text_and_code(notebook, notebook_page) -> None:
    cells = list(notebook_page.cells(notebook.read_text(encoding="utf-8")))
    assert cells[0][1].startswith("# ")
    for is_text, body in cells:
        if not is_text:
            ast.parse(body)


def test_a_cell_has_no_imports_of_the_page_maker(notebook_page) -> None:
    """Annotations of a class in a cell are objects, as in a notebook."""
    code = "class One:\n    size: int\n\n\nprint(One.__annotations__['size'] is int, __name__)"
    assert list(notebook_page.shown(code, {"__name__": "__main__"})) == ["```text\nTrue __main__\n```"]


def test_a_page_shows_what_a_cell_prints_and_gives(notebook_page, tmp_path) -> None:
    notebook = tmp_path / "short.py"
    notebook.write_text(
        "# ---\n# jupyter: {}\n# ---\n\n# %% [markdown]\n# # Title\n#\n# Text.\n\n# %%\nx = 2\nprint(x)\n\n"
        f"# %%\nx + 1\n\n# %%\n{CARD}\n"
    )
    assert notebook_page.page(notebook) == (
        "# Title\n\nText.\n\n```python\nx = 2\nprint(x)\n```\n\n```text\n2\n```\n\n"
        "```python\nx + 1\n```\n\n```text\n3\n```\n\n"
        f"```python\n{CARD}\n```\n\n<b>\n</b>\n"
    )
