"""What the certificate of a result states (`zerobeam/certificate/1`), and whether a history still agrees."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ...analysis.status import known, versions
from ...experiments.history.database import Database
from ...experiments.history.one_result import whole_answer
from ...experiments.history.signing import ALGORITHM
from ...experiments.history.store import StoredResult, results
from ...model.errors import BadInput
from ...words.provenance import SIMULATED, by_plain_key
from .lists import result_json

SCHEMA = "zerobeam/certificate/1"
_OFFSET = ("name", "unit", "status", "held", "estimate", "std", "interval95")
_INTERVALS = ("name", "unit", "linear", "profile", "posterior")


def certificate_json(own: StoredResult, answer: dict[str, Any], fingerprint: str) -> dict[str, Any]:
    """The certificate of a result for the key of this fingerprint; `answer` is the whole result.

    BadInput for a misfit, for a fit that did not converge, and where no offset is determined. What the data
    do not determine has no number.
    """
    _require_certifiable(own, answer)
    offsets = [row for row in answer["parameters"] if row["group"] == "offset"]
    stated = result_json(own)
    del stated["without_prior"]
    header, fit = answer["inputs"]["header"], answer["fits"]["likelihood"]
    return {
        "schema": SCHEMA,
        **stated,
        "vendor": answer["inputs"].get("vendor"),
        "simulated": by_plain_key(header.get("provenance") or {}).get("origin") == SIMULATED,
        "headline": answer["headline"],
        "offsets": [_offset(row, answer["geometry"]) for row in offsets],
        "not_determined": [row["name"] for row in offsets if row["status"] == "unidentifiable"],
        "intervals": _intervals(answer),
        "assumed": _assumed(answer),
        "misfit": answer["misfit"],
        "fit": {key: fit[key] for key in ("rms_mm", "chi2", "dof", "p_value", "noise_scale", "message")},
        "notes": answer["notes"],
        "key": {"algorithm": ALGORITHM, "fingerprint": fingerprint},
        "written_by": versions()["zerobeam"],
    }


def _require_certifiable(own: StoredResult, answer: dict[str, Any]) -> None:
    of = f"run {own.run}, SHA-256 {own.sha256[:12]}…"
    if own.verdict == "misfit":
        raise BadInput(
            "a misfit is not certified: the model does not describe the measurements",
            found=of,
            allowed="a result with the verdict pass, weak or degenerate",
            remedy="find the cause (zerobeam report), measure again, or name another result by --run",
        )
    converged = answer["fits"]["likelihood"]["converged"]
    if not converged or not any(known(row["status"]) for row in own.offsets):
        why = "the result determines no offset" if converged else "the fit did not converge"
        raise BadInput(
            f"there is nothing to certify: {why}",
            found=of,
            remedy="measure more postures (zerobeam check says which), or name another result by --run",
        )


def _offset(row: dict[str, Any], geometry: dict[str, Any]) -> dict[str, Any]:
    """`considered_std` is the uncertainty if the arm deviates from the nominal geometry that was assumed."""
    determined = known(row["status"])
    considered = geometry["consider"].get(row["name"]) if geometry["tolerance"] is None else None
    return {
        **{key: row[key] for key in _OFFSET},
        "considered_std": considered if determined else None,
        "reason": row["reason"],
    }


def _intervals(answer: dict[str, Any]) -> list[dict[str, Any]]:
    """Of the offsets whose 95 % interval differs from method to method."""
    offsets = {row["name"] for row in answer["parameters"] if row["group"] == "offset"}
    return [
        {key: row[key] for key in _INTERVALS}
        for row in answer["intervals"]
        if row["name"] in offsets and row["differ"]
    ]


def _assumed(answer: dict[str, Any]) -> dict[str, Any]:
    """What the result rests on besides the measurements."""
    header, geometry = answer["inputs"]["header"], answer["geometry"]
    free = [row for row in answer["parameters"] if not row["held"] and row["group"] != "noise"]
    priors = {(row["group"], row["unit"], row["prior_std"]): None for row in free if row["prior_std"]}
    return {
        "geometry": {key: geometry[key] for key in ("tolerance", "factors", "considered_tolerance")},
        "tool": {
            "kind": header["tool"]["kind"],
            "calibrated": header["tool"].get("calibrated", True),
        },
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


def read_certificate(content: bytes, file: Path) -> dict[str, Any]:
    """The certificate in a file; BadInput for another file."""
    try:
        found = json.loads(content)
        if found["schema"] != SCHEMA:
            raise ValueError(f"schema {found['schema']!r}")
        for name in ("serial", "model", "sha256", "document_sha256"):
            if not isinstance(found[name], str):
                raise ValueError(f"{name} is no text")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise BadInput(
            "this is not a certificate of zerobeam",
            found=f"{type(error).__name__}: {error}",
            allowed=f"a certificate.json of schema {SCHEMA}",
            file=file,
        ) from None
    return dict(found)


def why_history_differs(history: Database, certificate: dict[str, Any]) -> str | None:
    """None where the history holds the very result that was certified; else what is different."""
    found = results(history, (certificate["serial"], certificate["model"]))
    own = next((row for row in found if row.sha256 == certificate["sha256"]), None)
    if own is None:
        return "the history has no result of this run and arm"
    if own.document_sha256 != certificate["document_sha256"]:
        return "the history has another result of this run: it was replaced or altered since"
    try:
        whole_answer(history, own)
    except BadInput as error:
        return f"{error.what}: {error.found}"
    now = result_json(own)
    del now["offsets"], now["without_prior"]  # of the document that was certified
    differing = [name for name, value in now.items() if certificate.get(name) != value]
    if differing:
        return f"the history was altered: {', '.join(differing)} of the result"
    return None
