"""Options: what is stated to a command, said once as the fields of a record or the parameters of a function;
and how a run is analysed.

    @dataclass(frozen=True)
    class Reading:
        units: Annotated[Literal["deg", "rad"], Option("Unit of the angles.")]
        still_s: Annotated[float | None, Option("Dwell: for so many seconds.", least=0)] = None

The flags and the help of the command line, the fields of a form, what the app may state and the checks of the
Python functions follow. Nothing is loaded for them.
"""

import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache, cached_property
from numbers import Integral, Real
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from .errors import BadInput

REQUIRED = inspect.Parameter.empty
FARTHEST = 1e6  # mm, as in files
Record = TypeVar("Record")
# What its value names: a file that is read or written, or a run file where it is not a name.
Names = Literal["read", "write", "run or name"]


@dataclass(frozen=True)
class Option:
    """What help says of an option, and what neither its type nor its name nor its default says.

    `case` is what it is for, and `more` what else is to be known: help of the command line begins and ends
    with them, and a form says both by its place.

    `flag` is all flags in a row, where they are not `--name`, and an `argument` has none; `least` and `most`
    bound a number. `text` makes the value of what is typed, of the type `typed`. `names` says what a value
    names that is no path that is read. `app` False: only a person at a terminal may state it. `variable`: of
    the environment, which is read where it is not stated.

    For forms: `label`, where the flag does not say enough, and `unit`; `parts` are the names of several
    numbers; `among` is what its value is one of (a kind of file of the folder, the columns of a table);
    `needs` are words of other options, without all of which it says nothing; `rare`: it is folded at first.
    """

    help: str
    flag: str | None = None
    case: str = ""
    more: str = ""
    least: float | None = None
    most: float | None = None
    metavar: str | None = None
    argument: bool = False
    text: Callable[[Any], Any] | None = None
    typed: Any = str
    names: Names | None = None
    app: bool = True
    variable: str | None = None
    label: str | None = None
    unit: str | None = None
    parts: tuple[str, ...] = ()
    among: str | None = None
    needs: tuple[str, ...] = ()
    rare: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Callable[[Any], Any]) -> Any:
        """Where the record is read from a document: the number within its bounds."""
        schema = handler(source)
        number = schema.get("schema", schema)
        bounds = {"ge": self.least, "le": self.most}
        number.update({name: bound for name, bound in bounds.items() if bound is not None})
        return schema

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], Any]) -> Any:
        """The help says what the key is."""
        help = f"{self.case}: {self.help}" if self.case else self.help
        return {**handler(schema), "description": f"{help[0].lower()}{help[1:]}".removesuffix(".")}


def argument(help: str, **others: Any) -> Option:
    """What is stated without a flag."""
    return Option(help, argument=True, **others)


