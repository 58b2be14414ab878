"""Checks of settings and arguments that the systems share.

Public functions are entered through `checked_arguments`, and what they are given is made of fields that `check_fields` has seen:
both go by the annotations. What an annotation can't say, such as ranges and shapes, functions check by their names here.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import operator
import os
import re
import types
from collections.abc import Callable, Mapping, Sequence, Sized
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array
from intaglio.errors import InputError

_Function = TypeVar("_Function", bound=Callable[..., Any])

# Arguments of larger magnitude are refused.
LARGEST = 1e70

# Characters of a value that a message shows.
_SHOWN = 80

# Where objects of these classes come from.
_SOURCES = {
    "Binding": "bind_photographs gives one",
    "GeometryTexture": "read_geometry_texture gives one",
    "Parameterization": "parameterize gives one",
    "Photograph": "read_photographs gives them",
    "PhotometricStack": "read_stack gives one",
    "ReliefReport": "assess_relief gives one",
    "Relightable": "represent and read_relightable give one",
    "Surface": "read_surface gives one",
    "SurfaceMaps": "surface_maps gives them",
    "Synthesis": "weave, quilt, grow and synthesize give one",
    "Texture": "combine_photographs gives one",
}


def shown(value: object) -> str:
    """Return a value as it is quoted in a message: one line, not long."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of {value.dtype} of shape {value.shape}"
    if isinstance(value, type) or callable(value):
        return f"the {'class' if isinstance(value, type) else 'function'} {getattr(value, '__name__', type(value).__name__)}"
    try:
        text = " ".join(repr(value).split())
    except Exception:
        # Python refuses to print whole numbers of thousands of digits, and a stranger's object may fail in any way.
        return f"a {type(value).__name__}"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 20]} … {text[-15:]}"


def checked_number(name: str, value: float, low: float, high: float = np.inf) -> float:
    """Return ``value`` as a float, or raise `InputError` if it is not a number from ``low`` to ``high``."""
    number = _number(value)
    if number is None:
        raise InputError(f"{name} must be a number, not {shown(value)}")
    if not low <= number <= high or not np.isfinite(number):
        limits = f"at least {low:g}" if high == np.inf else f"from {low:g} to {high:g}"
        raise InputError(f"{name} must be {limits}, not {shown(value)}")
    return number


def checked_count(name: str, value: int, low: int, high: int) -> int:
    """Return ``value`` as an int, or raise `InputError` if it is no whole number from ``low`` to ``high``."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or not low <= value <= high:
        raise InputError(f"{name} must be a whole number from {low} to {high}, not {shown(value)}")
    return int(value)


def checked_choice(name: str, value: str, known: Sequence[str]) -> str:
    """Return ``value``, or raise `InputError` if it is none of ``known``."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} must be one of {', '.join(map(repr, known))}, not {shown(value)}")
    return value


def checked_flag(name: str, value: bool) -> bool:
    """Return ``value`` as a bool, or raise `InputError` if it is neither True nor False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} must be True or False, not {shown(value)}")
    return bool(value)


def checked_positive(name: str, value: float) -> float:
    """Return ``value`` as a float, or raise `InputError` if it is not a finite number above 0."""
    number = _number(value)
    if number is None or not 0 < number < np.inf:
        raise InputError(f"{name} must be a number above 0, not {shown(value)}")
    return number


def checked_path(name: str, value: os.PathLike[str] | str) -> Path:
    """Return ``value`` as a Path, or raise `InputError` if it can't name a file."""
    text = None
    if isinstance(value, str | os.PathLike) and not isinstance(value, type):
        text = os.fspath(value)
    if not isinstance(text, str):
        raise InputError(f"{name} must be the name of a file, text or a Path, not {shown(value)}")
    if not text or "\0" in text:
        raise InputError(f"{name} must be the name of a file, not {shown(text)}")
    return Path(text)


def checked_instance(name: str, value: object, kind: type) -> Any:
    """Return ``value``, or raise `InputError` if it is no ``kind``."""
    if not isinstance(value, kind):
        raise InputError(_another(name, kind.__name__, value))
    return value


