"""`zerobeam history key`, `certify` and `verify`: from a result to a certificate that anyone can check."""

import io
import json
import os
import pty
import random
import select
import shutil
import time
from pathlib import Path
from unittest import mock

import pytest
from certificates import kept
from child import ZEROBEAM, child
from command_line import zerobeam
from histories import a_result, as_misfit, write_result

pytest.importorskip("cryptography")

NAMES = ("certificate.json", "certificate.html", "certificate.pdf")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plant")
    results = a_result("A-1", "2025-01-31"), a_result("A-1", "2026-01-31", who="J. Doe")
    kept(folder, *results).engine.dispose()
    assert zerobeam("history", "key", folder / "plant.key").status == 0
    told = zerobeam(
        *("history", "certify", "A-1", "--key", folder / "plant.key", "-o", folder / "signed"),
        *("--db", folder / "history.sqlite"),
    )
    assert (told.status, told.err) == (0, "")
    assert "2026-01-31, verdict pass: " in told.out
    return folder


@pytest.fixture
def plant(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A history with two results of one arm, a key, and a certificate of the last one in `signed`."""
    folder = shutil.copytree(made, tmp_path / "plant")
    monkeypatch.setenv("ZEROBEAM_HISTORY", str(folder / "history.sqlite"))
    monkeypatch.delenv("ZEROBEAM_KEY_PASSPHRASE", raising=False)
    monkeypatch.chdir(folder)
    return folder


def test_a_certificate_is_made_and_verified(plant: Path) -> None:
    told = zerobeam("history", "verify", "signed", "--key", "plant.key.pub")
    assert (told.status, told.out.count(": valid")) == (0, 5)
    every = sorted(str(file.relative_to(plant)) for file in (plant / "signed").iterdir())
    again = zerobeam("history", "verify", *every, "--key", "plant.key.pub")  # signed/*
    assert sorted(again.out.splitlines()) == sorted(told.out.splitlines())
    found = zerobeam(
        *("history", "verify", "signed/certificate.json", "--key", "plant.key.pub"),
        *("--db", "history.sqlite", "--json"),
    )
    assert found.status == 0
    certificate = json.loads((plant / "signed" / "certificate.json").read_text(encoding="utf-8"))
    assert found.json == {
        "schema": "zerobeam/verification/1",
        "fingerprint": certificate["key"]["fingerprint"],
        "checks": [
            {"file": "signed/certificate.json", "check": check, "valid": True, "reason": None}
            for check in ("signature", "history")
        ],
    }
    first = zerobeam("history", "certify", "A-1", "--date", "2025-01-31", "--key", "plant.key", "-o", "first")
    assert "2025-01-31, verdict pass" in first.out
    by_run = zerobeam(
        *("history", "certify", "A-1", "--run", certificate["sha256"][:8], "--key", "plant.key"),
        *("-o", "again"),
    )
    assert by_run.status == 0
    for name in NAMES:
        assert (plant / "again" / name).read_bytes() == (plant / "signed" / name).read_bytes()


def test_one_changed_byte_in_any_file_is_found(plant: Path) -> None:
    chance = random.Random(1)
    for name in (*NAMES, *(f"{name}.sig" for name in NAMES)):
        file = plant / "signed" / name
        content = file.read_bytes()
        for place in (0, chance.randrange(len(content)), len(content) - 1):
            changed = bytearray(content)
            changed[place] ^= 1 << chance.randrange(8)
            file.write_bytes(changed)
            told = zerobeam("history", "verify", "signed", "--key", "plant.key.pub", "--json")
            assert told.status == 1
            wrong = [row["file"] for row in told.json["checks"] if not row["valid"]]
            assert wrong == [f"signed/{name.removesuffix('.sig')}"]
        file.write_bytes(content)


def test_files_of_two_results_are_no_certificate(plant: Path) -> None:
    """Each of them signed by the same key: last month's PDF in this month's folder."""
    words = ("--date", "2025-01-31", "--key", "plant.key", "-o", "first")
    assert zerobeam("history", "certify", "A-1", *words).status == 0
    verify = ("history", "verify", "signed", "--key", "plant.key.pub")
    for name in NAMES:
        before = {own: (plant / "signed" / own).read_bytes() for own in (name, f"{name}.sig")}
        for own in before:
            shutil.copyfile(plant / "first" / own, plant / "signed" / own)
        told = zerobeam(*verify, "--json")
        wrong = [(row["file"], row["check"]) for row in told.json["checks"] if not row["valid"]]
        others = NAMES[1:] if name == NAMES[0] else (name,)
        assert (told.status, wrong) == (1, [(f"signed/{own}", "certificate") for own in others])
        assert "the two state different results" in zerobeam(*verify).out
        for own, content in before.items():
            (plant / "signed" / own).write_bytes(content)
    assert zerobeam(*verify).status == 0


def test_another_key_is_found_and_another_history(plant: Path) -> None:
    zerobeam("history", "key", "other.key")
    told = zerobeam("history", "verify", "signed", "--key", "other.key.pub")
    assert (told.status, told.out.count("NOT VALID")) == (1, 3)
    other = a_result("A-1", "2026-01-31", who="J. Doe")
    other["parameters"][1]["estimate"] += 1.0
    file = write_result(plant / "other.json", other)
    assert zerobeam("history", "add", file, "--replace").out.startswith("0 added, 1 replaced")
    verify = ("history", "verify", "signed", "--key", "plant.key.pub")
    assert zerobeam(*verify).status == 0, "the certificate is as it was signed"
    told = zerobeam(*verify, "--db", "history.sqlite")
    assert told.status == 1
    assert "certificate.json, history: NOT VALID: the history has another document of this run" in told.out
    # What nobody has signed is not held against the history.
    (plant / "signed" / "certificate.json").write_text("{}")
    told = zerobeam(*verify, "--db", "history.sqlite")
    assert (told.status, "history:" in told.out) == (1, False)


def test_bad_input_is_one_clear_error(plant: Path) -> None:
    verify = ("history", "verify", "--key", "plant.key.pub")
    assert "no such file" in zerobeam(*verify, "none.pdf").refused()
    (plant / "signed" / "certificate.pdf.sig").unlink()
    assert "no signature beside it" in zerobeam(*verify, "signed").refused()
    only_html = zerobeam(*verify, "signed/certificate.html", "--db", "history.sqlite").refused()
    assert "a certificate.json among them" in only_html
    own = zerobeam("history", "verify", "--key", "plant.key", "signed/certificate.html").refused()
    assert "private key: it is for its owner alone" in own
    certify = ("history", "certify", "A-1", "-o", "new", "--key")
    assert "public key, which signs nothing" in zerobeam(*certify, "plant.key.pub").refused()
    assert "no such file" in zerobeam(*certify, "none.key").refused()
    assert "no such result" in zerobeam(*certify, "plant.key", "--run", "zz").refused()
    unknown = zerobeam("history", "certify", "A-2", "-o", "new", "--key", "plant.key").refused()
    assert "did you mean" in unknown
    assert "exists already" in zerobeam("history", "key", "plant.key").refused()
    misfit = as_misfit(a_result("B"))
    zerobeam("history", "add", write_result(plant / "misfit.json", misfit))
    refused = zerobeam("history", "certify", "B", "-o", "new", "--key", "plant.key").refused()
    assert "this result is not certified: something speaks against it" in refused
    assert not (plant / "new").exists()


def test_a_passphrase_by_the_environment(plant: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert "no terminal to ask" in zerobeam("history", "key", "safe.key", "--passphrase").refused()
    monkeypatch.setenv("ZEROBEAM_KEY_PASSPHRASE", "long & schön")
    told = zerobeam("history", "key", "safe.key", "--passphrase")
    assert "Private key, encrypted: safe.key" in told.out
    assert "ENCRYPTED" in (plant / "safe.key").read_text()
    certify = ("history", "certify", "A-1", "-o", "safe", "--key", "safe.key")
    assert zerobeam(*certify).status == 0
    assert zerobeam("history", "verify", "safe", "--key", "safe.key.pub").status == 0
    monkeypatch.setenv("ZEROBEAM_KEY_PASSPHRASE", "wrong")
    assert "another passphrase" in zerobeam(*certify).refused()
    monkeypatch.setenv("ZEROBEAM_KEY_PASSPHRASE", "")
    assert "0 bytes" in zerobeam(*certify).refused()
    monkeypatch.delenv("ZEROBEAM_KEY_PASSPHRASE")
    assert "ZEROBEAM_KEY_PASSPHRASE" in zerobeam(*certify).refused()


def test_without_the_extra_it_says_how_to_install_it(plant: Path) -> None:
    with mock.patch.dict("sys.modules", {"cryptography.hazmat.primitives.asymmetric.ed25519": None}):
        for words in (
            ("key", "new.key"),
            ("certify", "A-1", "--key", "plant.key", "-o", "new"),
            ("verify", "signed", "--key", "plant.key.pub"),
        ):
            assert 'pip install "zerobeam[sign]"' in zerobeam("history", *words).refused()


@pytest.mark.long
def test_a_passphrase_is_asked_for_on_the_terminal(plant: Path) -> None:
    def answered(*words: str, answers: list[str]) -> tuple[int, str]:
        """Exit status and output of a command on a terminal of its own, its questions answered."""
        terminal, theirs = pty.openpty()
        # A session's first process that opens a terminal has it as its own, for getpass.
        opened = ["sh", "-c", 'exec "$@" <"$0" >"$0" 2>&1', os.ttyname(theirs)]
        with child([*opened, *ZEROBEAM, *words], start_new_session=True) as process:
            said, told = "", 0
            while select.select([terminal], [], [], 0.1)[0] or process.poll() is None:
                if not select.select([terminal], [], [], 0)[0]:
                    continue
                said += os.read(terminal, 1000).decode()
                asked = said.count("Passphrase of the private key: ") + said.count("Again: ")
                if asked > told:
                    os.write(terminal, answers[told].encode())
                    told = asked
            status = process.wait()
        os.close(terminal)
        os.close(theirs)
        return status, said

    key = ("history", "key", "asked.key", "--passphrase")
    status, said = answered(*key, answers=["one\n", "other\n"])
    assert (status, "differ" in said) == (2, True)
    assert not (plant / "asked.key").exists()
    status, said = answered(*key, answers=["secret\n", "secret\n"])
    assert (status, "secret" in said) == (0, False)
    certify = ("history", "certify", "A-1", "--key", "asked.key", "-o", "asked")
    assert answered(*certify, answers=["wrong\n"])[0] == 2
    status, said = answered(*certify, answers=["\x04"])  # Ctrl-D
    assert (status, "0 bytes" in said, "Traceback" in said) == (2, True, False)
    assert answered(*certify, answers=["\x03"])[0] == 130  # Ctrl-C
    status, said = answered(*certify, answers=["secret\n"])
    assert (status, "Signed by" in said) == (0, True)


@pytest.mark.long
def test_a_killed_process_leaves_a_whole_certificate_or_none(plant: Path) -> None:
    chance, folder = random.Random(3), plant / "killed"
    command = [*ZEROBEAM, "history", "certify", "A-1", "--key", "plant.key", "-o", str(folder)]
    begun = time.monotonic()
    with child(command) as process:
        process.communicate()
    whole_s, counts = time.monotonic() - begun, [0, 0]
    expected = {path.name: path.read_bytes() for path in folder.iterdir()}
    for _ in range(25):
        shutil.rmtree(folder, ignore_errors=True)
        with child(command) as process:
            time.sleep(chance.uniform(0.3, 1.05) * whole_s)
            process.kill()
            process.communicate()
        counts[folder.exists()] += 1
        if folder.exists():
            assert {path.name: path.read_bytes() for path in folder.iterdir()} == expected
    with child(command) as process:
        process.communicate()
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == expected
    assert not list(plant.glob(".zerobeam-new*")), "what a killed process left is removed by the next"
    assert counts[0], "no process was killed before its end"
