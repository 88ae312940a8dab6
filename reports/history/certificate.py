"""A certificate (`zerobeam/certificate/1`): its page, its folder, and whether a history still agrees.

The page has the offsets, what they rest on, who signed and what that says. certificate.json has the hashes of
the other two files: all are of one result, and none can be exchanged.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ...analysis.answer.result import Result
from ...experiments.history.certified import CERTIFICATE_SCHEMA, CertifiedResult, certificate_of
from ...experiments.history.database import Database
from ...experiments.history.signing import fingerprint, sign, signature_file
from ...experiments.history.store import results, whole_answer
from ...experiments.history.stored_result import StoredResult
from ...model.errors import BadInput
from ...model.records import dumps, it, keys, read, record, to_json
from ..acceptance.acceptance_page import read_acceptance
from ..output.whole_folder import FolderContents, Kind, write_answer

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


import re
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC
from typing import Any

from ...analysis.acceptance.acceptance import ErrorSize
from ...analysis.answer.result import LikelihoodSummary
from ...analysis.diagnostics.values_to_enter import TcpError
from ...analysis.estimation.tolerance_factors import Factors
from ...analysis.observability.geometry_result import LinkTolerances
from ...analysis.posterior.intervals import Intervals
from ...experiments.history.certified import (
    Assumed,
    AssumedTool,
    Certificate,
    CertifiedOffset,
    Prior,
    SigningKey,
)
from ...experiments.history.signing import grouped
from ...words import numbers
from ...words.acceptance_words import ACCEPTANCE_WORDS, RULE
from ...words.entries import VERDICT_WORDS
from ...words.geometry_words import tolerance_words
from ...words.numbers import unit_of
from ...words.provenance import CERTIFICATE_KEYS, DATE, OPERATOR
from ...words.region_words import region_words
from ...words.wording import (
    NOT_DETERMINED,
    clipped,
    counted,
    ended,
    label,
    listed,
    sentence,
    shown,
    status_words,
)
from ..run.inputs import flat
from ..run.parameter_section import NO_NUMBER, OFFSETS, legend
from ..style.blocks import (
    Block,
    Cell,
    Commands,
    Facts,
    Form,
    Legend,
    LegendEntry,
    Page,
    Paragraph,
    Row,
    Table,
    Verdict,
    row_of,
    section_of,
    table_of,
)

JSON = "certificate.json"
SIGNED = (JSON, "certificate.html", "certificate.pdf")


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


_NOT_STATED = "not stated"
_IF_IT_DEVIATES = "U, incl. geometry tolerances"
_MEANING = (
    "A valid signature says that the holder of this key signed exactly these bytes. It does not say that the"
    " measurements are right, nor who the holder is: compare the fingerprint with the one that"
    " the signer gives you."
)
_GROUPS = {
    "offset": "offsets",
    "target": "targets",
    "tool": "tool",
    "frame": "frames",
    "geometry": "link geometry",
}


def certificate_page(certificate: Certificate) -> Page:
    """The display strings of a certificate (`zerobeam/certificate/1`)."""
    item = f"{clipped(certificate.model)}, serial number {clipped(certificate.serial, 60)}"
    return Page(
        "Certificate of calibration",
        f"No. {clipped(certificate.identification, 40)}, {item}",
        Verdict(
            certificate.grade or "held",
            VERDICT_WORDS[certificate.verdict],
            _named(certificate.result.headline or ""),
        ),
        list(_notes(certificate)),
        [
            section_of("Identification", Form(list(_identified(certificate)), ("Signature",))),
            section_of("Offsets", *_offsets(certificate)),
            section_of("As found and as left", Facts(list(_found_and_left(certificate)))),
            section_of("Method, traceability and decision rule", Facts(list(_statements(certificate)))),
            section_of(
                "What the offsets rest on",
                Facts(list(_assumed(certificate))),
            ),
            section_of("Fit", Paragraph(_fit(certificate.result.likelihood))),
            section_of("Origin", Facts(_origin(certificate))),
            section_of("Signature by key", *_signature(certificate.signing_key)),
        ],
    )


def _named(text: str) -> str:
    """A sentence of a result, with the offsets' names as people write them."""
    return sentence(re.sub(r"\bdelta\d+\b", lambda match: label(match.group()), text))


