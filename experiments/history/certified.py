"""A certificate of a result (`zerobeam/certificate/1`): what it states, when there is none, and its
signature."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import field, replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from ...analysis.acceptance import MeasuredError
from ...analysis.answer.answer_message import Message
from ...analysis.answer.result import LikelihoodSummary, Result
from ...analysis.covariance import OffsetsWithoutPrior
from ...analysis.diagnostics.values_to_enter import TcpError
from ...analysis.observability.geometry_result import GeometryResult
from ...analysis.posterior.posterior import Intervals
from ...analysis.row import ParameterRow
from ...analysis.solution import ParameterResult
from ...analysis.status import known, versions
from ...analysis.tcp_region import TcpRegion
from ...interruption import uninterrupted
from ...model.errors import BadInput, missing_extra
from ...model.files.header import by_plain_key
from ...model.files.whole_file import refuse_existing, write_whole
from ...model.parsing.reading import LARGEST_RECORDING, read_bytes
from ...model.records import if_any, inline, internal, it, key, only, record, to_json
from ...words.message import read_message
from ...words.provenance import CERTIFICATE_KEYS, DATE, KEYS, provenance_entry, traced
from ..acceptance_files import Verified
from .stored_result import StoredResult

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

# Signatures of files: Ed25519 (RFC 8032), detached, of the bytes of a file as they are.
#
# Keys are PEM files, PKCS#8 and SubjectPublicKeyInfo, and a signature is its 64 bytes: `openssl pkeyutl
# -rawin` makes and verifies the same.

ALGORITHM = "Ed25519"
_LENGTH = 64  # bytes of a signature
_LARGEST_KEY = 100_000


def require_library() -> None:
    """BadInput where the library is missing."""
    try:
        import cryptography.hazmat.primitives.asymmetric.ed25519  # noqa: F401
    except ImportError:
        raise missing_extra("a signature", "sign") from None


def public_file(private: Path) -> Path:
    """Where the public key of a private one is."""
    return private.with_name(f"{private.name}.pub")


def signature_file(file: Path) -> Path:
    """Where the signature of a file is."""
    return file.with_name(f"{file.name}.sig")


@uninterrupted()
def make_key(private: Path, passphrase: str | None) -> str:
    """Make a pair of keys, the private one readable by its owner alone; returns the fingerprint. BadInput if
    either file exists.

    The public key is written first: a process that is killed between the two leaves nothing that signs.
    """
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    public = public_file(private)
    for file in (private, public):
        refuse_existing(file)
    key = Ed25519PrivateKey.generate()
    closed = form.BestAvailableEncryption(passphrase.encode()) if passphrase else form.NoEncryption()
    text = key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, closed)
    public_half = key.public_key()
    write_whole(public, public_half.public_bytes(form.Encoding.PEM, form.PublicFormat.SubjectPublicKeyInfo))
    before = os.umask(0o077)  # at no moment may others read it
    try:
        write_whole(private, text)
    except BaseException:
        public.unlink()
        raise
    finally:
        os.umask(before)
    return fingerprint(public_half)


def private_key(file: Path, ask: Callable[[], str]) -> Ed25519PrivateKey:
    """The private key of a file; `ask` gives its passphrase if it has one. BadInput says what is wrong."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    content = read_bytes(file, _LARGEST_KEY)
    if b"PUBLIC KEY-----" in content:
        raise BadInput(
            "this is a public key, which signs nothing",
            file=file,
            allowed="a private key of zerobeam history key",
            remedy="name the private key: the file beside it without .pub",
        )
    try:
        try:
            key = load_pem_private_key(content, None)
        except TypeError:  # it has a passphrase
            key = load_pem_private_key(content, ask().encode())
    except (ValueError, UnsupportedAlgorithm):
        closed = b"ENCRYPTED" in content
        raise BadInput(
            "the private key cannot be read",
            found="another passphrase, or a damaged file" if closed else "no private key in PEM",
            allowed="a private key of zerobeam history key",
            file=file,
        ) from None
    if not isinstance(key, Ed25519PrivateKey):
        raise _other_kind(file, key)
    return key


