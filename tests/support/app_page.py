"""The app in a process of its own, and its page used as a person does."""

import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.request import Request, urlopen

from child import ZEROBEAM, child
from chromium import LAPTOP, PHONE, Size, Tab

SCREENS = {"laptop": LAPTOP, "tablet": Size(820, 1180, dark=True), "phone": PHONE}


def root(address: str) -> str:
    """The address without what it has of token and place."""
    return address.partition("#")[0].partition("?")[0]


def request(address: str, path: str, body: bytes | None = None, method: str | None = None) -> Request:
    """As a program with the address sends it; with a body by POST, unless `method` says otherwise."""
    token = address.partition("#")[0].partition("?token=")[2]
    headers = {
        "Authorization": f"Bearer {token}",
        "X-Zerobeam": "1",
        "Content-Type": "application/octet-stream",
    }
    return Request(f"{root(address)}{path}", body, headers, method=method)


class App(NamedTuple):
    """Its address, with the token, and its process."""

    address: str
    process: subprocess.Popen[str]

    def ask(self, path: str, body: Any = None) -> Any:
        """What an end point answers; with a body it is sent by POST."""
        content = None if body is None else json.dumps(body).encode()
        with urlopen(request(self.address, f"api/{path}", content), timeout=60) as answer:
            return json.load(answer)

    def until(self, job: str, share: float) -> Any:
        """The job once so much of it is done, or it has ended."""
        while (now := self.ask(f"jobs/{job}"))["share"] < share and now["state"] in ("waiting", "running"):
            time.sleep(0.02)
        return now

    def ended(self, job: str) -> Any:
        while (now := self.ask(f"jobs/{job}"))["state"] in ("waiting", "running"):
            time.sleep(0.05)
        return now


@contextmanager
def app(folder: Path, port: int = 0) -> Iterator[App]:
    command = [*ZEROBEAM, "app", "--port", str(port), "--no-open", "--dir", str(folder)]
    with child(command, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        yield App(process.stdout.readline().removeprefix("The app: ").strip(), process)


def wait(tab: Tab, condition: str, seconds: float = 30) -> None:
    assert tab.wait(condition, seconds), f"never: {condition}\n{tab.text}"


def give(tab: Tab, element: str, value: object) -> None:
    """What a person does to a slider, a field or a list."""
    tab.value(
        f"(() => {{ const e = {element}; e.value = {value!r}; for (const kind of ['input', 'change'])"
        " e.dispatchEvent(new Event(kind, {bubbles: true})); })()"
    )


def fill(tab: Tab, label: str, value: str) -> None:
    tab.on(lambda page: page.get_by_label(label, exact=True).first.fill(value))


def press(tab: Tab, name: str, role: str = "button") -> None:
    tab.on(lambda page: page.get_by_role(role, name=name, exact=True).first.click())


def touch(tab: Tab, element: str) -> None:
    """A finger on the middle of an element, and off again."""
    tab.value(f"{element}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    middle = "(({x, y, width, height}) => [x + width / 2, y + height / 2])"
    x, y = tab.value(f"{middle}({element}.getBoundingClientRect())")
    tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
