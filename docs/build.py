"""The site of the documentation, in build/site, which is read without a network.

    python docs/build.py [--without-gallery]

Beside the pages it has those of the commands and the gallery, which are made here. What the pages have for
the tests (`status=1`, `output`) is taken out of their fences. Equations become MathML: browsers draw that by
themselves, so no script is fetched; the font for it is the STIX Two Math (SIL Open Font License) that the
package ziamath brings.
"""

from __future__ import annotations

import contextlib
import html
import re
import shutil
import subprocess
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

import command_reference
import gallery
import notebook_page

ROOT = Path(__file__).resolve().parents[1]
SOURCE, SITE, PACKAGE = (ROOT / "build" / name for name in ("docs", "site", "package"))
_FENCE = re.compile(r"^(```\w+)( [^\n]*)$", flags=re.MULTILINE)
_EQUATION = re.compile(r'<(span|div) class="arithmatex">\s*\\([(\[])(.*?)\\[)\]]\s*</\1>', flags=re.DOTALL)
# A page may link to the world, but must not need it.
_NEEDED = r"rel=[\"']?(?:stylesheet|icon|preconnect|preload)\b"
_AFAR = r"[\"']?(?:https?:)?//[^>]*"
_FETCHED = re.compile(
    rf"<(?:script|img|iframe)\b[^>]*\bsrc={_AFAR}"
    rf"|<link\b(?=[^>]*\b{_NEEDED})[^>]*\bhref={_AFAR}"
)


def site_page(text: str) -> str:
    """A page as the site's generator reads it: of what stands behind a fence's language, the title alone."""

    def fence(found: re.Match[str]) -> str:
        title = re.search(r' title="[^"]+"', found[2])
        return found[1] + (title[0] if title else "")

    return _FENCE.sub(fence, text)


def with_equations(page: str) -> str:
    """A page of the site with its TeX turned into MathML; RuntimeError where that is not understood."""
    from latex2mathml.converter import convert

    def equation(found: re.Match[str]) -> str:
        tex = html.unescape(found[3]).strip()
        drawn = convert(tex, display="inline" if found[2] == "(" else "block")
        drawn = drawn.replace(r"<mi>\arg</mi>", "<mi>arg</mi>")  # which the converter does not know
        if "\\" in drawn:
            raise RuntimeError(f"the equation cannot be drawn: {tex}")
        # Names of functions (log, det) stand apart from what is beside them, as in TeX.
        return re.sub(r"<mi>([a-z]{2,})</mi>", r'<mo lspace="0.17em" rspace="0.17em">\1</mo>', drawn)

    return _EQUATION.sub(equation, page)


def require_no_network(page: str) -> None:
    """RuntimeError where a page would fetch something."""
    found = _FETCHED.search(page)
    if found:
        raise RuntimeError(f"the page needs the network: {found[0]}")


def stage() -> None:
    """All pages into build/docs; the rooms of the package under its name, for the reference."""
    for folder in (SOURCE, SITE, PACKAGE):
        shutil.rmtree(folder, ignore_errors=True)
    own = ROOT / "docs"
    for path in own.rglob("*"):
        there = SOURCE / path.relative_to(own)
        if path.suffix == ".md":
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_text(site_page(path.read_text(encoding="utf-8")), encoding="utf-8")
        elif path.suffix in (".png", ".svg", ".css"):
            there.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, there)
    fonts = SOURCE / "fonts"
    fonts.mkdir()
    shutil.copy(Path(str(files("ziamath"))) / "fonts" / "STIXTwoMath-Regular.ttf", fonts)
    (SOURCE / "reference" / "commands.md").write_text(command_reference.page(), encoding="utf-8")
    rooms = PACKAGE / "zerobeam"
    rooms.mkdir(parents=True)
    for path in (*ROOT.glob("*.py"), *(init.parent for init in ROOT.glob("*/__init__.py"))):
        (rooms / path.name).symlink_to(path)


def carry_out_notebooks() -> None:
    """A page of each notebook; what they write is not kept."""
    for path in sorted((ROOT / "docs" / "notebooks").glob("*.py")):
        there = SOURCE / "notebooks" / f"{path.stem}.md"
        there.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            there.write_text(notebook_page.page(path), encoding="utf-8")


def main() -> None:
    """Build it all."""
    stage()
    carry_out_notebooks()
    if "--without-gallery" not in sys.argv[1:]:
        gallery.make(SOURCE / "gallery")
    zensical = Path(sys.executable).with_name("zensical")
    subprocess.run([zensical, "build", "--clean", "--strict"], cwd=ROOT, check=True)
    for path in SITE.rglob("*.html"):
        page = with_equations(path.read_text(encoding="utf-8"))
        require_no_network(page)
        path.write_text(page, encoding="utf-8")
    print(f"Site: {SITE / 'index.html'}")  # noqa: T201 - what a person waits for


if __name__ == "__main__":
    main()
