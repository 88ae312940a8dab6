"""A certificate states what the result determines, what it rests on, and no number of anything else."""

import copy
import functools
import io
import json
import re
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import example_results
import pypdf
import pytest
from certificates import a_key, kept, no_passphrase, only
from histories import a_result, postgresql
from pages import Page, assert_fetches_nothing

from zerobeam.analysis.answer.result import Result, parse_result
from zerobeam.experiments.history.certified import (
    CERTIFICATE_SCHEMA,
    Certificate,
    CertifiedResult,
    certificate_of,
    fingerprint,
    grouped,
    private_key,
    public_file,
    public_key,
    read_signed,
    why_not_signed,
)
from zerobeam.experiments.history.store import add, results, whole_answer
from zerobeam.experiments.history.stored_result import StoredResult, read_entry
from zerobeam.model.errors import BadInput
from zerobeam.model.instruments.flange_tool import LaserBeam
from zerobeam.reports.history.certificate import (
    certificate_page,
    files_of_certificate,
    read_certificate,
    why_history_differs,
    write_certificate,
)
from zerobeam.reports.output.html import html
from zerobeam.words import numbers
from zerobeam.words.provenance import CERTIFICATE_KEYS
from zerobeam.words.sentences import to_json

pytest.importorskip("cryptography")

ISSUED = date(2026, 4, 1)


def written(folder: Path, answer: dict[str, Any]) -> Path:
    """The folder of the certificate of a result, that a history has kept."""
    folder.mkdir(exist_ok=True)
    history = kept(folder, answer)
    own = only(history)
    key = private_key(a_key(folder), no_passphrase)
    write_certificate(folder / "certificate", own, whole_answer(history, own), key, ISSUED)
    return folder / "certificate"