def _notes(certificate: Certificate) -> Iterator[str]:
    if certificate.simulated:
        yield "These measurements were simulated: no instrument took part, and nothing here is traceable."
    if certificate.not_determined:
        names = listed([label(name) for name in certificate.not_determined])
        yield f"Not determined by these measurements and not certified: {names}."
    for note in certificate.result.notes or ():
        yield ended(_named(note))


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def _identified(certificate: Certificate) -> Iterator[tuple[str, str]]:
    """What ISO/IEC 17025:2017, 7.8.2 asks for, two in a row; "" where nobody has stated it."""
    form = certificate.form

    def entry(key: str) -> tuple[str, str]:
        return CERTIFICATE_KEYS[key], getattr(form, key) or ""

    robot = ", ".join(shown(text) for text in (certificate.model, certificate.vendor) if text)
    yield CERTIFICATE_KEYS["certificate_number"], certificate.identification
    yield "Date of issue", certificate.issued
    yield entry("laboratory")
    yield entry("customer")
    yield entry("laboratory_address")
    yield entry("customer_address")
    yield "Item calibrated", robot
    yield "Serial number", shown(certificate.serial)
    yield DATE, f"{certificate.measured_at:%Y-%m-%d}"
    yield entry("place")
    instruments = [(row.name, row.text or "") for row in form.instruments]
    if instruments and certificate.instrument and not any(text for _, text in instruments):
        instruments[0] = (instruments[0][0], shown(certificate.instrument))
    yield from instruments
    yield entry("temperature")
    yield entry("payload")
    yield entry("warm_up")
    yield OPERATOR, shown(certificate.operator or "")
    yield entry("authorised_by")


def _found_and_left(certificate: Certificate) -> Iterator[tuple[str, str]]:
    """The robot before and after; as left alone what was measured with the corrected robot."""
    tcp, left = certificate.as_found.tcp, certificate.as_left
    region = region_words(certificate.region)
    yield (
        "As found",
        ended(f"The offsets above{'' if tcp is None else f'; error of the TCP {region}: {_tcp(tcp)}'}"),
    )
    if (expected := certificate.expected.tcp) is not None:
        yield (
            "Expected as left",
            f"Error of the TCP {region}: {_tcp(expected)}, once the values to enter are in the"
            " controller: predicted, not measured.",
        )
    if left is None:
        yield "As left", "Not measured for this certificate: ______________________________"
        return
    test, error = left.test, left.test.measured
    before = "" if error.before is None else f" ({_size(error.before)} as found, at the same postures)"
    on = f" on {shown(left.measured_on)}" if left.measured_on else ""
    yield (
        "As left",
        f"{ACCEPTANCE_WORDS[test.verdict]}: error {_size(error.after)}{before}, measured"
        f"{on} with {counted(test.measurements, 'measurement')} of the corrected robot; the noise of a"
        f" measurement is {numbers.significant(error.noise_mm, 2, 'mm')}.",
    )
    yield "Verification run", f"{shown(left.run)}, SHA-256 {left.sha256}"


def _tcp(error: TcpError) -> str:
    median, p95 = (numbers.significant(mm, 2, "mm") for mm in (error.median_mm, error.p95_mm))
    return f"{median} in the median posture, within {p95} in 95\u00a0% of them"


def _size(error: ErrorSize) -> str:
    rms, worst = (numbers.significant(mm, 2, "mm") for mm in (error.rms_mm, error.worst_mm))
    return f"{rms} rms, worst {worst}"


def _statements(certificate: Certificate) -> Iterator[tuple[str, str]]:
    kinds = certificate.result.inputs.instruments.values()
    methods = listed(list(dict.fromkeys(kind.words.method for kind in kinds)))
    paper = "Gao, Liu, Xi, Shen 2014; " if any(kind.beam for kind in kinds) else ""
    only_met = " No distance or pose was measured independently." if all(kind.met for kind in kinds) else ""
    yield (
        "Method",
        f"The offsets are estimated from {certificate.shots} measurements with {methods}, with what is"
        f" listed below as prior ({paper}zerobeam"
        f" {shown(certificate.made_by)}).{only_met}",
    )
    yield "Traceability", _traceability(certificate)
    yield "Decision rule", " ".join(_rules(certificate))
    yield (
        "Validity",
        "The results relate only to the item named above, and to its condition at the time of the"
        " measurements.",
    )


def _traceability(certificate: Certificate) -> str:
    form = certificate.form
    if certificate.simulated:
        return "None: the measurements were simulated."
    if form.traceability:
        return shown(form.traceability)
    certificates = [row.name for row in form.instruments if row.text and "certificate" in row.name]
    if not certificates:
        return "Not shown: no calibration certificate of an instrument is stated."
    return (
        f"By the certificates that the laboratory has stated ({listed(certificates)}, first page); zerobeam"
        " has not seen them."
    )


