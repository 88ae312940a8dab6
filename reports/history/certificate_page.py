"""The page of a certificate: the offsets, what they rest on, who signed and what that says."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ...analysis.status import known
from ...experiments.history.signing import grouped
from ...words import numbers
from ...words.geometry import IF_IT_DEVIATES, tolerance_words
from ...words.numbers import unit_of
from ...words.verdict import VERDICT_WORDS
from ...words.wording import NOT_DETERMINED, clipped, ended, label, listed, sentence, shown
from ..run.parameters import NO_NUMBER, OFFSETS, legend
from ..style.blocks import (
    Block,
    Cell,
    Commands,
    Facts,
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

SIGNED = ("certificate.json", "certificate.html", "certificate.pdf")
_NOT_STATED = "not stated"
_MEANING = (
    "A valid signature says that the holder of this key signed exactly these bytes. It does not say that the"
    " measurements are right, nor who the holder is: compare the fingerprint with the one that"
    " the signer gives you."
)
_GROUPS = {"offset": "offsets", "target": "targets", "tool": "tool", "geometry": "link geometry"}


def certificate_page(certificate: Mapping[str, Any]) -> Page:
    """The display strings of a certificate (`zerobeam/certificate/1`)."""
    serial = clipped(certificate["serial"], 60)
    return Page(
        "Certificate of calibration",
        f"{clipped(certificate['model'])}, serial number {serial}",
        Verdict(
            certificate["verdict"], VERDICT_WORDS[certificate["verdict"]], _named(certificate["headline"])
        ),
        list(_notes(certificate)),
        [
            section_of("Offsets", *_offsets(certificate)),
            section_of(
                "What the offsets rest on",
                Facts(list(_assumed(certificate["assumed"], certificate["offsets"]))),
            ),
            section_of("Fit", Paragraph(_fit(certificate["fit"]))),
            section_of("Origin", Facts(_origin(certificate))),
            section_of("Signature", *_signature(certificate["key"])),
        ],
        [
            ("Date of the measurements", certificate["measured_at"][:10]),
            ("Robot, serial number", serial),
            ("Calibrated by", clipped(certificate["operator"] or _NOT_STATED, 40)),
        ],
    )


def _named(text: str) -> str:
    """A sentence of a result, with the offsets' names as people write them."""
    return sentence(re.sub(r"\bdelta\d+\b", lambda match: label(match.group()), text))


def _notes(certificate: Mapping[str, Any]) -> Iterator[str]:
    if certificate["simulated"]:
        yield "These measurements were simulated: no instrument took part, and nothing here is traceable."
    if certificate["not_determined"]:
        names = listed([label(name) for name in certificate["not_determined"]])
        yield f"Not determined by these measurements and not certified: {names}."
    for note in certificate["notes"]:
        yield ended(_named(note))


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def _offsets(certificate: Mapping[str, Any]) -> Iterator[Block]:
    rows, assumed = certificate["offsets"], certificate["assumed"]
    nominal = assumed["geometry"]["tolerance"] is None
    columns = [
        ("name", "left"),
        ("estimate", "right"),
        ("95 % interval", "right"),
        ("status", "left"),
        ("u", "right"),
    ]
    yield table_of(
        OFFSETS,
        [*columns, (IF_IT_DEVIATES, "right")] if nominal else columns,
        [_offset(row, nominal) for row in rows],
    )
    if nominal:
        yield Paragraph(
            "u and the interval hold if the arm has its nominal geometry. The last column is u if its links"
            f" deviate from it by {_tolerances(assumed['geometry']['considered_tolerance'])}."
        )
    if certificate["intervals"]:
        yield _intervals(certificate["intervals"])
    grouped_by: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row["reason"]:
            grouped_by.setdefault((row["status"], row["reason"]), []).append(label(row["name"]))
    reasons = [
        LegendEntry(key, f"{listed(names)}:", _named(text)) for (key, text), names in grouped_by.items()
    ]
    tolerance = {"tolerance": assumed["tolerance"]}
    yield Legend(legend((row["status"] for row in rows), tolerance), reasons)


def _offset(row: Mapping[str, Any], nominal: bool) -> Row:
    """One offset. What is not determined has no number in its row."""
    status, unit, name = row["status"], unit_of(row["unit"]), label(row["name"])
    word, last = Cell(status, mark=status), [NO_NUMBER] if nominal else []
    if not known(status):
        text = f"held {_held_at(row)}" if row["held"] else NOT_DETERMINED
        return row_of(name, Cell(text, span=2), word, NO_NUMBER, *last, tone=status)
    if nominal and row["considered_std"] is not None:
        last = [numbers.spread(row["considered_std"], unit)]
    return row_of(
        name,
        numbers.estimate(row["estimate"], row["std"], unit),
        numbers.interval(row["interval95"], row["std"], unit),
        word,
        numbers.spread(row["std"], unit),
        *last,
        tone=status,
    )


def _intervals(rows: list[Mapping[str, Any]]) -> Table:
    methods = ("linear", "profile", "posterior")
    heads = ("name", "curvature at the mode", "profile likelihood", "posterior")
    columns = [(head, "left" if head == "name" else "right") for head in heads]
    return table_of(
        "95 % intervals by three methods, where they differ",
        columns,
        [row_of(label(row["name"]), *(_interval(row[key], row) for key in methods)) for row in rows],
    )