def real_array(name: str, value: object) -> Array:
    """Return ``value`` as a plain C-contiguous array of its own type, or raise `InputError` if it holds no real numbers.

    Masked values, imaginary parts and objects would be lost or misread further on; they are refused. Truth values are numbers.
    """
    masked = [one for one in (value if isinstance(value, list | tuple) else (value,)) if isinstance(one, np.ma.MaskedArray)]
    if any(np.ma.is_masked(one) for one in masked):
        raise InputError(f"{name} is a masked array with masked values; fill them in or leave them out")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers ({error})") from error
    if array.dtype.kind not in "biuf":
        what = shown(value) if array.ndim == 0 else f"of {array.dtype}"
        raise InputError(f"{name} must be an array of {'real ' if array.dtype.kind == 'c' else ''}numbers, not {what}")
    return np.require(array, array.dtype.newbyteorder("="), "C")


def refuse_huge(name: str, array: Array) -> None:
    """Raise `InputError` for finite numbers whose squares overflow."""
    if array.size and array.dtype.itemsize > 4 and max(array.max(), -array.min()) > LARGEST:
        raise InputError(f"{name} holds numbers beyond {LARGEST:g}, of which squares can't be computed")


def converted(name: str, array: Array, dtype: type) -> Array:
    """Return ``array`` as ``dtype``, or raise `InputError` for numbers that it can't hold."""
    with np.errstate(over="ignore", invalid="ignore"):
        made: Array = array.astype(dtype, order="C", copy=False)
    if made is array:
        return array
    if np.dtype(dtype).kind in "iu" and array.dtype.kind in "iuf" and not np.array_equal(made, array):
        raise InputError(f"{name} must hold whole numbers that fit into {np.dtype(dtype)}")
    if np.dtype(dtype).kind == "f" and made.dtype.itemsize < array.dtype.itemsize and (np.isinf(made) & np.isfinite(array)).any():
        raise InputError(f"{name} holds numbers that are too large for {np.dtype(dtype)}")
    return made


def checked_finite(name: str, value: object) -> Array:
    """Return ``value`` as a float64 array, or raise `InputError` if it is no array of finite real numbers."""
    array = real_array(name, value)
    if array.dtype == bool:
        raise InputError(f"{name} must be an array of numbers, not of {array.dtype}")
    bad = ~np.isfinite(array)
    if bad.any():
        rows = int(bad.reshape(len(bad), -1).any(axis=1).sum()) if array.ndim else 1
        raise InputError(f"{rows} of {len(array) if array.ndim else 1} {name} hold NaN or infinity; leave them out")
    made = converted(name, array, np.float64)
    refuse_huge(name, made)
    return made


def checked_vectors(name: str, value: object) -> Array:
    """Return ``value`` as an (N, 3) float64 array of finite numbers, or raise `InputError`."""
    array = checked_finite(name, value)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{name} must be an (N, 3) array, not {array.shape}")
    return array


_COUNTS = {2: "two", 3: "three"}


def checked_vector(name: str, value: object, count: int = 3) -> Array:
    """Return ``value`` as a float64 array of ``count`` finite numbers, or raise `InputError`."""
    array = converted(name, real_array(name, value), np.float64)
    if array.size != count or not np.isfinite(array).all():
        raise InputError(f"{name} must be {_COUNTS.get(count, count)} finite numbers, not {shown(value)}")
    refuse_huge(name, array)
    return array.reshape(-1)


def checked_direction(name: str, value: object) -> Array:
    """Return ``value`` as three float64 numbers of length 1, or raise `InputError` for what is no direction."""
    vector = checked_vector(name, value)
    # Squares of very small numbers vanish, those of the vector's shares do not.
    largest = np.abs(vector).max()
    if largest == 0:
        raise InputError(f"{name} must be three finite numbers, not all zero: it must not be the zero vector")
    vector = vector / largest
    return np.asarray(vector / np.linalg.norm(vector))


def checked_numeric(name: str, value: ArrayLike, dtype: type) -> Array:
    """Return ``value`` as a contiguous array of ``dtype``, or raise `InputError` if it is no array of real numbers."""
    return converted(name, real_array(name, value), dtype)


