"""Brings the files of other people's packages that the app's page loads: `python .ci/vendor.py`.

`app/page/vendor/packages.json` says which version of which npm package, the digest of its archive, and which
of its files: npm fetches the archive, what does not have the digest is refused, and the files are written as
they are. `--pin NAME@VERSION` states another version there, with its digest.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

VENDOR = Path(__file__).parents[1] / "app" / "page" / "vendor"
PACKAGES = VENDOR / "packages.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pin", metavar="NAME@VERSION", action="append", default=[])
    packages = json.loads(PACKAGES.read_text())
    for pin in parser.parse_args().pin:
        name, _, version = pin.rpartition("@")
        packages[name] |= {"version": version, "integrity": None}
    for name, package in packages.items():
        archive = fetched(f"{name}@{package['version']}")
        integrity = f"sha512-{base64.b64encode(hashlib.sha512(archive).digest()).decode()}"
        if package["integrity"] not in (None, integrity):
            sys.exit(f"{name}@{package['version']}: its digest is {integrity}, not {package['integrity']}")
        package["integrity"] = integrity
        package["files"] = {
            file: written(archive, source["from"], file) for file, source in package["files"].items()
        }
    PACKAGES.write_text(json.dumps(packages, indent=2) + "\n")


def fetched(package: str) -> bytes:
    """The archive of a package, from the registry that npm is set to."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["npm", "pack", "--silent", package]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        return next(Path(folder).glob("*.tgz")).read_bytes()


def written(archive: bytes, source: str, file: str) -> dict[str, str]:
    """A file of an archive, written below `vendor`: where it is from, and its digest."""
    with tempfile.TemporaryFile() as opened:
        opened.write(archive)
        opened.seek(0)
        with tarfile.open(fileobj=opened) as whole:
            member = whole.extractfile(f"package/{source}")
            assert member is not None, source
            content = member.read()
    (VENDOR / file).parent.mkdir(parents=True, exist_ok=True)
    (VENDOR / file).write_bytes(content)
    return {"from": source, "sha256": hashlib.sha256(content).hexdigest()}


if __name__ == "__main__":
    main()
