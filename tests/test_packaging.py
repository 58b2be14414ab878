"""The package list, the floors, and what the repository may not hold."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FLOORS = {"kernels": 0, "render": 0, "toolkit": 1, "scenes": 2}
LOOSE = {"arrays", "checks", "devices", "errors", "progress", "public", "randomness", "sparse", "statistics"}
# The rooms of toolkit/, each with what it may stand on below it. Rooms of one height don't import each other.
HEIGHT = {
    "files": 0,
    "mesh": 1,
    "parameterization": 2,
    "photometric": 3,
    "synthesis": 4,
    "relief.ground": 5,
    "relief.coherent": 6,
    "relief.growth": 6,
    "relief": 7,
    "restoration": 7,
    "photographs": 8,
    "geometry": 8,
    "cli": 9,
}


def modules(folder):
    return sorted(p for p in (ROOT / folder).rglob("*.py") if "__pycache__" not in p.parts)


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def module_name(path):
    inner = path.relative_to(ROOT).with_suffix("").parts
    inner = inner[:-1] if inner[-1] == "__init__" else inner
    return ".".join(["intaglio", *(inner[1:] if inner[0] == "toolkit" else inner)])


def room_of(name):
    """The innermost room of toolkit/ that a module lies in, or None."""
    found = [room for room in HEIGHT if name == f"intaglio.{room}" or name.startswith(f"intaglio.{room}.")]
    return max(found, key=len, default=None)


def test_every_folder_is_in_the_package_list():
    config = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    names = {"toolkit": "intaglio", **{f: f"intaglio.{f}" for f in FLOORS if f != "toolkit"}}
    found = set()
    for folder, name in names.items():
        for path in modules(folder):
            inner = path.parent.relative_to(ROOT / folder).parts
            found.add(".".join([name, *inner]))
    assert set(config["packages"]) == found
    for name, folder in config["package-dir"].items():
        assert names[folder] == name


def test_wheel_and_sdist_hold_every_module(tmp_path):
    sources = tmp_path / "sources"
    for folder in FLOORS:
        shutil.copytree(ROOT / folder, sources / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, sources)
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(sources)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,), (sdist,) = tmp_path.glob("*.whl"), tmp_path.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as opened:
        inside = set(opened.namelist())
    wanted = {p.relative_to(ROOT) for folder in FLOORS for p in modules(folder)} | {Path("toolkit/py.typed")}
    installed = {Path("intaglio", *(p.parts[1:] if p.parts[0] == "toolkit" else p.parts)).as_posix() for p in wanted}
    assert {name for name in inside if ".dist-info/" not in name} == installed
    assert any(name.endswith("licenses/LICENSE") for name in inside)
    with tarfile.open(sdist) as opened:
        inside = {Path(*Path(name).parts[1:]) for name in opened.getnames()}
    assert wanted | {Path("pyproject.toml"), Path("README.md"), Path("LICENSE")} <= inside


@pytest.mark.parametrize("folder", FLOORS)
def test_imports_run_down(folder):
    for path in modules(folder):
        for name in imports(path):
            if not name or not name.startswith("intaglio"):
                continue
            second = name.split(".")[1] if "." in name else ""
            floor = second if second in FLOORS else "toolkit"
            # The transfer functions import NumPy alone: they lie below everything.
            if floor != folder and name != "intaglio.kernels.transfer":
                assert FLOORS[floor] < FLOORS[folder], f"{path} imports {name}"


def test_what_lies_loose_is_what_every_system_stands_on():
    found = {p.stem for p in (ROOT / "toolkit").glob("*.py")} - {"__init__"}
    assert found == LOOSE
    # The public names are handed on from the rooms.
    for path in (ROOT / "toolkit" / f"{name}.py" for name in LOOSE - {"public"}):
        for name in imports(path):
            if name and name.startswith("intaglio"):
                assert name.split(".")[1] in {*LOOSE, "kernels"}, f"{path} imports {name}"


def test_systems_stand_on_each_other_in_their_order():
    for path in modules("toolkit"):
        own = room_of(module_name(path))
        if own is None:
            continue
        for name in imports(path):
            room = room_of(name or "")
            if room is not None and room != own:
                assert HEIGHT[room] < HEIGHT[own], f"{path} imports {name}: {own} lies below {room}"


@pytest.mark.parametrize("folder", FLOORS)
def test_a_room_is_entered_by_its_face(folder):
    for path in modules(folder):
        own = module_name(path)
        for name in imports(path):
            for room in (*HEIGHT, "render"):
                door = f"intaglio.{room}"
                inside = own == door or own.startswith(f"{door}.")
                assert inside or not (name or "").startswith(f"{door}."), f"{path} imports {name}: enter by {door}"


def test_no_module_bears_the_name_of_what_its_package_exports():
    for folder in FLOORS:
        for face in (ROOT / folder).rglob("__init__.py"):
            exported = {a.name for n in ast.walk(ast.parse(face.read_text())) if isinstance(n, ast.ImportFrom) for a in n.names}
            clash = exported & {p.stem for p in face.parent.glob("*.py")}
            assert not clash, f"{face.parent}: {clash}"


@pytest.mark.parametrize("folder", FLOORS)
def test_signatures_stay_short(folder):
    most = 14 if folder == "kernels" else 15
    for path in modules(folder):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                named = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                count = sum(a.arg not in ("self", "cls") for a in named)
                assert count <= most, f"{path}: {node.name} has {count} parameters"


def test_importing_the_package_starts_nothing(tmp_path):
    code = "import intaglio, sys; print('mitsuba' in sys.modules)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "False"


def test_public_names_exist_and_are_documented():
    import intaglio

    for name in intaglio.__all__:
        value = getattr(intaglio, name)
        assert name == "__version__" or (value.__doc__ and len(value.__doc__) > 20), name


def test_benchmarks_start():
    """Nothing else imports them: a name that is gone would show up only when someone measures."""
    names = ("relief", "photometric", "synthesis", "photographs", "geometry")
    code = (
        "import runpy, sys\n"
        f"for name in {names}:\n"
        "    sys.argv = [name, '--help']\n"
        "    try:\n"
        "        runpy.run_module(f'tests.benchmarks.{name}', run_name='__main__')\n"
        "    except SystemExit as stop:\n"
        "        assert not stop.code, name\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("usage: ") == len(names)
