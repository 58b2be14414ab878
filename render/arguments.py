"""Checks of what public functions are given: what renders must be finite, of the right shape, and of real numbers.

An array that holds something else would crash the renderer or come out as black or noisy pixels, far from its cause.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np

_Function = TypeVar("_Function", bound=Callable[..., Any])

# Returns an argument as it is used, given its name, its value and the arguments before it.
Check = Callable[[str, Any, dict[str, Any]], Any]

# The renderer's numbers are single precision, in which squares of larger ones overflow.
_LARGEST = 1e15


def shown(value: object) -> str:
    """Return a value as it is quoted in a message: one line, not long."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of {value.dtype} of shape {value.shape}"
    try:
        text = " ".join(repr(value).split())
    except Exception:
        # Python refuses to print whole numbers of thousands of digits, and a stranger's object may fail in any way.
        return f"a {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:60]} … {text[-15:]}"


def real_array(name: str, value: object, *, finite: bool = True) -> np.ndarray:
    """Return ``value`` as a plain C-contiguous float64 array, or raise `ValueError` for what is no array of real numbers."""
    given = value if isinstance(value, list | tuple) else (value,)
    if any(np.ma.is_masked(one) for one in given if isinstance(one, np.ma.MaskedArray)):
        raise ValueError(f"{name} is a masked array with masked values; fill them in or leave them out")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers ({error})") from error
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of real numbers, not {shown(value)}")
    with np.errstate(over="ignore"):
        array = np.require(array, np.float64, "C")
    if not np.isfinite(array).all() and finite:
        raise ValueError(f"{name} has values that are not finite (NaN or infinite)")
    return array


def shaped(*shape: int | tuple[int, ...] | None, largest: float = _LARGEST) -> Check:
    """Return the check of an array's shape; None stands for any length but 0, a tuple for a choice."""

    def check(name: str, value: Any, _: dict[str, Any]) -> np.ndarray:
        array = real_array(name, value)
        fits = array.ndim == len(shape) and all(
            n > 0 if wanted is None else n in (wanted if isinstance(wanted, tuple) else (wanted,))
            for n, wanted in zip(array.shape, shape, strict=True)
        )
        if not fits:
            listed = ", ".join(
                "any" if n is None else " or ".join(map(str, n)) if isinstance(n, tuple) else str(n) for n in shape
            )
            raise ValueError(f"{name} must be an array of shape ({listed}), not {array.shape}")
        if np.abs(array).max() > largest:
            raise ValueError(f"{name} holds numbers beyond {largest:g}, which can't be rendered; give it in another unit")
        return array

    return check


def vector(name: str, value: Any, _: dict[str, Any]) -> np.ndarray:
    """Return three finite numbers that are not all 0."""
    array = real_array(name, value)
    if array.size != 3 or not array.any() or np.abs(array).max() > _LARGEST:
        raise ValueError(f"{name} must be three numbers, not all 0, up to {_LARGEST:g}, not {shown(value)}")
    array = array.reshape(3)
    # Squares of very small numbers vanish.
    return array / np.abs(array).max() if np.abs(array).max() < 1e-100 else array


def numbers(name: str, value: Any, count: int, low: float = -_LARGEST, high: float = _LARGEST) -> tuple[float, ...]:
    """Return so many numbers in a range."""
    array = real_array(name, value).reshape(-1)
    if array.size != count or array.min(initial=np.inf) < low or array.max(initial=-np.inf) > high:
        raise ValueError(f"{name} must be {count} numbers from {low:g} to {high:g}, not {shown(value)}")
    return tuple(array.tolist())


def number(low: float, high: float = _LARGEST, *, open_ends: bool = False) -> Check:
    """Return the check of a number in a range, with or without its ends."""

    def check(name: str, value: Any, _: dict[str, Any]) -> Any:
        plain = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
        inside = plain and (low < value < high if open_ends else low <= value <= high)
        if not inside:
            raise ValueError(f"{name} must be a number from {low:g} to {high:g}, not {shown(value)}")
        return value

    return check


def whole(low: int, high: int) -> Check:
    """Return the check of a whole number in a range."""

    def check(name: str, value: Any, _: dict[str, Any]) -> int:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
            raise ValueError(f"{name} must be a whole number from {low} to {high}, not {shown(value)}")
        return int(value)

    return check


def _seed(name: str, value: Any, _: dict[str, Any]) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ValueError(f"{name} must be a whole number, not {shown(value)}")
    return int(value)


