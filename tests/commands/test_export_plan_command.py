"""`zerobeam export plan` and the way back, as a person calls them."""

from pathlib import Path

from cells import good_plan
from command_line import plan_file, zerobeam

from zerobeam.model.files.run import read_run


def test_a_program_and_what_it_recorded(tmp_path: Path) -> None:
    plan = good_plan(3)
    path, program = plan_file(tmp_path / "plan.yaml", plan), tmp_path / "zb_plan.mod"
    answer = zerobeam("export", "plan", "rapid", path, "-o", program)
    assert (answer.status, answer.out, answer.err) == (0, f"Written to {program}\n", "")
    assert "exists already" in zerobeam("export", "plan", "rapid", path, "-o", program).refused()
    assert zerobeam("export", "plan", "rapid", path, "-o", program, "--force").status == 0
    refused = zerobeam("export", "plan", "krl", path, "-o", tmp_path / "a.src").refused()
    assert "a KRL program is for robots of KUKA found: irb1600, of abb" in refused
    rows = plan.postures * plan.robot.display + 0.25
    said = [f"zerobeam posture {i} deg {' '.join(map(str, row))}\n" for i, row in enumerate(rows.tolist())]
    (tmp_path / "zb_plan.log").write_text("".join(said))
    run = tmp_path / "run.jsonl"
    answer = zerobeam("import", "rapid", tmp_path / "*.log", "--plan", path, "-o", run)
    assert answer.status == 0
    assert answer.out.endswith(f"3 measurements written to {run}\n")
    assert read_run(run).target_names == ("psd",)
    nothing = zerobeam("import", "rapid", tmp_path / "zb_plan.log", "-o", tmp_path / "b.jsonl").refused()
    assert "neither --header nor --plan is stated" in nothing
    text = zerobeam("import", "robodk", program, "--plan", path, "-o", tmp_path / "b.jsonl").refused()
    assert "not what the program recorded" in text
