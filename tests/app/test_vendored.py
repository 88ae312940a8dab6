"""Files of other people in the page are those of their packages, with their licences; no others are there."""

import hashlib
import json
from pathlib import Path

import zerobeam.app

VENDOR = Path(zerobeam.app.__file__).with_name("page") / "vendor"
PACKAGES = json.loads((VENDOR / "packages.json").read_text())


def test_every_file_has_the_digest_that_is_pinned() -> None:
    pinned = {file: row["sha256"] for package in PACKAGES.values() for file, row in package["files"].items()}
    there = {path.relative_to(VENDOR).as_posix(): path for path in VENDOR.rglob("*") if path.is_file()}
    del there["packages.json"]
    digests = {file: hashlib.sha256(path.read_bytes()).hexdigest() for file, path in there.items()}
    assert digests == pinned


def test_every_package_brings_its_licence() -> None:
    for name, package in PACKAGES.items():
        licences = [file for file in package["files"] if Path(file).name.startswith("LICENSE")]
        text = (VENDOR / licences[0]).read_text()
        assert "Permission is hereby granted" in text or "Apache License" in text, name
