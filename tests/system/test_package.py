"""The installed package: everything of the source tree that belongs in it is, and the command starts."""

import re
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

import zerobeam

ROOT = Path(__file__).resolve().parents[2]
NOT_ROOMS = {".ci", "tests", "docs", "benchmarks", "build", "dist"}


def rooms(tree: Path) -> list[Path]:
    """The folders at the root that hold code of the package, whatever `pyproject.toml` says of them."""
    return [code for code in tree.iterdir() if any(code.glob("*.py")) and code.name not in NOT_ROOMS]


def copy_of_tree(where: Path) -> Path:
    """The package with its tests, so that no build leaves anything in the real tree."""
    where.mkdir()
    for file in ROOT.iterdir():
        if file.is_file():
            shutil.copy(file, where)
    for folder in [*rooms(ROOT), ROOT / "tests"]:
        shutil.copytree(folder, where / folder.name, ignore=shutil.ignore_patterns("__pycache__"))
    return where


def build(tree: Path, where: Path) -> Path:
    """The wheel of `tree`, built offline by the setuptools of this environment."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index"]
    command += ["--no-build-isolation", "--wheel-dir", str(where), str(tree)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = where.glob("*.whl")
    return wheel


def contents(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def expected(tree: Path) -> set[str]:
    """Every file of the root's package and of its rooms, under the name that it has in the wheel."""
    files = [tree / "__init__.py", tree / "cli.py", tree / "interruption.py", tree / "py.typed"]
    files += [file for room in rooms(tree) for file in room.rglob("*") if file.is_file()]
    return {
        f"zerobeam/{file.relative_to(tree).as_posix()}"
        for file in files
        if "__pycache__" not in file.parts and not file.name.startswith(".")
    }


FORGOTTEN = {"model/nested/thing.py", "newroom/thing.py", "model/robots/x.bin"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a `tree` with three files that no list of the package has."""
    folder = tmp_path_factory.mktemp("package")
    tree = copy_of_tree(folder / "tree")
    for name in FORGOTTEN:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).touch()
    return folder


@pytest.fixture(scope="module")
def wheel(place: Path) -> Path:
    return build(place / "tree", place / "wheels")


@pytest.mark.long
def test_every_file_of_the_rooms_is_in_the_wheel(wheel: Path) -> None:
    assert expected(ROOT) - contents(wheel) == set()


def test_what_the_package_list_forgets_is_caught(place: Path, wheel: Path) -> None:
    assert expected(place / "tree") - contents(wheel) == {f"zerobeam/{name}" for name in FORGOTTEN}


def test_the_wheel_holds_nothing_else(wheel: Path) -> None:
    others = {name for name in contents(wheel) - expected(ROOT) if ".dist-info/" not in name}
    assert others == set()


def test_the_wheel_names_the_command_and_carries_the_licence(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (scripts,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
        assert "zerobeam = zerobeam.cli:main" in archive.read(scripts).decode().splitlines()
        assert any(name.endswith("licenses/LICENSE") for name in archive.namelist())


@pytest.mark.long
def test_the_installed_command_starts_from_any_folder(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=False)
    scripts = tmp_path / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
    python = scripts / ("python.exe" if sys.platform == "win32" else "python")
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    done = subprocess.run(
        [*command, "--no-deps", "--no-index", str(wheel)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr

    def run(*arguments: str | Path) -> str:
        done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    # The dependencies are lent by this environment; its own zerobeam is not, since a path named in a
    # .pth file comes after the new environment's own, and editable hooks are not followed from there.
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(run(python, "-c", ask).strip())
    lent = {path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")}
    (site / "lent.pth").write_text("".join(f"{path}\n" for path in sorted(lent)), encoding="utf-8")

    assert Path(run(python, "-c", "import zerobeam; print(zerobeam.__file__)").strip()).is_relative_to(site)
    assert re.search(rf"\b{re.escape(zerobeam.__version__)}\b", run(scripts / "zerobeam", "--version"))


def test_the_version_is_the_same_wherever_it_is_written() -> None:
    version = zerobeam.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_public_face():
    """A few names, which change on purpose; each is what its home says it is."""
    import zerobeam

    assert sorted(zerobeam.__all__) == sorted({*zerobeam._HOME, "__version__"})
    assert " ".join(sorted(zerobeam._HOME)) == (
        "Analysed BadInput Check CheckedPlan ComparedRuns Contour Covariance Draws Figure FitFailed Laser "
        "Noise OptimalPlan Plan Probe Profile Result RigFault Robot Run SceneView Solution ZerobeamError "
        "analyse check compare load_robot optimal_plan read_plan read_run simulate write_report"
    )
    for name, home in zerobeam._HOME.items():
        assert getattr(zerobeam, name).__module__ == f"zerobeam.{home}", name
    assert [name for name in dir(zerobeam) if not name.startswith("__")] == sorted(zerobeam._HOME)
    with pytest.raises(AttributeError, match="no attribute 'guess'"):
        zerobeam.guess  # noqa: B018
