"""What a run's provenance says of its origin, by which keys, and the true values of a simulated run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from ..model.files.header import SERIAL_KEYS, WHEN_KEYS, stated_by
from ..model.files.run import LEFT_OUT, MADE_OF
from ..model.instruments.kind import Instrument
from .wording import clipped, shown

SERIAL, DATE, OPERATOR = "Robot, serial number", "Date of the measurements", "Calibrated by"
MEASURED = (
    (OPERATOR, ("who", "operator", "calibrated by")),
    (DATE, WHEN_KEYS),
    ("Place", ("where", "place", "location")),
    ("Ambient temperature", ("temperature", "ambient temperature")),
    (SERIAL, SERIAL_KEYS),
)
AUTHORISED = "Authorised by"
NOTHING_MEASURED = "no robot was measured"
BAND = f"Simulated: {NOTHING_MEASURED}"  # above the verdict
VERIFIES = "verifies"  # of a plan and its run: the calibration run that they test
# What a certificate asks for besides (ISO/IEC 17025:2017, 7.8.2 and 7.8.4).
CERTIFIED = (
    ("Certificate number", ("certificate number", "certificate")),
    ("Laboratory", ("laboratory", "lab")),
    ("Laboratory, address", ("laboratory address", "lab address")),
    ("Customer", ("customer",)),
    ("Customer, address", ("customer address",)),
    ("Payload", ("payload",)),
    ("Warm-up", ("warm up",)),
    ("Traceability", ("traceability",)),
    (AUTHORISED, ("authorised by", "authorized by")),
)
KEYS = dict((*MEASURED, *CERTIFIED))
# Of a certificate.json, and the entries that they are.
CERTIFICATE_KEYS = {
    "certificate_number": "Certificate number",
    "laboratory": "Laboratory",
    "laboratory_address": "Laboratory, address",
    "customer": "Customer",
    "customer_address": "Customer, address",
    "place": "Place",
    "temperature": "Ambient temperature",
    "payload": "Payload",
    "warm_up": "Warm-up",
    "traceability": "Traceability",
    "authorised_by": AUTHORISED,
}


def provenance_entry(provenance: Mapping[str, object], keys: tuple[str, ...]) -> str:
    """What is stated by any of the `keys`; "" for nothing. `provenance` as of `by_plain_key`."""
    return ", ".join(shown(str(provenance[key])) for key in keys if key in provenance)


def first_entry(provenance: Mapping[str, object], keys: tuple[str, ...]) -> str:
    """The same by the first of the `keys` alone that is there."""
    return shown(stated_by(provenance, keys) or "")


def left_out(provenance: Mapping[str, object]) -> Iterator[str]:
    """Which measurements a person left out of a run, and of which run."""
    numbers, of = provenance.get(LEFT_OUT), provenance.get(MADE_OF)
    if isinstance(numbers, str) and isinstance(of, str):
        noun = "measurements" if "," in numbers else "measurement"
        yield f"{noun} {clipped(numbers, 60)} of {clipped(of.partition(' (SHA')[0], 60)}"


def made_of(provenance: Mapping[str, object]) -> str | None:
    """The SHA-256 of the run that this one is without some of its measurements; None of any other."""
    of = re.search(r"\(SHA-256 ([0-9a-f]{64})\)$", str(provenance.get(MADE_OF, "")))
    return of[1] if of and LEFT_OUT in provenance else None


def traced(kinds: Iterable[type[Instrument]]) -> list[tuple[str, tuple[str, ...]]]:
    """What a certificate names of instruments of these kinds, each entry once."""
    return list(dict.fromkeys(entry for kind in kinds for entry in kind.words.traced))


def instrument(provenance: Mapping[str, object], kinds: Iterable[type[Instrument]]) -> str:
    """The instruments of these kinds, their makers and serial numbers; "" where none is stated."""
    rows = [keys for name, keys in traced(kinds) if "serial" in name]
    return ", ".join(text for text in (provenance_entry(provenance, keys) for keys in rows) if text)


SIMULATED = "simulated"  # of the provenance key `origin`
_TRUE = re.compile(r"true (\S+) \((?:deg|mm|1)\)")


def rig_words(provenance: Mapping[str, object]) -> list[str] | None:
    """The options of `run` that say again what carried a run out, but for a simulated cell's file; None where
    the run does not say how its controller is reached."""
    match provenance.get("origin"):
        case "by hand":
            return ["--rig=manual"]
        case "simulated":
            camera = ["--no-camera"] if provenance.get("camera") is False else []
            return [*camera, f"--seed={provenance.get('seed', 0)}"]
        case _:
            return None


def is_simulated(provenance: Mapping[str, object]) -> bool:
    """Whether no robot was measured."""
    return provenance.get("origin") == SIMULATED


def true_values(provenance: Mapping[str, object]) -> dict[str, float]:
    """The true values by parameter (deg, mm) that the provenance of a simulated run states; else none."""
    if not is_simulated(provenance):
        return {}
    matches = ((_TRUE.fullmatch(key), value) for key, value in provenance.items())
    return {
        match.group(1): float(value)
        for match, value in matches
        if match is not None and isinstance(value, int | float) and not isinstance(value, bool)
    }
