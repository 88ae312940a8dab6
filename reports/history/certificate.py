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
from ...analysis.answer.result import parse_result
from ...analysis.status import known, versions
from ...experiments.history.content import StoredResult
from ...experiments.history.database import Database
from ...experiments.history.signing import ALGORITHM, fingerprint, sign, signature_file
from ...experiments.history.store import results, whole_answer
from ...model.errors import BadInput
from ...model.instruments.registry import kinds_of
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
_OFFSET = ("name", "unit", "status", "held", "estimate", "std", "interval95")
_INTERVALS = ("name", "unit", "linear", "profile", "posterior")


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
    result: StoredResult, answer: Json, fingerprint: str, issued: date, acceptance: Json | None = None
) -> Json:
    """The certificate of a result for the key of this fingerprint; `answer` is the whole result,
    `acceptance` what `read_acceptance` gives.

    BadInput for a misfit, for a fit that did not converge, where no offset is determined, and where something
    else speaks against the result. What the data
    do not determine has no number.
    """
    message = read_message(parse_result(json.dumps(answer)))
    _require_certifiable(result, answer, message)
    offsets = [row for row in answer["parameters"] if row["group"] == "offset"]
    row = to_json(result)
    del row["without_prior"]
    header, fit = answer["inputs"]["header"], answer["fits"]["likelihood"]
    k = answer.get("coverage_factor") or _coverage_factor(offsets)
    content = {
        **row,
        "issued": issued.isoformat(),
        "form": _form(header),
        "vendor": answer["inputs"].get("vendor"),
        "simulated": by_plain_key(header.get("provenance") or {}).get("origin") == SIMULATED,
        "grade": message.grade,
        "headline": answer["headline"],
        "coverage": {"k": k, "probability": 0.95},
        "offsets": [_offset(row, answer["geometry"], k) for row in offsets],
        "not_determined": [row["name"] for row in offsets if row["status"] == "unidentifiable"],
        "intervals": _intervals(answer),
        "as_found": {"tcp": (answer.get("enter") or {}).get("tcp_before")},
        "expected": {"tcp": (answer.get("enter") or {}).get("tcp_after")},
        "as_left": None if acceptance is None else _as_left(acceptance),
        "conformity": answer.get("conformity"),
        "assumed": _assumed(answer),
        "misfit": answer["misfit"],
        "fit": {
            **{key: fit[key] for key in ("rms_mm", "chi2", "dof", "p_value", "noise_scale", "message")},
            "rms_deg": fit.get("rms_deg"),
        },
        "notes": answer["notes"],
        "key": {"algorithm": ALGORITHM, "fingerprint": fingerprint},
        "written_by": versions()["zerobeam"],
    }
    # ISO/IEC 17025:2017, 7.8.2.1 d: no other certificate has it, whether a laboratory numbers them or not.
    digest = sha256(json.dumps(content, sort_keys=True).encode())[:_DIGITS]
    return {
        "schema": SCHEMA,
        "identification": content["form"]["certificate_number"] or f"SHA-256 {digest}",
        **content,
    }


def _require_certifiable(result: StoredResult, answer: Json, message: Message) -> None:
    if message.may.certify:
        return
    of = f"run {result.run}, SHA-256 {result.sha256[:12]}…"
    if result.verdict == "misfit":
        raise BadInput(
            "a misfit is not certified: the model does not describe the measurements",
            found=of,
            allowed="a result with the verdict pass, weak or degenerate",
            remedy="find the cause (zerobeam report), measure again, or name another result by --run",
        )
    converged = answer["fits"]["likelihood"]["converged"]
    if not converged or not any(known(row.status) for row in result.offsets):
        why = "the result determines no offset" if converged else "the fit did not converge"
        raise BadInput(
            f"there is nothing to certify: {why}",
            found=of,
            remedy="measure more postures (zerobeam check says which), or name another result by --run",
        )
    raise BadInput(
        "this result is not certified: something speaks against it",
        found=f"{of}: {message.verdict}",
        allowed="a result that nothing speaks against",
        remedy=message.action.text or "find the cause (zerobeam report), or name another result by --run",
    )


