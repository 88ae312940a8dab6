"""The files of a VAL3 application, which are XML: elements with the places of what they state in the text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from ....model.errors import BadInput

_TAG = re.compile(r"""<[\w:.-]+(?:\s+[\w:.-]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*/?>""")
_ATTRIBUTE = re.compile(r"""\s([\w:.-]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_CDATA = re.compile(r"\s*<!\[CDATA\[(.*?)\]\]>\s*", re.DOTALL)


@dataclass
class XmlElement:
    """`attributes` as (value, its start in the text); `start` and `end` of the first tag, `close` that of the
    last one's begin."""

    tag: str
    start: int
    end: int
    attributes: dict[str, tuple[str, int]]
    children: list[XmlElement] = field(default_factory=list)
    close: int = 0

    def of(self, attribute: str) -> str:
        """The value of an attribute, "" without it."""
        return self.attributes.get(attribute, ("", 0))[0]

    def all(self, tag: str) -> Iterator[XmlElement]:
        """Elements of this name in it, at any depth."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.all(tag)


def documents(text: str) -> list[XmlElement]:
    """The root of each document of a text, which has them one after the other, each with its declaration.

    BadInput where one is not well-formed, or has a document type: entities grow without bound.
    """
    starts = [match.start() for match in re.finditer(r"<\?xml\b", text)]
    if not starts or text[: starts[0]].strip():
        starts.insert(0, 0)
    ends = [*starts[1:], len(text)]
    return [_document(text, start, end) for start, end in zip(starts, ends, strict=True)]


def _document(text: str, start: int, end: int) -> XmlElement:
    first_line = text.count("\n", 0, start)
    parser, open_elements, root = expat.ParserCreate("us-ascii"), [], XmlElement("", start, start, {})
    open_elements.append(root)

    def begin(tag: str, attributes: dict[str, str]) -> None:
        at = start + parser.CurrentByteIndex
        match = _TAG.match(text, at)
        spans = (
            {}
            if match is None
            else {
                each[1]: (each[2] or each[3] or "", each.start(2) if each[2] is not None else each.start(3))
                for each in _ATTRIBUTE.finditer(match[0])
            }
        )
        if match is None or spans.keys() != attributes.keys():
            raise BadInput(
                "a tag is not understood",
                found=text[at : at + 60],
                line=first_line + parser.CurrentLineNumber,
            )
        placed = {name: (value, at + offset) for name, (value, offset) in spans.items()}
        element = XmlElement(tag, at, match.end(), placed)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def finish(_: str) -> None:
        open_elements.pop().close = start + parser.CurrentByteIndex

    def doctype(*_: object) -> None:
        raise BadInput(
            "a VAL3 file may have no document type or entities",
            found="<!DOCTYPE",
            remedy="remove the declaration",
            line=first_line + parser.CurrentLineNumber,
        )

    parser.StartElementHandler, parser.EndElementHandler = begin, finish
    parser.StartDoctypeDeclHandler = doctype
    try:
        # One byte a letter, so that places in the file are places in the text.
        parser.Parse(text[start:end].encode("ascii", "replace"), True)
    except expat.ExpatError as error:
        raise BadInput(
            f"the file is not valid XML: {expat.errors.messages[error.code]}",
            remedy="copy the whole application again",
            line=first_line + error.lineno,
        ) from None
    return root.children[0]


def code_of(text: str, code: XmlElement) -> tuple[int, int] | None:
    """Begin and end of the program in a Code element; None where it is not one block of plain text."""
    inner = text[code.end : code.close] if code.close > code.end else ""
    match = _CDATA.fullmatch(inner)
    if match is not None:
        return code.end + match.start(1), code.end + match.end(1)
    return None if re.search("[<&]", inner) else (code.end, code.end + len(inner))
