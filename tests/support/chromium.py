"""Headless Chromium, driven by the DevTools protocol over a pipe: no driver, no port, no network.

https://chromedevtools.github.io/devtools-protocol: JSON messages that end with a NUL, commands on the
browser's file descriptor 3, answers and events on its 4 (--remote-debugging-pipe).
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import functools
import importlib.util
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_FLAGS = [
    "--headless",
    "--remote-debugging-pipe",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
_PATIENCE = 60.0  # seconds for one answer
_FREE = 10  # file descriptors from here on are neither of the two that are asked for


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
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"none of these is on this machine: {', '.join(BROWSERS)}")
    return _started(found)


@functools.cache
def _started(path: str) -> Chromium:
    return Chromium(path)


@functools.cache
def axe() -> str:
    """The accessibility checker axe-core (MPL 2.0), from the package that ships it; skipped where it is not
    installed."""
    found = importlib.util.find_spec("axe_core_python")
    if found is None or found.origin is None:
        pytest.skip("axe-core-python is not installed; it is in the extra `test`")
    return Path(found.origin).with_name("axe.min.js").read_text(encoding="utf-8")


class Chromium:
    """A running browser; it ends with this process."""

    def __init__(self, path: str) -> None:
        self._profile = tempfile.TemporaryDirectory(prefix="zerobeam-chromium-", ignore_cleanup_errors=True)
        theirs, self._to = _above(os.pipe())
        self._from, theirs_too = _above(os.pipe())
        # dash cannot name a descriptor above 9: a word of Python puts the two ends where they are looked for.
        ends = f"os.dup2({theirs}, 3); os.dup2({theirs_too}, 4)"
        moved = f"import os, sys; {ends}; os.execv(sys.argv[1], sys.argv[1:])"
        profile = f"--user-data-dir={self._profile.name}"
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-E", "-c", moved, path, *_FLAGS, profile],
            pass_fds=(theirs, theirs_too),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs)
        os.close(theirs_too)
        self._left = b""
        self._number = 0
        self.events: list[dict[str, Any]] = []
        atexit.register(self.close)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._send("Browser.close", {}, None)
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._to)
        os.close(self._from)
        self._profile.cleanup()

    @contextlib.contextmanager
    def opened(self, file: Path | str, size: Size = LAPTOP, script: bool = True) -> Iterator[Tab]:
        """A file, or what is at an address, loaded, in a tab of its own."""
        target = self.call("Target.createTarget", {"url": "about:blank"})["targetId"]
        session = self.call("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        self.events.clear()
        tab = Tab(self, session, file if isinstance(file, str) else file.resolve().as_uri())
        for domain in ("Page", "Runtime", "Log", "Network"):
            tab.call(f"{domain}.enable")
        tab.call("Emulation.setScriptExecutionDisabled", value=not script)
        tab.call("Emulation.setDeviceMetricsOverride", width=size.width, height=size.height,
                 deviceScaleFactor=1, mobile=not size.print and size.width < 600)  # fmt: skip
        scheme = {"name": "prefers-color-scheme", "value": "dark" if size.dark else "light"}
        tab.call("Emulation.setEmulatedMedia", media="print" if size.print else "screen", features=[scheme])
        tab.call("Page.navigate", url=tab.address)
        self.wait_for("Page.loadEventFired")
        try:
            yield tab
        finally:
            self.call("Target.closeTarget", {"targetId": target})

    def call(self, method: str, parameters: dict[str, Any], session: str | None = None) -> Any:
        number = self._send(method, parameters, session)
        end = time.monotonic() + _PATIENCE
        while True:
            told = self._next(end)
            if told.get("id") == number:
                assert "error" not in told, (method, told["error"])
                return told["result"]

    def wait_for(self, event: str) -> None:
        end = time.monotonic() + _PATIENCE
        while not any(told["method"] == event for told in self.events):
            self._next(end)

    def _send(self, method: str, parameters: dict[str, Any], session: str | None) -> int:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._to, data) :]
        return self._number

    def _next(self, end: float) -> dict[str, Any]:
        """The next message; an event is kept."""
        while b"\0" not in self._left:
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            assert ready, "the browser does not answer"
            part = os.read(self._from, 1 << 20)
            assert part, "the browser has ended"
            self._left += part
        text, _, self._left = self._left.partition(b"\0")
        told: dict[str, Any] = json.loads(text)
        if "method" in told:
            self.events.append(told)
            if told["method"] == "Page.javascriptDialogOpening":
                # Until it is closed the page stands still.
                self._send("Page.handleJavaScriptDialog", {"accept": True}, told["sessionId"])
        return told


class Tab:
    """A loaded page."""

    def __init__(self, browser: Chromium, session: str, address: str) -> None:
        self._browser, self._session, self.address = browser, session, address

    def call(self, method: str, **parameters: Any) -> Any:
        return self._browser.call(method, parameters, self._session)

    def value(self, expression: str) -> Any:
        """What a JavaScript expression (or the promise that it makes) comes to."""
        told = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True, userGesture=True
        )
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def frame(self, start: str) -> Tab:
        """A frame whose address begins so, of another site or in a sandbox: the browser keeps those apart."""
        (target,) = [
            each["targetId"]
            for each in self._browser.call("Target.getTargets", {})["targetInfos"]
            if each["type"] == "iframe" and each["url"].startswith(start)
        ]
        asked = {"targetId": target, "flatten": True}
        session = self._browser.call("Target.attachToTarget", asked)["sessionId"]
        return Tab(self._browser, session, start)

    def reload(self) -> None:
        """Load the page anew, whole."""
        kept = self._browser.events
        kept[:] = [event for event in kept if event["method"] != "Page.loadEventFired"]
        self.call("Page.reload")
        self._browser.wait_for("Page.loadEventFired")

    def key(self, key: str) -> None:
        """Press a key where the focus is."""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    @property
    def page(self) -> str:
        return str(self.value("document.documentElement.outerHTML"))

    @property
    def text(self) -> str:
        """What can be read of the page, with single spaces."""
        return " ".join(str(self.value("document.body.innerText")).split())

    @property
    def console(self) -> list[str]:
        """All that was said there so far: by the page, of it, or thrown by its scripts."""
        self.value("1")
        told = []
        for event in self._events("Runtime.consoleAPICalled"):
            told.append(" ".join(str(part.get("value")) for part in event["args"]))
        told += [event["exceptionDetails"]["text"] for event in self._events("Runtime.exceptionThrown")]
        return told + [event["entry"]["text"] for event in self._events("Log.entryAdded")]

    @property
    def asked(self) -> list[str]:
        """Addresses asked for so far, but for the page's own and what it holds itself."""
        self.value("1")
        urls = [event["request"]["url"] for event in self._events("Network.requestWillBeSent")]
        return [url for url in urls if url != self.address and not url.startswith("data:")]

    @property
    def dialogs(self) -> list[str]:
        """What scripts of the page put before the reader so far."""
        self.value("new Promise((then) => setTimeout(then, 50))")
        return [event["message"] for event in self._events("Page.javascriptDialogOpening")]

    def _events(self, method: str) -> Iterator[dict[str, Any]]:
        for event in self._browser.events:
            if event["method"] == method and event.get("sessionId") == self._session:
                yield event["params"]

    def overflow(self) -> int:
        """By how many pixels the page is wider than what it is shown on."""
        return int(self.value("document.documentElement.scrollWidth - document.documentElement.clientWidth"))

    def accessibility(self) -> list[str]:
        """The serious and critical findings of axe-core, by WCAG 2.1 A and AA and its best practices."""
        self.value(f"{axe()}\n;1")
        found = self.value("axe.run(document, {resultTypes: ['violations']}).then((r) => r.violations)")
        return [
            f"{finding['impact']}: {finding['id']}: {node['html'][:200]}"
            for finding in found
            if finding["impact"] in ("serious", "critical")
            for node in finding["nodes"]
        ]


def _above(pipe: tuple[int, int]) -> tuple[int, int]:
    """The same pipe with its ends at numbers that are not in the way of 3 and 4."""
    ends = tuple(fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, _FREE) for end in pipe)
    for end in pipe:
        os.close(end)
    return ends[0], ends[1]
