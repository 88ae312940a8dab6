"""What the page decides without a browser: numbers as typed, plans as edited, time left; run by Node."""

from pathlib import Path
from typing import Any

import pytest
from node import paged

JOINTS = [[float(k + 10 * i) for k in range(6)] for i in range(7)]
EDITED = """(() => {
  m.plan.value = { robot: "irb1600", postures_deg: input };
  const seen = [], now = () => structuredClone(m.plan.value.postures_deg);
  const edit = (how) => { m.change(null, how); seen.push(now()); };
  %s
  return seen;
})()"""


def edited(folder: Path, *edits: str) -> list[Any]:
    """The postures after each of some edits of a plan."""
    rows: list[Any] = paged(folder, "core/editing.js", EDITED % "\n  ".join(edits), JOINTS)
    return rows


def test_numbers_are_read_as_meant_or_refused(tmp_path: Path) -> None:
    texts = {
        "0,5": 0.5, "0.5": 0.5, "-1,25": -1.25, "−3": -3, "1e-3": 0.001, " 12 ": 12, ",5": 0.5,
        "0,123": 0.123, "1,234": None, "1.234,5": None, "1,234.5": None, "1 000": None, "": None,
        "5°": None, "1,2,3": None,
    }  # fmt: skip
    lists = {"0, 0, 1": [0, 0, 1], "0,0,1": [0, 0, 1], "0,5; 1,5": [0.5, 1.5], "0.5 1": [0.5, 1], "1,x": None}
    told = paged(
        tmp_path,
        "core/decimal.js",
        "[input[0].map((one) => m.parsed(one)), input[1].map((one) => m.numbersOf(one))]",
        [list(texts), list(lists)],
    )
    assert dict(zip(texts, told[0], strict=True)) == texts
    assert dict(zip(lists, told[1], strict=True)) == lists


def test_readings_that_could_be_misread_are_not_sent(tmp_path: Path) -> None:
    texts = {
        "1234,5 20 300": [1234.5, 20, 300], "1.5; 2; 3": [1.5, 2, 3], "1.234,5 20 300": None,
        "1,234 20 300": None, "12 20": None, "": None,
    }  # fmt: skip
    read = "input.map((one) => m.readingOf({ numbers: 3 }, one))"
    told = paged(tmp_path, "measure/Hand.js", read, list(texts))
    assert dict(zip(texts, told, strict=True)) == texts


def test_an_expanded_uncertainty_states_its_factor(tmp_path: Path) -> None:
    told = paged(tmp_path, "core/words.js", "input.map(m.expandedWord)", [2, 2.0000001, 2.7764])
    assert told == ["U (k = 2)", "U (k = 2)", "U (k = 2.78)"]


@pytest.mark.parametrize(
    ("stalled", "tolerance", "words"),
    [
        (False, None, "about 12 s left."),
        (True, None, "at least 12 s left."),
        (False, 0.1, "at most 12 s left."),
        (True, 0.1, "about 12 s left."),
    ],
)
def test_time_left_is_a_bound_where_it_is_one(
    tmp_path: Path, stalled: bool, tolerance: float | None, words: str
) -> None:
    job = {"state": "running", "left_s": 12, "left_at_least": stalled}
    run = {"recorded": [1], "refused": [], "postures": 7, "rig": "simulated", "tolerance": tolerance}
    script = "[0, 5].map((since) => m.progress(...input, since))"
    told, later = paged(tmp_path, "measure/running.js", script, [job, run])
    assert told == f"1 measurement recorded, of 7 planned; {words}"
    assert later == told.replace("12 s", "7 s"), "it runs down by the clock"


def test_the_file_that_a_command_writes_is_that_of_its_words(tmp_path: Path) -> None:
    commands = [["plan", "x", "--out=a/b.yaml"], ["plan", "x", "-o", "a/b.yaml"], ["analyse", "run.jsonl"]]
    assert paged(tmp_path, "core/jobs.js", "input.map(m.outOf)", commands) == ["a/b.yaml", "a/b.yaml", ""]


def test_suggested_postures_keep_their_targets(tmp_path: Path) -> None:
    deed = {"kind": "postures", "postures_deg": JOINTS[:2], "targets": ["a", "b"]}
    after = paged(
        tmp_path,
        "core/actions.js",
        """(async () => {
          const editing = await import("./page/core/editing.js");
          editing.plan.value = { robot: "irb1600", postures_deg: [[0, 0, 0, 0, 0, 0]] };
          await m.doAction(input, () => {}, () => {});
          return editing.plan.value.postures_deg;
        })()""",
        deed,
    )
    assert after == [{"joints_deg": JOINTS[0], "target": "a"}, {"joints_deg": JOINTS[1], "target": "b"}]