@dataclass(frozen=True, eq=False)
class OptionField:
    """An option with its name, its type and its usual value (REQUIRED: none)."""

    name: str
    type: Any
    default: Any
    option: Option

    @property
    def typed(self) -> Any:
        """The type of what is typed."""
        kind = self.type if self.option.text is None else self.option.typed
        if get_origin(kind) is Sequence:
            kind = list[get_args(kind)]  # type: ignore[misc]
        return kind if self.option.text is None or self.default is REQUIRED else kind | None

    @property
    def typed_default(self) -> Any:
        """The usual value as it would be typed."""
        if self.option.typed is not str and self.option.text is not None and self.default is not REQUIRED:
            return None
        if not isinstance(self.default, tuple | dict):
            return self.default
        return ",".join(f"{value:g}" for value in self.default) or None

    @cached_property
    def flags(self) -> tuple[str, ...]:
        """As it is stated; of an argument none."""
        if self.option.argument:
            return ()
        return tuple((self.option.flag or f"--{self.name.replace('_', '-')}").split())

    @property
    def long_flags(self) -> list[str]:
        """Those of a word; of a box that can be emptied both."""
        return [flag for flags in self.flags for flag in flags.split("/") if flag.startswith("--")]

    @property
    def flag(self) -> str:
        """The long flag, as messages call the option."""
        return self.long_flags[0]

    @property
    def typed_help(self) -> str:
        """What help says to who types it."""
        case = f"{self.option.case}: " if self.option.case else ""
        again = "Repeatable." if self.several and not self.option.argument else ""
        return case + " ".join(filter(None, (self.option.help, again, self.option.more)))

    @cached_property
    def kinds(self) -> tuple[Any, ...]:
        """The types that what is typed may be of."""
        return (self.typed, *get_args(self.typed))

    @property
    def several(self) -> bool:
        """Whether it may be stated several times."""
        return any(get_origin(kind) is list for kind in self.kinds)

    @property
    def box(self) -> bool:
        """Whether it takes no value."""
        return bool in self.kinds

    def words_for(self, value: Any) -> list[str]:
        """What states a value of what is typed as it is; nothing of the usual one."""
        if value == self.default:
            return []
        if not self.box:
            return [self.flag, str(value)]
        true, *false = self.long_flags
        return [true] if value else false

    def value(self, typed: Any) -> Any:
        """What was typed as the record has it."""
        if typed == self.typed_default:
            return self.default
        return typed if self.option.text is None else self.option.text(typed)

    @property
    def words(self) -> list[Any]:
        """The words that it may be; none where it may be anything."""
        return [word for kind in self.kinds if get_origin(kind) is Literal for word in get_args(kind)]

    @property
    def whole(self) -> bool:
        """Whether it is a whole number."""
        return int in self.kinds

    @property
    def number(self) -> bool:
        """Whether it is a number."""
        return self.whole or float in self.kinds

    def require_typed(self, text: str) -> None:
        """BadInput where a text states no value of it."""
        if self.words and text not in map(str, self.words):
            allowed = ", ".join(map(str, self.words))
            raise BadInput(f"{self.flag} is none of these words", found=text, allowed=allowed)
        if self.number:
            try:
                self.require(int(text) if self.whole else float(text), self.flag)
            except (ValueError, BadInput) as error:
                allowed = getattr(error, "allowed", f"a {'whole ' if self.whole else ''}number")
                raise BadInput(f"{self.flag} cannot be used", found=text, allowed=allowed) from None
        elif self.option.text is not None and not self.box:
            self.value([text] if self.several else text)

    def require(self, value: object, name: str) -> None:
        """BadInput where an argument of a Python function of this `name` has not the type or the range."""
        if value is None and type(None) in get_args(self.type):
            return
        if self.words and value not in self.words:
            optional = (None,) if type(None) in get_args(self.type) else ()
            listed = ", ".join(map(repr, (*optional, *self.words)))
            raise BadInput("there is no such choice", found=repr(value), allowed=listed, argument=name)
        if self.number:
            least, most = self.option.least, self.option.most
            require_number(
                value,
                -math.inf if least is None else least,
                name,
                most=math.inf if most is None else most,
                whole=self.whole,
            )


def require_number(
    value: object, least: float, name: str, *, most: float = math.inf, whole: bool = False
) -> None:
    """BadInput where the argument `name` is no number from `least` to `most`."""
    right = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
    if not right or not math.isfinite(float(value)) or not least <= float(value) <= most:  # type: ignore[arg-type]
        allowed = f"a {'whole' if whole else 'finite'} number"
        if math.isfinite(least):
            allowed += f", {least:g} or more" if math.isinf(most) else f", {least:g} to {most:.9g}"
        raise BadInput("this cannot be used", found=repr(value), allowed=allowed, argument=name)


def options_of(source: Callable[..., Any]) -> Sequence[OptionField]:
    """The options of a record, or of a function, in their order; those of a record that a function takes are
    among its own."""
    if is_dataclass(source):
        return _of_record(source)
    return list(_options((one.name, hint, one.default) for one, hint in parameters_of(source)))


@cache
def _of_record(record: Any) -> tuple[OptionField, ...]:
    hints = get_type_hints(record, include_extras=True)
    return tuple(_options((one.name, hints[one.name], _usual(one)) for one in fields(record)))


def _options(rows: Iterable[tuple[str, Any, Any]]) -> Iterator[OptionField]:
    for name, hint, default in rows:
        if isinstance(hint, type) and is_dataclass(hint):
            yield from _of_record(hint)
        for mark in getattr(hint, "__metadata__", ()):
            if isinstance(mark, Option):
                yield OptionField(name, hint.__origin__, default, mark)


