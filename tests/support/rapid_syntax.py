"""The syntax of RAPID as its manual has it, for the interpreter of the tests: text to nested tuples.

Nothing here is of the code that is tested. `ValueError` is raised for what is no program.
"""

from __future__ import annotations

import re
from typing import Any

_TOKEN = re.compile(
    r'(?P<text>"[^"\n]*")|(?P<comment>![^\n]*)|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)'
    r"|(?P<word>[A-Za-z]\w*)|(?P<sign>:=|<>|<=|>=|[-+*/=<>()\[\]{},;:.\\?|])|(?P<blank>\s+)"
)
_LEVELS = (("OR", "XOR"), ("AND",), ("=", "<>", "<", ">", "<=", ">="), ("+", "-"), ("*", "/", "DIV", "MOD"))
_BLOCK_ENDS = {
    *("ENDIF", "ELSE", "ELSEIF", "ENDWHILE", "ENDFOR", "ENDTEST", "CASE", "DEFAULT", "ENDPROC", "ENDFUNC"),
    *("ENDTRAP", "ERROR"),
}


def parse(text: str) -> dict[str, Any]:
    """`data`: declarations; `records`: types; `routines` by name: kind, parameters, body, error handler."""
    return _Parser(text).module()


class _Parser:
    def __init__(self, text: str) -> None:
        text = re.sub(r"\A%%%.*?%%%", "", text, flags=re.DOTALL)
        self.tokens, place = [], 0
        while place < len(text):
            found = _TOKEN.match(text, place)
            if found is None:
                raise ValueError(f"no token: {text[place : place + 20]!r}")
            if found.lastgroup not in ("comment", "blank"):
                self.tokens.append((found.lastgroup, found[0]))
            place = found.end()
        self.tokens.append(("end", ""))
        self.i = 0

    @property
    def next(self) -> str:
        return self.tokens[self.i][1].upper()

    def take(self, *wanted: str) -> str:
        kind, text = self.tokens[self.i]
        if wanted and text.upper() not in wanted and f"<{kind}>" not in wanted:
            raise ValueError(f"{text!r} for {wanted}")
        self.i += 1
        return text

    def has(self, *words: str) -> bool:
        if self.next in words:
            self.i += 1
            return True
        return False

    def name(self) -> str:
        return self.take("<word>").lower()

    def module(self) -> dict[str, Any]:
        self.take("MODULE")
        self.name()
        found: dict[str, Any] = {"data": [], "records": {}, "routines": {}}
        while not self.has("ENDMODULE"):
            self.has("LOCAL", "TASK")
            if self.has("RECORD"):
                name, fields = self.name(), []
                while not self.has("ENDRECORD"):
                    kind = self.name()
                    fields.append((self.name(), kind))
                    self.take(";")
                found["records"][name] = fields
            elif self.next in ("CONST", "PERS", "VAR"):
                found["data"].append(self.declaration())
            else:
                self.routine(found["routines"])
        self.take("")
        return found

    def declaration(self) -> tuple[Any, ...]:
        self.take("CONST", "PERS", "VAR")
        kind, name, sizes, value = self.name(), self.name(), [], None
        if self.has("{"):
            sizes = self.listed("}")
        if self.has(":="):
            value = self.value()
        self.take(";")
        return "data", kind, name, sizes, value

    def routine(self, routines: dict[str, Any]) -> None:
        kind = self.take("PROC", "FUNC", "TRAP").upper()
        if kind == "FUNC":
            self.name()
        name, parameters = self.name(), []
        if kind != "TRAP":
            self.take("(")
            while not self.has(")"):
                optional, mode = self.has("\\"), "IN"
                if self.next in ("INOUT", "VAR", "PERS"):
                    mode = self.take().upper()
                of = self.name()
                parameters.append((mode, of, self.name(), optional))
                self.has(",", "|")
        body, handler = self.block(), []
        if self.has("ERROR"):
            handler = self.block()
        self.take(f"END{kind}")
        if name in routines:
            raise ValueError(f"{name} is there twice")
        routines[name] = kind, parameters, body, handler

    def block(self) -> list[Any]:
        found = []
        while self.next not in _BLOCK_ENDS:
            found.append(self.statement())
        return found

    def statement(self) -> tuple[Any, ...]:
        word = self.next
        if word in ("CONST", "PERS", "VAR"):
            return self.declaration()
        if word in ("IF", "WHILE", "FOR", "TEST"):
            return getattr(self, f"_{word.lower()}")()
        if self.tokens[self.i + 1][1] == ":" and self.tokens[self.i][0] == "word":
            name = self.name()
            self.take(":")
            return "label", name
        return self.simple()

    def simple(self) -> tuple[Any, ...]:
        word = self.next
        if word in ("GOTO", "RETURN", "RAISE", "RETRY", "TRYNEXT", "EXIT", "CONNECT"):
            self.take()
            value = None
            if word == "CONNECT":
                value = self.name(), self.take("WITH"), self.name()
            elif word == "GOTO":
                value = self.name()
            elif self.next != ";":
                value = self.value()
            self.take(";")
            return word.lower(), value
        name, parts = self.name(), self.accessors()
        if self.has(":="):
            value = self.value()
            self.take(";")
            return "assign", ("reference", name, parts), value
        if parts:
            raise ValueError(f"{name} is no statement")
        arguments = self.arguments((";",))
        self.take(";")
        return "call", name, arguments

    def _if(self) -> tuple[Any, ...]:
        self.take("IF")
        condition = self.value()
        if not self.has("THEN"):
            return "if", [(condition, [self.simple()])], []
        branches, other = [(condition, self.block())], []
        while not self.has("ENDIF"):
            if self.has("ELSEIF"):
                condition = self.value()
                self.take("THEN")
                branches.append((condition, self.block()))
            else:
                self.take("ELSE")
                other = self.block()
        return "if", branches, other

    def _while(self) -> tuple[Any, ...]:
        self.take("WHILE")
        condition = self.value()
        self.take("DO")
        body = self.block()
        self.take("ENDWHILE")
        return "while", condition, body

    def _for(self) -> tuple[Any, ...]:
        self.take("FOR")
        name = self.name()
        self.take("FROM")
        begin = self.value()
        self.take("TO")
        end = self.value()
        step = self.value() if self.has("STEP") else None
        self.take("DO")
        body = self.block()
        self.take("ENDFOR")
        return "for", name, begin, end, step, body

    def _test(self) -> tuple[Any, ...]:
        self.take("TEST")
        value, cases = self.value(), []
        while not self.has("ENDTEST"):
            values = None
            if self.has("CASE"):
                values = [self.value()]
                while self.has(","):
                    values.append(self.value())
            else:
                self.take("DEFAULT")
            self.take(":")
            cases.append((values, self.block()))
        return "test", value, cases

    def arguments(self, ends: tuple[str, ...]) -> list[tuple[Any, dict[str, Any]]]:
        found: list[tuple[Any, dict[str, Any]]] = []
        while self.next not in ends:
            value = None if self.next == "\\" else self.value()
            options: dict[str, Any] = {}
            while self.has("\\"):
                option = self.name()
                if option in options:
                    raise ValueError(f"{option} is there twice")
                if self.has("?"):
                    options[option] = "present", self.name()
                else:
                    options[option] = self.value() if self.has(":=") else None
            found.append((value, options))
            if self.next not in ends:
                self.take(",")
        return found

    def accessors(self) -> list[tuple[str, Any]]:
        found = []
        while self.next in ("{", "."):
            if self.has("{"):
                found.append(("{", self.listed("}")))
            else:
                self.take(".")
                found.append((".", self.name()))
        return found

    def listed(self, end: str) -> list[Any]:
        found = [self.value()]
        while self.has(","):
            found.append(self.value())
        self.take(end)
        return found

    def value(self, level: int = 0) -> Any:
        if level == len(_LEVELS):
            return self.term()
        found = self.value(level + 1)
        while self.next in _LEVELS[level]:
            found = "operation", self.take().upper(), found, self.value(level + 1)
        return found

    def term(self) -> Any:
        if self.next in ("+", "-", "NOT"):
            return self.take().upper(), self.term()
        kind, text = self.tokens[self.i]
        self.i += 1
        if kind == "number":
            return "constant", float(text)
        if kind == "text":
            return "constant", text[1:-1]
        if text == "(":
            found = self.value()
            self.take(")")
            return found
        if text == "[":
            return "list", self.listed("]")
        if kind != "word":
            raise ValueError(f"{text!r} is no value")
        if text.upper() in ("TRUE", "FALSE"):
            return "constant", text.upper() == "TRUE"
        if self.has("("):
            arguments = self.arguments((")",))
            self.take(")")
            return "function", text.lower(), arguments
        return "reference", text.lower(), self.accessors()
