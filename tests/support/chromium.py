"""Headless Chromium, the one of this machine, driven by Playwright: no download, no network."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_FLAGS = [
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
_PATIENCE_MS = 60_000
Result = TypeVar("Result")


class Size(NamedTuple):
    """What a page is shown on: CSS pixels, whether it is printed, and whether its user likes it dark."""

    width: int
    height: int
    print: bool = False
    dark: bool = False


PHONE, LAPTOP = Size(390, 844, dark=True), Size(1280, 800)
PAPER = Size(680, 970, print=True)  # A4 less its margins at 96 px an inch
SIZES = {"phone": PHONE, "laptop": LAPTOP, "paper": PAPER}


def chromium() -> Chromium:
    """The one browser of all tests of this process; without any on this machine the test is skipped."""
    path = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"none of these is on this machine: {', '.join(BROWSERS)}")
    pytest.importorskip("playwright", reason="it is in the extra `test`")
    return _started(path)


_running: list[Chromium] = []


@functools.cache
def _started(path: str) -> Chromium:
    _running.append(Chromium(path))
    return _running[-1]


def close_browser() -> None:
    """Before the process ends: at its exit the browser's thread takes no more work."""
    while _running:
        _running.pop().close()


@functools.cache
def axe() -> str:
    """The accessibility checker axe-core (MPL 2.0), from the package that ships it; skipped where it is not
    installed."""
    package = importlib.util.find_spec("axe_core_python")
    if package is None or package.origin is None:
        pytest.skip("axe-core-python is not installed; it is in the extra `test`")
    return Path(package.origin).with_name("axe.min.js").read_text(encoding="utf-8")


class Chromium:
    """A running browser; it ends with this process.

    Playwright has a thread of its own: its event loop would be in the way of those of the tests.
    """

    def __init__(self, path: str) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="playwright")
        self._playwright, self._browser = self.do(lambda: self._start(path))

    @staticmethod
    def _start(path: str) -> tuple[Any, Any]:
        from playwright.sync_api import sync_playwright

        playwright = sync_playwright().start()
        flags = {"executable_path": path, "chromium_sandbox": False, "args": _FLAGS}
        return playwright, playwright.chromium.launch(**flags, handle_sigint=False, handle_sigterm=False)

    def do(self, action: Callable[[], Result]) -> Result:
        """Carry an action out in the browser's thread."""
        return self._thread.submit(action).result()

    def close(self) -> None:
        with contextlib.suppress(Exception):  # the browser may have ended
            self.do(self._browser.close)
        self.do(self._playwright.stop)
        self._thread.shutdown()

    @contextlib.contextmanager
    def opened(
        self, file: Path | str, size: Size = LAPTOP, script: bool = True, beside: Tab | None = None
    ) -> Iterator[Tab]:
        """A file, or what is at an address, loaded, in a tab of its own; with the cookies (and the settings)
        of the tab `beside` it, else with none."""
        address = file if isinstance(file, str) else file.resolve().as_uri()
        context = beside.target.page.context if beside else self.do(lambda: self._context(size, script))
        tab = self.do(lambda: self._open(address, context, size))
        try:
            yield tab
        finally:
            self.do(tab.target.page.close if beside else context.close)

    def _context(self, size: Size, script: bool) -> Any:
        return self._browser.new_context(
            viewport={"width": size.width, "height": size.height},
            is_mobile=not size.print and size.width < 600,
            has_touch=not size.print and size.width < 900,
            java_script_enabled=script,
            color_scheme="dark" if size.dark else "light",
        )

    def _open(self, address: str, context: Any, size: Size) -> Tab:
        page = context.new_page()
        page.set_default_timeout(_PATIENCE_MS)
        page.emulate_media(media="print" if size.print else "screen")
        tab = Tab(self, page.main_frame, address)
        page.on("console", lambda message: _of_driver(message.text) or tab.messages.append(message.text))
        page.on("pageerror", lambda error: tab.messages.append(error.message))
        page.on("request", lambda request: tab.requests.append(request.url))
        page.on("dialog", tab.accept)
        page.goto(address)
        return tab