def _usual(one: Field[Any]) -> Any:
    if one.default_factory is not MISSING:
        return one.default_factory()
    return REQUIRED if one.default is MISSING else one.default


def parameters_of(function: Callable[..., Any]) -> list[tuple[inspect.Parameter, Any]]:
    """The parameters of a function with their types, as far as these are there at run time."""
    names = getattr(inspect.unwrap(function), "__globals__", {})
    rows = []
    for one in inspect.signature(function).parameters.values():
        hint = one.annotation
        if isinstance(hint, str):
            try:
                hint = eval(hint, names)  # as typing.get_type_hints does
            except NameError:  # of what only type checkers load
                hint = None
        rows.append((one, hint))
    return rows


def arguments(function: Callable[..., Any], typed: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of a function from what was typed of its options, by name: its records are made of them.
    What is no option stays as it is."""
    made, left = {}, dict(typed)
    for one, hint in parameters_of(function):
        if isinstance(hint, type) and is_dataclass(hint):
            made[one.name] = record_of(hint, {each.name: left.pop(each.name) for each in options_of(hint)})
    for each in options_of(function):
        if each.name in left:
            left[each.name] = each.value(left[each.name])
    return made | left


def record_of(record: type[Record], typed: Mapping[str, Any]) -> Record:
    """A record of what was typed of its options."""
    return record(**{each.name: each.value(typed[each.name]) for each in options_of(record)})


def checked_options(record: type[Record], **values: Any) -> Record:
    """A record of the arguments of a Python function; BadInput names the first that cannot be used."""
    by_name = {each.name: each for each in options_of(record)}
    for name, value in values.items():
        by_name[name].require(value, name)
    return record(**values)


def numbers_typed(count: int, flag: str) -> Callable[[str], tuple[float, ...]]:
    """What makes `count` finite numbers of text in which commas separate them."""

    def numbers(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(-FARTHEST <= value <= FARTHEST for value in values):
            allowed = f"{count} numbers up to {FARTHEST:g} separated by commas"
            raise BadInput(f"{flag} is not understood", found=text, allowed=allowed)
        return values

    return numbers


def names_typed(text: str) -> list[str]:
    """Names that commas separate."""
    return [name.strip() for name in text.split(",")]


USUAL_REPEATS = 2  # measurements that a plan, or an adaptive run, makes again at its end
Seed = Annotated[
    int, Option("Random seed: the same seed gives the same answer.", least=0, label="Random seed")
]
# What a pendant shows.
J3 = Literal["ground", "link"]
PendantUnit = Literal["deg", "rad", "pulse"]
PoseAngles = Literal["quaternion", "abc", "wpr", "rotation-vector", "xyz", "zyz"]

JOINT_3 = "Joint 3 is counted from"  # as forms call it
J3Origin = Annotated[
    J3 | None,
    Option("What joint 3 is counted from, if not as the robot file states.", label=JOINT_3),
]


Ess = Annotated[
    float, Option("Effective sample size of the posterior, for every parameter.", least=100, most=1e5)
]
# Of the posterior; "where needed": where the profile likelihood shows that the curvature at the mode does not
# describe it.
Sampling = Literal["always", "where needed", "never"]


@dataclass(frozen=True)
class AnalyseOptions:
    """How a run is analysed: with which seed, how long it is sampled, and what is left out or held out."""

    seed: Seed = 0
    ess: Ess = 1000.0
    robust: Annotated[
        Literal["huber", "student"] | None,
        Option("Fit once more with this robust loss: large residuals weigh less, outliers are named."),
    ] = None
    hold_out: Annotated[
        list[str] | None,
        Option(
            "Validate on this placement, with a fit of the others; * and ? match."
            " Or predict another run (.jsonl) of the same header.",
            metavar="NAME|FILE",
            names="run or name",
        ),
    ] = None
    drop: Annotated[
        list[str] | None,
        Option(
            "Leave out these measurements: by number, or FILE:LINE of the imported file or the run;"
            " several with commas.",
            metavar="NUMBER|FILE:LINE",
            app=False,
        ),
    ] = None
