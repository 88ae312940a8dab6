"""A certificate (`zerobeam/certificate/1`): its page, its folder, and whether a history still agrees.

The page has the offsets, what they rest on, who signed and what that says. certificate.json has the hashes of
the other two files: all are of one result, and none can be exchanged.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ...analysis.acceptance import ErrorSize
from ...analysis.answer.result import LikelihoodSummary, Result
from ...analysis.diagnostics.values_to_enter import Entered, TcpError
from ...analysis.solution import ParameterResult
from ...experiments.history.certified import (
    ALGORITHM,
    CERTIFICATE_SCHEMA,
    Certificate,
    CertifiedResult,
    certificate_of,
    fingerprint,
    grouped,
    sign,
    signature_file,
)
from ...experiments.history.database import Database
from ...experiments.history.store import results, whole_answer
from ...experiments.history.stored_result import StoredResult
from ...model.errors import BadInput
from ...model.records import dumps, it, keys, read, record, to_json
from ...words import numbers
from ...words.controllers import taken_by
from ...words.enter import ACCEPTANCE_WORDS, RULE, conformity_sentence
from ...words.entries import VERDICT_WORDS, said_word
from ...words.finding_words import small_residuals
from ...words.geometry_words import factors_sentence, tolerances_words
from ...words.numbers import unit_of
from ...words.outlook_words import region_words
from ...words.provenance import CERTIFICATE_KEYS, DATE, OPERATOR, left_out
from ...words.wording import clipped, counted, ended, joints, label, listed, sentence, shown
from ..acceptance_page import read_acceptance
from ..output.whole_folder import FolderContents, Kind, write_answer
from ..run.fit_section import intervals_table
from ..run.inputs import settings
from ..run.parameter_section import NO_NUMBER, legend, offsets_table_of, parameter_table
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
    Verdict,
    row_of,
    section_of,
)
from .history_tables import with_labels

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

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
        return "the history has another document of this run: it was solved again, replaced or altered"
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


_WITHHELD = "assumed: no value is certified"
_MEANING = (
    "A valid signature says that the holder of this key signed exactly these bytes. It does not say that the"
    " measurements are right, nor who the holder is: compare the fingerprint with the one that"
    " the signer gives you."
)


def certificate_page(certificate: Certificate) -> Page:
    """The display strings of a certificate (`zerobeam/certificate/1`)."""
    item = f"{clipped(certificate.model)}, serial number {clipped(certificate.serial, 60)}"
    return Page(
        "Certificate of calibration",
        f"No. {clipped(certificate.identification, 40)}, {item}",
        Verdict(
            certificate.grade or "held",
            said_word(VERDICT_WORDS[certificate.verdict], certificate.simulated),
            sentence(with_labels(certificate.result.headline or "")),
        ),
        list(_notes(certificate)),
        [
            section_of("Identification", Form(list(_identified(certificate)), ("Signature",))),
            section_of("Offsets", *_offsets(certificate)),
            section_of("As found and as left", Facts(list(_found_and_left(certificate)))),
            section_of("Method, traceability and decision rule", Facts(list(_statements(certificate)))),
            section_of("What the offsets rest on", *_assumed(certificate)),
            section_of("Fit", Paragraph(_fit(certificate.result.likelihood))),
            section_of("Origin", Facts(_origin(certificate))),
            section_of("Signature by key", *_signature(certificate.fingerprint)),
        ],
    )


def _notes(certificate: Certificate) -> Iterator[str]:
    if certificate.simulated:
        yield "These measurements were simulated: no instrument took part, and nothing here is traceable."
    if certificate.not_determined:
        names = listed([label(name) for name in certificate.not_determined])
        yield f"Not determined by these measurements and not certified: {names}."
    for note in certificate.notes:
        yield ended(sentence(with_labels(note)))


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def _identified(certificate: Certificate) -> Iterator[tuple[str, str]]:
    """What ISO/IEC 17025:2017, 7.8.2 asks for, two in a row; "" where nobody has stated it."""

    def entry(key: str) -> tuple[str, str]:
        return CERTIFICATE_KEYS[key], certificate.entries[key] or ""

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
    instruments = [(row.name, row.text or "") for row in certificate.instruments]
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
    tcp, left = certificate.as_found["tcp"], certificate.as_left
    region = region_words(certificate.region)
    yield (
        "As found",
        ended(f"The offsets above{'' if tcp is None else f'; error of the TCP {region}: {_tcp(tcp)}'}"),
    )
    if (expected := certificate.expected["tcp"]) is not None:
        result, exact = certificate.result, ""
        if result.enter is not None and taken_by(certificate.vendor) == "offsets":
            values = listed(_entered(result.enter, certificate.k), 99)
            yield "Values to enter", f"{values}; U is the values' own."
        if result.geometry.tolerance is None:
            exact = " The links are taken as exact: those of a typical arm add to it."
        yield (
            "Expected as left",
            f"Error of the TCP {region}: {_tcp(expected)}, once the values to enter are in the"
            f" controller: predicted, not measured.{exact}",
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


def _entered(entered: Entered, k: float) -> list[str]:
    """The values to enter with their own U."""
    u = {name: numbers.spread(k * std, "deg") for name, std in entered.u.items()}
    return [
        f"{joints([name])[0]} {numbers.estimate(value, k * entered.u[name], 'deg')} ± {u[name]}"
        for name, value in entered.values.items()
    ]


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
    if certificate.simulated:
        return "None: the measurements were simulated."
    if by := certificate.entries["traceability"]:
        return shown(by)
    certificates = [row.name for row in certificate.instruments if row.text and "certificate" in row.name]
    if not certificates:
        return "Not shown: no calibration certificate of an instrument is stated."
    return (
        f"By the certificates that the laboratory has stated ({listed(certificates)}, first page); zerobeam"
        " has not seen them."
    )


def _rules(certificate: Certificate) -> Iterator[str]:
    conformity, left = certificate.result.conformity, certificate.as_left
    if conformity is None and "required" in certificate.result.inputs.header:
        yield conformity_sentence(certificate.result)
    elif conformity is None:
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
    """The tables of the answer's page, without the numbers that are not certified."""
    result, k = certificate.result, certificate.k
    offsets, nominal = result.offsets, result.geometry.tolerance is None
    table = offsets_table_of(offsets, k, result.geometry if nominal else None)
    withheld = [
        row_of(row.cells[0], Cell(_WITHHELD, span=2), row.cells[3], *[NO_NUMBER] * nominal, tone=row.tone)
        if row.tone == "assumed"
        else row
        for row in table.rows
    ]
    yield replace(table, rows=withheld)
    yield Paragraph(
        f"U is the expanded uncertainty, the standard uncertainty times {numbers.coverage(k)}: estimate ± U"
        " holds the offset with a probability of about 95 % (JCGM 100)."
    )
    if nominal:
        yield Paragraph(
            f"U holds if the arm has its nominal geometry. {table.columns[-1].text} has the same k and links"
            f" that deviate by {tolerances_words(result.geometry)}."
        )
    if certificate.intervals:
        yield intervals_table(replace(result, intervals=certificate.intervals))[0]
    grouped_by: dict[tuple[str, str], list[str]] = {}
    for row in offsets:
        if row.reason:
            grouped_by.setdefault((row.status, row.reason), []).append(label(row.name))
    reasons = [
        LegendEntry(status, f"{listed(names)}:", sentence(with_labels(text)))
        for (status, text), names in grouped_by.items()
    ]
    yield Legend(legend((row.status for row in offsets), result.inputs.header), reasons)