def _rules(certificate: Certificate) -> Iterator[str]:
    conformity, left = certificate.result.conformity, certificate.as_left
    if conformity is None:
        yield "No requirement was stated: no statement of conformity is made."
    else:
        required, probability = conformity.required_mm, numbers.p_value(conformity.probability)
        yield (
            f"Required at the TCP: {numbers.exact(required, 'mm')} in 95\u00a0% of the postures"
            f" {region_words(certificate.region)}. Decision: {conformity.decision} (probability"
            f" {probability}). Rule: {ended(conformity.rule)}"
        )
    if left is not None:
        yield f"Acceptance test: {RULE}"


def _offsets(certificate: Certificate) -> Iterator[Block]:
    rows, geometry, k = certificate.offsets, certificate.result.geometry, certificate.k
    nominal = geometry.tolerance is None
    heads = [
        "name",
        "estimate",
        f"U ({numbers.coverage(k)})",
        *([_IF_IT_DEVIATES] if nominal else []),
        "status",
    ]
    aligned = "lrrrl" if nominal else "lrrl"
    yield table_of(OFFSETS, heads, [_offset(row, nominal, k) for row in rows], aligned)
    yield Paragraph(
        f"U is the expanded uncertainty, the standard uncertainty times {numbers.coverage(k)}: estimate ± U"
        " holds the offset with a probability of about 95 % (JCGM 100)."
    )
    if nominal:
        yield Paragraph(
            "U holds if the arm has its nominal geometry. U incl. geometry tolerances has the same"
            f" k and links that deviate by {_tolerances(geometry.considered_tolerance)}."
        )
    if certificate.intervals:
        yield _intervals(certificate.intervals)
    grouped_by: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.reason:
            grouped_by.setdefault((row.status, row.reason), []).append(label(row.name))
    reasons = [
        LegendEntry(key, f"{listed(names)}:", _named(text)) for (key, text), names in grouped_by.items()
    ]
    yield Legend(legend((row.status for row in rows), certificate.result.inputs.header), reasons)


def _offset(row: CertifiedOffset, nominal: bool, k: float) -> Row:
    """One offset. What is not determined has no number in its row."""
    status, unit, name = row.status, unit_of(row.unit), label(row.name)
    word, more = Cell(status_words(status), mark=status), [NO_NUMBER] if nominal else []
    if row.expanded is None or row.estimate is None:
        withheld = "assumed: no value is certified" if row.status == "assumed" else NOT_DETERMINED
        text = f"held {_held_at(row)}" if row.held else withheld
        return row_of(name, Cell(text, span=2), *more, word, tone=status)
    if nominal and row.considered_std is not None:
        more = [numbers.spread(k * row.considered_std, unit)]
    return row_of(
        name,
        numbers.estimate(row.estimate, row.expanded, unit),
        numbers.spread(row.expanded, unit),
        *more,
        word,
        tone=status,
    )


def _intervals(rows: Iterable[Intervals]) -> Table:
    heads = ("name", "curvature at the mode", "profile likelihood", "posterior")
    return table_of(
        "95 % intervals by three methods, where they differ",
        heads,
        [row_of(label(row.name), *_ends(row)) for row in rows],
    )


def _ends(row: Intervals) -> Iterator[str]:
    """By each method."""
    (low, high), unit = row.linear, unit_of(row.unit)
    for bounds in (row.linear, row.profile, row.posterior):
        yield NO_NUMBER if bounds is None else numbers.interval(bounds, (high - low) / 4, unit)


def _assumed(certificate: Certificate) -> Iterator[tuple[str, str]]:
    assumed, geometry = certificate.assumed, certificate.result.geometry
    tool, noise = assumed.tool, assumed.noise
    if geometry.tolerance is not None:
        within = f"estimated within tolerances of {_tolerances(geometry.tolerance)}"
        yield "Geometry", f"{within}{_factors(geometry.factors)}"
    else:
        yield "Geometry", "nominal, taken as the robot file states it"
    if tool:
        yield "Tool", f"{tool.kind}, {_tool(tool)}"
    for name, entry in assumed.instruments.items():
        facts = [f"{key} {text}" for key, text in flat(entry) if key != "kind"]
        yield f"Instrument {clipped(name, 24)}", f"{shown(entry['kind'])}: {', '.join(facts)}"
    spot = {} if tool else {"spot_mm": None}
    yield "Noise (standard deviation)", f"{_noise({**noise, **spot})}; {_scale(assumed)}"
    yield "Priors (standard deviation)", "; ".join(_priors(assumed.priors)) or "none"
    held_at = {row.name: _held_at(row) for row in certificate.offsets if row.held}
    held = [f"{label(name)} {held_at.get(name, '')}".rstrip() for name in assumed.held]
    yield "Held, not estimated", listed(held) if held else "nothing"


