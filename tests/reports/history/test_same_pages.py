"""The pages of a history are the same bytes, whatever database holds it."""

from pathlib import Path

import pytest
from command_line import zerobeam
from histories import a_result, as_misfit, postgresql, write_result


def fill(folder: Path, url: object) -> None:
    assert zerobeam("history", "add", folder, "--db", url).status == 0
    for serial, date, what, note in (
        ("Ä-1", "2025-02-01T06:00:00+02:00", "collision", "table 3, 中"),
        ("a-1", "2024-06-01", "mastering", ""),
        ("B", "2026-03-01", "motor", "axis 2"),
    ):
        event = ("history", "event", serial, "--date", date, "--what", what, "--note", note, "--db", url)
        assert zerobeam(*event).status == 0


@pytest.mark.long
def test_sqlite_and_postgresql_give_the_same_pages(tmp_path: Path) -> None:
    number = 0
    for serial in ("Ä-1", "a-1", "A-1", "B", "<b>", "Z" * 300):
        for year in range(2023, 2026):
            answer = a_result(serial, f"{year}-0{len(serial) % 9 + 1}-15", psd=f"no. {number % 2}")
            answer["without_prior"]["values"][1] += 1.0 if (serial, year) == ("Ä-1", 2025) else 0.0
            if (serial, year) == ("B", 2025):
                answer = as_misfit(answer)
            write_result(tmp_path / "in" / str(number) / "result.json", answer)
            number += 1
    pages: list[dict[Path, bytes]] = []
    with postgresql() as server:
        for name, url in (("sqlite", tmp_path / "history.sqlite"), ("server", server)):
            fill(tmp_path / "in", url)
            out = tmp_path / name
            assert zerobeam("history", "report", "-o", out, "--db", url).status == 0
            pages.append(
                {path.relative_to(out): path.read_bytes() for path in out.rglob("*.*") if path.is_file()}
            )
    one, other = pages
    assert len([path for path in one if path.name == "arm.html"]) == 6
    assert sorted(one) == sorted(other)
    assert [path for path in one if one[path] != other[path]] == []
    for content in one.values():
        assert str(tmp_path).encode() not in content