def stated(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    return found


def of_file(folder: Path) -> CertifiedResult:
    file = folder / "certificate.json"
    return read_certificate(file.read_bytes(), file)


def of_result(folder: Path, result: Result) -> Certificate:
    """The certificate of a result of the examples."""
    answer = copy.deepcopy(to_json(result))
    answer["inputs"]["header"]["provenance"] = {"serial": "A-1", "when": "2026-01-31"}
    own = only(kept(folder, answer))
    return certificate(own, answer)


def certificate(own: StoredResult, answer: dict[str, Any], issued: date = ISSUED) -> Certificate:
    """The certificate of a result.json."""
    return certificate_of(own, parse_result(json.dumps(answer)), "0" * 64, issued)


def page(certificate: Certificate) -> Page:
    return Page(html(certificate_page(certificate), {}, "study"))


@functools.cache
def pdf_text(file: Path) -> str:
    pages = pypdf.PdfReader(io.BytesIO(file.read_bytes())).pages
    return "\n".join(own.extract_text() for own in pages)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("example", ["good", "uncalibrated"])
def test_only_what_the_header_states_is_a_setting_of_the_run(tmp_path: Path, example: str) -> None:
    """What the offsets rest on: what is assumed of the laser stands under that word alone."""
    own = of_result(tmp_path, example_results.EXAMPLES[example])
    shown = page(own).words
    for name in ("tool.direction", "noise.joint_deg", "noise.spot_mm"):
        assert name in shown
    for name in ("tool.sigma", "noise.scale", "noise.plausible_factor"):
        assert name not in shown
    assert to_json(own)["assumed"]["tool"]["sigma"] is None


def test_it_states_the_result_and_is_signed(tmp_path: Path) -> None:
    answer = a_result("A-1", "2026-03-31T14:05:00+02:00", psd="Hamamatsu 17", who="J. Doe")
    folder = written(tmp_path, answer)
    own = only(kept(tmp_path))
    found = stated(folder)
    assert found["schema"] == CERTIFICATE_SCHEMA
    assert (found["serial"], found["model"], found["vendor"]) == ("A-1", "irb1600", "abb")
    assert (found["measured_at"], found["operator"]) == ("2026-03-31T12:05:00+00:00", "J. Doe")
    assert (found["sha256"], found["document_sha256"]) == (answer["inputs"]["sha256"], own.document_sha256)
    assert (found["verdict"], found["misfit"], found["not_determined"]) == ("pass", None, [])
    for row, of in zip(found["offsets"], answer["parameters"], strict=False):
        if row["status"] == "assumed":
            assert (row["name"], row["estimate"], row["std"], row["expanded"]) == ("delta6", None, None, None)
            assert row["reason"].startswith("as good as the laser's mounting")
            continue
        assert [row[key] for key in ("name", "status", "estimate", "std", "interval95")] == [
            of[key] for key in ("name", "status", "estimate", "std", "interval95")
        ]
        nominal = answer["geometry"]["tolerance"] is None
        considered = answer["geometry"]["consider"].get(row["name"]) if nominal else None
        assert row["considered_std"] == considered
    assert found["assumed"]["noise"]["joint_deg"] == 0.01
    assert found["assumed"]["priors"][0] == {"group": "offset", "unit": "deg", "std": 5.0}
    assert found["assumed"]["held"][0] == "delta1"
    by = public_key(public_file(a_key(tmp_path)))
    assert found["key"] == {"algorithm": "Ed25519", "fingerprint": fingerprint(by)}
    files = files_of_certificate(folder)
    assert len(files) == 3
    assert all(why_not_signed(*read_signed(file), by) is None for file in files)
    assert {path.name for path in folder.iterdir()} == {
        name for file in files for name in (file.name, f"{file.name}.sig")
    }
    shown = Page((folder / "certificate.html").read_text(encoding="utf-8"))
    assert_fetches_nothing(shown)
    for text in (shown.words, pdf_text(folder / "certificate.pdf")):
        plain = " ".join(text.split())
        for said in ("A-1", "J. Doe", "Hamamatsu 17", "2026-04-01", "No misfit"):
            assert said in plain
        for row in (row for row in found["offsets"] if row["status"] == "identified"):
            assert numbers.estimate(row["estimate"], row["expanded"], "deg") in plain
            assert numbers.spread(row["expanded"], "deg") in plain
        assert own.document_sha256 in re.sub(r"\s", "", text)
        assert grouped(fingerprint(by)).replace(" ", "") in re.sub(r"\s", "", text)
        assert "assumed: no value is certified" in plain
        assert "signed exactly these bytes" in plain


def test_the_same_result_and_key_give_the_same_bytes(tmp_path: Path) -> None:
    folder = written(tmp_path, a_result())
    first = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {path.name: path.read_bytes() for path in written(tmp_path, a_result()).iterdir()} == first


def test_another_day_of_issue_gives_another_certificate(tmp_path: Path) -> None:
    own = only(kept(tmp_path, a_result()))
    made = [to_json(certificate(own, a_result(), day)) for day in (ISSUED, date(2026, 4, 2))]
    assert [one.pop("issued") for one in made] == ["2026-04-01", "2026-04-02"]
    identified = [one.pop("identification") for one in made]
    assert made[0] == made[1]
    # Each has an identification of its own, the same whenever it is written.
    assert re.fullmatch(r"SHA-256 [0-9a-f]{16}", identified[0])
    assert identified[0] != identified[1]
    again = certificate(own, a_result())
    assert again.identification == identified[0]


STATED = {
    "certificate_number": "K-17",
    "laboratory": "Muster GmbH",
    "laboratory_address": "Werkstr. 1",
    "customer": "Plant 4",
    "customer_address": "Hafen 2",
    "place": "Hall 3",
    "temperature": "21.4",
    "payload": "12.4 kg",
    "warm_up": "40 min",
    "traceability": "by DKD-K-0815",
    "authorised_by": "R. Roe",
}


def first_page(folder: Path) -> str:
    page = pypdf.PdfReader(io.BytesIO((folder / "certificate.pdf").read_bytes())).pages[0]
    return " ".join(page.extract_text().split())


def test_the_first_page_has_what_a_laboratory_must_state(tmp_path: Path) -> None:
    """ISO/IEC 17025:2017, 7.8.2: what is stated, else a line for ink; and a place to sign."""
    folder = written(tmp_path / "stated", a_result(**STATED, psd_certificate="DKD-K-0815"))
    found, text = stated(folder), first_page(folder)
    assert {key: found["form"][key] for key in STATED} == STATED
    assert found["form"].keys() == {*CERTIFICATE_KEYS, "instruments"}
    names = [name for key, name in CERTIFICATE_KEYS.items() if key != "traceability"]
    names += [name for name, _ in LaserBeam.words.traced]
    for said in (*names, *(text for key, text in STATED.items() if key != "traceability"), "Signature"):
        assert said in text, said
    assert "by DKD-K-0815" in pdf_text(folder / "certificate.pdf")
    assert found["identification"] == "K-17"
    blank = written(tmp_path / "blank", a_result())
    form = stated(blank)["form"]
    assert [row["text"] for row in form.pop("instruments")] == [None] * 4
    assert set(form.values()) == {None}
    for said in (*names, "Signature"):
        assert said in first_page(blank), said
    shown = (blank / "certificate.html").read_text(encoding="utf-8")
    # Nine entries, four of instruments, the operator, the signature: the number is that of the contents.
    assert shown.count('<dd class="blank">') == len(names) + 1
    assert stated(blank)["identification"] in first_page(blank)
    assert "Not shown: no calibration certificate" in " ".join(pdf_text(blank / "certificate.pdf").split())


def test_a_document_has_one_u_and_one_k(tmp_path: Path) -> None:
    folder = written(tmp_path, a_result())
    found = stated(folder)
    k = found["coverage"]["k"]
    assert k == a_result()["coverage_factor"]
    for row in (row for row in found["offsets"] if row["status"] == "identified"):
        assert row["expanded"] == pytest.approx(k * row["std"])
    shown = Page((folder / "certificate.html").read_text(encoding="utf-8"))
    for text in (shown.words, pdf_text(folder / "certificate.pdf")):
        factors = re.findall(r"k\s=\s([\d.]*\d)", text)
        assert len(factors) > 1
        assert {float(factor) for factor in factors} == {k}


def test_a_result_of_an_older_version_is_certified(tmp_path: Path) -> None:
    answer = a_result()
    for key in ("enter", "conformity", "coverage_factor", "message"):
        answer.pop(key, None)
    made = certificate(only(kept(tmp_path, answer)), answer)
    assert (made.as_found["tcp"], made.as_left) == (None, None)
    assert made.coverage["k"] == pytest.approx(1.96, abs=1e-3)  # of its 95 % intervals
    words = page(made).words
    assert "Not measured for this certificate" in words
    assert "Expected as left" not in words


def a_verification(folder: Path, sha256: str) -> Path:
    """The folder of a verification of the calibration of this run."""
    measured = {
        "before": {"rms_mm": 32.0, "worst_mm": 41.0},
        "after": {"rms_mm": 0.34, "worst_mm": 0.44},
        "noise_mm": 0.4,
    }
    answer = {
        "schema": "zerobeam/acceptance/1",
        **{"verdict": "pass", "measurements": 4, "dof": 5, "p_value": 0.9, "false_alarm": 0.01},
        **{"statistic": 0.6, "rms_mm": 0.3, "expected_mm": 0.4, "offsets": [], "mistakes": []},
        **{"power_required": 0.8, "measured": {"postures": [], **measured}},
        "calibration": {"file": "run.jsonl", "sha256": sha256, "provenance": {}},
        "run": {"file": "new.jsonl", "sha256": "ab" * 32, "provenance": {"When": "2026-04-01"}},
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "verification.json").write_text(json.dumps(answer), encoding="utf-8")
    return folder


def test_as_left_is_what_was_measured_with_the_corrected_robot(tmp_path: Path) -> None:
    answer = a_result()
    sha256 = answer["inputs"]["sha256"]
    history = kept(tmp_path, answer)
    own, key = only(history), private_key(a_key(tmp_path), no_passphrase)
    whole = whole_answer(history, own)
    folder = tmp_path / "certificate"
    write_certificate(folder, own, whole, key, ISSUED, a_verification(tmp_path / "verified", sha256))
    left = stated(folder)["as_left"]
    assert (left["verdict"], left["run"], left["measured_on"]) == ("pass", "new.jsonl", "2026-04-01")
    assert left["error_mm"]["after"] == {"rms_mm": 0.34, "worst_mm": 0.44}
    shown = Page((folder / "certificate.html").read_text(encoding="utf-8")).words
    for words in (shown, pdf_text(folder / "certificate.pdf")):
        plain = " ".join(words.split())
        assert "0.34 mm rms, worst 0.44 mm (32 mm rms, worst 41 mm as found" in plain
        assert "Acceptance test: Fail where" in plain
        assert "Not measured for this certificate" not in plain
    other = a_verification(tmp_path / "other", "0" * 64)
    with pytest.raises(BadInput, match="another calibration"):
        write_certificate(tmp_path / "no", own, whole, key, ISSUED, other)
    (other / "verification.json").write_text('{"schema": "zerobeam/acceptance/1"}', encoding="utf-8")
    with pytest.raises(BadInput, match="not the report of a verification"):
        write_certificate(tmp_path / "no", own, whole, key, ISSUED, other)
    assert not (tmp_path / "no").exists()


def test_a_requirement_comes_with_its_decision_and_rule(tmp_path: Path) -> None:
    answer = a_result()
    answer["conformity"] = {
        **{"required_mm": 0.5, "tcp_95_mm": 0.6, "probability": 0.2, "decision": "undecided"},
        "rule": "as JCGM 106 says",
    }
    words = page(certificate(only(kept(tmp_path, answer)), answer)).words
    assert "Decision: undecided (probability 0.20). Rule: as JCGM 106 says." in words
    answer["conformity"] = None
    words = page(certificate(only(kept(tmp_path, answer)), answer)).words
    assert "no statement of conformity is made" in words


def test_what_is_not_determined_has_no_number_anywhere(tmp_path: Path) -> None:
    answer = a_result(demo="x-pattern")
    lost = next(row for row in answer["parameters"] if row["status"] == "unidentifiable")
    assert lost["name"] == "delta2"
    folder = written(tmp_path, answer)
    found = stated(folder)
    assert (found["verdict"], found["not_determined"]) == ("degenerate", ["delta2"])
    row = next(row for row in found["offsets"] if row["name"] == "delta2")
    assert [row[key] for key in ("estimate", "std", "interval95", "considered_std")] == [None] * 4
    shown = Page((folder / "certificate.html").read_text(encoding="utf-8"))
    cells = shown.row("J2 (δ2)")
    assert cells[1:] == ["not determined by these data", "unidentifiable", "—"]
    assert not re.search(r"\d", "".join(cells[1:]))
    text = pdf_text(folder / "certificate.pdf")
    # The verdict's sentence comes before the table.
    every = re.findall(r"J2 \(δ2\)([^J]*?)J3 \(δ3\)", text)
    between = next(each for each in every if "not determined" in each)
    assert not re.search(r"\d", between)
    whole = (folder / "certificate.json").read_text(encoding="utf-8") + shown.words + text
    if lost["data_std"] is not None:
        assert f"{lost['data_std']:.4g}" not in whole
    # A document that claims a number for it is none of ours, and is not certified.
    claimed = copy.deepcopy(answer)
    next(own for own in claimed["parameters"] if own["name"] == "delta2")["estimate"] = 0.1
    with pytest.raises(BadInput, match="is unidentifiable, yet it has a value"):
        kept(tmp_path / "certificate", claimed)


def test_it_says_what_to_do_where_nothing_may_be_entered(tmp_path: Path) -> None:
    """As the message, which alone decides; and expects nothing of values that are not entered."""
    answer = a_result()
    for enter in (False, True):
        answer["message"]["may"]["enter"] = enter
        answer["message"]["action"]["text"] = "Enter nothing yet: plan and measure."
        folder = written(tmp_path / str(enter), answer)
        said = [] if enter else ["Enter nothing yet: plan and measure."]
        assert stated(folder)["notes"] == [*said, *answer["notes"]]
        assert (stated(folder)["expected"]["tcp"] is None) is not enter
        shown = Page((folder / "certificate.html").read_text(encoding="utf-8")).words
        for text in (shown, pdf_text(folder / "certificate.pdf")):
            plain = " ".join(text.split())
            assert ("Enter nothing yet: plan and measure." in plain) is not enter
            assert ("Expected as left" in plain) is enter


def test_a_misfit_is_not_certified(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"not certified[\s\S]*The model does not describe"):
        of_result(tmp_path, example_results.misfit())


@pytest.mark.parametrize("converged", [True, False])
def test_what_determines_no_offset_is_not_certified(tmp_path: Path, converged: bool) -> None:
    answer = a_result(demo="x-pattern")
    for row in answer["parameters"]:
        row |= {"status": "unidentifiable", "estimate": None, "std": None, "interval95": None, "held": False}
    answer["without_prior"], answer["fits"]["likelihood"]["converged"] = None, converged
    answer |= {"intervals": [], "budget": [], "scene": None, "outlook": None}
    answer["posterior"]["parameters"] = None
    own = only(kept(tmp_path, answer))
    with pytest.raises(BadInput, match="not certified: something speaks against it"):
        certificate(own, answer)
    answer["message"] = None  # of an earlier version
    with pytest.raises(BadInput, match="not certified: something speaks against it"):
        certificate(own, answer)


def test_a_posterior_that_did_not_converge_is_said(tmp_path: Path) -> None:
    shown = page(of_result(tmp_path, example_results.unconverged()))
    assert "No posterior is shown: the posterior has not converged" in shown.words


@pytest.mark.long
def test_what_the_offsets_rest_on_is_stated(tmp_path: Path) -> None:
    for name in ("geometry", "separate", "uncalibrated"):
        (tmp_path / name).mkdir()
    freed = of_result(tmp_path / "geometry", example_results.geometry())
    assert freed.assumed.geometry.tolerance is not None
    assert {row.considered_std for row in freed.offsets} == {None}
    assert "geometry" in {row.group for row in freed.assumed.priors}
    shown = page(freed)
    factors = example_results.geometry().geometry.factors
    assert factors is not None
    assert to_json(freed)["assumed"]["geometry"]["factors"]["length"] == factors.length
    assert "estimated within tolerances of 0.3\u00a0mm and 0.1°" in shown.words
    parts = [f"{kind} by {factor:#.2g}" for kind, factor in factors.by_kind().items()]
    assert len(parts) > 1
    assert all(part in shown.words for part in parts)
    assert "incl. tolerances" not in shown.words
    noisy = of_result(tmp_path / "separate", example_results.separate())
    assert [row["name"] for row in to_json(noisy)["assumed"]["noise_factors"]] == [
        "noise.joint",
        "noise.spot",
    ]
    words = page(noisy).words
    assert "Noise, as a multiple of the stated" in words
    assert re.search(r"noise\.scale\s*separate", words)
    assert "noise.spot" in words
    free = of_result(tmp_path / "uncalibrated", example_results.uncalibrated())
    assert free.assumed.tool is not None
    assert (free.assumed.tool.kind, free.assumed.tool.calibrated) == ("laser", False)
    assert re.search(r"tool\.kind\s*laser\s*tool\.calibrated\s*false", page(free).words)
    assert "tool 3° and 10" in page(free).words


def test_intervals_that_differ_between_methods_are_shown(tmp_path: Path) -> None:
    answer = a_result()
    ends = {"linear": [-1.26, -1.18], "profile": [-1.4, -1.18], "posterior": None}
    answer["intervals"] = [
        {"name": name, "unit": "deg", **ends, "differ": differ}
        for name, differ in (("delta2", True), ("delta3", False), ("psd.x", True))
    ]
    found = certificate(only(kept(tmp_path, answer)), answer)
    assert [row["name"] for row in to_json(found)["intervals"]] == ["delta2"]
    assert ["J2 (δ2)", "−1.260 to −1.180°", "−1.400 to −1.180°", "not sampled"] in page(found).rows
    assert not [row for row in page(found).rows if row[:2] == ["J3 (δ3)", "−1.260 to −1.180°"]]


def test_what_the_result_found_and_a_simulation_are_on_the_first_page(tmp_path: Path) -> None:
    answer = a_result(origin="simulated")
    answer["notes"] = ["Outlying: measurement 3; delta4 hangs on it"]
    found = certificate(only(kept(tmp_path, answer)), answer)
    assert found.simulated
    assert certificate_page(found).verdict.word == "Simulated: pass"
    notes = certificate_page(found).notes
    assert notes[0].startswith("These measurements were simulated")
    assert notes[1].startswith("Enter nothing: no robot was measured")
    assert notes[2] == "Outlying: measurement 3; J4 (δ4) hangs on it."


def test_names_do_no_harm(tmp_path: Path) -> None:
    name = "<script>alert('x')</script> #import \"/etc/passwd\" {{ 7*7 }} \u202eמ \x00 \ud800 🎯"
    folder = written(tmp_path, a_result(name, who=name, psd=name))
    shown = Page((folder / "certificate.html").read_text(encoding="utf-8"))
    assert_fetches_nothing(shown)
    text = pdf_text(folder / "certificate.pdf")
    for said in (shown.words, text):
        assert "<script>alert(" in said
        assert "\\u202e" in said
        assert not set("\x00\u202e\ud800") & set(said)
    # `provenance` was made fit to be shown when the result was added.
    assert stated(folder)["serial"].startswith("<script>")


def test_a_history_says_whether_it_still_holds_the_result(tmp_path: Path) -> None:
    answer = a_result()
    history = kept(tmp_path, answer)
    own = certificate(only(history), answer)
    assert why_history_differs(history, own) is None
    assert "no result" in (why_history_differs(history, replace(own, sha256="0" * 64)) or "")
    assert "operator" in (why_history_differs(history, replace(own, operator="x")) or "")
    other = copy.deepcopy(answer)
    other["parameters"][1]["estimate"] += 1.0
    (tmp_path / "other.json").write_text(json.dumps(other), encoding="utf-8")
    entry = read_entry(tmp_path / "other.json", lambda sha256: None)
    assert entry is not None
    assert add(history, [entry], replace=True) == ["replaced"]
    assert "replaced or altered" in (why_history_differs(history, own) or "")


@pytest.mark.long
def test_postgresql_gives_the_same_bytes(tmp_path: Path) -> None:
    answers = [a_result("A-1", "2026-01-01"), a_result("A-1", "2026-02-01", demo="x-pattern")]
    key = private_key(a_key(tmp_path), no_passphrase)
    with postgresql() as url:
        made: dict[str, list[dict[str, bytes]]] = {}
        for name, at in (("sqlite", None), ("server", url)):
            (tmp_path / name).mkdir()
            history = kept(tmp_path / name, *answers, url=at)
            for number, own in enumerate(results(history)):
                folder = tmp_path / name / str(number)
                write_certificate(folder, own, whole_answer(history, own), key, ISSUED)
                assert why_history_differs(history, of_file(folder)) is None
                made.setdefault(name, []).append({path.name: path.read_bytes() for path in folder.iterdir()})
            history.engine.dispose()
    assert len(made["sqlite"]) == 2
    assert made["sqlite"] == made["server"]


def test_another_result_of_the_same_run_has_another_certificate(tmp_path: Path) -> None:
    first = certificate(only(kept(tmp_path, a_result())), a_result())
    (tmp_path / "other").mkdir()
    answer = a_result()
    answer["posterior"]["seconds"] += 1.0
    second = certificate(only(kept(tmp_path / "other", answer)), answer)
    assert first.sha256 == second.sha256
    assert first.document_sha256 != second.document_sha256
