"""The program's own exceptions: each says what was found, what is allowed and what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class ZerobeamError(Exception):
    """Base of all errors that a person gets as one message.

    Attributes
    ----------
    exit_status : int
        What the command line ends with.

    Examples
    --------
    >>> import zerobeam as zb
    >>> issubclass(zb.BadInput, zb.ZerobeamError)
    True
    """

    exit_status = 2


class BadInput(ZerobeamError):
    """A file, an option or a value that cannot be used.

    The message has one line a fact: where and what is wrong, what was found, what is allowed,
    what to do.

    Attributes
    ----------
    what : str
        What is wrong.
    found, allowed, remedy
        What was found, what is allowed, what to do; None where it is not stated.
    file : str or None
        The file, if the input came from one.
    line : int or None
        The line in it, counted from 1.
    argument : str or None
        The argument, if the input came from a call in Python.

    Examples
    --------
    >>> import zerobeam as zb
    >>> try:
    ...     zb.Noise(joint_deg=-0.01, spot_mm=0.05)
    ... except zb.BadInput as error:
    ...     print(error)
    argument joint_deg: the standard deviation of a joint reading cannot be used
      found:   -0.01
      allowed: one number above 0, or a list of them, one for each joint
    """

    def __init__(
        self,
        what: str,
        *,
        found: object = None,
        allowed: object = None,
        remedy: str | None = None,
        file: Path | str | None = None,
        line: int | None = None,
        argument: str | None = None,
    ) -> None:
        self.what = what
        self.found = found
        self.allowed = allowed
        self.remedy = remedy
        self.file = None if file is None else str(file)
        self.line = line
        self.argument = argument
        super().__init__(self._message())

    def at(self, file: Path | str, line: int | None) -> BadInput:
        """The same error, with `file` and `line` as its place unless it has a place already; a line of its
        own it keeps."""
        if self.file is not None or self.argument is not None:
            return self
        return self.restated(file=file, line=self.line or line)

    def of_argument(self, argument: str) -> BadInput:
        """The same error, with an argument as its place unless it has a place already."""
        if self.file is not None or self.argument is not None:
            return self
        return self.restated(argument=argument, line=None)

    def renamed(self, arguments: Mapping[str, str]) -> BadInput:
        """The same error, its argument called otherwise: by the option of the command line, say."""
        if self.argument is None or self.argument not in arguments:
            return self
        return self.restated(argument=arguments[self.argument])

    def restated(self, **otherwise: Any) -> BadInput:
        """The same error with some of its attributes, by name, said otherwise."""
        names = ("what", "found", "allowed", "remedy", "file", "line", "argument")
        return type(self)(**{name: getattr(self, name) for name in names} | otherwise)

    def _message(self) -> str:
        where = ""
        if self.file is not None:
            where = self.file if self.line is None else f"{self.file}, line {self.line}"
            where += ": "
        elif self.argument is not None:
            where = f"argument {self.argument}: "
        parts = [f"{where}{self.what}"]
        if self.found is not None:
            parts.append(f"  found:   {self.found}")
        if self.allowed is not None:
            parts.append(f"  allowed: {self.allowed}")
        if self.remedy is not None:
            parts.append(f"  to do:   {self.remedy}")
        return "\n".join(parts)


@contextmanager
def located(file: Path | str, line: int | None = None) -> Iterator[None]:
    """Within, a BadInput that has no place yet names this file and line; a line of its own it keeps."""
    try:
        yield
    except BadInput as error:
        raise error.at(file, line) from None


class NotWritten(BadInput):
    """Output that could not be written: no room on the disk, no right to, a file system that is read-only.

    Nothing may be wrong with what was given; a program that asks for the same again may well get it.

    Examples
    --------
    >>> from zerobeam.model.errors import BadInput, NotWritten
    >>> issubclass(NotWritten, BadInput), NotWritten.exit_status
    (True, 3)
    """

    exit_status = 3


def missing_extra(what: str, extra: str, *, needed: str | None = None) -> BadInput:
    """The error that `what` needs zerobeam's optional `extra`; `needed` calls it by another name."""
    return BadInput(
        f"{what} needs {needed or f'the extra `{extra}`'}, which is not installed",
        remedy=f'pip install "zerobeam[{extra}]"',
    )


class FitFailed(ZerobeamError):
    """The estimation could not be carried out; nothing that it left behind may be read as a result.

    Examples
    --------
    >>> import zerobeam as zb
    >>> zb.FitFailed.exit_status
    3
    """

    exit_status = 3


class WorkersLost(ZerobeamError):
    """The workers of a cluster cannot go on: the scheduler has gone, or a piece of work ends each of them."""

    exit_status = 3


class RigFault(ZerobeamError):
    """The rig (controller, sensor or simulated cell) did not do what it was asked to.

    Examples
    --------
    >>> import zerobeam as zb
    >>> zb.RigFault.exit_status
    3
    """

    exit_status = 3


class UnsoundResult(ZerobeamError):
    """An answer that claims more than the status of a parameter allows: a fault of the program."""

    exit_status = 3
