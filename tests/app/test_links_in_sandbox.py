"""The links of pages that are shown in a sandbox, which sends no cookie with them: framed, and alone."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from app_page import App, app, root, wait
from chromium import Tab, chromium

pytestmark = pytest.mark.browser

PAGES = {
    "history/fleet.html": "<title>All</title><script>document.title += ' arms'</script>"
    "<a href='arms/a%20b/arm.html'>the arm</a><a href='/report/history/fleet.html'>the control</a>",
    "history/arms/a b/arm.html": "<title>Arm</title><a href='../../fleet.html'>all arms</a>",
}
FOLLOW = "document.querySelectorAll('a')[{}].click()"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[App]:
    chromium()
    for name, content in PAGES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    with app(tmp_path) as opened:
        yield opened


def in_frame(tab: Tab) -> Tab:
    return tab.frame(root(tab.address))


@pytest.mark.long
def test_in_the_frame_of_the_page_and_in_a_tab_of_its_own(server: App) -> None:
    with chromium().opened(server.address) as tab:
        wait(tab, "document.querySelector('.brand[aria-current]')")
        assert tab.value("location.href") == root(server.address)  # the token has left the address
        tab.value(
            "document.querySelector('main').append(Object.assign(document.createElement('iframe'), {sandbox:"
            " 'allow-scripts', src: '/report/history/fleet.html', onload: () => { window.there = 1 }}))"
        )
        wait(tab, "window.there")
        wait(in_frame(tab), "document.title === 'All arms'")
        in_frame(tab).value(FOLLOW.format(0))
        wait(in_frame(tab), "document.title === 'Arm'")
        in_frame(tab).value(FOLLOW.format(0))
        wait(in_frame(tab), "document.title === 'All arms'")
        assert in_frame(tab).value("origin") == "null"
        assert tab.console == []
        in_frame(tab).value(FOLLOW.format(1))  # the control: what needs the cookie is refused
        wait(in_frame(tab), "document.body?.textContent.includes('A token is needed')")
    # And in a tab of its own.
    with chromium().opened(server.address) as tab:
        wait(tab, "document.querySelector('.brand[aria-current]')")
        tab.reload()
        wait(tab, "document.querySelector('.brand[aria-current]')")
        tab.visit(f"{root(server.address)}report/history/fleet.html")
        wait(tab, "document.title === 'All arms'")
        tab.value(FOLLOW.format(0))
        wait(tab, "document.title === 'Arm'")
        tab.reload()
        assert tab.value("document.title") == "Arm"
        tab.value(FOLLOW.format(0))
        wait(tab, "document.title === 'All arms'")
        assert tab.value("origin") == "null"
