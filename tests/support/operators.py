"""Binary operators by precedence, for the interpreters of controllers' languages."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Operators = Mapping[str, Callable[[Any, Any], Any]]

ORDER: Operators = {"<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge}
SUMS: Operators = {"+": operator.add, "-": operator.sub}


def operated(tokens: list[str], levels: Sequence[Operators], operand: Callable[[], Any]) -> Any:
    """The value of the expression that the tokens begin with, which are taken away: operators of the first
    level bind least, those of one level from left to right."""
    if not levels:
        return operand()
    value = operated(tokens, levels[1:], operand)
    while tokens and tokens[0] in levels[0]:
        operation = levels[0][tokens.pop(0)]
        value = operation(value, operated(tokens, levels[1:], operand))
    return value
