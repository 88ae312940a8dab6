"""Makers are found by their folders: a made-up one needs one new file; docs/export.md lists what each has."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cells import good_plan
from command_line import plan_file
from exact_runs import demo_runs
from recorded_logs import HEADER, POSTURES

from zerobeam.experiments.makers.maker import Maker, makers
from zerobeam.experiments.positions.position_languages import LANGUAGES
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.run import read_run
from zerobeam.words.controllers import POSITIONS, export_command, taken_by

ROOT = Path(__file__).resolve().parents[3]
GOOD = demo_runs()[0].path

ACME = '''
from typing import Annotated

from zerobeam.experiments.makers.maker import KnownLog, Maker, OffsetFile, Option, PlanProgram, Reader


def zeros(run, calibration, scale: Annotated[float, Option("Units of one degree.")] = 1.0):
    """ACME: the zeros of all joints."""
    return "".join(f"ZERO {offset.applied * scale:.6f}\\n" for offset in calibration.offsets)


def program(plan, motion, file):
    return {file: f"{len(plan.postures)} postures at {motion.speed:g}\\n"}


def read(job, skip: Annotated[int, Option("Lines to skip.", least=0)] = 0):
    """ACME: joints, a line each."""
    from zerobeam.experiments.makers.maker import TaughtPoint
    from zerobeam.experiments.makers.taught_positions import import_points

    def parse(text, path):
        lines = text.splitlines()[skip:]
        rows = [tuple(map(float, line.split())) for line in lines]
        return [TaughtPoint(f"p{i}", row, i) for i, row in enumerate(rows, start=1)]

    return import_points(job, parse, names=None, note="ACME lines")


def trace(count):
    from zerobeam.experiments.makers.generic.layouts import CsvLayout

    names = [f"axis{i}" for i in range(1, count + 1)]
    return CsvLayout("deg", columns=names, header_row=True, delimiter="|", time_column="t", time_units="s")


MAKER = Maker(
    "ACME",
    "acme",
    r"acme ?\\d*",
    offsets=(OffsetFile("acme", zeros),),
    program=(PlanProgram("acme", "ACME", ("zb_plan.acme",), program, ("speed",)),),
    read=(Reader("acme", read, "Files of ACME."),),
    logs=(KnownLog("acme", "trace of ACME", trace),),
)
'''
RUN = """
import sys
import zerobeam.experiments.makers as package
package.__path__.append(sys.argv[1])
from zerobeam.cli import main
sys.argv = ["zerobeam", *sys.argv[2:]]
main()
"""


@pytest.mark.long
def test_a_made_up_maker_is_one_new_file(tmp_path: Path) -> None:
    folder = tmp_path / "makers" / "acme"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text(ACME)

    def zerobeam(*arguments: object, status: int = 0) -> str:
        command = [sys.executable, "-c", RUN, folder.parent, *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == status, (done.stdout, done.stderr)
        return done.stdout + done.stderr

    assert "ACME: the zeros of all joints." in zerobeam("export", "--help")
    out = tmp_path / "out"
    zerobeam("export", "acme", GOOD, "-o", out, "--scale", "10")
    assert out.read_text().startswith("ZERO 0.000000\nZERO ")
    plan, unknown = plan_file(tmp_path / "plan.yaml", good_plan(3)), tmp_path / "unknown.yaml"
    assert "robots of ACME" in zerobeam("export", "plan", "acme", plan, "-o", out, "--force", status=2)
    shutil.copy(ROOT / "model" / "robots" / "irb1600.yaml", tmp_path / "arm.yaml")
    arm = (tmp_path / "arm.yaml").read_text()
    arm = re.sub(r"^vendor:.*\n", "", re.sub(r"^name:.*", "name: mine", arm, flags=re.M), flags=re.M)
    (tmp_path / "arm.yaml").write_text(arm)
    unknown.write_text(re.sub(r"^robot:.*", "robot: arm.yaml", plan.read_text(), flags=re.M))
    told = zerobeam("export", "plan", "acme", unknown, "-o", out, "--force")
    assert "nothing says who made 'mine': check that" in " ".join(told.split())
    assert out.read_text() == "3 postures at 10\n"
    (tmp_path / "header.yaml").write_text(HEADER)
    lines = ["head", *(" ".join(map(str, row)) for row in POSTURES.tolist())]
    (tmp_path / "a.acme").write_text("\n".join(lines))
    run = tmp_path / "run.jsonl"
    options = ["--skip", "1", "--header", tmp_path / "header.yaml", "--target", "a", "-o", run]
    assert "4 measurements written" in zerobeam("import", "acme", tmp_path / "a.acme", *options)
    assert len(read_run(run).shots) == 4
    log, traced = tmp_path / "trace.txt", tmp_path / "traced.jsonl"
    log.write_text(trace_of(POSTURES))
    options = ["--still-deg", "0.01", "--still-s", "0.5", *options[2:-1], traced]
    assert "4 measurements written" in zerobeam("import", "log", "acme", log, *options)
    assert [shot.joints_deg for shot in read_run(traced).shots] == [
        shot.joints_deg for shot in read_run(run).shots
    ]


def trace_of(postures: Matrix) -> str:
    """A second in each posture, with ten rows, and a second from one to the next."""
    rows, clock = ["t|" + "|".join(f"axis{i}" for i in range(1, postures.shape[1] + 1))], 0.0
    for here, there in zip(postures, [*postures[1:], postures[-1]], strict=True):
        for share in [0.0] * 10 + [k / 10 for k in range(10)]:
            joints = here + share * (there - here)
            rows.append(f"{clock:.1f}|" + "|".join(map(str, joints.tolist())))
            clock += 0.1
    return "\n".join(rows) + "\n"


def row(maker: Maker) -> str:
    """A maker as the table in docs/export.md has it."""

    def listed(command: str, names: list[str]) -> str:
        return f"`{command}` " + ", ".join(names) if names else "–"

    readers = [reader.name for reader in maker.read if not reader.hidden]
    logs = [f"log {log.name}" for log in maker.logs]
    cells = [
        maker.name,
        listed("export", [kind.name for kind in maker.offsets]),
        listed("export plan", [program.name for program in maker.program]),
        listed("import", [*readers, *logs]),
        listed("positions", [POSITIONS[maker.vendor]] if maker.vendor in POSITIONS else []),
        "–" if maker.live is None else f"`run --rig {maker.live}`",
        maker.tried,
    ]
    return f"| {' | '.join(cells)} |"


def test_the_table_of_makers_in_the_docs_is_what_there_is() -> None:
    rows = [row(maker) for maker in sorted(makers(), key=lambda maker: maker.vendor is None)]
    assert "\n".join(rows) in (ROOT / "docs" / "export.md").read_text(encoding="utf-8"), "\n".join(rows)


def test_what_reports_offer_is_what_the_makers_have() -> None:
    vendors = [maker for maker in makers() if maker.vendor is not None]
    assert {"offsets", "model"} <= {maker.takes for maker in vendors}
    assert {language.vendor for language in LANGUAGES} == set(POSITIONS)
    for language in LANGUAGES:
        assert {*POSITIONS[language.vendor].split(", ")} <= {*language.endings}
    for maker in vendors:
        assert taken_by(maker.vendor) == maker.takes, f"words/controllers.py: {maker.name}"
        command, _ = export_command(maker.vendor)
        kinds = [f"export {kind.name}" for kind in maker.offsets] or ["export robot"]
        assert command in kinds


def test_help_loads_no_grammar_and_no_numbers() -> None:
    code = "import sys\nfrom zerobeam.commands.program import app\nprint(*sys.modules)"
    names = set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.split())
    assert "zerobeam.experiments.makers.kuka" in names
    assert names & {"scipy", "numpy", "casadi", "pydantic"} == set()
