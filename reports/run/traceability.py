"""The section that a person completes and signs. Only what the run's provenance states is filled in."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ...analysis.result import Result
from ..style.blocks import Paragraph, Section, row_of, section_of, table_of
from ..words.wording import shown

# What stands in the form, and the keys of `provenance` that state it. An approval is given after the result:
# nothing in a run can state it.
_MEASURED = (
    ("Calibrated by", ("who", "operator", "calibrated by")),
    ("Date of the measurements", ("when", "date", "calibrated on")),
    ("Place", ("where", "place", "location")),
    ("Ambient temperature", ("temperature", "ambient temperature")),
    ("Robot, serial number", ("serial", "serial number", "robot serial", "robot serial number")),
)
_INSTRUMENTS = {
    "laser": (
        ("PSD, maker and serial number", ("psd", "psd serial", "psd serial number")),
        ("PSD, calibration certificate", ("psd certificate",)),
        ("Laser, maker and serial number", ("laser", "laser serial", "laser serial number")),
        ("Laser, calibration certificate", ("laser certificate",)),
    ),
    "probe": (
        ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
        ("Probe, calibration certificate", ("probe certificate",)),
    ),
}
_SIGNED = ("Approved by", "Date of approval", "Signature")


def traceability_section(result: Result) -> Section:
    """A form with a field a row; what nobody has stated is left empty."""
    provenance = {_plain(key): value for key, value in result.inputs.provenance.items()}
    fields = [*_MEASURED, *_INSTRUMENTS[result.inputs.tool]]
    rows = [row_of(name, _stated(provenance, keys)) for name, keys in fields]
    rows += [row_of("SHA-256 of the run", result.inputs.sha256)]
    rows += [row_of(name, "") for name in _SIGNED]
    said = "To be completed by hand. Entries that are there were stated in the run’s provenance."
    if provenance.get("origin") == "simulated":
        said += " These measurements were simulated: no instrument took part, and nothing here is traceable."
    columns = [("field", "left"), ("entry", "left")]
    return section_of("Traceability", Paragraph(said), table_of("For a person", columns, rows))


def _stated(provenance: Mapping[str, object], keys: tuple[str, ...]) -> str:
    return ", ".join(shown(str(provenance[key])) for key in keys if key in provenance)


def _plain(key: str) -> str:
    return re.sub(r"[\s_-]+", " ", key).strip().casefold()
