"""Options stated once: what follows of their fields."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import typer
from typer.testing import CliRunner

from zerobeam.commands.shared_options import with_options
from zerobeam.model.errors import BadInput
from zerobeam.model.options import (
    REQUIRED,
    Option,
    argument,
    arguments,
    checked_options,
    names_typed,
    numbers_typed,
    options_of,
)


@dataclass(frozen=True)
class Reading:
    units: Annotated[Literal["deg", "rad"], Option("Unit of the angles.")]
    still_s: Annotated[float | None, Option("Dwell: for so many seconds.", least=0, most=60)] = None
    shots: Annotated[int, Option("How many.", "--shots -n", least=2)] = 7
    columns: Annotated[Sequence[str] | None, Option("Columns: a,b,c.", text=names_typed)] = None
    facing: Annotated[tuple[float, ...], Option("X,Y,Z.", text=numbers_typed(3, "--facing"))] = (0, 0, 1)
    names: Annotated[Sequence[str], Option("Repeatable.", "--name")] = ()
    camera: Annotated[bool, Option("With it or not.", "--camera/--no-camera")] = True
    changes_only: bool = False


def read(
    job: str,
    file: Annotated[Path, argument("A file.")],
    *,
    reading: Reading,
    force: Annotated[bool, Option("Over it.")] = False,
) -> dict[str, Any]:
    """Read a file."""
    return {"job": job, "file": file, "reading": reading, "force": force}


def test_what_follows_of_a_field() -> None:
    by_name = {one.name: one for one in options_of(Reading)}
    assert "changes_only" not in by_name
    assert by_name["still_s"].flags == ("--still-s",)
    assert by_name["shots"].flags == ("--shots", "-n")
    assert by_name["camera"].long_flags == ["--camera", "--no-camera"]
    assert (by_name["units"].default, by_name["units"].words) == (REQUIRED, ["deg", "rad"])
    assert (by_name["columns"].typed, by_name["facing"].typed_default) == (str | None, "0,0,1")
    assert [name for name, one in by_name.items() if one.several] == ["names"]
    assert [name for name, one in by_name.items() if one.box] == ["camera"]
    assert [one.name for one in options_of(read)] == ["file", *by_name, "force"]


def test_a_function_gets_the_record_of_what_was_typed() -> None:
    typed = {one.name: one.typed_default for one in options_of(read)} | {
        "file": Path("a.csv"), "units": "deg", "columns": "a, b", "facing": "1,0,0", "job": "j"
    }  # fmt: skip
    made = read(**arguments(read, typed))
    assert (made["job"], made["file"], made["force"]) == ("j", Path("a.csv"), False)
    assert made["reading"] == Reading("deg", columns=["a", "b"], facing=(1.0, 0.0, 0.0))
    with pytest.raises(BadInput, match="--facing is not understood"):
        arguments(read, typed | {"facing": "1,0,nan"})


@pytest.mark.parametrize(
    ("values", "allowed"),
    [
        ({"units": "grad"}, "'deg', 'rad'"),
        ({"still_s": "one"}, "a finite number, 0 to 60"),
        ({"still_s": float("nan")}, "a finite number, 0 to 60"),
        ({"shots": 7.0}, "a whole number, 2 or more"),
        ({"shots": True}, "a whole number, 2 or more"),
        ({"shots": 1}, "a whole number, 2 or more"),
    ],
)
def test_an_argument_that_cannot_be_used_is_named(values: dict[str, Any], allowed: str) -> None:
    with pytest.raises(BadInput) as refused:
        checked_options(Reading, **{"units": "deg", **values})
    (name,) = values
    assert (refused.value.argument, refused.value.allowed) == (name, allowed)
    assert checked_options(Reading, units="deg", still_s=None, shots=2).shots == 2


def test_the_command_line_of_a_record() -> None:
    made: list[dict[str, Any]] = []
    app = typer.Typer()
    app.command()(with_options(lambda **typed: made.append(typed), read))
    run = CliRunner().invoke
    wanted = run(app, ["a.csv", "--units=rad", "-n", "3", "--name", "p", "--name", "q", "--no-camera"])
    assert wanted.exit_code == 0, wanted.output
    assert (made[0]["units"], made[0]["shots"], made[0]["camera"]) == ("rad", 3, False)
    assert list(made[0]["names"]) == ["p", "q"]
    assert run(app, ["a.csv"]).exit_code == 2
    assert run(app, ["a.csv", "--units=deg", "--shots=1"]).exit_code == 2
    described = " ".join(re.sub("[│╭╰─╮╯]", " ", run(app, ["--help"]).output).split())
    for part in ("[default: 7]", "[default: 0,0,1]", "--still-s", "[required]"):
        assert part in described
