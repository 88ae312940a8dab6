"""Two calibrations in one page: nothing of the one is shown, started or written under the other's name."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from app_page import App, app, wait
from cells import good_plan, pattern_plan
from chromium import LAPTOP, Tab, chromium
from command_line import plan_file, zerobeam

from zerobeam import app as package
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


# ── every view and every action ──────────────────────────────────────────────────────────────────────

PAGE = Path(package.__file__).parent / "page"
_CALL = re.compile(r"""\b(?:get|post|put|getFile)\(\s*["`]([\w/]+)""")
_VIEW = re.compile(r"""^  (\w+): \(\) => import\(""", re.MULTILINE)
# Of no calibration: the whole folder, what is the same for all, and the views that make a calibration.
OF_NONE = {
    *("files", "home", "robots", "forms", "history", "jobs", "unfinished"),
    *("calibrations", "calibrations/choices", "calibrations/proposal", "calibrations/withdraw", "example"),
    *("recording", "columns", "header/schema", "header/check", "folders"),
}
VIEWS_OF_NONE = {"new", "import"}
RESTING = {"meshes", "inverse"}  # no arm of this test has any; the flange is held in the picture alone
# By when a view is there: each that the page's code has.
READY = {
    "cell": ".plan-bar",
    "plan": ".plan-bar",
    "measure": "form.start button.main:not(:disabled)",
    "result": ":is(.offsets, .bare)",
}
FIRST, OTHER = "sinister", "dexter"  # words that no page has by itself

# Everything that is asked is kept; the answers to what is asked on hold are heard once they are let go. The
# picture is drawn flat, which is quicker.
LISTEN = """(() => {
  const ask = window.fetch;
  delete window.OffscreenCanvas;
  Object.assign(window, { asked: [], busy: 0, held: null, hold: () => {
    window.held = new Promise((done) => { window.release = done; });
  } });
  window.EventSource = class extends EventSource {
    constructor(...of) { super(...of); window.busy += 1; }
    close() { if (this.readyState !== EventSource.CLOSED) window.busy -= 1; super.close(); }
  };
  window.fetch = async (path, how = {}) => {
    const { held } = window;
    window.busy += 1;
    window.asked.push(`${how.method ?? "GET"} ${path}`);
    try {
      return await Promise.all([ask(path, how), held]).then(([answer]) => answer);
    } finally {
      window.busy -= 1;
    }
  };
})()"""
# What can be acted on: each button by its words, and one field of each kind in each part.
UNFOLD = "document.querySelectorAll('main details:not([open]) > summary').forEach((one) => one.click())"
ACTS = """(() => {
  window.acts = new Map();
  for (const one of document.querySelectorAll("main :is(button, input, select)")) {
    if (one.disabled || one.type === "file" || one.closest(".scene-tools")) continue;
    const part = one.closest("fieldset, .fields, .joints, .measurements, form, figure")?.className;
    const fold = one.closest("details")?.firstChild.textContent;
    const said = (one.ariaLabel ?? one.textContent.trim()).replace(/\\d+/g, "#");
    window.acts.set([one.type, one.tagName === "BUTTON" ? said : part, fold].join(" "), one);
  }
  return [...window.acts.keys()];
})()"""
OPENERS = ("checkbox measurements", "button Add a box")  # after which there is more to be done
ACT = """(one) => {
  if (one.tagName === "BUTTON" || ["checkbox", "radio"].includes(one.type)) { one.click(); return; }
  one.value = one.tagName === "SELECT" ? one.options[one.options.length - 1].value : "2";
  for (const kind of ["input", "change"]) one.dispatchEvent(new Event(kind, { bubbles: true }));
}"""
# What is read of the page: without what says by itself of which calibration it is, and what is chosen from.
READ = f"""(() => {{
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), seen = [];
  while (walker.nextNode()) {{
    const {{ textContent: text, parentElement: of }} = walker.currentNode;
    const free = of.closest("select, .choice-of, .elsewhere, .stop-bar, .notice");
    if (!free && text.includes("{FIRST}") && !text.startsWith("{FIRST}: ")) seen.push(text);
  }}
  return seen;
}})()"""


def code_of(pattern: re.Pattern[str]) -> set[str]:
    """What is called so in the page's code."""
    sources = (path.read_text() for path in PAGE.rglob("*.js") if "vendor" not in path.parts)
    return {found[1] for text in sources for found in pattern.finditer(text)}


def content_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def both_in(made: Path, reported: Path) -> Path:
    """Two calibrations with all that one can have: a plan that leaves a direction open, obstacles, a run
    that was broken off, one with a report."""
    for name, plan, run in ((FIRST, pattern_plan("x"), "good"), (OTHER, good_plan(7), "x-pattern")):
        at = made / name
        at.mkdir(parents=True)
        plan_file(at / f"{name}-plan.yaml", plan)
        plan_file(at / f"{name}-second.yaml", good_plan(4))
        box = f"name: {name}, min_mm: [-900, -900, 0], max_mm: [-800, -800, 100]"
        (at / f"{name}-boxes.yaml").write_text(f"boxes: [{{{box}}}]\n")
        (at / f"{name}.prg").write_text(f"' {name}\n")
        shutil.copy(reported / f"{run}.jsonl", at / f"{name}-run.jsonl")
        shutil.copytree(reported / run, at / f"{name}-report")
        lines = (at / f"{name}-run.jsonl").read_text().splitlines(keepends=True)
        (at / f"{name}-bare.jsonl").write_text("".join(lines[:-1]))
    return made


def leads(tab: Tab, name: str, step: str, file: str = "") -> None:
    """To a step, whatever is not saved."""
    where = f"#/job/{name}/{step}{file and f'/{file}'}"
    tab.value(f"import('/page/core/route.js').then((m) => m.go('{where}', {{sure: true}}))")
    current = "document.querySelector('.rail [aria-current]')?.getAttribute('href')"
    wait(tab, f"{current} === '#/job/{name}/{step}'")


QUIET = """window.busy === 0 && new Promise((done) => setTimeout(done, 60)).then(() => window.busy === 0)"""


def settled(tab: Tab) -> None:
    wait(tab, QUIET, 120)


def acts_of(tab: Tab, view: str, until: str = "") -> list[str]:
    """What can be done in the view, with all that it folds, once nothing more comes; or once this comes."""
    wait(tab, f"document.querySelector({READY[view]!r})")
    acts, same = list[str](), 0
    while same < 3 and (not until or until not in acts):
        settled(tab)
        tab.value(UNFOLD)
        tab.value("new Promise((done) => setTimeout(done, 120))")
        before, acts = acts, tab.value(ACTS)
        same = same + 1 if acts == before else 0
    return acts


def act(tab: Tab, name: str) -> None:
    tab.value(f"window.acts.has({name!r}) && ({ACT})(window.acts.get({name!r}))")


def leave_and_come(tab: Tab, view: str, file: str, first: str = "", then: str = "") -> list[str]:
    """Looks at a view of the first calibration, does this and then that, and looks at the other before an
    answer comes: what is wrong there once it has come."""
    if not first:
        tab.value("window.hold()")
    leads(tab, FIRST, view, file)
    for name in filter(None, (first, then)):
        acts_of(tab, view, name)
        if name == (then or first):
            tab.value("window.hold()")
        act(tab, name)
    tab.value("new Promise((done) => setTimeout(done, 30)).then(() => { window.held = null; })")
    leads(tab, OTHER, view)
    wait(tab, f"document.querySelector({READY[view]!r})")
    tab.value("new Promise((done) => setTimeout(done, 100))")
    tab.value("window.release()")
    settled(tab)
    found: list[str] = tab.value(READ)
    where = str(tab.value("location.hash"))
    return found if where.startswith(f"#/job/{OTHER}/{view}") else [*found, where]


def acts_in(tab: Tab, view: str, file: str) -> list[tuple[str, str]]:
    """Each act of a view, and those that another one opens."""
    leads(tab, FIRST, view, file)
    acts, more = acts_of(tab, view), list[tuple[str, str]]()
    for opener in (one for one in acts if one.startswith(OPENERS)):
        leads(tab, FIRST, view, file)
        acts_of(tab, view, opener)
        act(tab, opener)
        more += [(opener, one) for one in acts_of(tab, view) if one not in acts]
    # What is typed stays, and a form with half of a pair of numbers is not sent: buttons before fields.
    acts.sort(key=lambda one: not one.startswith(("button", "submit")))
    return [*((one, "") for one in acts), *more]


def late_in(tab: Tab, folder: Path, view: str, files: list[str]) -> list[tuple[str, ...]]:
    """What was wrong in the other calibration, by view and acts."""
    before, faults, done = content_of(folder / OTHER), list[tuple[str, ...]](), set[tuple[str, str]]()
    wait(tab, "document.querySelector('.calibrations li')")
    tab.value(LISTEN)
    for file in files:
        acts = [("", ""), *(one for one in acts_in(tab, view, file) if one not in done)]
        done |= {*acts}
        for first, then in acts:
            found = leave_and_come(tab, view, file, first, then)
            if content_of(folder / OTHER) != before:
                found.append("written")
                before = content_of(folder / OTHER)
            faults += [(view, first, then, each) for each in found]
    return faults


@pytest.mark.long
def test_what_comes_after_its_reader_has_left_is_of_its_own_calibration(
    tmp_path: Path, reported: Path
) -> None:
    """Every view, and each button and field of it. What the page's code asks for has been asked for here."""
    chromium()
    files = {
        "result": [f"{FIRST}/{FIRST}-report/result.json", f"{FIRST}/{FIRST}-bare.jsonl"],
        "measure": ["", f"{FIRST}/{FIRST}-run.jsonl"],
    }
    asked, faults = set[str](), list[tuple[str, ...]]()
    for view in sorted(code_of(_VIEW) - VIEWS_OF_NONE):
        folder = both_in(tmp_path / view, reported)
        with app(folder) as server, chromium().opened(f"{server.address}#/", LAPTOP) as tab:
            faults += late_in(tab, folder, view, files.get(view, [""]))
            asked |= {each.partition("?")[0].partition(" /api/")[2] for each in tab.value("window.asked")}
    assert faults == []
    assert {each.removeprefix("/api/") for each in code_of(_CALL)} - asked - OF_NONE - RESTING == set()