def public_key(file: Path) -> Ed25519PublicKey:
    """The public key of a file. BadInput says what is wrong."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    content = read_bytes(file, _LARGEST_KEY)
    if b"PRIVATE KEY-----" in content:
        raise BadInput(
            "this is a private key: it is for its owner alone",
            file=file,
            allowed="the public key",
            remedy=f"name {public_file(file).name}",
        )
    try:
        key = load_pem_public_key(content)
    except (ValueError, UnsupportedAlgorithm):
        raise BadInput(
            "the public key cannot be read",
            found="no public key in PEM",
            allowed="a public key (.pub) of zerobeam history key",
            file=file,
        ) from None
    if not isinstance(key, Ed25519PublicKey):
        raise _other_kind(file, key)
    return key


def _other_kind(file: Path, key: object) -> BadInput:
    kind = type(key).__name__.removesuffix("PublicKey").removesuffix("PrivateKey")
    return BadInput("the key is of another kind", found=kind, allowed=ALGORITHM, file=file)


def fingerprint(key: Ed25519PublicKey) -> str:
    """SHA-256 of the 32 bytes of a public key."""
    return hashlib.sha256(key.public_bytes_raw()).hexdigest()


def grouped(digits: str) -> str:
    """A fingerprint as people compare it: groups of four."""
    return " ".join(digits[i : i + 4] for i in range(0, len(digits), 4))


def sign(file: Path, key: Ed25519PrivateKey) -> None:
    """Write the signature of a file beside it; the same key and bytes give the same signature."""
    write_whole(signature_file(file), key.sign(file.read_bytes()))


def why_not_signed(content: bytes, signature: bytes, key: Ed25519PublicKey) -> str | None:
    """None where the signature is of these bytes by this key; else what is wrong."""
    from cryptography.exceptions import InvalidSignature

    if len(signature) != _LENGTH:
        return f"the signature has {len(signature)} bytes, not {_LENGTH}"
    try:
        key.verify(signature, content)
    except InvalidSignature:
        return "the file or its signature was changed, or another key has signed it"
    return None


def read_signed(file: Path) -> tuple[bytes, bytes]:
    """The bytes of a file and of its signature; BadInput where either is missing."""
    content = read_bytes(file, LARGEST_RECORDING)
    beside = signature_file(file)
    if not beside.exists():
        raise BadInput(
            "the file has no signature beside it",
            file=file,
            allowed=beside.name,
            remedy="get it from whoever signed, or make the certificate again with zerobeam history certify",
        )
    return content, read_bytes(beside, _LARGEST_KEY)


CERTIFICATE_SCHEMA: Final = "zerobeam/certificate/1"
_OF_FIT = only("rms_mm", "chi2", "dof", "p_value", "noise_scale", "message", "rms_deg")
_DIGITS = 16  # hexadecimal, of an identification


@record
class TracedInstrument:
    """What the provenance states of an instrument."""

    name: str
    text: str | None


@record(repr=False)
class CertifiedOffset(ParameterRow):
    """An offset. What is only as good as an assumption has no number on a certificate, but its reason."""

    claims = (*ParameterRow.claims, "expanded", "considered_std")

    expanded: Annotated[float | None, it("U = k u")]
    considered_std: Annotated[
        float | None, it("u incl. geometry tolerances, where the geometry was taken as nominal")
    ]
    reason: Annotated[str | None, it("as in the result")]


@record
class AsLeft:
    """The error measured with the corrected robot, and the verdict of the acceptance test."""

    test: Annotated[
        Verified, inline("verdict", "measurements", "dof", "p_value", "false_alarm", "power_required")
    ]
    error_mm: Annotated[MeasuredError, only("before", "after", "noise_mm")]
    run: str
    sha256: str
    measured_on: str | None


@record
class AssumedTool:
    """The tool, as the header states it: `sigma` is null where nobody stated one."""

    kind: str
    calibrated: bool
    sigma: dict[str, Any] | None


@record
class Prior:
    """The standard deviation of the prior of a group of parameters."""

    group: str
    unit: str
    std: float


@record
class Assumed:
    """What a `result` rests on besides the measurements."""

    result: Annotated[Result, internal]

    @property
    @key("as in the result")
    def geometry(
        self,
    ) -> Annotated[GeometryResult, only("tolerance", "factors", "considered_tolerance")]:
        return self.result.geometry

    @property
    @key("null without one")
    def tool(self) -> AssumedTool | None:
        by_header: dict[str, Any] | None = self.result.inputs.stated
        tool = (self._header if by_header is None else by_header).get("tool")
        return tool and AssumedTool(tool["kind"], tool.get("calibrated", True), tool.get("sigma"))

    @property
    @key("as in the header")
    def instruments(self) -> dict[str, Any]:
        return self._header.get("instruments") or {}

    @property
    @key("as in the header")
    def noise(self) -> dict[str, Any]:
        return self._header["noise"]  # type: ignore[no-any-return]

    @property
    @key("factors on the stated noise")
    def noise_factors(
        self,
    ) -> Annotated[tuple[ParameterResult, ...], only("name", "status", "estimate", "std")]:
        return tuple(row for row in self.result.parameters if row.group == "noise")

    @property
    @key("standard deviations of the groups of parameters")
    def priors(self) -> tuple[Prior, ...]:
        free = [row for row in self.result.parameters if not row.held and row.group != "noise"]
        rows = dict.fromkeys((row.group, row.unit, row.prior_std) for row in free if row.prior_std)
        return tuple(Prior(*row) for row in rows)

    @property
    @key("names of the held parameters")
    def held(self) -> tuple[str, ...]:
        return tuple(row.name for row in self.result.parameters if row.held)

    @property
    @key("as in the header")
    def tolerance(self) -> dict[str, Any] | None:
        return self._header.get("tolerance")

    @property
    def _header(self) -> dict[str, Any]:
        return self.result.inputs.header


@record(needed=("schema", "sha256", "serial", "model", "document_sha256"))
class CertifiedResult(StoredResult):
    """What a certificate.json has of the row of a history, and the hashes of the `files` beside it."""

    schema: Annotated[Literal["zerobeam/certificate/1"], it("kind and version of the document")] = field(
        default=CERTIFICATE_SCHEMA, kw_only=True
    )
    offsets: Annotated[tuple[ParameterRow, ...], internal]
    without_prior: Annotated[OffsetsWithoutPrior | None, internal]
    files: Annotated[dict[str, str] | None, if_any] = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Its offsets are not all of those of the row: they were checked there."""


