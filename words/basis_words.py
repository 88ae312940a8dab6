"""What was stated and what was assumed, as two lines, each assumption with what it does to U."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ..analysis.observability.geometry_result import Basis
from ..model.likelihood.parameters import Unit
from . import numbers
from .geometry_words import tolerance_words
from .observability import named_part
from .wording import Namer, clipped, joints, listed

_HARDLY = 0.95  # of a U that is left were this known exactly: it does not matter


def basis_lines(
    bases: Sequence[Basis], header: Mapping[str, object], k: float, name: Namer, *, effects: bool
) -> tuple[str, ...]:
    """The lines; with `effects` what each does to the expanded uncertainties, of coverage factor `k`."""
    by_header = [*_noise(header), *(_words(one, k, name, effects) for one in bases if one.stated)]
    assumed = [_words(one, k, name, effects) for one in bases if not one.stated]
    lines = [f"Stated: {'; '.join(by_header)}."] if by_header else []
    return (*lines, *([f"Assumed: {'; '.join(assumed)}."] if assumed else []))


def _noise(header: Mapping[str, object]) -> Iterator[str]:
    """What the header says of the noise of joints and instruments."""
    noise, instruments = header.get("noise"), header.get("instruments")
    if isinstance(noise, Mapping):
        sizes = _sizes(noise, (("joint_deg", "deg"), ("joint_mm", "mm")))
        if sizes:
            yield f"noise of joints {sizes}"
        if noise.get("spot_mm"):
            yield f"of spot {_sizes(noise, (('spot_mm', 'mm'),))}"
    if isinstance(instruments, Mapping):
        for label, entry in instruments.items():
            keys: tuple[tuple[str, Unit], ...] = (("sigma_mm", "mm"), ("sigma_deg", "deg"))
            sizes = _sizes(entry, keys) if isinstance(entry, Mapping) else ""
            if sizes:
                yield f"of {clipped(str(label))} {sizes}"


def _sizes(entry: Mapping[str, object], keys: Sequence[tuple[str, Unit]]) -> str:
    parts = []
    for key, unit in keys:
        value = entry.get(key)
        if isinstance(value, int | float) or (isinstance(value, list | tuple) and value):
            parts.append(tolerance_words(value if isinstance(value, int | float) else tuple(value), unit))
        elif isinstance(value, Mapping):
            at_zero, per_m = (tolerance_words(value[each], unit) for each in ("constant", "per_m"))
            parts.append(f"{at_zero} and {per_m} a metre")
    return listed(parts) if parts else ""


def _words(basis: Basis, k: float, name: Namer, effects: bool) -> str:
    if basis.part == "links":
        what = "links" if basis.stated else "typical links"
        exact = "links exact"
    else:
        what = named_part(basis.kind, basis.of, basis.part)
        exact = f"{named_part(basis.kind, basis.of, basis.part)} exactly as stated"
    if not basis.sizes:
        return f"{exact} (in no U)" if effects else exact
    text = f"{what} {', '.join(tolerance_words(size.std, size.unit) for size in basis.sizes)}"
    if not effects or basis.offset is None or basis.u is None or basis.u_if_exact is None:
        return text
    if basis.u_if_exact > _HARDLY * basis.u:
        return f"{text} (U hardly less if exact)"
    u, if_exact = (numbers.spread(k * each, basis.unit or "") for each in (basis.u, basis.u_if_exact))
    (offset,) = joints([basis.offset], name)
    return f"{text} ({offset} U {u}, if exact {if_exact})"
