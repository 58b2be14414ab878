"""A sample of the attack on the public functions; ``python tests/api_attack.py`` makes all of its calls."""

from __future__ import annotations

import random
from collections import defaultdict

import api_attack
import numpy as np
import pytest

import intaglio
from intaglio.checks import LARGEST, real_array, shown

# Of every function some of its calls, and of these most on what is refused at the door.
CALLS = 4


def test_every_argument_of_every_public_function_is_attacked():
    table = api_attack.Table()
    attacked = defaultdict(set)
    for name, call in table.calls().items():
        attacked[name.split()[0]] |= set(call()[1])
    public = api_attack.public_names()
    assert {name: attacked[name] for name in public} == public


def test_bad_arguments_are_named():
    calls = api_attack.Table().calls()

    def some(name, jobs):
        return random.Random(name).sample(jobs, min(CALLS, len(jobs)))

    found = api_attack.attack(list(calls), count=1, choose=some)
    assert len({name for name, *_ in found}) == len(calls)
    assert [(name, argument, place, bad, wrong) for name, argument, place, bad, wrong, _ in found if wrong] == []
    outcomes = [outcome for *_, outcome in found]
    assert outcomes.count("refused") > outcomes.count("accepted") > 0


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: [0.0], None),
        (lambda: np.full(3, np.nan), "NaN in ['result[].value']"),
        (lambda: np.log(np.zeros(1)), "warning: RuntimeWarning"),
        (lambda: {}["none"], "KeyError"),
        (lambda: [][3], "IndexError"),
        (lambda: np.zeros(2) + np.zeros(3), "without the name"),
        (lambda: float("a"), "without the name"),
    ],
)
def test_the_attack_finds_what_is_wrong(wrong, said):
    """The engine is tried on a function that fails in the given way."""
    from dataclasses import make_dataclass

    record = make_dataclass("Record", ["value"])
    worker = api_attack.Worker.__new__(api_attack.Worker)
    worker.name, worker.expected, worker.arguments = "probe", None, {"argument": 0.0}
    worker.function = lambda argument: record(wrong())
    found, _ = worker.attack("probe", "argument", None, "1e308")
    assert found is None if said is None else found.startswith(said)


def test_layouts_masks_and_imaginary_parts_are_found():
    worker = api_attack.Worker.__new__(api_attack.Worker)
    worker.name, worker.arguments = "probe", {"argument": np.linspace(0, 1, 12).reshape(3, 4)}
    worker.function = lambda argument: np.array(argument).ravel(order="K")
    worker.expected = worker.result(worker.arguments)
    assert worker.attack("probe", "argument", None, "Fortran")[0].startswith("other bits")
    assert worker.attack("probe", "argument", None, "read-only")[0] is None
    assert worker.attack("probe", "argument", None, "complex")[0] == "complex array accepted"
    assert worker.attack("probe", "argument", None, "masked")[0] == "masked array accepted"
    worker.function = lambda argument: argument.sort()
    worker.arguments["argument"] = -worker.arguments["argument"]
    assert worker.attack("probe", "argument", None, "float128")[0] == "the input was altered"


def test_hangs_crashes_and_memory_end_a_call_and_not_the_attack():
    code = {"hang": "while True: pass", "crash": "import os; os.abort()"}
    for what, body in code.items():
        process = api_attack.Process(["-c", f"import sys\nfor line in sys.stdin:\n    {body}"])
        answer = process.ask(("probe", None, None, None), 0.5, started=0)
        assert answer[0].startswith({"hang": "hangs", "crash": "crash"}[what])
        process.close()


def test_arrays_arrive_plain():
    values = np.linspace(0, 1, 12).reshape(3, 4)
    for given in (
        np.asfortranarray(values),
        values[::-1][::-1],
        values.view(np.matrix),
        np.ma.masked_array(values),
        values.tolist(),
    ):
        found = real_array("values", given)
        assert type(found) is np.ndarray
        assert found.flags.c_contiguous
        assert np.array_equal(found, values)
    assert real_array("values", 0.5).shape == ()
    for given in (values + 0j, np.ma.masked_greater(values, 0.5), values.astype(object), values.astype(str), [values, [1]], None):
        with pytest.raises(intaglio.InputError, match=r"^values "):
            real_array("values", given)
    assert len(shown([[0.5] * 1000])) < 100
    assert shown(10**5000) == "a int"


def test_positions_whose_squares_overflow_are_refused():
    triangle = {"vertices": np.eye(3) * LARGEST * 2, "faces": np.array([[0, 1, 2]])}
    with pytest.raises(intaglio.InputError, match="vertices holds numbers beyond"):
        intaglio.Surface(**triangle)


def test_warnings_point_at_the_caller(tmp_path):
    surface = intaglio.Surface(vertices=np.eye(3) * 1e-3 + 4e6, faces=np.array([[0, 1, 2]]))
    with pytest.warns(intaglio.IntaglioWarning) as heard:
        intaglio.write_surface(surface, tmp_path / "s.stl")
    assert heard[0].filename == __file__
