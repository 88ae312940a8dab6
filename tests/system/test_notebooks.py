"""The notebooks of the docs run as plain scripts, and become pages that show what their cells give."""

from __future__ import annotations

import ast
import runpy
import sys

import pytest
from scripts import DOCS, load_script

CARD = """class Card:
    def _repr_html_(self):
        return '<b>\\n\\n</b>'


Card()"""
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.py"))


@pytest.fixture
def notebook_page():
    return load_script(DOCS, "notebook_page")


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_as_a_script(notebook, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "IPython", None)
    names = runpy.run_path(str(notebook))
    assert names["degenerate"]["delta2"].estimate is None
    assert names["solution"].verdict == "pass"
    # The simulated arm's: beyond five standard uncertainties by chance once in a million.
    for name, true in {"delta2": 0.3, "delta5": -0.1}.items():
        row = names["solution"][name]
        assert abs(row.estimate - true) < 5 * row.u
    assert (tmp_path / "report" / "report.html").is_file()
    assert "degenerate unidentifiable None None\nFalse\n" in capsys.readouterr().out


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_its_cells_are_text_and_code(notebook, notebook_page) -> None:
    cells = list(notebook_page.cells(notebook.read_text(encoding="utf-8")))
    assert cells[0][1].startswith("# ")
    for is_text, body in cells:
        if not is_text:
            ast.parse(body)


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
