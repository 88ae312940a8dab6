"""The folder of a certificate: certificate.json, .html, .pdf and their signatures; whole or not at all.

certificate.json has the hashes of the other two: the three are of one result, and none can be exchanged.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...experiments.history.signing import fingerprint, sign, signature_file
from ...experiments.history.store import StoredResult
from ...words.result_json import dumps
from ..output.whole_folder import Kind, write_folder, write_page
from .certificate import SCHEMA, certificate_json
from .certificate_page import SIGNED, certificate_page

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

JSON = "certificate.json"
_NAMES = [Path(name) for name in SIGNED]
_KIND = Kind(
    "certificate", frozenset({*SIGNED, *(signature_file(name).name for name in _NAMES)}), JSON, SCHEMA
)


def write_certificate(
    folder: Path | str, own: StoredResult, answer: dict[str, Any], key: Ed25519PrivateKey
) -> str:
    """Write the certificate of a result, signed by `key`; returns the key's fingerprint.

    `answer` is the whole result. Raises BadInput where it cannot be certified, or where `folder` is a file,
    is not ours, or cannot be written.
    """
    by = fingerprint(key.public_key())
    found = certificate_json(own, answer, by)

    def fill(aside: Path) -> None:
        write_page(aside, "certificate", certificate_page(found), {}, "study", answer=(JSON, dumps(found)))
        (aside / "figures").rmdir()  # there is none
        beside = {name: sha256((aside / name).read_bytes()) for name in SIGNED if name != JSON}
        (aside / JSON).write_text(dumps({**found, "files": beside}), encoding="utf-8")
        for name in SIGNED:
            sign(aside / name, key)

    write_folder(folder, _KIND, fill)
    return by


def sha256(content: bytes) -> str:
    """As `files` of a certificate has it."""
    return hashlib.sha256(content).hexdigest()


def why_not_of_certificate(certificate: Mapping[str, Any], name: str, content: bytes) -> str | None:
    """None where the certificate has this file by its hash, or none of that name; else what is wrong."""
    files = certificate.get("files")
    if not isinstance(files, Mapping):
        return f"{JSON} does not state the hash of this file: make the certificate again"
    if name in files and files[name] != sha256(content):
        return f"{JSON} is of another file of this name: the two state different results"
    return None


def files_of_certificate(given: Path) -> list[Path]:
    """The signed files of a certificate's folder; the file that a signature is of; another file as it is."""
    if given.is_dir():
        return [given / name for name in SIGNED]
    return [given.with_suffix("") if given.suffix == ".sig" else given]
