"""The package list, the floors, and what the repository may not hold."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FLOORS = {"kernels": 0, "render": 0, "toolkit": 1, "scenes": 2}


def modules(folder):
    return sorted(p for p in (ROOT / folder).rglob("*.py") if "__pycache__" not in p.parts)


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


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


@pytest.mark.parametrize("folder", FLOORS)
def test_imports_run_down(folder):
    for path in modules(folder):
        for name in imports(path):
            if not name or not name.startswith("intaglio"):
                continue
            second = name.split(".")[1] if "." in name else ""
            floor = second if second in FLOORS else "toolkit"
            if floor != folder:
                assert FLOORS[floor] < FLOORS[folder], f"{path} imports {name}"


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


@pytest.mark.parametrize("name", ["relief", "photometric", "synthesis", "photographs", "geometry"])
def test_benchmarks_start(name):
    """Nothing else imports them: a name that is gone would show up only when someone measures."""
    done = subprocess.run(
        [sys.executable, "-m", f"tests.benchmarks.{name}", "--help"], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout
