"""The documentation names what there is: commands, options, keys, defaults, public names, links.

Its blocks are run and read in tests/system/test_docs_blocks.py.
"""

import importlib
import json
import re
import tomllib
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main
from command_line import zerobeam as command_line
from documents import (
    DOCS,
    FILE_PAGES,
    PAGES,
    ROOT,
    blocks,
    prepare,
    prose,
    read,
    sentences,
    told_commands,
    words,
)
from example_results import EXAMPLES
from measured_arms import cube_run
from scripts import load_script

import zerobeam
from zerobeam.commands.program import app
from zerobeam.experiments.schema import SCHEMA_NAMES, json_schema
from zerobeam.experiments.studies.sweeps.study_file import built_in_studies
from zerobeam.model.records import dumps
from zerobeam.words.sentences import to_json

COMMANDS: Any = typer.main.get_command(app)
TEXTS = {name: read(name) for name in PAGES} | {
    name: (ROOT / name).read_text(encoding="utf-8") for name in ("CONTRIBUTING.md", "CHANGELOG.md")
}
FILES = "\n".join(TEXTS[name] for name in FILE_PAGES)


def script(name: str) -> types.ModuleType:
    """One of the scripts in docs that make the site."""
    return load_script(DOCS, name)


# --- how the pages read -----------------------------------------------------------------------------

READ = [*PAGES, "CONTRIBUTING.md"]
MOST_WORDS, LONG = 3000, 40


def too_long(text: str) -> bool:
    """Whether a page is two: its prose, without blocks and tables, has more than 3,000 words."""
    return sum(map(words, sentences(text))) > MOST_WORDS


def long_sentences(text: str) -> list[str]:
    return [one for one in sentences(text) if words(one) > LONG]


@pytest.mark.parametrize("name", READ)
def test_a_page_has_at_most_3000_words(name: str) -> None:
    assert not too_long(TEXTS[name])


def test_the_pages_together_have_at_most_40000_words() -> None:
    """Of prose: tables, which are for looking up, and blocks do not count."""
    count = sum(words(one) for name in READ for one in sentences(TEXTS[name]))
    assert 20_000 < count <= 40_000


def test_at_most_one_sentence_of_a_hundred_has_more_than_40_words() -> None:
    long = {name: long_sentences(TEXTS[name]) for name in READ}
    count = sum(len(sentences(TEXTS[name])) for name in READ)
    assert count > 2000
    assert sum(map(len, long.values())) <= 0.01 * count, {name: all_ for name, all_ in long.items() if all_}


def test_words_and_sentences_are_counted_as_a_reader_reads_them() -> None:
    sentence = "One two, `code of many words` and [a link](https://example.org/a_b)."
    assert sentences(sentence) == ["One two, `code` and [a link]."]
    page = f"# A heading\n\n{sentence} Two\nlines.\n\n- An item\n- An\n  item: More.\n\n| a | table |\n"
    page += "|---|---|\n\n```sh\nzerobeam demo\n```\n\n    zerobeam demo\n\n$$x = 1$$\n"
    assert [words(one) for one in sentences(page)] == [6, 2, 2, 3]
    assert long_sentences("Word " * 40 + ".") == []
    assert len(long_sentences("Word " * 41 + "." + " Short.")) == 1
    assert len(long_sentences("- " + "word\n  " * 41)) == 1
    assert not too_long("Word word.\n\n" * 1500)
    assert too_long("Word word.\n\n" * 1500 + "Word.")
    assert not too_long("| word |\n" * 3001)


# --- what the pages name ----------------------------------------------------------------------------


def commands_of(group: Any) -> Iterator[str]:
    for name, command in group.commands.items():
        yield name
        for below in commands_of(command) if hasattr(command, "commands") else ():
            yield f"{name} {below}"


def test_every_command_that_a_page_names_exists() -> None:
    known = set(commands_of(COMMANDS))
    named: set[str] = set()
    for text in TEXTS.values():
        shown = [block.text for block in blocks(text) if block.language != "python"]
        code = "\n".join([*shown, *re.findall(r"`([^`\n]+)`", text)])
        command = r"\bzerobeam ((?:(?:import|study|export|history|positions) )?[a-z][a-z0-9-]*)\b"
        named |= set(re.findall(command, code))
    named -= {"posture"}  # a line of the log of a plan's program begins like a command
    assert named <= known, named - known
    # Five alone are groups of commands; every command that does something is documented.
    assert known - named <= {"import", "study", "export", "history", "positions"}


def unknown_to_the_command_line(words: list[str]) -> str | None:
    """What of a call (behind `zerobeam`) is no command, option or value of one; None if all is."""
    command, rest = COMMANDS, list(words)
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        if rest[0] not in command.commands:
            return rest[0]
        command = command.commands[rest.pop(0)]
    options = {name: one for one in command.params for name in (*one.opts, *one.secondary_opts)}
    asked = [one for one in command.params if one.param_type_name == "argument"]
    given = 0
    while rest:
        word = rest.pop(0)
        if not word.startswith("-"):
            if given < len(asked) and not allows(asked[given], word):
                return word
            given += 1
        elif word != "--help" and word not in options:
            return word
        elif word == "--help" or options[word].is_flag:
            continue
        elif not rest or not allows(options[word], rest.pop(0)):
            return word
    many = any(one.nargs == -1 for one in asked)
    return None if many or given <= len(asked) else words[-1]


def allows(parameter: Any, value: str) -> bool:
    """Whether a choice has the value; `a|b` names several, capitals stand for any."""
    choices = script("command_reference").choices(parameter.type_descriptor.annotation)
    return not choices or value.isupper() or set(value.split("|")) <= set(choices)


@pytest.mark.parametrize("name", PAGES)
def test_every_command_of_a_block_is_one_of_the_command_line(name: str) -> None:
    for call in told_commands(read(name)):
        assert unknown_to_the_command_line(call) is None, call


@pytest.mark.parametrize("name", PAGES)
def test_every_option_in_the_text_exists(name: str) -> None:
    known = {
        option
        for command in every_command(COMMANDS)
        for one in command.params
        for option in (*one.opts, *one.secondary_opts)
    } | {"--help", "--version"}
    code = re.findall(r"`(?:zerobeam )?[^`\n]*`", prose(read(name)))
    named = {option for text in code for option in re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text)}
    assert named <= known, named - known


def every_command(group: Any) -> Iterator[Any]:
    for command in group.commands.values():
        yield command
        yield from every_command(command) if hasattr(command, "commands") else ()


@pytest.mark.parametrize(
    ("call", "wrong"),
    [
        ("analyse run.jsonl --robust huber --hold-out left_*", None),
        ("import csv a.csv b.csv --units rad", None),
        ("plan x|y|optimal --shots 7", None),
        ("plan KIND", None),
        ("plan z", "z"),
        ("analyse run.jsonl --robust tukey", "--robust"),
        ("analyse run.jsonl --robusts huber", "--robusts"),
        ("import cvs a.csv", "cvs"),
        ("import csv a.csv --units grad", "--units"),
        ("check a.yaml b.yaml", "b.yaml"),
        ("check a.yaml --picture", "--picture"),
    ],
)
def test_a_call_is_held_against_the_command_line(call: str, wrong: str | None) -> None:
    assert unknown_to_the_command_line(call.split()) == wrong


def test_every_make_target_that_a_page_names_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, flags=re.MULTILINE))
    for name, text in TEXTS.items():
        named = set(re.findall(r"(?:^ *|`)make ([a-z-]+)", text, flags=re.MULTILINE))
        assert named <= targets, (name, named - targets)


def words_in_code(text: str) -> set[str]:
    """The words of a page that stand in `code`."""
    return {word for code in re.findall(r"`([^`\n]+)`", prose(text)) for word in re.findall(r"\w+", code)}


