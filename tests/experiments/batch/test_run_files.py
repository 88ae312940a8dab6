"""Which files a batch has, and what their results are called."""

import pytest

from zerobeam.experiments.batch import PATTERN, names_of, run_files, shown_path
from zerobeam.model.errors import BadInput


def touched(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def test_files_and_folders_each_file_once_and_nothing_of_the_answer(tmp_path):
    touched(tmp_path, "a/1.jsonl", "a/2.txt", "b/c/1.jsonl", "out/finished.jsonl", "b/3.jsonl")
    given = [tmp_path / "b", tmp_path, tmp_path / "a" / "2.txt"]
    found = run_files(given, PATTERN, tmp_path / "out")
    shown = [shown_path(path, tmp_path / "out") for path in found]
    assert shown == ["../a/1.jsonl", "../a/2.txt", "../b/3.jsonl", "../b/c/1.jsonl"]
    assert len(run_files([tmp_path], "*/1.*", tmp_path / "out")) == 1


@pytest.mark.parametrize(("given", "pattern", "said"), [
    ("nowhere", PATTERN, "there is no such file or folder"),
    ("", "*.csv", "no file in this folder matches the pattern"),
    ("", "", "the pattern cannot be used"),
])  # fmt: skip
def test_what_is_not_there_is_said(tmp_path, given, pattern, said):
    touched(tmp_path, "1.jsonl")
    with pytest.raises(BadInput, match=said):
        run_files([tmp_path / given], pattern, tmp_path / "out")


def test_equal_stems_get_names_of_their_own():
    files = ["../m/run.jsonl", "../n/run.jsonl", "../n/other.jsonl", "../p/n/RUN.jsonl", "m-run.jsonl"]
    names = names_of(files, {}, ())
    assert names["../n/other.jsonl"] == "other"
    assert len({name.casefold() for name in names.values()}) == len(files)
    assert set(names) == set(files)
    assert not any("/" in name for name in names.values())


def test_a_name_is_kept_when_more_come_and_files_of_the_folder_are_not_taken():
    kept = {"../m/run.jsonl": "run"}
    names = names_of(["../m/run.jsonl", "../n/run.jsonl", "../n/batch.html.jsonl"], kept, {"batch.html"})
    assert names == {
        "../m/run.jsonl": "run",
        "../n/run.jsonl": "n-run",
        "../n/batch.html.jsonl": "n-batch.html",
    }


def test_paths_that_differ_by_case_or_a_hyphen_alone():
    names = names_of(["A/b.jsonl", "a/B.jsonl", "a-b.jsonl", "a-b.txt"], {}, ())
    assert len({name.casefold() for name in names.values()}) == 4