@record(eq=False, kw_only=True)
class Certificate(CertifiedResult):
    """A whole certificate; `result` is what it certifies, `acceptance` the test of the corrected robot."""

    identification: str
    issued: str
    offsets: tuple[CertifiedOffset, ...]
    k: Annotated[float, internal]
    message: Annotated[Message, internal]
    result: Annotated[Result, inline("headline", "conformity", "misfit")]
    acceptance: Annotated[Verified | None, internal]
    fingerprint: Annotated[str, internal]

    @property
    @key("of the robot's maker")
    def vendor(self) -> str | None:
        return self.result.inputs.vendor

    @property
    @key("as in the result; before them the action of its message, where nothing may be entered")
    def notes(self) -> tuple[str, ...]:
        action = self.message.action.text
        first = (action,) if action and not self.message.may.enter else ()
        return (*first, *(self.result.notes or ()))

    @property
    @key("of the expanded uncertainties")
    def coverage(self) -> dict[str, float]:
        return {"k": self.k, "probability": 0.95}

    @property
    @key("what the provenance states of laboratory, customer, conditions; null where it states nothing")
    def form(self) -> dict[str, str | tuple[TracedInstrument, ...] | None]:
        return {**self.entries, "instruments": self.instruments}

    @property
    def entries(self) -> dict[str, str | None]:
        """Of the form, without the instruments."""
        return {
            key: provenance_entry(self._provenance, KEYS[name]) or None
            for key, name in CERTIFICATE_KEYS.items()
        }

    @property
    def instruments(self) -> tuple[TracedInstrument, ...]:
        """What the provenance states of them."""
        kinds = self.result.inputs.instruments.values()
        return tuple(
            TracedInstrument(name, provenance_entry(self._provenance, keys) or None)
            for name, keys in traced(kinds)
        )

    @property
    @key("names of the unidentifiable offsets")
    def not_determined(self) -> tuple[str, ...]:
        return tuple(row.name for row in self.offsets if row.status == "unidentifiable")

    @property
    @key("of the offsets whose 95 % interval differs from method to method")
    def intervals(
        self,
    ) -> Annotated[tuple[Intervals, ...], only("name", "unit", "linear", "profile", "posterior")]:
        offsets = {row.name for row in self.offsets}
        return tuple(row for row in self.result.intervals if row.name in offsets and row.differ)

    @property
    @key("before the calibration")
    def as_found(self) -> dict[str, TcpError | None]:
        return {"tcp": None if self.result.enter is None else self.result.enter.tcp_before}

    @property
    @key("once the values are entered; null where nothing may be entered")
    def expected(self) -> dict[str, TcpError | None]:
        enter = self.result.enter if self.message.may.enter else None
        return {"tcp": None if enter is None else enter.tcp_after}

    @property
    @key("what was measured with the corrected robot; null where nothing was")
    def as_left(self) -> AsLeft | None:
        if (test := self.acceptance) is None:
            return None
        when = provenance_entry(by_plain_key(test.run.provenance), KEYS[DATE]) or None
        return AsLeft(test, test.measured, test.run.file, test.run.sha256, when)

    @property
    @key("of the errors of the TCP, as in the result; null of results of an earlier version")
    def region(self) -> TcpRegion | None:
        return self.result.region

    @property
    @key("what the result rests on besides the measurements")
    def assumed(self) -> Assumed:
        return Assumed(self.result)

    @property
    @key("as in `fits.likelihood` of the result")
    def fit(self) -> Annotated[LikelihoodSummary, _OF_FIT]:
        return self.result.likelihood

    @property
    @key("that it is signed by", name="key")
    def signing_key(self) -> dict[str, str]:
        return {"algorithm": ALGORITHM, "fingerprint": self.fingerprint}

    @property
    @key("the version of zerobeam that wrote the certificate")
    def written_by(self) -> str:
        return versions()["zerobeam"]

    @property
    def _provenance(self) -> dict[str, object]:
        return by_plain_key(self.result.inputs.provenance)

    @property
    def digest(self) -> str:
        """Digits of the hash of what it states."""
        content = to_json(self)
        del content["schema"], content["identification"]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:_DIGITS]


