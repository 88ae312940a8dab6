"""All commands put together, each loaded when it is called, and what becomes of their errors: messages, and
exit statuses of errors."""

from __future__ import annotations

import errno
import functools
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import version as installed
from threading import RLock
from types import ModuleType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ..interruption import answered, requested
from ..model.errors import RigFault, ZerobeamError
from .console import FAULT, UNREAD, OutputLost, err, guarded_streams, plain, say
from .shared_options import with_options


class _Late(ModuleType):
    """Stands in for a module, and passes on what is asked of it once it is `made`."""

    def __getattr__(self, name: str) -> Any:
        if "made" not in self.__dict__:
            raise AttributeError(name)
        return getattr(_late.real(self), name)


class _LateModules(MetaPathFinder, Loader):
    def __init__(self) -> None:
        self.names: set[str] = set()
        self._one_at_a_time = RLock()

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname in self.names else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Late(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__["made"] = True

    def real(self, late: _Late) -> ModuleType:
        """The module that `late` stands in for."""
        with self._one_at_a_time:
            self.names.discard(late.__name__)
            if sys.modules.get(late.__name__) is late:
                del sys.modules[late.__name__]
            return import_module(late.__name__)


_late = _LateModules()


def when_used(*names: str) -> None:
    """From now on these modules come when they are used."""
    _late.names.update(names)
    if _late not in sys.meta_path:
        sys.meta_path.insert(0, _late)


# Of a disk that is full or read-only, a quota, a limit of the process, a device that fails.
_NO_ROOM = {errno.ENOSPC, errno.EROFS, errno.EFBIG, errno.EIO, getattr(errno, "EDQUOT", errno.ENOSPC)}


class _Stopped(Exception):
    """The command was interrupted."""


class _Commands(TyperGroup):
    """All commands; an interruption of any of them reaches `carried_out`.

    Typer would end without a word after Ctrl-C, and after Ctrl-C at a question with status 1, a verdict.
    """

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, typer.Abort):
            raise _Stopped from None


def _loaded(module: str) -> Any:
    """A module of commands: loaded once one of them is called, or their help is asked for."""
    return import_module(f".{module}", __package__)


# Each command with its module, in which the function has its name; in the order of help.
_COMMANDS = {
    "demo": "judging",
    "check": "judging",
    "analyse": "judging",
    "report": "judging",
    "compare": "judging",
    "batch": "judging",
    "plan": "planning",
    "verify": "planning",
    "robot": "robots",
    "run": "carrying_out",
    "app": "app",
    "schema": "judging",
}
_GROUPS: dict[str, Callable[[], typer.Typer]] = {
    "import": lambda: _loaded("exchange").imports(),
    "study": lambda: _loaded("studying").studies,
    "export": lambda: _loaded("exchange").exports(),
    "positions": lambda: _loaded("positions").positions,
    "history": lambda: _loaded("history").histories,
}


def _print_version(wanted_version: bool) -> None:
    if wanted_version:
        say(f"zerobeam {installed('zerobeam')}")
        raise typer.Exit


def _zerobeam(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Joint offsets of an industrial robot from laser measurements of one point, with their uncertainty."""


@functools.cache
def _program(name_typed: str | None = None) -> typer.Typer:
    """The program; with the command `name_typed` alone, if there is one of that name.

    To make all of them ready takes Typer a tenth of a second.
    """
    app = typer.Typer(
        name="zerobeam",
        cls=_Commands,
        help=_zerobeam.__doc__,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
    )
    app.callback()(_zerobeam)
    one = name_typed in _COMMANDS or name_typed in _GROUPS
    for name, module in _COMMANDS.items():
        if name == name_typed or not one:
            app.command(name)(with_options(getattr(_loaded(module), name)))
    for name, group in _GROUPS.items():
        if name == name_typed or not one:
            app.add_typer(group(), name=name)
    return app


def __getattr__(name: str) -> typer.Typer:
    """`app`, the whole program: made where it is asked for, since it needs the formats of all makers."""
    if name == "app":
        return _program()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _warn(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a note of our own. What libraries note of numbers says nothing to a person."""
    if not category.__module__.startswith(__package__.partition(".")[0]):
        return
    say(f"note: {message}", to=err)


def carried_out() -> int:
    """The exit status of what `sys.argv` asks for; KeyboardInterrupt where it was stopped.

    Every error that is the user's is one message, no traceback.
    """
    warnings.showwarning = _warn
    # SciPy asks NumPy for all that it has, emcee for a file format: these take as long as an analysis.
    when_used("numpy.f2py", "numpy.testing", "h5py")
    with guarded_streams() as lost:
        status = _status()
        error = lost()
        if error is None or requested():
            return status
        if isinstance(error, BrokenPipeError):
            return UNREAD
        say(f"error: the output cannot be written: {error.strerror}", to=err)
        return FAULT


def _status() -> int:
    try:
        _program(*sys.argv[1:2])(standalone_mode=True)
    except SystemExit as end:
        return int(end.code or 0)
    except OutputLost:
        return UNREAD
    except _Stopped:
        raise KeyboardInterrupt from None
    except Exception as error:
        if isinstance(error, RigFault):
            answered()  # a rig that could not be stopped is the worse message
        elif requested():
            raise  # other words for an interruption
        if isinstance(error, ZerobeamError):
            say(f"error: {error}", to=err)
            return error.exit_status
        if isinstance(error, OSError) and error.errno in _NO_ROOM:
            say(f"error: the output cannot be written: {error.strerror}", to=err)
            return FAULT
        # Python's own status for this is 1, which is a verdict here.
        sys.stderr.write(plain(traceback.format_exc()))
        say("error: this is a fault of zerobeam itself, please report it with the lines above", to=err)
        return FAULT
    return 0