def properties(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for value in schema.values():
            yield from properties(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from properties(value)


# Objects whose keys are names: of parameters, packages, indices, or the user's own.
OPEN = {
    "U",
    "at_half",
    "at_twice",
    "combination",
    "consider",
    "enough",
    "header",
    "jackknife",
    "observability",
    "state",
    "status",
    "u",
    "stated",
    "values",
    "versions",
    "worst_std",
}


def keys(answer: Any) -> Iterator[str]:
    """The keys of an answer, at every depth."""
    if isinstance(answer, dict):
        for key, value in answer.items():
            yield key
            yield from () if key in OPEN else keys(value)
    elif isinstance(answer, list):
        for value in answer:
            yield from keys(value)


def answers_of(kind: str, folder: Path) -> list[dict[str, Any]]:
    """Real answers which together leave no key without content."""
    if kind == "check":
        prepare(TEXTS["docs/files.md"], folder)
        return [command_line("check", folder / "x-pattern.yaml", "--json").json]
    cube, good = cube_run(folder / "cube.jsonl"), folder / "good.jsonl"
    header, *shots = (ROOT / "experiments/demos/good.jsonl").read_text(encoding="utf-8").splitlines()
    required = json.dumps({**json.loads(header), "required": {"tcp_mm": 1.0}})
    good.write_text("\n".join([required, *shots]), encoding="utf-8")
    runs = [command_line("analyse", run, "--ess", 100, "--json").json for run in (cube, good)]
    return [*runs, *(json.loads(dumps(to_json(result))) for result in EXAMPLES.values())]


@pytest.mark.parametrize("name", SCHEMA_NAMES)
def test_every_key_of_a_file_is_documented(name: str) -> None:
    plant = ("history", "history-arm", "history-fleet", "drift")
    page = {
        "compare": "docs/compare.md",
        "offsets": "docs/export.md",
        "positions": "docs/how-to/after-mastering.md",
        **dict.fromkeys(plant, "docs/how-to/plant.md"),
    }.get(name, "docs/files.md")
    missing = set(properties(json_schema(name))) - words_in_code(TEXTS[page] + FILES)
    assert not missing


@pytest.mark.parametrize("kind", ["check", "result"])
def test_every_key_of_an_answer_is_documented(kind: str, tmp_path: Path) -> None:
    found = answers_of(kind, tmp_path)
    for key in found[0].keys() - {"notes", "advice"}:  # `advice` is null in every answer
        assert any(answer[key] for answer in found), f"{key} has no content to look into"
    missing = set(keys(found)) - words_in_code(FILES)
    assert not missing


# --- the site --------------------------------------------------------------------------------------


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    site = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))
    listed = list(leaves(site["project"]["nav"]))
    assert len(listed) == len(set(listed))
    pages = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    made = {f"notebooks/{path.stem}.md" for path in (DOCS / "notebooks").glob("*.py")}
    assert set(listed) == pages | made | {"reference/commands.md"}


def leaves(entry: Any) -> Iterator[str]:
    if isinstance(entry, str):
        yield entry
    else:
        for below in entry.values() if isinstance(entry, dict) else entry:
            yield from leaves(below)


def test_the_page_of_commands_has_every_command_and_option() -> None:
    made = script("command_reference")
    _, *parts = made.page().split("\n## ")
    commands = dict(made.commands(COMMANDS))
    assert [part.splitlines()[0] for part in parts] == list(commands)
    for part, command in zip(parts, commands.values(), strict=True):
        options = {one.opts[0] for one in command.params if one.param_type_name == "option"}
        listed = set(re.findall(r"^\| `(-[\w-]+)", part, flags=re.MULTILINE))
        assert listed == options - {"--help"}


def test_the_reference_has_every_public_name_at_its_home() -> None:
    listed = re.findall(r"^::: ([\w.]+)$", read("docs/reference/python.md"), flags=re.MULTILINE)
    assert len(listed) == len(set(listed))
    found = {}
    for path in listed:
        module, _, name = path.rpartition(".")
        found[name] = getattr(importlib.import_module(module), name)
        assert found[name].__doc__, path
    for name in set(zerobeam.__all__) - {"__version__"}:
        assert found[name] is getattr(zerobeam, name), name