def test_what_is_measured_again_follows_its_posture(tmp_path: Path) -> None:
    """Through edits of joints, of the order, and where a posture is removed."""
    repeated, turned, moved, own, removed = edited(
        tmp_path,
        "const row = (of, again) => ({ joints_deg: [...of], target: 'psd', again });",
        "edit((plan) => { plan.postures_deg.push(row(input[0], 0), row(input[1], 1)); });",
        "edit((plan) => { plan.postures_deg[0].splice(0, 6, 10, 20, 30, 40, 50, 60); });",
        "edit((plan) => { plan.postures_deg.unshift(plan.postures_deg.splice(6, 1)[0]); });",
        "edit((plan) => { plan.postures_deg[7].joints_deg[0] += 5; });",
        "edit((plan) => { plan.postures_deg.splice(2, 1); });",
    )
    assert [row["again"] for row in repeated[7:]] == [0, 1]
    assert turned[7]["joints_deg"] == turned[0] == [10, 20, 30, 40, 50, 60]
    # Another is put before it, and it follows; turned itself it is its own, as one whose other is gone.
    assert [row["again"] for row in moved[7:]] == [1, 2]
    assert ["again" in row for row in own[7:]] == [False, True]
    assert all("again" not in row for row in removed[6:])


# A browser that keeps drafts, and a server whose answers come when they are called.
SERVED = """(async () => {
  const kept = new Map(), waiting = [], names = { a: "cell/a.yaml", b: "cell/b.yaml" };
  globalThis.localStorage = { getItem: (key) => kept.get(key) ?? null,
    setItem: (key, text) => kept.set(key, text), removeItem: (key) => kept.delete(key) };
  globalThis.requestAnimationFrame = (then) => setTimeout(then);
  globalThis.fetch = (path, { method, body }) => new Promise((done) => {
    const answer = (content) => done({ ok: true, status: 200, json: async () => content });
    if (/files|home/.test(path)) answer(path.includes("home") ? { calibrations: [] } : []);
    else waiting.push({ what: `${method} ${decodeURIComponent(path)}`, body, answer });
  });
  const tick = () => new Promise((done) => setTimeout(done, 5));
  const comes = async (what, content) => {
    await tick();
    const at = waiting.findIndex((one) => one.what.includes(what));
    const [one] = waiting.splice(at, at < 0 ? 0 : 1);
    one?.answer(content);
    await tick();
    return one?.body && JSON.parse(one.body);
  };
  const read = (name) => comes(`file=${names[name]}`, { plan: input[name], version: `${name}1`, robot: {} });
  const turned = (joint) => m.change(null, (plan) => { plan.postures_deg[0][0] = joint; });
  const now = () => ({ file: m.file.value, joint: m.plan.value?.postures_deg[0][0], unsaved: m.unsaved.value,
    drafts: [...kept].map(([key, text]) => [key.at(-6), JSON.parse(text).content.postures_deg[0][0]]) });
  m.open(names.a);
  await read("a");
  %s
  return now();
})()"""
PLANS = {name: {"robot": "irb1600", "postures_deg": [[k] * 6]} for k, name in enumerate("ab")}


def opened(folder: Path, steps: str) -> Any:
    """What is open at the end of some steps, with plan a open at first."""
    return paged(folder, "core/editing.js", SERVED % steps, PLANS)


def test_an_edit_outlives_what_was_asked_for_before_it(tmp_path: Path) -> None:
    """Of a plan that a view opens twice the first answer is edited before the second comes."""
    steps = 'm.close(); m.open(names.b); m.open(names.b); await read("b"); turned(9); await read("b");'
    now = opened(tmp_path, steps)
    assert now == {"file": "cell/b.yaml", "joint": 9, "unsaved": True, "drafts": [["b", 9]]}


def test_the_plan_that_is_open_is_that_of_the_address(tmp_path: Path) -> None:
    back = opened(tmp_path, 'm.open(names.b); m.open(names.a); turned(9); await read("b");')
    assert back == {"file": "cell/a.yaml", "joint": 9, "unsaved": True, "drafts": [["a", 9]]}


def test_an_edit_before_another_plan_is_there_is_kept_as_a_draft(tmp_path: Path) -> None:
    away = 'm.open(names.b); turned(9); await read("b");'
    assert opened(tmp_path, away) == {
        "file": "cell/b.yaml", "joint": 1, "unsaved": False, "drafts": [["a", 9]],
    }  # fmt: skip


def test_a_plan_that_was_left_while_it_was_written_is_not_mixed_with_the_next(tmp_path: Path) -> None:
    written = '{ file: names.a, version: "a2", notes: [] }'
    now = opened(
        tmp_path,
        f'turned(9); m.save(); await tick(); m.open(names.b); await read("b"); turned(8);'
        f' const sent = await comes("PUT", {written}); if (sent.file !== names.a) throw sent;',
    )
    assert now == {"file": "cell/b.yaml", "joint": 8, "unsaved": True, "drafts": [["b", 8]]}


def test_a_plan_that_is_saved_twice_is_no_conflict_with_itself(tmp_path: Path) -> None:
    written = '{ file: names.a, version: "a2", notes: [] }'
    steps = f'turned(9); m.save(); const again = m.save(); await comes("PUT", {written}); await again;'
    refused = 'if (waiting.some((one) => one.what.includes("PUT")) || m.conflict.value) throw waiting;'
    now = opened(tmp_path, steps + refused)
    assert now == {"file": "cell/a.yaml", "joint": 9, "unsaved": False, "drafts": []}
