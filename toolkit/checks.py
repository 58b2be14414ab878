"""Checks of settings that the systems share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array
from intaglio.errors import InputError


def checked_number(name: str, value: float, low: float, high: float = np.inf) -> float:
    """Return ``value`` as a float, or raise `InputError` if it is not a number from ``low`` to ``high``."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be a number, not {value!r}") from error
    if not low <= number <= high or not np.isfinite(number):
        limits = f"at least {low:g}" if high == np.inf else f"from {low:g} to {high:g}"
        raise InputError(f"{name} must be {limits}, not {value!r}")
    return number


def checked_count(name: str, value: int, low: int, high: int) -> int:
    """Return ``value`` as an int, or raise `InputError` if it is no whole number from ``low`` to ``high``."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or not low <= value <= high:
        raise InputError(f"{name} must be a whole number from {low} to {high}, not {value!r}")
    return int(value)


def checked_choice(name: str, value: str, known: Sequence[str]) -> str:
    """Return ``value``, or raise `InputError` if it is none of ``known``."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} must be one of {', '.join(map(repr, known))}, not {value!r}")
    return value


def checked_flag(name: str, value: bool) -> bool:
    """Return ``value`` as a bool, or raise `InputError` if it is neither True nor False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} must be True or False, not {value!r}")
    return bool(value)


def checked_positive(name: str, value: float) -> float:
    """Return ``value`` as a float, or raise `InputError` if it is not a finite number above 0."""
    wrong = isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating)
    number = np.nan if wrong else float(value)
    if not 0 < number < np.inf:
        raise InputError(f"{name} must be a number above 0, not {value!r}")
    return number


def checked_finite(name: str, value: object) -> Array:
    """Return ``value`` as a float64 array, or raise `InputError` if it is no array of finite real numbers."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name} must be an array of numbers ({error})") from error
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name} must be an array of numbers, not of {array.dtype}")
    bad = ~np.isfinite(array)
    if bad.any():
        rows = int(bad.reshape(len(bad), -1).any(axis=1).sum()) if array.ndim else 1
        raise InputError(f"{rows} of {len(array) if array.ndim else 1} {name} hold NaN or infinity; leave them out")
    return np.ascontiguousarray(array, np.float64)


def checked_vectors(name: str, value: object) -> Array:
    """Return ``value`` as an (N, 3) float64 array of finite numbers, or raise `InputError`."""
    array = checked_finite(name, value)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{name} must be an (N, 3) array, not {array.shape}")
    return array


def checked_numeric(name: str, value: ArrayLike, dtype: type) -> Array:
    """Return ``value`` as a contiguous array of ``dtype``, or raise `InputError` if it is no array of real numbers."""
    try:
        if np.iscomplexobj(value):
            raise InputError(f"{name} must be real numbers")
        return np.ascontiguousarray(value, dtype)
    except (TypeError, ValueError) as problem:
        if isinstance(problem, InputError):
            raise
        raise InputError(f"{name} is no array of numbers ({problem})") from problem


def checked_rows(name: str, value: Array, dtype: type, count: int | None = None) -> Array:
    """Return ``value`` as an (N, 3) array of finite numbers, N being ``count`` if given, or raise `InputError`."""
    array = checked_numeric(name, value, dtype)
    if array.ndim != 2 or array.shape[1] != 3 or (count is not None and len(array) != count):
        raise InputError(f"{name} must have shape ({'N' if count is None else count}, 3), not {array.shape}")
    finite = np.isfinite(array).all(axis=1)
    if not finite.all():
        first = int(np.flatnonzero(~finite)[0])
        raise InputError(f"{name}: {(~finite).sum()} rows are not finite, the first is row {first}: {array[first]}")
    return array


def checked_mask(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return ``value`` as a bool array, or raise `InputError` if it is not one of ``shape``."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name} must be a bool array {shape} like the maps ({error})") from error
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
        raise InputError(f"{name} must be a whole number or (rows, columns), not {value!r}") from error
    for number in (rows, columns):
        if not isinstance(number, int | np.integer) or isinstance(number, bool) or not 1 <= number <= 65536:
            raise InputError(f"{name} must be whole numbers from 1 to 65536, (rows, columns); given: {value!r}")
    return int(rows), int(columns)