def certificate_of(
    stored: StoredResult, result: Result, fingerprint: str, issued: date, acceptance: Verified | None = None
) -> Certificate:
    """The certificate of a result for the key of this fingerprint; `result` is the whole one of the history.

    BadInput where its message does not allow it. What the data do not determine has no number.
    """
    message = read_message(result)
    if not message.may.certify:
        raise BadInput(
            "this result is not certified: something speaks against it",
            found=f"run {stored.run}, SHA-256 {stored.sha256[:12]}…: {message.verdict}",
            allowed="a result that nothing speaks against",
            remedy=message.action.text or "find the cause (zerobeam report), or name another result by --run",
        )
    k = result.coverage_factor or _coverage_factor(result)
    certificate = Certificate(
        **{
            **vars(stored),
            "grade": message.grade,
            "offsets": tuple(_offset(row, result.geometry, k) for row in result.offsets),
        },
        identification="",
        issued=issued.isoformat(),
        k=k,
        message=message,
        result=result,
        acceptance=acceptance,
        fingerprint=fingerprint,
    )
    # ISO/IEC 17025:2017, 7.8.2.1 d: no other certificate has it, whether a laboratory numbers them or not.
    number = certificate.entries["certificate_number"] or f"SHA-256 {certificate.digest}"
    return replace(certificate, identification=number)


def _coverage_factor(result: Result) -> float:
    """k of the 95 % intervals, of a result that does not state it: one for all, since all have the degrees of
    freedom of the fit."""
    row = next(row for row in result.offsets if known(row.status))
    assert row.interval95 is not None
    assert row.std is not None
    low, high = row.interval95
    return (high - low) / 2 / row.std


def _offset(row: ParameterResult, geometry: GeometryResult, k: float) -> CertifiedOffset:
    considered = geometry.consider.get(row.name) if geometry.tolerance is None else None
    determined = known(row.status) and row.std is not None
    numbers = (None,) * 3 if row.status == "assumed" else (row.estimate, row.std, row.interval95)
    return CertifiedOffset(
        row.name,
        row.unit,
        row.status,
        *numbers,
        expanded=k * row.std if determined and row.std is not None else None,
        considered_std=considered if determined else None,
        reason=row.reason,
    )