def _assumed(certificate: Certificate) -> Iterator[Block]:
    """What was stated and assumed, by the message of the answer; geometry, priors, held parameters, and the
    settings of the run that say so."""
    result, assumed, geometry = certificate.result, certificate.assumed, certificate.result.geometry
    if result.message is not None:
        yield from map(Paragraph, result.message.basis)
    yield from (Paragraph(text) for text in [factors_sentence(geometry)] if text)
    facts = [("Geometry", "nominal, taken as the robot file states it")]
    if geometry.tolerance is not None:
        facts = [("Geometry", f"estimated within tolerances of {tolerances_words(geometry)}")]
    priors: dict[str, list[str]] = {}
    for one in assumed.priors:
        std = numbers.exact(float(f"{one.std:.3g}"), unit_of(one.unit))  # where the data have multiplied it
        priors.setdefault(one.group, []).append(std)
    stds = [f"{group} {listed(values)}" for group, values in priors.items()]
    facts.append(("Priors (standard deviation)", "; ".join(stds) or "none"))
    held = [_held(row) for row in result.parameters if row.held]
    facts.append(("Held, not estimated", listed(held) if held else "nothing"))
    header = {key: result.inputs.header.get(key) for key in ("tool", "instruments", "noise")}
    by_header, _ = settings({key: value for key, value in header.items() if value}, result.inputs.stated)
    facts += by_header
    yield Facts(facts)
    if factors := [row for row in result.parameters if row.group == "noise" and not row.held]:
        yield parameter_table("Noise, as a multiple of the stated", factors, certificate.k)


def _held(row: ParameterResult) -> str:
    at = "" if row.estimate is None else f" at {numbers.exact(row.estimate, unit_of(row.unit))}"
    return f"{label(row.name)}{at if row.group == 'offset' else ''}"


def _fit(fit: LikelihoodSummary) -> str:
    rms = numbers.length_and_angle(fit.rms_mm, fit.rms_deg)
    parts = [f"Residuals {rms} rms, {fit.dof} degrees of freedom."]
    if fit.noise_scale is not None:
        parts.append(f"The noise is {numbers.times(fit.noise_scale)} times the stated one.")
    if fit.p_value is not None:
        chi2 = numbers.significant(fit.chi2)
        parts.append(f"χ²\u00a0{chi2}, p-value {numbers.p_value(fit.p_value)} for the stated noise.")
    parts.append("No misfit was found.")
    parts += small_residuals(fit)
    if fit.message:
        parts.append(ended(f"{fit.message[0].upper()}{fit.message[1:]}"))
    return " ".join(parts)


def _origin(certificate: Certificate) -> list[tuple[str, str]]:
    return [
        ("Measured at", certificate.measured_at.replace(tzinfo=UTC).isoformat()),
        ("Instrument", shown(certificate.instrument or "not stated")),
        ("Run", f"{shown(certificate.run)}, {certificate.shots} measurements"),
        *(("Left out", text) for text in left_out(certificate.result.inputs.provenance)),
        ("SHA-256 of the run", certificate.sha256),
        ("SHA-256 of the whole result", certificate.document_sha256),
        ("zerobeam", f"{shown(certificate.made_by)} (result), {certificate.written_by} (certificate)"),
    ]


def _signature(fingerprint_of_key: str) -> Iterator[Block]:
    yield Paragraph(f"{listed(list(SIGNED))} are signed, each in a file .sig beside it. {_MEANING}")
    yield Facts([("Key", ALGORITHM), ("Fingerprint (SHA-256)", grouped(fingerprint_of_key))])
    yield Paragraph("Either command verifies a file:")
    yield Commands(
        (
            "zerobeam history verify certificate.pdf --key PUBLIC_KEY",
            "openssl pkeyutl -verify -pubin -inkey PUBLIC_KEY -rawin \\",
            "  -in certificate.pdf -sigfile certificate.pdf.sig",
        )
    )
