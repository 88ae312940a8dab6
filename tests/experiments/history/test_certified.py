"""Keys and signatures: known answers, a second program, and whatever may be wrong with either."""

import base64
import os
import shutil
import stat
import subprocess
from pathlib import Path

import pytest
from certificates import a_key, no_passphrase

from zerobeam.experiments.history import certified
from zerobeam.experiments.history.certified import (
    fingerprint,
    make_key,
    private_key,
    public_file,
    public_key,
    read_signed,
    sign,
    signature_file,
    why_not_signed,
)
from zerobeam.model.errors import BadInput

pytest.importorskip("cryptography")

# RFC 8032, section 7.1, tests 2 and 3: secret key, public key, message, signature. What comes before a raw
# key in its DER: RFC 8410, sections 4 and 7.
VECTORS = [
    (
        "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
        "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
        "72",
        "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
        "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00",
    ),
    (
        "c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7",
        "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025",
        "af82",
        "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac"
        "18ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a",
    ),
]
_PRIVATE, _PUBLIC = "302e020100300506032b657004220420", "302a300506032b6570032100"


def pem(kind: str, der: str) -> str:
    body = base64.b64encode(bytes.fromhex(der)).decode()
    return f"-----BEGIN {kind} KEY-----\n{body}\n-----END {kind} KEY-----\n"


@pytest.mark.parametrize(("secret", "public", "message", "signature"), VECTORS)
def test_the_vectors_of_rfc_8032(
    tmp_path: Path, secret: str, public: str, message: str, signature: str
) -> None:
    (tmp_path / "key").write_text(pem("PRIVATE", _PRIVATE + secret))
    (tmp_path / "key.pub").write_text(pem("PUBLIC", _PUBLIC + public))
    file = tmp_path / "message"
    file.write_bytes(bytes.fromhex(message))
    sign(file, private_key(tmp_path / "key", no_passphrase))
    assert signature_file(file).read_bytes().hex() == signature
    own = public_key(tmp_path / "key.pub")
    assert why_not_signed(*read_signed(file), own) is None
    assert why_not_signed(b"other", bytes.fromhex(signature), own) is not None


def test_one_flipped_bit_is_found_wherever_it_is(tmp_path: Path) -> None:
    own = private_key(a_key(tmp_path), no_passphrase)
    content = bytes(range(10))
    signature, by = own.sign(content), own.public_key()
    assert why_not_signed(content, signature, by) is None
    for bit in range(8 * len(content)):
        changed = (int.from_bytes(content, "big") ^ 1 << bit).to_bytes(len(content), "big")
        assert why_not_signed(changed, signature, by) is not None
    for bit in range(8 * len(signature)):
        changed = (int.from_bytes(signature, "big") ^ 1 << bit).to_bytes(len(signature), "big")
        assert why_not_signed(content, changed, by) is not None
    assert why_not_signed(content, signature[:-1], by) == "the signature has 63 bytes, not 64"
    other = tmp_path / "other"
    make_key(other, None)
    assert why_not_signed(content, signature, public_key(public_file(other))) is not None


