"""Docstrings: every public name is documented in full, as numpydoc lays it down, and its examples run."""

from __future__ import annotations

import ast
import dataclasses
import doctest
import importlib
import inspect
import io
import textwrap

import pytest
from numpydoc.docscrape import NumpyDocString
from numpydoc.validate import validate

import intaglio
import intaglio.render

# https://numpydoc.readthedocs.io/en/latest/validation.html says what each of them finds.
CHECKS = {
    *("GL03", "GL05", "GL06", "GL07", "GL08", "GL09", "GL10"),  # sections: known, in order, well formed
    *("SS01", "SS02", "SS03", "SS04"),  # a summary that is a sentence
    *("PR01", "PR02", "PR03", "PR04", "PR06", "PR07", "PR09", "PR10"),  # all parameters, no others, in order, said in words
    *("RT01", "RT03", "RT05", "YD01"),  # what comes back
    "EX01",  # an example
}


def public():
    """Yield the full name of every public function and class, and of every public method and property of a class, and each."""
    for module in (intaglio, intaglio.render):
        for name in module.__all__:
            value = getattr(module, name)
            if not callable(value):
                continue
            yield f"{module.__name__}.{name}", value
            if not inspect.isclass(value):
                continue
            for member, kept in vars(value).items():
                written = inspect.isroutine(kept) or isinstance(kept, property | classmethod | staticmethod)
                if written and not member.startswith("_"):
                    yield f"{module.__name__}.{name}.{member}", kept


def documented_names(module):
    """Yield the full names of what a module hands on and can have an example: functions and classes."""
    yield from (f"{module.__name__}.{name}" for name in module.__all__ if callable(getattr(module, name)))


def raised(value):
    """Return the names of the exceptions that the code itself raises."""
    value = value.fget if isinstance(value, property) else value
    value = getattr(value, "__post_init__", value) if inspect.isclass(value) else inspect.unwrap(value)
    if inspect.isclass(value):
        return set()
    tree = ast.parse(textwrap.dedent(inspect.getsource(value)))
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            names.add(node.exc.func.id)
    return names


def faults(name, value):
    """Return what is wrong with a docstring, as text."""
    text = inspect.getdoc(value) or ""
    document = NumpyDocString(text)
    fields = {f.name for f in dataclasses.fields(value)} if dataclasses.is_dataclass(value) else set()
    # Results are made by Intaglio, not by its user: their fields are attributes.
    listed = {part.strip() for a in document["Attributes"] for part in a.name.split(",")}
    wanted = CHECKS - {"PR01"} if fields and fields <= listed else CHECKS
    said = [f"{code} {message}" for code, message in validate(name)["errors"] if code in wanted]
    documented = {entry.type for entry in document["Raises"]}
    if missing := raised(value) - documented - {"TypeError", "AssertionError"}:
        said.append(f"raises {', '.join(sorted(missing))}, which Raises does not say")
    return said


def test_docstrings_are_complete():
    found = {name: faults(name, value) for name, value in public()}
    assert len(found) > 150
    wrong = [f"{name}: {fault}" for name, said in found.items() for fault in said]
    assert not wrong, "\n".join(["", *wrong])


@pytest.mark.parametrize("name", sorted(name for module in (intaglio, intaglio.render) for name in documented_names(module)))
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module, _, short = name.rpartition(".")
    said = io.StringIO()
    runner = doctest.DocTestRunner()
    for test in doctest.DocTestFinder().find(getattr(importlib.import_module(module), short), name, globs={}):
        runner.run(test, out=said.write)
    assert runner.summarize(verbose=False).failed == 0, said.getvalue()