def checked_shape(name: str, value: ArrayLike, dtype: type, shape: Sequence[int | None], *, finite: bool = False) -> Array:
    """Return ``value`` as a contiguous array of ``dtype`` without NaN and of ``shape``, or raise `InputError`.

    None stands for any length. ``finite`` refuses infinity as well.
    """
    array = checked_numeric(name, value, dtype)
    if array.ndim != len(shape) or any(wanted not in (None, given) for wanted, given in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise InputError(f"{name} must have shape ({wanted}{',' if len(shape) == 1 else ''}), not {array.shape}")
    if array.dtype.kind == "f" and np.isnan(array).any():
        raise InputError(f"{name} holds NaN, {int(np.isnan(array).sum())} of {array.size} values")
    if finite and not np.isfinite(array).all():
        raise InputError(f"{name} holds infinity, {int(np.isinf(array).sum())} of {array.size} values")
    return array


def checked_rows(name: str, value: Array, dtype: type, count: int | None = None) -> Array:
    """Return ``value`` as an (N, 3) array of finite numbers, N being ``count`` if given, or raise `InputError`."""
    array = checked_numeric(name, value, dtype)
    if array.ndim != 2 or array.shape[1] != 3 or (count is not None and len(array) != count):
        raise InputError(f"{name} must have shape ({'N' if count is None else count}, 3), not {array.shape}")
    finite = np.isfinite(array).all(axis=1)
    if not finite.all():
        first = int(np.flatnonzero(~finite)[0])
        raise InputError(f"{name}: {(~finite).sum()} rows are not finite, the first is row {first}: {array[first]}")
    refuse_huge(name, array)
    return array


def checked_faces(name: str, value: object, count: int) -> Array:
    """Return ``value`` as an (F, 3) int32 array of vertex numbers below ``count``, or raise `InputError`."""
    array = real_array(name, value)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{name} must have shape (F, 3), not {array.shape}; polygons with more corners must be triangulated")
    if array.size and array.dtype.kind not in "iu":
        raise InputError(f"{name} must hold integers, not {array.dtype}")
    if array.size and (array.min() < 0 or array.max() >= count):
        row = int(np.flatnonzero(((array < 0) | (array >= count)).any(axis=1))[0])
        raise InputError(
            f"{name} name vertices that are not there: face {row} names vertices {array[row].tolist()}, but there are only "
            f"{count} (0 to {count - 1})"
        )
    return np.ascontiguousarray(array, np.int32)


def checked_mask(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return ``value`` as a bool array, or raise `InputError` if it is not one of ``shape``."""
    array = real_array(name, value)
    if array.shape != tuple(shape) or array.dtype.kind not in "bui":
        raise InputError(f"{name} must be a bool array {tuple(shape)} like the maps, not {array.dtype} {array.shape}")
    return array.astype(bool)


def checked_size(name: str, value: int | tuple[int, int]) -> tuple[int, int]:
    """Return ``value``, a number or (rows, columns), as (rows, columns).

    Raises
    ------
    InputError
        If it is neither a whole number from 1 to 65536 nor two of them.
    """
    both = (value, value) if isinstance(value, int | np.integer) and not isinstance(value, bool) else value
    try:
        rows, columns = both  # type: ignore[misc]
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be a whole number or (rows, columns), not {shown(value)}") from error
    for number in (rows, columns):
        if not isinstance(number, int | np.integer) or isinstance(number, bool) or not 1 <= number <= 65536:
            raise InputError(f"{name} must be whole numbers from 1 to 65536, (rows, columns); given: {shown(value)}")
    return int(rows), int(columns)


def checked_arguments(function: _Function) -> _Function:
    """Let a function be entered only with arguments that are what their annotations say.

    Arrays arrive as plain C-contiguous arrays of real numbers, of the type that they had; numbers are no NaN. What an annotation
    can't say is left to the function: ranges, shapes, infinity.

    Raises
    ------
    InputError
        When the function is called with anything else; the message names the argument.
    """
    signature = inspect.signature(function)
    wanted = [(p.name, p.annotation, p.default is None) for p in signature.parameters.values() if p.annotation is not p.empty]

    @functools.wraps(function)
    def entered(*given: Any, **named: Any) -> Any:
        try:
            bound = signature.bind(*given, **named)
        except TypeError:
            # Python's own message names the function, too.
            return function(*given, **named)
        for name, annotation, optional in wanted:
            if name in bound.arguments and not (optional and bound.arguments[name] is None):
                bound.arguments[name] = _checked_by(name, bound.arguments[name], annotation, function.__globals__)
        return function(*bound.args, **bound.kwargs)

    return cast("_Function", entered)


def check_fields(record: Any, *, nan: bool = False) -> None:
    """Raise `InputError` unless the fields of a frozen dataclass are what their annotations say; arrays become plain ones.

    Parameters
    ----------
    record : dataclass
        What is being made.
    nan : bool
        Whether values may be NaN, as figures of a report are where they have no meaning, or are looked at further on.
    """
    scope = inspect.getmodule(type(record)).__dict__
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        unset = value is None and field.default is None
        if unset or (nan and field.type in ("float", "float | None") and isinstance(value, float) and value != value):
            continue
        made = _checked_by(field.name, value, str(field.type), scope)
        if not nan and isinstance(made, np.ndarray) and made.dtype.kind == "f" and np.isnan(made).any():
            raise InputError(f"{field.name} holds NaN, {int(np.isnan(made).sum())} of {made.size} values")
        object.__setattr__(record, field.name, made)


def _number(value: object) -> float | None:
    """Return a real number as a float, None for anything else; infinity for a whole number that is too large."""
    if isinstance(value, bool | np.bool_ | str | bytes | complex | np.complexfloating) or np.ma.is_masked(value):
        return None
    if isinstance(value, np.ndarray) and (value.ndim or value.dtype.kind not in "iuf"):
        return None
    try:
        return float(value)  # type: ignore[arg-type]
    except OverflowError:
        return np.inf
    except Exception:
        # A stranger's object may fail in any way.
        return None


def _another(name: str, kind: str, value: object) -> str:
    """Return the message that ``value`` should be a ``kind``."""
    source = f" ({_SOURCES[kind]})" if kind in _SOURCES else ""
    what = f"a {type(value).__name__}" if not isinstance(value, type) else shown(value)
    return f"{name} must be a {kind}{source}, not {what}"


@functools.cache
def _split(annotation: str, mark: str) -> tuple[str, ...]:
    """Return the parts of an annotation between marks; brackets keep theirs together."""
    found, depth, start = [], 0, 0
    for at, letter in enumerate(annotation):
        depth += (letter == "[") - (letter == "]")
        if letter == mark and depth == 0:
            found.append(annotation[start:at].strip())
            start = at + 1
    return (*found, annotation[start:].strip())


def _checked_by(name: str, value: object, annotation: str, scope: Mapping[str, object]) -> Any:
    """Return ``value``, checked by an annotation; of several alternatives the first that it fits."""
    parts = _split(annotation, "|")
    if value is None and "None" in parts:
        return None
    kinds = [kind for kind in parts if kind != "None"]
    problems = []
    for kind in kinds:
        try:
            return _checked_kind(name, value, kind, scope)
        except InputError as problem:
            problems.append(problem)
    if len(kinds) == 1 or (_number(value) is not None and "float" in kinds):
        raise problems[kinds.index("float") if "float" in kinds else 0]
    raise InputError(f"{name} must be {' or '.join(_words(kind) for kind in kinds)}, not {shown(value)}")


def _checked_kind(name: str, value: object, kind: str, scope: Mapping[str, object]) -> Any:
    """Return ``value``, checked by an annotation without alternatives."""
    if kind in _CHECKS:
        return _CHECKS[kind](name, value)
    outer, _, inner = kind.removesuffix("]").partition("[")
    if outer in ("Sequence", "list", "tuple"):
        return _checked_several(name, value, outer, _split(inner, ","), scope)
    if outer in ("Mapping", "dict"):
        if not isinstance(value, Mapping):
            raise InputError(f"{name} must be {_words(kind)}, not {shown(value)}")
        of_key, of_value = _split(inner, ",")
        named = {_checked_by(f"{name}: a key", key, of_key, scope): one for key, one in value.items()}
        return {key: _checked_by(f"{name}[{shown(key)}]", one, of_value, scope) for key, one in named.items()}
    known = scope.get(kind)
    if isinstance(known, types.UnionType):
        # An alias of several annotations.
        annotation = re.sub(r"\b(?:\w+\.)+(\w+)", r"\1", str(known)).replace("ndarray", "Array")
        return _checked_by(name, value, annotation, scope)
    if getattr(known, "_is_protocol", False):
        lacking = [method for method in vars(known) if not method.startswith("_") and not hasattr(value, method)]
        if lacking or isinstance(value, type):
            raise InputError(_another(name, kind, value))
        return value
    if isinstance(known, type):
        return checked_instance(name, value, known)
    # A class that is imported for its annotation only is known by its name; an alias of an annotation says nothing.
    if known is None and kind not in (found.__name__ for found in type(value).__mro__):
        raise InputError(_another(name, kind, value))
    return value


def _checked_several(name: str, value: object, outer: str, kinds: tuple[str, ...], scope: Mapping[str, object]) -> Any:
    """Return a sequence whose items are checked by their annotations; text is a sequence of one text."""
    kind = f"{outer}[{', '.join(kinds)}]"
    if isinstance(value, str | bytes) and not (isinstance(value, str) and outer == "Sequence" and kinds == ("str",)):
        raise InputError(f"{name} must be {_words(kind)}, not {shown(value)}")
    if isinstance(value, str):
        return value
    if (
        isinstance(value, Mapping | memoryview)
        or (isinstance(value, np.ndarray) and value.ndim == 0)
        or not isinstance(value, Sized)
        or not hasattr(value, "__iter__")
    ):
        raise InputError(f"{name} must be {_words(kind)}, not {shown(value)}")
    items: list[object] = list(value)  # type: ignore[call-overload]
    each = kinds[:1] * len(items) if outer != "tuple" or kinds[-1] == "..." else kinds
    if len(items) != len(each):
        raise InputError(f"{name} must be {_words(kind)}, not {len(items)} values: {shown(value)}")
    try:
        made = [_checked_by(f"{name}[{i}]", one, wanted, scope) for i, (one, wanted) in enumerate(zip(items, each, strict=True))]
    except InputError as problem:
        if outer != "tuple" or kinds[-1] == "...":
            raise
        raise InputError(f"{name} must be {_words(kind)}, not {shown(value)}") from problem
    return tuple(made) if outer == "tuple" else made


def _words(kind: str) -> str:
    """Return an annotation in words."""
    outer, _, inner = kind.removesuffix("]").partition("[")
    if outer in ("Sequence", "list", "tuple"):
        kinds = _split(inner, ",")
        if outer == "tuple" and kinds[-1] != "...":
            return f"({', '.join(_words(one) for one in kinds)})"
        return f"a sequence, each item {_words(kinds[0])}"
    if outer in ("Mapping", "dict"):
        return "a dict"
    return _NAMES.get(kind, kind)


def _checked_whole(name: str, value: object) -> int:
    try:
        if not isinstance(value, bool | np.bool_):
            return operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        pass
    raise InputError(f"{name} must be a whole number, not {shown(value)}")


def _checked_real(name: str, value: object) -> Any:
    number = _number(value)
    if number is None or number != number:
        raise InputError(f"{name} must be a number, not {shown(value)}")
    if LARGEST < abs(number) < np.inf or (number == np.inf and isinstance(value, int)):
        raise InputError(f"{name} must be a number of no more than {LARGEST:g}, not {shown(value)}; give a smaller {name}")
    return value if isinstance(value, int | float) else number


def _checked_text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise InputError(f"{name} must be text, not {shown(value)}")
    return value


def _checked_bytes(name: str, value: object) -> bytes:
    if not isinstance(value, bytes):
        raise InputError(f"{name} must be bytes, not {shown(value)}")
    return value


def _checked_name(name: str, value: object) -> Any:
    checked_path(name, value)  # type: ignore[arg-type]
    return value


def _checked_function(name: str, value: object) -> Any:
    if not callable(value) or isinstance(value, type):
        raise InputError(f"{name} must be a function that can be called, not {shown(value)}")
    return value


_CHECKS: dict[str, Callable[[str, object], Any]] = {
    "Any": lambda name, value: value,
    "object": lambda name, value: value,
    "bool": lambda name, value: checked_flag(name, value),  # type: ignore[arg-type]
    "int": _checked_whole,
    "float": _checked_real,
    "str": _checked_text,
    "bytes": _checked_bytes,
    "Path": _checked_name,
    "PathLike": _checked_name,
    "Array": real_array,
    "ArrayLike": real_array,
    "Progress": _checked_function,
}

_NAMES = {
    "bool": "True or False",
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bytes": "bytes",
    "Path": "a file's name",
    "PathLike": "a file's name",
    "Array": "an array of numbers",
    "ArrayLike": "an array of numbers",
    "Progress": "a function",
}
