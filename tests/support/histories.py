"""Results for the tests of the history: a real one, of which copies are made for other arms and dates."""

import copy
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from exact_runs import demo_runs
from made_once import made_once

from zerobeam.analysis.analyse import analyse
from zerobeam.model.files.run import read_run
from zerobeam.model.records import dumps
from zerobeam.words.sentences import to_json


def demo_result(name: str) -> dict[str, Any]:
    """The result.json of a run of the demo with exact geometry, as JSON has it."""

    def make() -> dict[str, Any]:
        (path,) = [demo.path for demo in demo_runs() if demo.name == name]
        run = read_run(path)
        exact = run.header.model_copy(update={"geometry": "exact"})
        return to_json(analyse(replace(run, header=exact), ess=100.0).result)

    return copy.deepcopy(made_once(f"demo result {name}", make))


def a_result(
    serial: str | None = "A-1", when: str | None = "2026-01-31", *, demo: str = "good", **provenance: object
) -> dict[str, Any]:
    """The result of a run that states this origin: another origin is another run, of another hash."""
    answer = demo_result(demo)
    stated = {"serial": serial, "when": when, **provenance}
    own = {key: value for key, value in stated.items() if value is not None}
    answer["inputs"]["header"]["provenance"] = own
    answer["inputs"]["sha256"] = hashlib.sha256(json.dumps(own).encode()).hexdigest()
    return answer


def as_misfit(answer: dict[str, Any]) -> dict[str, Any]:
    """The same of a run that the model does not describe."""
    numbers = {"chi2": 405.0, "dof": 5, "p_value": 1e-80}
    criteria = [{"kind": "chi2", **numbers, "sentence": "Residuals are 9 times the stated noise."}]
    rows = [row | ({} if row["std"] is None else {"status": "unvalidated"}) for row in answer["parameters"]]
    steps = answer["next_steps"] | {"enter": []}
    return answer | {
        "parameters": rows,
        "verdict": "misfit",
        "misfit": {"criteria": criteria},
        "next_steps": steps,
    }


def write_result(path: Path, answer: dict[str, Any]) -> Path:
    """The result as a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(dumps(answer), encoding="utf-8")
    return path


@contextmanager
def postgresql() -> Iterator[str]:
    """The URL of an empty database of a real PostgreSQL server, started for the test; skipped without one."""
    program = shutil.which("pg_ctl") or next(
        map(str, sorted(Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"))), None
    )
    if program is None:
        pytest.skip("PostgreSQL is not installed (no pg_ctl)")
    programs = Path(os.path.realpath(program)).parent
    # A folder of its own: pytest's are closed to the user that the server runs as.
    with tempfile.TemporaryDirectory(prefix="zerobeam-server-") as name:
        folder = Path(name)
        as_user: dict[str, Any] = {}
        if os.getuid() == 0:  # the server refuses to run as root
            import pwd

            nobody = pwd.getpwnam("nobody")
            os.chown(folder, nobody.pw_uid, nobody.pw_gid)
            as_user = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}

        def do(*command: object) -> None:
            ran = subprocess.run(
                [str(part) for part in command],
                stdout=subprocess.DEVNULL,  # the server would keep a pipe open
                stderr=subprocess.DEVNULL,
                cwd=folder,
                timeout=120,
                check=False,
                **as_user,
            )
            assert ran.returncode == 0, command

        data = folder / "data"
        do(programs / "initdb", "-D", data, "-U", "plant", "-A", "trust", "--no-sync", "-E", "UTF8")
        listen = f"-c listen_addresses='' -c unix_socket_directories='{folder}'"
        do(programs / "pg_ctl", "-D", data, "-w", "-o", listen, "-l", folder / "log", "start")
        try:
            do(programs / "createdb", "-h", folder, "-U", "plant", "history")
            yield f"postgresql://plant@/history?host={folder}"
        finally:
            do(programs / "pg_ctl", "-D", data, "-m", "immediate", "stop")


# Adds the results of a folder one after the other, and says of each that it is there.
ADDING = """
import sys
from pathlib import Path
from zerobeam.experiments.history.database import open_history
from zerobeam.experiments.history.stored_result import read_entry
from zerobeam.experiments.history.store import add
history = open_history(sys.argv[1], create=True)
for path in sorted(Path(sys.argv[2]).iterdir()):
    (outcome,) = add(history, [read_entry(path, lambda sha256: None)])
    print(path.name, outcome, flush=True)
"""


def adding(url: str, folder: Path) -> list[str]:
    """The command of a process that adds a folder's results."""
    return [sys.executable, "-c", ADDING, url, str(folder)]
