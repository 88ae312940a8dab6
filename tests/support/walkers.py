"""Who goes through the app's page: with a mouse, with the keyboard alone, with a finger.

None of them calls a script's click() or focus(): each does what the person's device does. What the system
draws itself (the open list of a select, the dialog that chooses files) is outside the page; there the driver
chooses.
"""

import re
import time
from typing import Any, Protocol

from app_page import wait
from chromium import Size, Tab

DESK = Size(1440, 900)
LEAST_TARGET = 40.0  # CSS pixels, of what a finger is to hit
_MOST_STOPS = 120
_PATIENCE_S = 20.0


class Walker(Protocol):
    """What a person does to controls, by their role and accessible name."""

    def press(self, role: str, name: str) -> None:
        """A button, a link, or the head of what is folded."""

    def choose(self, label: str, text: str) -> None:
        """An item of a list, by the text that is shown."""


def control(page: Any, role: str, name: str) -> Any:
    """The first control of a role whose accessible name begins so."""
    if role == "summary":
        return page.locator("summary", has_text=name).first
    if role == "field":
        return page.get_by_label(re.compile(f"^{re.escape(name)}")).first
    return page.get_by_role(role, name=re.compile(f"^{re.escape(name)}")).first


_HIT = """(e, [x, y]) => {
  const top = document.elementFromPoint(x, y);
  return e.contains(top) || top?.closest('label')?.contains(e) === true;
}"""


def _uncovered(page: Any, role: str, name: str) -> tuple[float, float]:
    """The middle of a control, scrolled to as a person scrolls; it is in sight, and nothing is above it."""
    element = control(page, role, name)
    element.wait_for()
    element.scroll_into_view_if_needed()
    box = element.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    assert element.evaluate(_HIT, [x, y]), f"{role} {name!r} is out of sight or covered"
    return x, y


class _Pointer:
    """What points at a control and hits it; text is typed where it has hit."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab

    def hit(self, page: Any, role: str, name: str) -> None:
        raise NotImplementedError

    def press(self, role: str, name: str) -> None:
        self._tab.on(lambda frame: self.hit(frame.page, role, name))

    def choose(self, label: str, text: str) -> None:
        def act(frame: Any) -> None:
            _uncovered(frame.page, "field", label)
            control(frame.page, "field", label).select_option(label=text)

        self._tab.on(act)


class Mouse(_Pointer):
    """A mouse at a desk."""

    def hit(self, page: Any, role: str, name: str) -> None:
        page.mouse.click(*_uncovered(page, role, name))


class Finger(_Pointer):
    """A finger on a tablet or a phone: what it is to hit is large enough."""

    def hit(self, page: Any, role: str, name: str) -> None:
        x, y = _uncovered(page, role, name)
        box = control(page, role, name).bounding_box()
        assert min(box["width"], box["height"]) >= LEAST_TARGET, f"{role} {name!r} is too small: {box}"
        page.touchscreen.tap(x, y)


_FOCUSED = """(e) => {
  if (document.activeElement !== e) return null;
  const { outlineStyle, outlineWidth } = getComputedStyle(e), box = e.getBoundingClientRect();
  const [x, y] = [box.x + box.width / 2, box.y + Math.min(box.height, innerHeight) / 2];
  const top = document.elementFromPoint(x, y);
  const ring = outlineStyle !== 'none' && parseFloat(outlineWidth) >= 2;
  return { ring, seen: e.contains(top) || top?.closest('label')?.contains(e) === true };
}"""


class Keyboard:
    """The keyboard alone: Tab to each control, where the focus is seen, then its key.

    Attributes
    ----------
    stops : dict of int by control
        How often Tab was pressed to reach it.
    """

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self.stops: dict[str, int] = {}

    def skip(self) -> None:
        """To the content of the page, by its first stop."""
        self._tab.key("Tab")
        assert self._tab.value("document.activeElement.textContent") == "To the content"
        self._tab.key("Enter")
        assert self._tab.value("document.activeElement.id") == "content"

    def reach(self, role: str, name: str) -> int:
        """Tab until it has the focus; how many stops that took."""

        def act(frame: Any) -> int:
            element = control(frame.page, role, name)
            element.wait_for()
            # Tab passes a control by that is not ready yet.
            frame.page.wait_for_function("(e) => !e.disabled", arg=element.element_handle())
            for count in range(1, _MOST_STOPS + 1):
                frame.page.keyboard.press("Tab")
                state = element.evaluate(_FOCUSED)
                if state is not None:
                    self._see_focus(element, name)
                    return count
            raise AssertionError(f"{role} {name!r} has no focus after {_MOST_STOPS} stops")

        self.stops[f"{role} {name}"] = count = int(self._tab.on(act))
        return count

    @staticmethod
    def _see_focus(element: Any, name: str) -> None:
        """Wait until the focus is in sight: the page is laid out and scrolled after the key was pressed."""
        state, end = None, time.monotonic() + _PATIENCE_S
        while time.monotonic() < end:
            state = element.evaluate(_FOCUSED)
            if state == {"ring": True, "seen": True}:
                return
        raise AssertionError(f"the focus on {name!r} is not seen: {state}")

    def press(self, role: str, name: str) -> None:
        self.reach(role, name)
        self._tab.key("Enter")

    def choose(self, label: str, text: str) -> None:
        """By its first letters, else item by item: a browser that is slow between two letters takes the
        second for the begin of another word."""
        self.reach("field", label)
        chosen = "document.activeElement.selectedOptions[0].textContent"

        def act(frame: Any) -> None:
            frame.page.keyboard.type(text)
            if frame.evaluate(chosen) == text:
                return
            frame.page.keyboard.press("Home")
            for _ in range(frame.evaluate("document.activeElement.options.length")):
                if frame.evaluate(chosen) == text:
                    return
                frame.page.keyboard.press("ArrowDown")

        self._tab.on(act)
        wait(self._tab, f"{chosen} === {text!r}")
