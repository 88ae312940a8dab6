"""Signatures of files: Ed25519 (RFC 8032), detached, of the bytes of a file as they are.

Keys are PEM files, PKCS#8 and SubjectPublicKeyInfo, and a signature is its 64 bytes: `openssl pkeyutl -rawin`
makes and verifies the same.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ...interruption import uninterrupted
from ...model.errors import BadInput, missing_extra
from ...model.files.whole_file import refuse_existing, write_whole
from ...model.parsing.reading import LARGEST_RECORDING, read_bytes

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

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