def _of_driver(message: str) -> bool:
    """Whether it is about how fast WebGL is where there is no graphics card, and not about the page."""
    return message.startswith("[.WebGL-") and "GL Driver Message (OpenGL, Performance" in message


class Tab:
    """A loaded page, or a frame of one."""

    def __init__(self, browser: Chromium, target: Any, address: str) -> None:
        self._browser, self.target, self.address = browser, target, address
        self.messages: list[str] = []
        self.requests: list[str] = []
        self._shown: list[str] = []
        self._session: Any = None

    def accept(self, dialog: Any) -> None:
        """Until it is closed the page stands still."""
        self._shown.append(dialog.message)
        dialog.accept()

    def call(self, method: str, **parameters: Any) -> Any:
        """A command of the DevTools protocol that Playwright has no function for.

        All of a tab go through one session: a finger that moves must have touched in the same one.
        """

        def send() -> Any:
            if self._session is None:
                self._session = self.target.page.context.new_cdp_session(self.target.page)
            return self._session.send(method, parameters)

        return self._browser.do(send)

    def value(self, expression: str) -> Any:
        """What a JavaScript expression (or the promise that it makes) evaluates to."""
        return self._browser.do(lambda: self.target.evaluate(expression))

    def on(self, action: Callable[[Any], Result]) -> Result:
        """What an action on Playwright's page gives."""
        return self._browser.do(lambda: action(self.target))

    def wait(self, condition: str, seconds: float) -> bool:
        """Whether a JavaScript condition becomes true in this time; another page may load meanwhile."""
        from playwright.sync_api import Error

        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                if self.value(f"Boolean({condition})"):
                    return True
            except Error as error:
                if "navigation" not in error.message:
                    raise
            time.sleep(0.02)
        return False

    def frame(self, start: str) -> Tab:
        """The one frame within the page whose address begins so."""

        def within() -> list[Any]:
            page = self.target.page
            return [each for each in page.frames if each != page.main_frame and each.url.startswith(start)]

        (frame,) = self._browser.do(within)
        return Tab(self._browser, frame, start)

    def visit(self, address: str) -> None:
        """Load another page in the same tab."""
        self._browser.do(lambda: self.target.page.goto(address))
        self.address = address

    def choose(self, element: str, files: Sequence[Path]) -> None:
        """What the dialog for files of an element (a JavaScript expression) gives."""
        self._browser.do(lambda: self.target.evaluate_handle(element).as_element().set_input_files(files))

    def reload(self) -> None:
        """Load the page anew, whole."""
        self._browser.do(self.target.page.reload)

    def key(self, key: str) -> None:
        """Press a key where the focus is."""
        self._browser.do(lambda: self.target.page.keyboard.press(key))

    @property
    def page(self) -> str:
        return str(self.value("document.documentElement.outerHTML"))

    @property
    def text(self) -> str:
        """What can be read of the page, with single spaces."""
        return " ".join(str(self.value("document.body.innerText")).split())

    @property
    def console(self) -> list[str]:
        """Messages so far: by the page, about it, or thrown by its scripts."""
        self.value("1")
        return list(self.messages)

    @property
    def asked(self) -> list[str]:
        """Addresses requested so far, without the page's own and what it holds itself."""
        self.value("1")
        return [url for url in self.requests if url != self.address and not url.startswith("data:")]

    @property
    def dialogs(self) -> list[str]:
        """What scripts of the page put before the reader so far."""
        self.value("new Promise((then) => setTimeout(then, 50))")
        return list(self._shown)

    def overflow(self) -> int:
        """By how many pixels the page is wider than what it is shown on."""
        return int(self.value("document.documentElement.scrollWidth - document.documentElement.clientWidth"))

    def accessibility(self) -> list[str]:
        """The serious and critical findings of axe-core, by WCAG 2.1 A and AA and its best practices."""
        self.value(f"{axe()}\n;1")
        violations = self.value("axe.run(document, {resultTypes: ['violations']}).then((r) => r.violations)")
        return [
            f"{finding['impact']}: {finding['id']}: {node['html'][:200]}"
            for finding in violations
            if finding["impact"] in ("serious", "critical")
            for node in finding["nodes"]
        ]
