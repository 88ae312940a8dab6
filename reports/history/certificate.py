"""A certificate of a result (`zerobeam/certificate/1`), its folder, and whether a history still agrees.

certificate.json has the hashes of the other two files: all are of one result, and none can be exchanged.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from ...analysis.answer.answer_message import Message
from ...analysis.answer.result import Inputs, Result
from ...analysis.observability.geometry_result import GeometryResult
from ...analysis.solution import ParameterResult
from ...analysis.status import known, versions
from ...experiments.acceptance_files import Verified
from ...experiments.history.content import StoredResult
from ...experiments.history.database import Database
from ...experiments.history.signing import ALGORITHM, fingerprint, sign, signature_file
from ...experiments.history.store import results, whole_answer
from ...model.errors import BadInput
from ...model.records import dumps, it, record, to_json
from ...words.message import read_message
from ...words.provenance import (
    CERTIFICATE_KEYS,
    DATE,
    KEYS,
    SIMULATED,
    by_plain_key,
    provenance_entry,
    traced,
)
from ..acceptance.acceptance_folder import read_acceptance
from ..output.whole_folder import FolderContents, Kind, write_answer
from .certificate_page import SIGNED, certificate_page

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

Json = dict[str, Any]  # of a result.json, or of a certificate
SCHEMA = "zerobeam/certificate/1"
_DIGITS = 16  # hexadecimal, of an identification


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


def certificate_json(
    stored: StoredResult, result: Result, fingerprint: str, issued: date, acceptance: Verified | None = None
) -> Json:
    """The certificate of a result for the key of this fingerprint; `result` is the whole one of the history.

    BadInput for a misfit, for a fit that did not converge, where no offset is determined, and where something
    else speaks against the result. What the data do not determine has no number.
    """
    message = read_message(result)
    _require_certifiable(stored, result, message)
    fit, geometry, entered = result.likelihood, result.geometry, result.enter
    k = result.coverage_factor or _coverage_factor(result)
    row = to_json(stored)
    del row["without_prior"]
    content = {
        **row,
        "issued": issued.isoformat(),
        "form": _form(result.inputs),
        "vendor": result.inputs.vendor,
        "simulated": by_plain_key(result.inputs.provenance).get("origin") == SIMULATED,
        "grade": message.grade,
        "headline": result.headline,
        "coverage": {"k": k, "probability": 0.95},
        "offsets": [_offset(row, geometry, k) for row in result.offsets],
        "not_determined": [row.name for row in result.offsets if row.status == "unidentifiable"],
        "intervals": _intervals(result),
        "as_found": {"tcp": entered and entered.tcp_before},
        "expected": {"tcp": entered and entered.tcp_after},
        "as_left": None if acceptance is None else _as_left(acceptance),
        "conformity": result.conformity,
        "assumed": _assumed(result),
        "misfit": result.misfit,
        "fit": _of(fit, "rms_mm", "chi2", "dof", "p_value", "noise_scale", "message", "rms_deg"),
        "notes": result.notes,
        "key": {"algorithm": ALGORITHM, "fingerprint": fingerprint},
        "written_by": versions()["zerobeam"],
    }
    content = to_json(content)
    # ISO/IEC 17025:2017, 7.8.2.1 d: no other certificate has it, whether a laboratory numbers them or not.
    digest = sha256(json.dumps(content, sort_keys=True).encode())[:_DIGITS]
    return {
        "schema": SCHEMA,
        "identification": content["form"]["certificate_number"] or f"SHA-256 {digest}",
        **content,
    }


def _of(answer: object, *names: str) -> dict[str, object]:
    return {name: getattr(answer, name) for name in names}


def _require_certifiable(stored: StoredResult, result: Result, message: Message) -> None:
    """BadInput where its message does not allow it, or its own rows do not, whatever its message says."""
    of = f"run {stored.run}, SHA-256 {stored.sha256[:12]}…"
    if result.verdict == "misfit":
        raise BadInput(
            "a misfit is not certified: the model does not describe the measurements",
            found=of,
            allowed="a result with the verdict pass, weak or degenerate",
            remedy="find the cause (zerobeam report), measure again, or name another result by --run",
        )
    converged = result.likelihood.converged
    if not converged or not any(known(row.status) for row in result.offsets):
        why = "the result determines no offset" if converged else "the fit did not converge"
        raise BadInput(
            f"there is nothing to certify: {why}",
            found=of,
            remedy="measure more postures (zerobeam check says which), or name another result by --run",
        )
    if not message.may.certify:
        raise BadInput(
            "this result is not certified: something speaks against it",
            found=f"{of}: {message.verdict}",
            allowed="a result that nothing speaks against",
            remedy=message.action.text or "find the cause (zerobeam report), or name another result by --run",
        )


def _form(inputs: Inputs) -> Json:
    """What the run's provenance states of laboratory, customer, conditions and instruments; null where it
    states nothing."""
    provenance = by_plain_key(inputs.provenance)
    return {
        **{key: provenance_entry(provenance, KEYS[name]) or None for key, name in CERTIFICATE_KEYS.items()},
        "instruments": [
            {"name": name, "text": provenance_entry(provenance, keys) or None}
            for name, keys in traced(inputs.instruments.values())
        ],
    }


def _coverage_factor(result: Result) -> float:
    """k of the 95 % intervals, of a result that does not state it: one for all, since all have the degrees of
    freedom of the fit."""
    row = next(row for row in result.offsets if known(row.status))
    assert row.interval95 is not None
    assert row.std is not None
    low, high = row.interval95
    return (high - low) / 2 / row.std


def _as_left(acceptance: Verified) -> Json:
    """The error measured with the corrected robot, and the verdict of the acceptance test."""
    run = acceptance.run
    return {
        **_of(acceptance, "verdict", "measurements", "dof", "p_value", "false_alarm", "power_required"),
        "error_mm": _of(acceptance.measured, "before", "after", "noise_mm"),
        "run": run.file,
        "sha256": run.sha256,
        "measured_on": provenance_entry(by_plain_key(run.provenance), KEYS[DATE]) or None,
    }


def _offset(row: ParameterResult, geometry: GeometryResult, k: float) -> Json:
    """`expanded` is U = k u; `considered_std` is u if the arm deviates from the nominal geometry that was
    assumed."""
    # What is only as good as an assumption has no number on a certificate, but its reason.
    numbers = {} if row.status != "assumed" else dict.fromkeys(("estimate", "std", "interval95"))
    considered = geometry.consider.get(row.name) if geometry.tolerance is None else None
    determined = known(row.status) and row.std is not None
    return {
        **_of(row, "name", "unit", "status", "held", "estimate", "std", "interval95"),
        **numbers,
        "expanded": k * row.std if determined and row.std is not None else None,
        "considered_std": considered if determined else None,
        "reason": row.reason,
    }


def _intervals(result: Result) -> list[Json]:
    """Of the offsets whose 95 % interval differs from method to method."""
    offsets = {row.name for row in result.offsets}
    return [
        _of(row, "name", "unit", "linear", "profile", "posterior")
        for row in result.intervals
        if row.name in offsets and row.differ
    ]


def _assumed(result: Result) -> Json:
    """What the result rests on besides the measurements."""
    header, rows = result.inputs.header, result.parameters
    tool: Any = header.get("tool")
    free = [row for row in rows if not row.held and row.group != "noise"]
    priors = {(row.group, row.unit, row.prior_std): None for row in free if row.prior_std}
    return {
        "geometry": _of(result.geometry, "tolerance", "factors", "considered_tolerance"),
        "tool": tool
        and {"kind": tool["kind"], "calibrated": tool.get("calibrated", True), "sigma": tool.get("sigma")},
        "instruments": header.get("instruments") or {},
        "noise": header["noise"],
        "noise_factors": [
            _of(row, "name", "status", "estimate", "std") for row in rows if row.group == "noise"
        ],
        "priors": [{"group": group, "unit": unit, "std": std} for group, unit, std in priors],
        "held": [row.name for row in rows if row.held],
        "tolerance": header.get("tolerance"),
    }


def read_certificate(content: bytes, file: Path) -> Json:
    """The certificate in a file; BadInput for another file."""
    try:
        certificate = json.loads(content)
        if certificate["schema"] != SCHEMA:
            raise ValueError(f"schema {certificate['schema']!r}")
        for name in ("serial", "model", "sha256", "document_sha256"):
            if not isinstance(certificate[name], str):
                raise ValueError(f"{name} is no text")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise BadInput(
            "this is not a certificate of zerobeam",
            found=f"{type(error).__name__}: {error}",
            allowed=f"a certificate.json of schema {SCHEMA}",
            file=file,
        ) from None
    return dict(certificate)


def why_history_differs(history: Database, certificate: Json) -> str | None:
    """None where the history holds the very result that was certified; else what is different."""
    candidates = results(history, (certificate["serial"], certificate["model"]))
    stored = next((row for row in candidates if row.sha256 == certificate["sha256"]), None)
    if stored is None:
        return "the history has no result of this run and arm"
    if stored.document_sha256 != certificate["document_sha256"]:
        return "the history has another result of this run: it was replaced or altered since"
    try:
        whole_answer(history, stored)
    except BadInput as error:
        return f"{error.what}: {error.found}"
    now = to_json(stored)
    del now["offsets"], now["without_prior"]  # of the document that was certified
    differing = [name for name, value in now.items() if certificate.get(name) != value]
    if differing:
        return f"the history was altered: {', '.join(differing)} of the result"
    return None


JSON = "certificate.json"
_KIND = Kind.of_answer("certificate", JSON, SCHEMA, *(signature_file(Path(name)).name for name in SIGNED))


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
    certificate = certificate_json(stored, result, by, issued, verified)

    def sign_all(new_folder: Path) -> None:
        beside = {name: sha256((new_folder / name).read_bytes()) for name in SIGNED if name != JSON}
        (new_folder / JSON).write_text(dumps({**certificate, "files": beside}), encoding="utf-8")
        for name in SIGNED:
            sign(new_folder / name, key)

    contents = FolderContents(certificate, certificate_page(certificate), others=sign_all)
    write_answer(folder, _KIND, contents)
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


def files_of_certificate(path: Path) -> list[Path]:
    """The signed files of a certificate's folder; the file that a signature is of; another file as it is."""
    if path.is_dir():
        return [path / name for name in SIGNED]
    return [path.with_suffix("") if path.suffix == ".sig" else path]