def _tool(tool: AssumedTool) -> str:
    if not tool.calibrated:
        return "estimated"
    sigma = [
        tolerance_words(value, "deg" if key.endswith("deg") else "mm")
        for key, value in (tool.sigma or {}).items()
        if value is not None
    ]
    return f"calibrated: estimated within {' and '.join(sigma)}" if sigma else "calibrated: taken as stated"


def _tolerances(links: LinkTolerances) -> str:
    return f"{tolerance_words(links.length_mm, 'mm')} and {tolerance_words(links.angle_deg, 'deg')}"


def _factors(factors: Factors | None) -> str:
    if factors is None:
        return ""
    parts = [f"{numbers.significant(factor, 2)} ({kind})" for kind, factor in factors.by_kind().items()]
    return f", which the data multiply by {listed(parts)}"


def _priors(rows: Iterable[Prior]) -> Iterator[str]:
    for group in dict.fromkeys(row.group for row in rows):
        stds = [_rounded(row.std, unit_of(row.unit)) for row in rows if row.group == group]
        yield f"{_GROUPS.get(group, group)} {listed(stds)}"


def _rounded(std: float, unit: str) -> str:
    """As it was stated; to three digits where the data have multiplied it."""
    return numbers.exact(float(f"{std:.3g}"), unit)


def _held_at(row: CertifiedOffset) -> str:
    return f"at {numbers.exact(row.estimate or 0.0, unit_of(row.unit))}"


def _noise(noise: Mapping[str, Any]) -> str:
    parts = []
    for key, what, unit in (
        ("joint_deg", "joints", "deg"),
        ("joint_mm", "prismatic joints", "mm"),
        ("spot_mm", "spot", "mm"),
    ):
        if noise.get(key) is not None:
            parts.append(f"{what} {tolerance_words(noise[key], unit)}")
    return ", ".join(parts)


def _scale(assumed: Assumed) -> str:
    scale, rows = assumed.noise.get("scale", "known"), assumed.noise_factors
    if scale == "known":
        return "taken as stated"
    if scale == "estimated" and not rows:
        return "estimated up to one factor"
    factors = [
        f"{clipped(row.name)} {NOT_DETERMINED}"
        if row.estimate is None or row.std is None
        else f"{clipped(row.name)} {numbers.estimate(row.estimate, row.std)}"
        for row in rows
    ]
    count = "two" if len(factors) == 2 else str(len(factors))
    return f"estimated up to {count} factors: {', '.join(factors)}"


def _fit(fit: LikelihoodSummary) -> str:
    rms = numbers.length_and_angle(fit.rms_mm, fit.rms_deg)
    parts = [f"Residuals {rms} rms, {fit.dof} degrees of freedom."]
    if fit.noise_scale is not None:
        parts.append(f"The noise is {numbers.times(fit.noise_scale)} times the stated one.")
    if fit.p_value is not None:
        chi2 = numbers.significant(fit.chi2)
        parts.append(f"χ²\u00a0{chi2}, p-value {numbers.p_value(fit.p_value)} for the stated noise.")
    parts.append("No misfit was found.")
    if fit.message:
        parts.append(ended(f"{fit.message[0].upper()}{fit.message[1:]}"))
    return " ".join(parts)


def _origin(certificate: Certificate) -> list[tuple[str, str]]:
    return [
        ("Robot", ", ".join(shown(text) for text in (certificate.model, certificate.vendor) if text)),
        ("Serial number", shown(certificate.serial)),
        ("Measured at", certificate.measured_at.replace(tzinfo=UTC).isoformat()),
        ("Instrument", shown(certificate.instrument or _NOT_STATED)),
        ("Calibrated by", shown(certificate.operator or _NOT_STATED)),
        ("Run", f"{shown(certificate.run)}, {certificate.shots} measurements"),
        ("SHA-256 of the run", certificate.sha256),
        ("SHA-256 of the whole result", certificate.document_sha256),
        ("zerobeam", f"{shown(certificate.made_by)} (result), {certificate.written_by} (certificate)"),
    ]


def _signature(key: SigningKey) -> Iterator[Block]:
    yield Paragraph(f"{listed(list(SIGNED))} are signed, each in a file .sig beside it. {_MEANING}")
    yield Facts([("Key", key.algorithm), ("Fingerprint (SHA-256)", grouped(key.fingerprint))])
    yield Paragraph("Either command verifies a file:")
    yield Commands(
        (
            "zerobeam history verify certificate.pdf --key PUBLIC_KEY",
            "openssl pkeyutl -verify -pubin -inkey PUBLIC_KEY -rawin \\",
            "  -in certificate.pdf -sigfile certificate.pdf.sig",
        )
    )
