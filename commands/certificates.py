"""`zerobeam history key`, `certify` and `verify`: signed certificates of results."""

from __future__ import annotations

import getpass
import os
import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..experiments.command_options import Model, Url
from ..model.errors import BadInput
from ..model.options import Option, argument
from .console import print_json, say
from .history import Serial, histories, opened
from .shared_options import Json

if TYPE_CHECKING:
    from ..reports.history.certificate import SignatureCheck

VARIABLE = "ZEROBEAM_KEY_PASSPHRASE"
_LONGEST = 1000  # bytes of a passphrase


@histories.of_options("certify")
def certify(
    serial: Serial,
    private: Annotated[Path, Option("Private key to sign with.", "--key", metavar="FILE")],
    folder: Annotated[Path, Option("Folder for the certificate.", "-o --out")],
    run: Annotated[str | None, Option("The run, by the beginning of its SHA-256.", metavar="SHA256")] = None,
    date: Annotated[str | None, Option("The run, by its date or time (ISO 8601). Default: the last.")] = None,
    verification: Annotated[
        Path | None,
        Option(
            "Report of the corrected robot (zerobeam verify -o DIR): the certificate states it as left.",
            metavar="DIR",
        ),
    ] = None,
    model: Model = None,
    db: Url = None,
) -> None:
    """Write a certificate of a result (JSON, HTML, PDF), each file signed."""
    from ..experiments.history.signing import grouped, private_key, require_library

    require_library()
    with opened(db) as history:
        from ..experiments.history.store import choose, find_arm, results, whole_answer
        from ..reports.history.certificate import write_certificate

        stored = choose(list(results(history, find_arm(history, serial, model))), run, date)
        result = whole_answer(history, stored)
        today = datetime.now().astimezone().date()
        signing = private_key(private, _passphrase)
        by = write_certificate(folder, stored, result, signing, today, verification)
    verdict = f"verdict {stored.verdict}{', simulated' * stored.simulated}"
    say(f"Certificate of {stored.run}, {stored.measured_at:%Y-%m-%d}, {verdict}: {folder}")
    say(f"Signed by: {grouped(by)}")


@histories.of_options("key")
def key(
    file: Annotated[Path, argument("File for the private key; the public one is FILE.pub.")],
    passphrase: Annotated[
        bool, Option(f"Encrypt the private key: the passphrase is asked for, or taken from {VARIABLE}.")
    ] = False,
) -> None:
    """Make a pair of keys (Ed25519) to sign certificates with; no file is ever replaced."""
    from ..experiments.history.signing import grouped, make_key, public_file, require_library

    require_library()
    made = make_key(file, _passphrase(twice=True) if passphrase else None)
    if passphrase:
        say(f"Private key, encrypted: {file}. Keep it to yourself.")
    else:
        say(f"Private key: {file}. Keep it to yourself: whoever can read it can sign.")
    say(f"Public key: {public_file(file)}. Give it to whoever is to verify.")
    say(f"Fingerprint: {grouped(made)}")


@histories.of_options("verify")
def verify(
    files: Annotated[
        list[Path],
        argument(
            "Signed files (the signature is beside each, FILE.sig), or folders of certificates.",
            metavar="FILE...",
        ),
    ],
    public: Annotated[Path, Option("Public key of the signer (.pub).", "--key", metavar="FILE")],
    db: Annotated[
        str | None,
        Option("A history (SQLite file or URL): does it still hold the certified results?", metavar="URL"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check the signatures of certificates, whether the files of each state one result, and with --db whether
    the history still holds it."""
    from ..experiments.history.signing import (
        fingerprint,
        grouped,
        public_key,
        read_signed,
        require_library,
        why_not_signed,
    )
    from ..model.records import to_json
    from ..reports.history.certificate import SignatureChecks, files_of_certificate

    require_library()
    by = public_key(public)
    read = {file: read_signed(file) for path in files for file in files_of_certificate(path)}
    checks = [_verdict(file, why_not_signed(*signed, by)) for file, signed in read.items()]
    signed = {
        file: content for (file, (content, _)), row in zip(read.items(), checks, strict=True) if row.valid
    }
    checks += _of_one_result(signed)
    if db is not None:
        checks += _against_history(db, list(read), signed)
    if as_json:
        print_json(to_json(SignatureChecks(fingerprint=fingerprint(by), checks=tuple(checks))))
    else:
        say(f"Key: {grouped(fingerprint(by))}")
        for row in checks:
            words = f"NOT VALID: {row.reason}" if not row.valid else "valid"
            say(f"{row.file}, {row.check}: {words}")
    raise typer.Exit(0 if all(row.valid for row in checks) else 1)


def _verdict(
    file: Path, reason: str | None, check: Literal["signature", "certificate", "history"] = "signature"
) -> SignatureCheck:
    from ..reports.history.certificate import SignatureCheck

    return SignatureCheck(file=str(file), check=check, valid=reason is None, reason=reason)


def _of_one_result(signed: dict[Path, bytes]) -> list[SignatureCheck]:
    """Of each file beside a certificate.json whether it is of that certificate."""
    from ..reports.history.certificate import JSON, read_certificate, why_not_of_certificate

    beside = {
        file.parent: read_certificate(content, file) for file, content in signed.items() if file.name == JSON
    }
    return [
        _verdict(file, why_not_of_certificate(beside[file.parent], file.name, content), "certificate")
        for file, content in signed.items()
        if file.parent in beside and file.name != JSON
    ]


def _against_history(db: str, files: list[Path], signed: dict[Path, bytes]) -> list[SignatureCheck]:
    """Of each certificate.json whether the history agrees; what is not signed is not asked about."""
    from ..reports.history.certificate import read_certificate, why_history_differs

    if not any(file.suffix == ".json" for file in files):
        raise BadInput(
            "none of the files can be held against a history",
            found=", ".join(map(str, files)),
            allowed="a certificate.json among them",
        )
    with opened(db) as history:
        return [
            _verdict(file, why_history_differs(history, read_certificate(content, file)), "history")
            for file, content in signed.items()
            if file.suffix == ".json"
        ]


def _passphrase(*, twice: bool = False) -> str:
    """From the environment, or asked for on the terminal."""
    passphrase = os.environ.get(VARIABLE)
    if passphrase is None:
        if not sys.stdin.isatty():
            raise BadInput(
                "the private key needs its passphrase, and there is no terminal to ask for it",
                remedy=f"state it in the environment variable {VARIABLE}",
            )
        passphrase = _typed("Passphrase of the private key: ")
        if twice and _typed("Again: ") != passphrase:
            raise BadInput("the two passphrases differ", remedy="the same command asks again")
    if not 0 < len(passphrase.encode()) <= _LONGEST:
        raise BadInput(
            "the passphrase cannot be used",
            found=f"{len(passphrase.encode())} bytes",
            allowed=f"1 to {_LONGEST} bytes",
        )
    return passphrase


def _typed(question: str) -> str:
    try:
        return getpass.getpass(question)
    except EOFError:  # Ctrl-D
        return ""
