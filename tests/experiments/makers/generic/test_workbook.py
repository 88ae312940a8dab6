"""Workbooks (.xlsx) as tables: the same measurements as of CSV, the sheet's rows in errors, and what is
refused."""

import io
import zipfile
from contextlib import suppress
from datetime import datetime

import numpy as np
import pytest
from import_files import import_csv
from openpyxl import Workbook

from zerobeam.experiments.makers.contents import contents_of
from zerobeam.experiments.makers.generic.joint_logs import CsvLayout
from zerobeam.model.errors import BadInput
from zerobeam.model.files import text_tables
from zerobeam.model.files.text_tables import is_workbook, layout_of, table_of, table_text

ROWS = [
    [10, 20.5, -30, 40, 50.123456789012, -60],
    [1, 21, -31, 41, 51.125, -61],
    [170.5, 22, -32, 42, 52, 300],
]
NAMES = [f"A{i}" for i in range(1, 7)]


@pytest.fixture
def saved(tmp_path):
    """A workbook of sheets, by their rows."""

    def save(name="joints.xlsx", hidden=(), **sheets):
        book = Workbook()
        book.remove(book.active)
        for title, rows in sheets.items():
            sheet = book.create_sheet(title)
            sheet.sheet_state = "hidden" if title in hidden else "visible"
            for row in rows:
                sheet.append(row)
        path = tmp_path / name
        book.save(path)
        return path

    return save


@pytest.mark.parametrize("name", ["joints.xlsx", "joints.csv"])
def test_a_workbook_is_the_run_that_its_csv_is(saved, header, tmp_path, name):
    rows = [[*row, "psd"] for row in ROWS]
    layout = CsvLayout("deg", header_row=True, columns=tuple(NAMES), target_column="target")
    text = tmp_path / "text.csv"
    text.write_text("\n".join(",".join(map(str, row)) for row in [[*NAMES, "target"], *rows]))
    made = [
        import_csv([file], [], layout, header, tmp_path / "run.jsonl").shots
        for file in (saved(name, Sheet=[[*NAMES, "target"], *rows]), text)
    ]
    assert [shot.joints_deg for shot in made[0]] == [tuple(row) for row in ROWS]
    assert [shot.joints_deg for shot in made[1]] == [shot.joints_deg for shot in made[0]]
    assert [shot.source for shot in made[0]] == [f"{name}:2", f"{name}:3", f"{name}:4"]


def test_errors_name_the_row_of_the_sheet(saved, header, tmp_path, refused):
    file = saved(Sheet=[ROWS[0], [], [*ROWS[1][:5], "off"], ROWS[2]])
    error = refused(import_csv, [file], ["psd"], CsvLayout("deg"), header, tmp_path / "run.jsonl")
    assert (error.line, error.found) == (3, '"off"')
    # A formula that no program has computed has no value.
    file = saved(Sheet=[ROWS[0], [*ROWS[1][:5], "=1+1"]])
    error = refused(import_csv, [file], ["psd"], CsvLayout("deg"), header, tmp_path / "run.jsonl")
    assert error.line == 2


def test_no_delimiter_is_told_of_a_workbook(saved, header, tmp_path):
    layout = CsvLayout("deg")
    understood = import_csv([saved(Sheet=ROWS)], ["psd"], layout, header, tmp_path / "run.jsonl").understood
    assert not any("delimiter found" in line for line in understood)


def test_the_app_sees_its_columns(saved):
    found = contents_of(saved(Sheet=[[*NAMES, "remark"], *([*row, "as found"] for row in ROWS)]))
    assert (found.form, found.rows, found.whole) == ("csv", 3, True)
    assert [column.name for column in found.columns] == [*NAMES, "remark"]
    assert (found.columns[0].highest, found.columns[6].highest) == (170.5, None)


def test_cells_are_as_exact_as_they_are_stored(saved):
    when = datetime(2026, 3, 4, 5, 6, 7)
    values = [0.1, 1e-12, 123456789.25, 3.0, when, "two\nlines\tof text", None, True, '"as found"']
    text = table_text(saved(Sheet=[values, [1] * 9]))
    first, _ = text.splitlines()
    cells = first.split("\t")
    assert [float(cell) for cell in cells[:4]] == values[:4]
    assert cells[3:] == ["3", "2026-03-04T05:06:07", "two lines of text", "", "True", '"""as found"""']


def test_one_visible_sheet_has_cells(saved, refused):
    hidden = table_text(saved(hidden=("old",), new=ROWS, old=[[1, 2]], notes=[]))
    table = table_of(hidden, "joints.xlsx", layout_of(hidden))
    np.testing.assert_array_equal(table.numbers(range(6)), ROWS)
    error = refused(table_text, saved(one=ROWS, two=ROWS))
    assert error.found == "sheets with cells: one, two"
    assert refused(table_text, saved(one=[])).found == "no cell"


def test_what_is_no_whole_workbook_is_refused(saved, tmp_path, refused):
    file = saved(Sheet=ROWS)
    whole, whole_text = file.read_bytes(), table_text(file)
    rng, refusals = np.random.default_rng(0), 0
    for k in range(60):
        broken = bytearray(whole)
        if k % 3 == 0:
            del broken[int(rng.integers(20, len(whole))) :]
        else:
            at = rng.integers(0, len(whole), 1 + k)
            broken[int(at[0])] ^= 1 + k
            for i in at[1:]:
                broken[int(i)] = int(rng.integers(256))
        file = tmp_path / f"broken-{k}.xlsx"
        file.write_bytes(broken)
        read = None
        with suppress(BadInput):
            read = table_text(file)
        assert read in (None, whole_text), "a checksum guards the cells"
        refusals += read is None
    assert refusals > 40
    archive = tmp_path / "other.xlsx"
    with zipfile.ZipFile(archive, "w") as made:
        made.writestr("content.xml", "<x/>")
    assert not is_workbook(archive)
    error = refused(table_text, archive)
    assert "archive" in error.what
    assert "CSV" in error.remedy


def test_two_cells_at_the_corners_of_a_sheet_end_in_a_refusal(tmp_path, refused):
    book = Workbook()
    book.active["A1"], book.active["XFD1048576"] = 1, 2
    book.save(tmp_path / "corners.xlsx")
    assert "too large" in refused(table_text, tmp_path / "corners.xlsx").what


def test_what_unpacks_to_too_much_is_not_unpacked(saved, monkeypatch, refused):
    file = saved(Sheet=ROWS)
    with zipfile.ZipFile(io.BytesIO(file.read_bytes())) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    monkeypatch.setattr(text_tables, "_MOST_UNPACKED", unpacked)
    table_text(file)
    monkeypatch.setattr(text_tables, "_MOST_UNPACKED", unpacked - 1)
    assert "too large" in refused(table_text, file).what


def test_without_the_library_the_extra_is_named(saved, monkeypatch, refused):
    file = saved(Sheet=ROWS)
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    error = refused(table_text, file)
    assert error.remedy == 'pip install "zerobeam[xlsx]"'
