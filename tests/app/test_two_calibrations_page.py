"""Two calibrations in one page: nothing of the one is shown, started or written under the other's name."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from app_page import App, app, wait
from cells import good_plan
from chromium import LAPTOP, Tab, chromium
from command_line import plan_file, zerobeam

from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.browser

POSTURES = 120  # no machine has carried them out before somebody stops it
UNDER_WAY = "document.querySelector('.stop-bar')"
MAIN = "document.getElementById('content').innerText"
STEPS = ("cell", "plan", "measure", "result")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """`left` has a long plan and a run with its result, `right` a plan of three postures."""
    chromium()
    made = tmp_path / "dir"
    for name, count in (("left", POSTURES), ("right", 3)):
        (made / name).mkdir(parents=True)
        plan_file(made / name / f"{name}-plan.yaml", good_plan(count))
    plan_file(tmp_path / "short.yaml", good_plan(8))
    zerobeam("run", tmp_path / "short.yaml", "-o", made / "left" / "left-old.jsonl")
    return made


@pytest.fixture
def server(folder: Path) -> Iterator[App]:
    with app(folder) as opened:
        yield opened


def opened(tab: Tab, name: str, step: str, file: str = "") -> str:
    """What the step says once it is there."""
    tab.value(f"location.hash = '#/job/{name}/{step}{f'/{file}' if file else ''}'")
    wait(
        tab,
        f"document.querySelector('.rail [aria-current]')?.getAttribute('href').includes('/{name}/{step}')",
    )
    wait(tab, f"{MAIN}.length > 20 && !{MAIN}.startsWith('…')")
    return str(tab.value(MAIN))


def start(tab: Tab) -> None:
    wait(tab, "document.querySelector('form.start button.main:not(:disabled)')")
    tab.value("document.querySelector('form.start button.main').click()")
    wait(tab, UNDER_WAY)


def test_no_step_of_a_calibration_shows_starts_or_writes_what_is_of_another(
    server: App, folder: Path
) -> None:
    """Nor does what ends after its reader has left take anybody along."""
    with chromium().opened(f"{server.address}#/job/left/measure", LAPTOP) as tab:
        wait(tab, "document.querySelector('form.start')")
        tab.on(lambda page: page.get_by_label("Random seed").fill("7"))
        start(tab)
        wait(tab, "document.querySelector('.known')")
        for step in STEPS:
            said = opened(tab, "right", step).replace("left/left-plan-run.jsonl", "")  # the link to it
            assert "left-plan" not in said, step
            assert "left-old" not in said, step
            assert tab.value("location.hash").startswith(f"#/job/right/{step}")
        said = opened(tab, "right", "measure")
        # The run that is under way is a link there, and nothing is begun beside it.
        wait(tab, "document.querySelector('.elsewhere a')?.textContent === 'left/left-plan-run.jsonl'")
        assert tab.value("document.querySelector('form.start')") is None
        assert tab.value("document.querySelector('.known, .watch, .run-now')") is None
        # Nor is another's plan or run shown where the address names it.
        said = opened(tab, "right", "plan", "left/left-plan.yaml")
        wait(tab, "document.querySelector('.plan-bar')")
        assert (
            tab.value("import('/page/core/editing.js').then((m) => m.file.value)") == "right/right-plan.yaml"
        )
        tab.value("document.querySelector('.stop').click()")
        wait(tab, f"!{UNDER_WAY}")
        kept = len(read_run(folder / "left" / "left-plan-run.jsonl").shots)

        # Once it has ended: this calibration's plan, its own form, and no run of the other to be resumed.
        opened(tab, "right", "measure", "left/left-plan.yaml")
        wait(tab, "document.querySelector('form.start')")
        assert tab.on(lambda page: page.get_by_label("Random seed").input_value()) == ""
        assert (
            tab.on(lambda page: page.get_by_label("Plan", exact=True).input_value())
            == "right/right-plan.yaml"
        )
        assert tab.value("document.querySelector('.unfinished')") is None
        wait(tab, "document.querySelector('.elsewhere a')?.textContent === 'left/left-plan-run.jsonl'")
        start(tab)
        wait(
            tab,
            f"!{UNDER_WAY} && document.querySelector('.now')?.textContent.startsWith('3 measurements')",
        )
        assert len(read_run(folder / "right" / "right-plan-run.jsonl").shots) == 3
        assert len(read_run(folder / "left" / "left-plan-run.jsonl").shots) == kept

        # And the other one is as it was left.
        opened(tab, "left", "measure", "left/left-plan-run.jsonl")
        wait(tab, "document.querySelector('.unfinished button')")
        assert "right-plan" not in tab.value(MAIN)
        assert tab.on(lambda page: page.get_by_label("Random seed").input_value()) == "7"

        # A plan is made in one calibration while its reader looks at the other.
        opened(tab, "left", "plan")
        wait(tab, "document.querySelector('.plan-bar')")
        tab.on(lambda page: page.get_by_text("Make another plan", exact=True).click())
        tab.on(lambda page: page.get_by_role("textbox", name="Measurements").fill("4"))
        tab.on(lambda page: page.get_by_text("Constraints and search").click())
        tab.on(lambda page: page.get_by_label("Candidates").fill("60"))
        tab.on(lambda page: page.get_by_role("button", name="Make the plan").click())
        wait(tab, "document.querySelector('.making progress, .making [role=progressbar]')")
        opened(tab, "right", "plan")
        listed = "import('/page/core/store.js').then((m) => m.files.value.map((one) => one.path).join())"
        wait(tab, f"{listed}.then((paths) => paths.includes('left/plan.yaml'))", 120)
        tab.value("new Promise((done) => setTimeout(done, 500))")
        assert tab.value("location.hash") == "#/job/right/plan/right/right-plan.yaml"
        assert tab.console == []