def test_a_key_is_its_owners_alone_and_is_never_replaced(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        told = make_key(tmp_path / "key", None)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "key").stat().st_mode) == 0o600
    assert stat.S_IMODE((tmp_path / "key.pub").stat().st_mode) == 0o666
    assert fingerprint(public_key(tmp_path / "key.pub")) == told
    content = (tmp_path / "key").read_bytes()
    with pytest.raises(BadInput, match="exists already") as caught:
        make_key(tmp_path / "key", None)
    assert "--force" not in str(caught.value)  # no key is ever replaced
    (tmp_path / "key").rename(tmp_path / "away")
    with pytest.raises(BadInput, match=r"key\.pub: the file exists already"):
        make_key(tmp_path / "key", None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["away", "key.pub"]
    assert (tmp_path / "away").read_bytes() == content


def test_a_key_that_cannot_be_written_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = certified.write_whole

    def full(path: Path, content: bytes) -> None:
        if path.suffix != ".pub":
            raise BadInput("the file cannot be written: No space left on device", file=path)
        write(path, content)

    monkeypatch.setattr(certified, "write_whole", full)
    with pytest.raises(BadInput, match="No space left"):
        make_key(tmp_path / "key", None)
    assert not list(tmp_path.iterdir())


def test_a_key_with_a_passphrase(tmp_path: Path) -> None:
    told = make_key(tmp_path / "key", "schön & long")
    assert b"ENCRYPTED" in (tmp_path / "key").read_bytes()
    own = private_key(tmp_path / "key", lambda: "schön & long")
    assert fingerprint(own.public_key()) == told
    with pytest.raises(BadInput, match="another passphrase"):
        private_key(tmp_path / "key", lambda: "schoen")


def test_other_files_are_no_keys(tmp_path: Path) -> None:
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric import ec

    private = a_key(tmp_path)
    with pytest.raises(BadInput, match=r"public key, which signs nothing[\s\S]*without \.pub"):
        private_key(public_file(private), no_passphrase)
    with pytest.raises(BadInput, match=r"private key: it is for its owner[\s\S]*plant\.key\.pub"):
        public_key(private)
    other = ec.generate_private_key(ec.SECP256R1())
    (tmp_path / "ec").write_bytes(
        other.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption())
    )
    (tmp_path / "ec.pub").write_bytes(
        other.public_key().public_bytes(form.Encoding.PEM, form.PublicFormat.SubjectPublicKeyInfo)
    )
    with pytest.raises(BadInput, match=r"another kind[\s\S]*Ed25519"):
        private_key(tmp_path / "ec", no_passphrase)
    with pytest.raises(BadInput, match=r"another kind[\s\S]*Ed25519"):
        public_key(tmp_path / "ec.pub")
    for text in ("hello", private.read_text()[:60], pem("PRIVATE", "00"), pem("PUBLIC", "00"), "\udcff"):
        (tmp_path / "bad").write_text(text, errors="surrogateescape")
        with pytest.raises(BadInput):
            private_key(tmp_path / "bad", no_passphrase)
        with pytest.raises(BadInput):
            public_key(tmp_path / "bad")
    with pytest.raises(BadInput, match="no such file"):
        public_key(tmp_path / "none")


def test_a_signed_file_is_read_with_its_signature(tmp_path: Path) -> None:
    file = tmp_path / "certificate.pdf"
    file.write_bytes(b"%PDF")
    with pytest.raises(BadInput, match=r"no signature beside it[\s\S]*certificate\.pdf\.sig"):
        read_signed(file)
    own = private_key(a_key(tmp_path), no_passphrase)
    sign(file, own)
    content, signature = read_signed(file)
    assert (content, len(signature)) == (b"%PDF", 64)
    signature_file(file).unlink()
    sign(file, own)
    assert read_signed(file) == (content, signature), "Ed25519 is deterministic"


def test_openssl_verifies_what_is_signed_here_and_the_other_way_round(tmp_path: Path) -> None:
    program = shutil.which("openssl")
    if program is None:
        pytest.skip("openssl is not installed")
    private, file = a_key(tmp_path), tmp_path / "file"
    file.write_bytes(bytes(range(256)) * 100)

    def ran(*words: object) -> bool:
        command = [program, *map(str, words)]
        return subprocess.run(command, capture_output=True, timeout=60, check=False).returncode == 0

    def verified() -> bool:
        public = ("-verify", "-pubin", "-inkey", public_file(private))
        return ran("pkeyutl", *public, "-rawin", "-in", file, "-sigfile", signature_file(file))

    sign(file, private_key(private, no_passphrase))
    assert verified()
    signature = signature_file(file).read_bytes()
    file.write_bytes(b"\x01" + file.read_bytes()[1:])
    assert not verified()
    file.write_bytes(b"\x00" + file.read_bytes()[1:])
    signature_file(file).unlink()
    assert ran(*("pkeyutl", "-sign", "-inkey", private, "-rawin", "-in", file, "-out", signature_file(file)))
    assert signature_file(file).read_bytes() == signature
    # A key that openssl makes is a key.
    assert ran("genpkey", "-algorithm", "ed25519", "-out", tmp_path / "theirs")
    assert private_key(tmp_path / "theirs", no_passphrase).sign(b"") != b""