def test_every_built_in_study_is_listed() -> None:
    listed = re.findall(r"^\| `([\w-]+)` \|", read("docs/studies.md"), flags=re.MULTILINE)
    assert {
        *built_in_studies(),
        "coverage",
        "cell",
        "geometry",
        "table2",
        "wrong-models",
        "instruments",
    } == set(listed)


@pytest.fixture
def build(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """The script that makes the site."""
    monkeypatch.syspath_prepend(str(DOCS))
    return script("build")


def test_what_is_for_the_tests_alone_is_not_on_the_site(build: types.ModuleType) -> None:
    page = '```sh status=1\na\n```\n```text output\nb\n```\n```yaml title="c.yaml"\nd\n```\n'
    assert build.site_page(page) == '```sh\na\n```\n```text\nb\n```\n```yaml title="c.yaml"\nd\n```\n'


@pytest.mark.parametrize(
    "fetched",
    [
        '<script src="https://example.org/a.js"></script>',
        "<img alt=x src=//example.org/a.png>",
        '<link rel="stylesheet" href="https://example.org/a.css">',
        '<link href="https://example.org" crossorigin rel="preconnect">',
    ],
)
def test_a_page_that_needs_the_network_is_noticed(build: types.ModuleType, fetched: str) -> None:
    build.require_no_network('<a href="https://example.org">x</a><script src="a.js"></script>')
    with pytest.raises(RuntimeError, match="needs the network"):
        build.require_no_network(fetched)


def test_equations_are_drawn_when_the_site_is_made(build: types.ModuleType) -> None:
    pytest.importorskip("latex2mathml", reason="an extra: docs")
    drawn = build.with_equations(r'<p>a <span class="arithmatex">\(\log x_1 &lt; 2\)</span></p>')
    assert drawn.startswith("<p>a <math")
    assert "arithmatex" not in drawn
    with pytest.raises(RuntimeError, match="cannot be drawn"):
        build.with_equations(r'<div class="arithmatex">\[\nosuch x\]</div>')
    for text in TEXTS.values():
        for tex in re.findall(r"\$\$(.+?)\$\$", prose(text), flags=re.DOTALL):
            assert "<math" in build.with_equations(rf'<div class="arithmatex">\[{tex}\]</div>')


# --- links ------------------------------------------------------------------------------------------


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub, and the site, give to the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", prose(page.read_text(encoding="utf-8")), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def leads_nowhere(page: Path, link: str, made: set[Path]) -> bool:
    """Whether a link of a page leads to nothing: neither a file with that heading nor one that is made."""
    if link.startswith("https://"):
        return False
    path, _, anchor = link.partition("#")
    there = (page.parent / path).resolve() if path else page
    if there in made:
        return bool(anchor)
    return not there.is_file() or (bool(anchor) and anchor not in anchors(there))


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_somewhere(name: str) -> None:
    made = {DOCS / "gallery" / page for page in script("gallery").PAGES}
    made.add(DOCS / "reference" / "commands.md")
    made |= {path.with_suffix(".md") for path in (DOCS / "notebooks").glob("*.py")}
    for link in re.findall(r"\]\(([^)\s]+)\)", read(name)):
        assert not leads_nowhere(PAGES[name], link, made), link
        if name.startswith("docs/") and not link.startswith(("https://", "#")):
            assert (PAGES[name].parent / link).resolve().is_relative_to(DOCS), "not on the site"


def test_a_link_that_leads_nowhere_is_noticed() -> None:
    page, made = PAGES["docs/index.md"], {DOCS / "gallery" / "plan.html"}
    for link in ("files.md", "files.md#plan", "gallery/plan.html", "https://example.org", "how-to/my-rig.md"):
        assert not leads_nowhere(page, link, made), link
    for link in ("file.md", "files.md#plane", "#plan", "gallery/plans.html", "my-rig.md"):
        assert leads_nowhere(page, link, made), link


def test_every_page_of_the_gallery_is_linked() -> None:
    linked = set(re.findall(r"\]\(gallery/([^)\s]+)\)", read("docs/gallery.md")))
    assert linked == set(script("gallery").PAGES)
