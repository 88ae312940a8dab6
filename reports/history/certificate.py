"""The folder of a certificate (`zerobeam/certificate/1`), and whether a history still agrees.

certificate.json has the hashes of the other two files: all are of one result, and none can be exchanged.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ...analysis.answer.result import Result
from ...experiments.history.certified import CERTIFICATE_SCHEMA, CertifiedResult, certificate_of
from ...experiments.history.content import StoredResult
from ...experiments.history.database import Database
from ...experiments.history.signing import fingerprint, sign, signature_file
from ...experiments.history.store import results, whole_answer
from ...model.errors import BadInput
from ...model.records import dumps, it, keys, read, record, to_json
from ..acceptance.acceptance_page import read_acceptance
from ..output.whole_folder import FolderContents, Kind, write_answer
from .certificate_page import SIGNED, certificate_page

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


@record
class SignatureCheck:
    """Whether a file is what it says: by its signature, its certificate.json, or a history."""

    file: str
    check: Literal["signature", "certificate", "history"]
    valid: bool
    reason: Annotated[str | None, it("null where it is valid")]


@record(kw_only=True)
class SignatureChecks:
    """`history verify`."""

    schema: Annotated[Literal["zerobeam/verification/1"], it("kind and version of the document")] = (
        "zerobeam/verification/1"
    )
    fingerprint: Annotated[str, it("of the key")]
    checks: tuple[SignatureCheck, ...]


def read_certificate(content: bytes, file: Path) -> CertifiedResult:
    """The certificate in a file; BadInput for another file."""
    try:
        return read(CertifiedResult, content)
    except ValueError as error:
        raise BadInput(
            "this is not a certificate of zerobeam",
            found=str(error),
            allowed=f"a certificate.json of schema {CERTIFICATE_SCHEMA}",
            file=file,
        ) from None


def why_history_differs(history: Database, certificate: CertifiedResult) -> str | None:
    """None where the history holds the very result that was certified; else what is different."""
    candidates = results(history, (certificate.serial, certificate.model))
    stored = next((row for row in candidates if row.sha256 == certificate.sha256), None)
    if stored is None:
        return "the history has no result of this run and arm"
    if stored.document_sha256 != certificate.document_sha256:
        return "the history has another result of this run: it was replaced or altered since"
    try:
        whole_answer(history, stored)
    except BadInput as error:
        return f"{error.what}: {error.found}"
    differing = [
        one.name
        for one in keys(StoredResult)
        if one.name not in ("offsets", "without_prior")  # of the document that was certified
        and (now := getattr(stored, one.attribute)) is not None
        and now != getattr(certificate, one.attribute)
    ]
    if differing:
        return f"the history was altered: {', '.join(differing)} of the result"
    return None


JSON = "certificate.json"
_KIND = Kind.of_answer(
    "certificate", JSON, CERTIFICATE_SCHEMA, *(signature_file(Path(name)).name for name in SIGNED)
)


def write_certificate(
    folder: Path | str,
    stored: StoredResult,
    result: Result,
    key: Ed25519PrivateKey,
    issued: date,
    acceptance: Path | None = None,
) -> str:
    """Write the certificate of a result, signed by `key`; returns the key's fingerprint.

    `result` is the whole one of the history, `acceptance` the folder of the acceptance test of the corrected
    robot. Raises BadInput where it cannot be certified, or where `folder` is a file, is not ours, or cannot
    be written.
    """
    by = fingerprint(key.public_key())
    verified = None if acceptance is None else read_acceptance(acceptance, stored.sha256)
    certificate = certificate_of(stored, result, by, issued, verified)

    def sign_all(new_folder: Path) -> None:
        beside = {name: sha256((new_folder / name).read_bytes()) for name in SIGNED if name != JSON}
        whole = to_json(replace(certificate, files=beside))
        (new_folder / JSON).write_text(dumps(whole), encoding="utf-8")
        for name in SIGNED:
            sign(new_folder / name, key)

    contents = FolderContents(to_json(certificate), certificate_page(certificate), others=sign_all)
    write_answer(folder, _KIND, contents)
    return by


def sha256(content: bytes) -> str:
    """As `files` of a certificate has it."""
    return hashlib.sha256(content).hexdigest()


def why_not_of_certificate(certificate: CertifiedResult, name: str, content: bytes) -> str | None:
    """None where the certificate has this file by its hash, or none of that name; else what is wrong."""
    files = certificate.files
    if files is None:
        return f"{JSON} does not state the hash of this file: make the certificate again"
    if name in files and files[name] != sha256(content):
        return f"{JSON} is of another file of this name: the two state different results"
    return None


def files_of_certificate(path: Path) -> list[Path]:
    """The signed files of a certificate's folder; the file that a signature is of; another file as it is."""
    if path.is_dir():
        return [path / name for name in SIGNED]
    return [path.with_suffix("") if path.suffix == ".sig" else path]
