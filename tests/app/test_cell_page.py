"""The step Cell: what a plan states is edited, undone and refused at its field, by the schema of its file."""

import shutil
from pathlib import Path

import pytest
from app_page import app, press, wait
from chromium import LAPTOP, chromium

from zerobeam.experiments.demos import example_files

FIELD = "[data-key='noise/joint_deg'] input"
SHOWN = f'document.querySelector("{FIELD}").value'


@pytest.mark.browser
def test_noise_is_edited_undone_and_refused_where_it_stands(tmp_path: Path) -> None:
    (tmp_path / "cell").mkdir()
    for name, file in example_files().items():
        shutil.copy(file, tmp_path / "cell" / name)
    with app(tmp_path) as served, chromium().opened(f"{served.address}#/job/cell/cell", LAPTOP) as tab:
        wait(tab, f'document.querySelector("{FIELD}")')
        before = tab.value(SHOWN)
        tab.on(lambda page: page.locator(FIELD).fill("0,02"))
        wait(tab, "document.body.textContent.includes('Changes are not saved.')")
        press(tab, "Undo")
        wait(tab, f"{SHOWN} === {before!r}")
        tab.on(lambda page: page.locator(FIELD).fill("-"))  # no number yet: the plan stays as it is
        wait(tab, f"document.querySelector(\"{FIELD}\").getAttribute('aria-invalid') === 'true'")
        assert "Saved." in tab.text
        tab.on(lambda page: page.locator(FIELD).fill("-3"))
        wait(tab, "document.querySelector('[data-key=\"noise/joint_deg\"] .error')")