def _form(header: Json) -> Json:
    """What the run's provenance states of laboratory, customer, conditions and instruments; null where it
    states nothing."""
    provenance = by_plain_key(header.get("provenance") or {})
    return {
        **{key: provenance_entry(provenance, KEYS[name]) or None for key, name in CERTIFICATE_KEYS.items()},
        "instruments": [
            {"name": name, "text": provenance_entry(provenance, keys) or None}
            for name, keys in traced(kinds_of(header).values())
        ],
    }


def _coverage_factor(offsets: list[Json]) -> float:
    """k of the 95 % intervals, of a result that does not state it: one for all, since all have the degrees of
    freedom of the fit."""
    row = next(row for row in offsets if known(row["status"]))
    low, high = row["interval95"]
    return float((high - low) / 2 / row["std"])


def _as_left(acceptance: Json) -> Json:
    """The error measured with the corrected robot, and the verdict of the acceptance test."""
    measured = acceptance["measured"]
    provenance = by_plain_key(acceptance["run"].get("provenance") or {})
    return {
        **{key: acceptance[key] for key in ("verdict", "measurements", "dof", "p_value", "false_alarm")},
        "power_required": acceptance["power_required"],
        "error_mm": {key: measured[key] for key in ("before", "after", "noise_mm")},
        "run": acceptance["run"]["file"],
        "sha256": acceptance["run"]["sha256"],
        "measured_on": provenance_entry(provenance, KEYS[DATE]) or None,
    }


def _offset(row: Json, geometry: Json, k: float) -> Json:
    """`expanded` is U = k u; `considered_std` is u if the arm deviates from the nominal geometry that was
    assumed."""
    determined = known(row["status"])
    # What is only as good as an assumption has no number on a certificate, but its reason.
    numbers = {} if row["status"] != "assumed" else dict.fromkeys(("estimate", "std", "interval95"))
    considered = geometry["consider"].get(row["name"]) if geometry["tolerance"] is None else None
    return {
        **{key: row[key] for key in _OFFSET},
        **numbers,
        "expanded": k * row["std"] if determined else None,
        "considered_std": considered if determined else None,
        "reason": row["reason"],
    }


def _intervals(answer: Json) -> list[Json]:
    """Of the offsets whose 95 % interval differs from method to method."""
    offsets = {row["name"] for row in answer["parameters"] if row["group"] == "offset"}
    return [
        {key: row[key] for key in _INTERVALS}
        for row in answer["intervals"]
        if row["name"] in offsets and row["differ"]
    ]


def _assumed(answer: Json) -> Json:
    """What the result rests on besides the measurements."""
    header, geometry = answer["inputs"]["header"], answer["geometry"]
    tool = header.get("tool")
    free = [row for row in answer["parameters"] if not row["held"] and row["group"] != "noise"]
    priors = {(row["group"], row["unit"], row["prior_std"]): None for row in free if row["prior_std"]}
    return {
        "geometry": {key: geometry[key] for key in ("tolerance", "factors", "considered_tolerance")},
        "tool": tool
        and {"kind": tool["kind"], "calibrated": tool.get("calibrated", True), "sigma": tool.get("sigma")},
        "instruments": header.get("instruments") or {},
        "noise": header["noise"],
        "noise_factors": [
            {key: row[key] for key in ("name", "status", "estimate", "std")}
            for row in answer["parameters"]
            if row["group"] == "noise"
        ],
        "priors": [{"group": group, "unit": unit, "std": std} for group, unit, std in priors],
        "held": [row["name"] for row in answer["parameters"] if row["held"]],
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
    result: StoredResult,
    answer: Json,
    key: Ed25519PrivateKey,
    issued: date,
    acceptance: Path | None = None,
) -> str:
    """Write the certificate of a result, signed by `key`; returns the key's fingerprint.

    `answer` is the whole result, `acceptance` the folder of the acceptance test of the corrected robot.
    Raises BadInput where it cannot be certified, or where `folder` is a file, is not ours, or cannot be
    written.
    """
    by = fingerprint(key.public_key())
    verified = None if acceptance is None else read_acceptance(acceptance, result.sha256)
    certificate = certificate_json(result, answer, by, issued, verified)

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
