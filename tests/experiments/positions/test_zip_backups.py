"""A backup as a zip archive."""

from pathlib import Path
from zipfile import ZipFile

import pytest
from made_backups import DIALECTS, kept, written

from zerobeam.model.errors import BadInput
from zerobeam.reports.positions_page import write_conversion


def zipped(path: Path, files: dict[str, str]) -> Path:
    with ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def test_a_zip_is_converted_as_its_folder(tmp_path: Path) -> None:
    backup = DIALECTS["KRL"].made(4)
    path = zipped(tmp_path / "backup.zip", {f"KRC/R1/{name}": text for name, text in backup.texts.items()})
    answer = kept(path, backup.dialect.robot, **backup.options)
    folder = kept(written(backup, tmp_path / "folder"), backup.dialect.robot, **backup.options)
    assert answer.converted
    assert {f"KRC/R1/{name}": each for name, each in folder.content.items()} == answer.content
    write_conversion(tmp_path / "new", answer)
    again = zipped(tmp_path / "again.zip", {"audit.json": "{}", **backup.texts})
    with pytest.raises(BadInput, match="it was converted before"):
        kept(again, backup.dialect.robot, **backup.options)


@pytest.mark.parametrize("name", ["../a.src", "/a.src", "C:/a.src", "a\\..\\b.src", "x/../a.src"])
def test_a_zip_whose_names_lead_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    path = zipped(tmp_path / "backup.zip", {name: "DEF a( )\nEND\n"})
    with pytest.raises(BadInput, match="no backup of a controller"):
        kept(path, "kr6_r900")


def test_what_is_no_zip_is_refused(tmp_path: Path) -> None:
    (tmp_path / "backup.zip").write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(BadInput, match="the archive cannot be read"):
        kept(tmp_path / "backup.zip", "kr6_r900")
