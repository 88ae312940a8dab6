"""PDF documents, set by typst: templates are fixed, and whatever comes from a run reaches them as data."""

from __future__ import annotations

import dataclasses
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import typst

from ..style.blocks import Page, Section, on_paper
from ..style.canvas import Picture
from ..style.theme import FAMILY, FOLDER, PALETTE, in_font
from .html import TEMPLATES

_DOCUMENT, _PARTS = "document.typ", "parts.typ"


def pdf(page: Page, pictures: Mapping[str, Picture]) -> bytes:
    """A page (`blocks.py`) as a tagged PDF/UA document; the same page gives the same bytes.

    Letters that the shipped typeface lacks are written as escapes, since a PDF cannot borrow them
    from the machine that shows it.
    """
    data = {
        "view": _writable(replace(page, sections=_on_paper(page.sections))),
        "pictures": {
            name: {"title": _writable(picture.title), "alt": _writable(picture.alt)}
            for name, picture in pictures.items()
        },
        "colours": {role: colour.light for role, colour in PALETTE.items()},
        "typeface": FAMILY,
    }
    # typst sees this folder and nothing else of the disk.
    with tempfile.TemporaryDirectory(prefix="zerobeam-") as root:
        folder = Path(root)
        for name in (_DOCUMENT, _PARTS):
            shutil.copyfile(TEMPLATES / name, folder / name)
        (folder / "view.json").write_text(json.dumps(data), encoding="utf-8")
        for name, picture in pictures.items():
            (folder / f"{name}.svg").write_text(picture.svg, encoding="utf-8")
        made: bytes = typst.compile(
            str(folder / _DOCUMENT),
            root=root,
            font_paths=[str(FOLDER)],
            ignore_system_fonts=True,
            pdf_standards=["ua-1"],
            timestamp=0,
        )
    return made


def _on_paper(sections: Sequence[Section]) -> list[Section]:
    """The sections with what paper has of them, if it has any."""
    papers = [replace(one, lead=on_paper(one.lead), blocks=on_paper(one.blocks)) for one in sections]
    return [paper for paper, one in zip(papers, sections, strict=True) if paper.all or not one.all]


def picture_bytes(picture: Picture, form: Literal["pdf", "png"]) -> bytes:
    """A figure alone, on a page of its own size; a PNG has 300 dots an inch and a white ground."""
    source = f'#set page(width: auto, height: auto, margin: 2mm)\n#image({json.dumps(picture.name)} + ".svg")'
    with tempfile.TemporaryDirectory(prefix="zerobeam-") as root:
        folder = Path(root)
        (folder / f"{picture.name}.svg").write_text(picture.svg, encoding="utf-8")
        (folder / "figure.typ").write_text(source, encoding="utf-8")
        made: bytes = typst.compile(
            str(folder / "figure.typ"),
            root=root,
            font_paths=[str(FOLDER)],
            ignore_system_fonts=True,
            format=form,
            ppi=300.0,
            timestamp=0,
        )
    return made


def _writable(value: Any) -> Any:
    if isinstance(value, str):
        return in_font(value)
    if dataclasses.is_dataclass(value):
        kind = {"kind": value.kind} if hasattr(value, "kind") else {}
        return kind | {
            field.name: _writable(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
    return [_writable(item) for item in value] if isinstance(value, list | tuple) else value