def _interval(bounds: tuple[float, float] | None, row: Mapping[str, Any]) -> str:
    low, high = row["linear"]
    return NO_NUMBER if bounds is None else numbers.interval(bounds, (high - low) / 4, unit_of(row["unit"]))


def _assumed(assumed: Mapping[str, Any], offsets: list[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    geometry, tool, noise = assumed["geometry"], assumed["tool"], assumed["noise"]
    if geometry["tolerance"] is not None:
        within = f"estimated within tolerances of {_tolerances(geometry['tolerance'])}"
        yield "Geometry", f"{within}{_factors(geometry['factors'])}"
    else:
        yield "Geometry", "nominal, taken as the robot file states it"
    yield "Tool", f"{tool['kind']}, {'calibrated: taken as stated' if tool['calibrated'] else 'estimated'}"
    yield "Noise (standard deviation)", f"{_noise(noise)}; {_scale(assumed)}"
    yield "Priors (standard deviation)", "; ".join(_priors(assumed["priors"])) or "none"
    held_at = {row["name"]: _held_at(row) for row in offsets if row["held"]}
    held = [f"{label(name)} {held_at.get(name, '')}".rstrip() for name in assumed["held"]]
    yield "Held, not estimated", listed(held) if held else "nothing"


def _tolerances(tolerance: Mapping[str, Any]) -> str:
    length, angle = tolerance["length_mm"], tolerance["angle_deg"]
    return f"{tolerance_words(length, 'mm')} and {tolerance_words(angle, 'deg')}"


def _factors(factors: Mapping[str, float] | None) -> str:
    if factors is None:
        return ""
    length, angle = (numbers.significant(factors[key], 2) for key in ("length", "angle"))
    return f", which the data multiply by {length} (lengths) and {angle} (angles)"


def _priors(rows: list[Mapping[str, Any]]) -> Iterator[str]:
    for group in dict.fromkeys(row["group"] for row in rows):
        stds = [_rounded(row["std"], unit_of(row["unit"])) for row in rows if row["group"] == group]
        yield f"{_GROUPS.get(group, group)} {listed(stds)}"


def _rounded(std: float, unit: str) -> str:
    """As it was stated; to three digits where the data have multiplied it."""
    return numbers.exact(float(f"{std:.3g}"), unit)


def _held_at(row: Mapping[str, Any]) -> str:
    return f"at {numbers.exact(row['estimate'], unit_of(row['unit']))}"


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


def _scale(assumed: Mapping[str, Any]) -> str:
    scale = assumed["noise"].get("scale", "known")
    if scale == "known":
        return "taken as stated"
    if scale == "estimated":
        return "estimated up to one factor"
    factors = [
        f"{clipped(row['name'])} {numbers.estimate(row['estimate'], row['std'])}"
        if known(row["status"])
        else f"{clipped(row['name'])} {NOT_DETERMINED}"
        for row in assumed["noise_factors"]
    ]
    return f"estimated up to two factors: {', '.join(factors)}"


def _fit(fit: Mapping[str, Any]) -> str:
    rms = numbers.significant(fit["rms_mm"], unit="mm")
    parts = [f"Residuals {rms} rms, {fit['dof']} degrees of freedom."]
    if fit["noise_scale"] is not None:
        parts.append(f"The noise is {numbers.times(fit['noise_scale'])} times the stated one.")
    if fit["p_value"] is not None:
        chi2 = numbers.significant(fit["chi2"])
        parts.append(f"χ²\u00a0{chi2}, p-value {numbers.p_value(fit['p_value'])} for the stated noise.")
    parts.append("No misfit was found.")
    if fit["message"]:
        parts.append(ended(f"{fit['message'][0].upper()}{fit['message'][1:]}"))
    return " ".join(parts)


def _origin(certificate: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [
        ("Robot", ", ".join(shown(text) for text in (certificate["model"], certificate["vendor"]) if text)),
        ("Serial number", shown(certificate["serial"])),
        ("Measured at", certificate["measured_at"]),
        ("Instrument", shown(certificate["instrument"] or _NOT_STATED)),
        ("Calibrated by", shown(certificate["operator"] or _NOT_STATED)),
        ("Run", f"{shown(certificate['run'])}, {certificate['shots']} measurements"),
        ("SHA-256 of the run", certificate["sha256"]),
        ("SHA-256 of the whole result", certificate["document_sha256"]),
        ("zerobeam", f"{shown(certificate['zerobeam'])} (result), {certificate['written_by']} (certificate)"),
    ]


def _signature(key: Mapping[str, str]) -> Iterator[Block]:
    yield Paragraph(f"{listed(list(SIGNED))} are signed, each in a file .sig beside it. {_MEANING}")
    yield Facts([("Key", key["algorithm"]), ("Fingerprint (SHA-256)", grouped(key["fingerprint"]))])
    yield Paragraph("Either command verifies a file:")
    yield Commands(
        (
            "zerobeam history verify certificate.pdf --key PUBLIC_KEY",
            "openssl pkeyutl -verify -pubin -inkey PUBLIC_KEY -rawin \\",
            "  -in certificate.pdf -sigfile certificate.pdf.sig",
        )
    )
