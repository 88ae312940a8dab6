"""Which result is meant, and whether the history still holds it as it was added."""

import json
import zlib
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from certificates import kept, only
from histories import a_result

from zerobeam.analysis.answer.result import parse_result
from zerobeam.experiments.history.database import document, result
from zerobeam.experiments.history.store import add, choose, results, whole_answer
from zerobeam.experiments.history.stored_result import read_entry
from zerobeam.model.errors import BadInput


def test_the_result_that_is_meant(tmp_path: Path) -> None:
    days = ("2026-01-31", "2026-02-28T08:00:00", "2026-02-28T17:00:00", "2026-03-31")
    found = list(results(kept(tmp_path, *(a_result("A", day) for day in days))))
    assert choose(found) == found[3]
    assert choose(found, run=found[0].sha256[:8].upper()) == found[0]
    assert choose(found, date="2026-01-31") == found[0]
    assert choose(found, date="2026-02-28T18:00:00+01:00") == found[2]
    with pytest.raises(BadInput, match=r"several results[\s\S]*--run"):
        choose(found, date="2026-02-28")
    with pytest.raises(BadInput, match="several results"):
        choose([*found, found[3]])
    for how in ({"run": "zz"}, {"run": ""}, {"date": "2026-02-27"}):
        with pytest.raises(BadInput, match="no such result"):
            choose(found, **how)
    with pytest.raises(BadInput, match="exclude each other"):
        choose(found, run="a", date="2026-01-31")
    with pytest.raises(BadInput, match="ISO 8601"):
        choose(found, date="31/1/26")
    with pytest.raises(BadInput, match="no result in the history"):
        choose([])


def _tampered(text: str) -> bytes:
    answer = json.loads(text)
    answer["parameters"][1]["estimate"] += 0.1
    return zlib.compress(json.dumps(answer).encode())


def test_a_history_that_was_altered_is_found_out(tmp_path: Path) -> None:
    answer = a_result("A")
    history = kept(tmp_path, answer)
    tampered = _tampered((tmp_path / "0.json").read_text(encoding="utf-8"))
    for table, values, told in (
        (result, {"verdict": "weak"}, "verdict"),
        (result, {"operator": "someone else"}, "operator"),
        (result, {"measured_at": datetime(2026, 2, 1)}, "measured_at"),
        (result, {"offsets": "[]", "without_prior": None, "sensitivity_mm2": None}, "offsets"),
        (result, {"without_prior": None}, "without_prior"),
        (result, {"document_sha256": "0" * 64}, "document_sha256"),
        (document, {"content": b"torn"}, "damaged"),
        (document, {"content": zlib.compress(b"{}")}, "damaged"),
        (document, {"content": tampered}, "document_sha256"),
    ):
        assert whole_answer(history, only(history)) == parse_result(json.dumps(answer))
        columns: Any = [table.c[name] for name in values]
        with history.writing() as connection:
            before = connection.execute(sa.select(*columns)).one()._asdict()
            connection.execute(sa.update(table).values(values))
        with pytest.raises(BadInput, match=rf"the history was altered[\s\S]*{told}"):
            whole_answer(history, only(history))
        with history.writing() as connection:
            connection.execute(sa.update(table).values(before))
    with history.writing() as connection:
        connection.execute(sa.delete(document))
    with pytest.raises(BadInput, match="missing or damaged"):
        whole_answer(history, only(history))


def test_what_the_run_did_not_state_is_as_it_was_given(tmp_path: Path) -> None:
    answer = a_result(None, None, who="J. Doe")
    history = kept(tmp_path)
    (tmp_path / "one.json").write_text(json.dumps(answer), encoding="utf-8")
    own = read_entry(tmp_path / "one.json", lambda sha256: None, serial="A", when="2026-03-31T14:05:00+02:00")
    assert own is not None
    add(history, [own])
    assert whole_answer(history, only(history)) == parse_result(json.dumps(answer))