def _flag(name: str, value: Any, _: dict[str, Any]) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, not {shown(value)}")
    return bool(value)


def function(name: str, value: Any, _: dict[str, Any]) -> Any:
    """Return what can be called."""
    if not callable(value) or isinstance(value, type):
        raise ValueError(f"{name} must be a function that can be called, not {shown(value)}")
    return value


def instance(kind: str) -> Check:
    """Return the check of an object's class, by its name."""

    def check(name: str, value: Any, _: dict[str, Any]) -> Any:
        if kind not in (known.__name__ for known in type(value).__mro__):
            raise ValueError(f"{name} must be a {kind}, not {shown(value)}")
        return value

    return check


def _size(name: str, value: Any, _: dict[str, Any]) -> tuple[int, int]:
    if not isinstance(value, list | tuple | np.ndarray) or (isinstance(value, np.ndarray) and value.ndim != 1) or len(value) != 2:
        raise ValueError(f"{name} must be two whole numbers, rows and columns, not {shown(value)}")
    rows, columns = (whole(1, 16384)(name, one, {}) for one in value)
    return rows, columns


def _faces(name: str, value: Any, before: dict[str, Any]) -> np.ndarray:
    real_array(name, value)
    array = np.asarray(value)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array) or array.dtype.kind not in "iu":
        raise ValueError(f"{name} must be whole numbers of shape (F, 3), not {shown(array)}")
    count = len(before["vertices"])
    if array.min() < 0 or array.max() >= count:
        raise ValueError(f"{name} name vertices {array.min()} to {array.max()}, but there are only {count}")
    return np.ascontiguousarray(array, np.int32)


def _texture_places(name: str, value: Any, before: dict[str, Any]) -> np.ndarray:
    array = real_array(name, value)
    if array.shape != (len(before["vertices"]), 2):
        raise ValueError(f"{name}: texture coordinates must be ({len(before['vertices'])}, 2), not {array.shape}")
    if np.abs(array).max() > _LARGEST:
        raise ValueError(f"{name} holds numbers beyond {_LARGEST:g}")
    return array


_shape_of_vertices = shaped(None, 3)


def _vertices(name: str, value: Any, before: dict[str, Any]) -> np.ndarray:
    array = real_array(name, value)
    if array.ndim == 2 and array.shape[1] == 3 and len(array) == 0:
        raise ValueError(f"there is nothing to render: {name} are none")
    return _shape_of_vertices(name, array, before)


def _bsdf(name: str, value: Any, _: dict[str, Any]) -> Any:
    if "BSDF" not in (known.__name__ for known in type(value).__mro__):
        raise ValueError(f"{name} must come from relightable_bsdf or matte_bsdf, not {shown(value)}")
    return value


# Arguments mean the same everywhere.
_USUAL: dict[str, Check] = {
    "vertices": _vertices,
    "faces": _faces,
    "uv": _texture_places,
    "bsdf": _bsdf,
    "image": shaped(None, None, 3),
    "camera": instance("Viewpoint"),
    "size": _size,
    "samples": whole(1, 1 << 16),
    "seed": _seed,
    "background": number(-_LARGEST),
    "ambient": number(0),
    "noise": number(0),
    "steepest": number(0, 90),
    "fov": number(0, 180, open_ends=True),
    "margin": number(0, 1e6, open_ends=True),
    "bounces": whole(0, 1000),
    "light": vector,
    "direction": vector,
    "up": vector,
    **dict.fromkeys(("flat", "shadows", "facing", "tiled", "smooth", "back"), _flag),
    "progress": function,
}


def checked(**checks: Check) -> Callable[[_Function], _Function]:
    """Let a function be entered only with arguments that pass their checks: the given ones, and the usual ones by name.

    Raises
    ------
    ValueError
        When the function is called with anything else; the message names the argument.
    """

    def decorate(inner: _Function) -> _Function:
        signature = inspect.signature(inner)
        chosen = {name: checks.get(name, _USUAL.get(name)) for name in signature.parameters}
        optional = {name for name, parameter in signature.parameters.items() if parameter.default is None}

        @functools.wraps(inner)
        def entered(*given: Any, **named: Any) -> Any:
            try:
                bound = signature.bind(*given, **named).arguments
            except TypeError:
                # Python's own message names the function, too.
                return inner(*given, **named)
            for name, check in chosen.items():
                if check is not None and name in bound and not (name in optional and bound[name] is None):
                    bound[name] = check(name, bound[name], bound)
            return inner(**bound)

        return cast("_Function", entered)

    return decorate
