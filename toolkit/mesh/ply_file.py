"""PLY files as they are: elements of scalars and lists, ASCII or binary, whatever they describe."""

from __future__ import annotations

import math
import re
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError
from intaglio.files import check_memory, check_readable

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
# No header of a real file is longer.
_LONGEST_HEADER = 1 << 20
# So many rows, and more and more, are read at once as long as their lists are as long as the first one's; where fewer than
# _WORTHWHILE follow, the next _SINGLE_ROWS are read one by one.
_REACH, _WORTHWHILE, _SINGLE_ROWS = 4096, 16, 256


@dataclass(frozen=True)
class Lists:
    """The values of a list property: row i has ``counts[i]`` of them, one row's after the other's in ``values``."""

    counts: Array
    values: Array


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    # Type of a list's length; empty for a scalar.
    count: str = ""


@dataclass
class _Element:
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


@dataclass(frozen=True)
class Ply:
    """Content of a PLY file.

    Attributes
    ----------
    elements : dict of str to dict
        For every element its properties by name: an array (rows,) or `Lists`.
    rows : dict of str to int
        How many rows every element has.
    comments : tuple of str
        The header's comments.
    info : dict of str to str
        The header's obj_info lines of two words.
    """

    elements: dict[str, dict[str, Array | Lists]]
    rows: dict[str, int]
    comments: tuple[str, ...]
    info: dict[str, str]

    def columns(self, element: str, *names: str) -> Array | None:
        """Return scalar properties as the columns of an array, or None if one of them is missing."""
        found = self.elements.get(element, {})
        columns = [found.get(name) for name in names]
        if any(column is None or isinstance(column, Lists) for column in columns):
            return None
        return np.stack(columns, axis=1)  # type: ignore[arg-type]

    def lists(self, element: str, *names: str) -> Lists | None:
        """Return the first list property among those named."""
        for name in names:
            found = self.elements.get(element, {}).get(name)
            if isinstance(found, Lists):
                return found
        return None


def read_ply(path: Path) -> Ply:
    """Read all elements of a PLY file.

    Raises
    ------
    FileError
        If the file is no PLY, its header is damaged, or it is shorter than its header says.
    """
    check_readable(path)
    with open(path, "rb") as file:
        order, elements, comments, info = _read_header(path, file.read(_LONGEST_HEADER))
        start = info.pop("")
        file.seek(int(start))
        size = path.stat().st_size - int(start)
        _check_room(path, elements, size, order)
        # Text becomes eight bytes a value, and is held beside them while it is read.
        check_memory(path, size if order else 6 * size, "its content")
        body = file.read()
    rows: _Rows = _BinaryRows(path, body, order) if order else _TextRows(path, body)
    content = {element.name: _read_element(rows, element) for element in elements}
    return Ply(content, {element.name: element.rows for element in elements}, tuple(comments), info)


def _read_header(path: Path, head: bytes) -> tuple[str, list[_Element], list[str], dict[str, str]]:
    """Return byte order, elements, comments, and information, under "" where the body starts."""
    if not re.match(rb"ply\s", head):
        raise FileError(f"{path}: is named {path.suffix}, but its content is not PLY")
    end = re.search(rb"[\r\n]end_header[ \t]*(\r\n|\n|\r)", head)
    if end is None:
        raise FileError(f"{path}: its header has no end_header line")
    order: str | None = None
    elements: list[_Element] = []
    comments: list[str] = []
    info = {"": str(end.end())}
    for line in re.split(r"\r\n|\n|\r", head[: end.start()].decode("utf-8", "replace"))[1:]:
        words = line.split()
        match words:
            case []:
                continue
            case ["comment", *_]:
                comments.append(line.strip()[len("comment") :].strip())
            case ["obj_info", *rest]:
                if len(rest) == 2:
                    info[rest[0]] = rest[1]
            case ["format", kind, _] if kind in _ORDERS:
                order = _ORDERS[kind]
            case ["element", name, number] if number.isdecimal() and len(number) < 16:
                if any(element.name == name for element in elements):
                    raise FileError(f"{path}: its header declares two elements {name!r}")
                elements.append(_Element(name, int(number)))
            case ["property", "list", count, kind, name] if elements and _TYPES.get(count, "f")[0] != "f" and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case _:
                raise FileError(f"{path}: its header has a line that is no PLY: {line.strip()[:80]!r}")
    if order is None:
        raise FileError(f"{path}: its header has no format line")
    for element in elements:
        names = [p.name for p in element.properties]
        if len(set(names)) < len(names):
            raise FileError(f"{path}: its header declares a property of element {element.name!r} twice")
        if not names and element.rows:
            raise FileError(f"{path}: its header declares no properties of element {element.name!r}")
    return order, elements, comments, info


def _check_room(path: Path, elements: list[_Element], size: int, order: str) -> None:
    """Raise `FileError` if the least that the declared rows take is more than there is."""
    for element in elements:
        least = sum(np.dtype(p.count or p.type).itemsize if order else 2 for p in element.properties)
        # The last value of a text needs no white space after it.
        if element.rows * least > size + 1:
            raise FileError(
                f"{path}: its header declares {element.rows} {element.name} entries, which its {size} bytes of content can't "
                "hold: the file is cut off or damaged"
            )


class _Rows(ABC):
    """The body of a PLY file, from which rows are taken in order."""

    def __init__(self, path: Path, end: int) -> None:
        self.path, self.end = path, end
        self.at = 0

    @abstractmethod
    def lengths(self, element: _Element, at: int) -> tuple[tuple[int, ...], int]:
        """Return the lengths of the lists in the row that starts at ``at``, and where the next row starts."""

    @abstractmethod
    def block(self, element: _Element, lengths: tuple[int, ...], rows: int) -> tuple[dict[str, Array], int]:
        """Return the columns of up to ``rows`` rows whose lists have these lengths, and how many rows these are.

        A list's column is (rows, length). The rows are taken.
        """

    def cut_off(self, element: _Element, found: int) -> FileError:
        """Return the error for a body that ends too early."""
        return FileError(
            f"{self.path}: its header declares {element.rows} {element.name} entries, but it holds {found}: the file is cut off"
        )


class _BinaryRows(_Rows):
    def __init__(self, path: Path, body: bytes, order: str) -> None:
        super().__init__(path, len(body))
        self.body, self.order = body, order

    def lengths(self, element: _Element, at: int) -> tuple[tuple[int, ...], int]:
        found = []
        for p in element.properties:
            step = np.dtype(p.type).itemsize
            if p.count:
                width = np.dtype(p.count).itemsize
                raw = self.body[at : at + width]
                number = int.from_bytes(raw, "big" if self.order == ">" else "little", signed=p.count[0] == "i")
                # Beyond the end, a list that certainly doesn't fit.
                found.append(number if len(raw) == width else self.end + 1)
                at += width
                step *= max(found[-1], 0)
            at += step
        return tuple(found), at

    def block(self, element: _Element, lengths: tuple[int, ...], rows: int) -> tuple[dict[str, Array], int]:
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        left = iter(lengths)
        for k, p in enumerate(element.properties):
            if p.count:
                fields.append((f"n{k}", self.order + p.count))
                fields.append((f"v{k}", self.order + p.type, (next(left),)))
            else:
                fields.append((f"v{k}", self.order + p.type))
        kind = np.dtype(fields)
        rows = min(rows, (len(self.body) - self.at) // max(kind.itemsize, 1))
        table = np.frombuffer(self.body, kind, rows, self.at)
        for k, length in zip((k for k, p in enumerate(element.properties) if p.count), lengths, strict=True):
            other = np.flatnonzero(table[f"n{k}"] != length)
            if len(other):
                table = table[: other[0]]
        self.at += len(table) * kind.itemsize
        return {p.name: table[f"v{k}"] for k, p in enumerate(element.properties)}, len(table)


class _TextRows(_Rows):
    def __init__(self, path: Path, body: bytes) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            try:
                self.values = np.fromstring(body, np.float64, sep=" ") if body.strip() else np.zeros(0)
            except (DeprecationWarning, ValueError) as error:
                raise FileError(f"{path}: {_bad_word(body)}") from error
        super().__init__(path, len(self.values))

    def lengths(self, element: _Element, at: int) -> tuple[tuple[int, ...], int]:
        found = []
        for p in element.properties:
            if p.count:
                value = self.values[at] if at < self.end else math.nan
                whole = math.isfinite(value) and value == int(value) and value >= 0
                # Beyond the end, a list that certainly doesn't fit.
                found.append(int(value) if whole else self.end + 1 if at >= self.end else -1)
                at += max(found[-1], 0)
            at += 1
        return tuple(found), at

    def block(self, element: _Element, lengths: tuple[int, ...], rows: int) -> tuple[dict[str, Array], int]:
        width = len(element.properties) + sum(lengths)
        rows = min(rows, (len(self.values) - self.at) // width)
        table = self.values[self.at : self.at + rows * width].reshape(rows, width)
        columns: dict[str, Array] = {}
        at, left = 0, iter(lengths)
        good = rows
        for p in element.properties:
            length = next(left) if p.count else None
            if length is not None:
                other = np.flatnonzero(table[:, at] != length)
                good = min(good, int(other[0]) if len(other) else rows)
                at += 1
            columns[p.name] = table[:, at] if length is None else table[:, at : at + length]
            at += 1 if length is None else length
        self.at += good * width
        return {p.name: self._as(p, columns[p.name][:good]) for p in element.properties}, good

    def _as(self, p: _Property, values: Array) -> Array:
        """Return values in a property's own type."""
        if p.type[0] == "f":
            return values.astype(p.type)
        limits = np.iinfo(p.type)
        if not (np.isfinite(values).all() and (values == np.round(values)).all()):
            raise FileError(f"{self.path}: its property {p.name} holds a number that is not whole")
        if values.size and (values.min() < limits.min or values.max() > limits.max):
            raise FileError(f"{self.path}: its property {p.name} holds {values.min():g} to {values.max():g}, not {p.type} values")
        return values.astype(p.type)


def _bad_word(body: bytes) -> str:
    """Say which word of a text is no number, and in which line after the header."""
    for number, line in enumerate(body.splitlines(), 1):
        for word in line.split():
            try:
                float(word)
            except ValueError:
                return f"line {number} after its header has {word[:40].decode('utf-8', 'replace')!r} where a number is needed"
    return "its content is not all numbers"


def _read_element(rows: _Rows, element: _Element) -> dict[str, Array | Lists]:
    """Return an element's properties."""
    blocks = list(_blocks(rows, element))
    found: dict[str, Array | Lists] = {}
    for p in element.properties:
        parts = [columns[p.name] for columns, _ in blocks]
        if p.count:
            # One number stands for all lists of a block.
            counts = [np.broadcast_to(np.int64(columns[p.name].shape[1]), taken) for columns, taken in blocks]
            values = [part.astype(p.type, copy=False).reshape(-1) for part in parts]
            found[p.name] = Lists(_joined(counts, "i8"), _joined(values, p.type))
        else:
            found[p.name] = np.concatenate(parts) if parts else np.zeros(0, p.type)
    return found


def _joined(parts: list[Array], kind: str) -> Array:
    """Return parts one after the other; a single one is not copied."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.zeros(0, kind)


def _blocks(rows: _Rows, element: _Element) -> Iterator[tuple[dict[str, Array], int]]:
    """Yield an element's rows as blocks with lists of one length: long ones as long as that goes well, else single rows."""
    done, reach, single = 0, _REACH, 0
    while done < element.rows:
        lengths, after = rows.lengths(element, rows.at)
        if min(lengths, default=0) < 0:
            raise FileError(f"{rows.path}: its {element.name} entry {done} has a list with a length that is no whole number")
        wanted = 1 if single else min(reach, element.rows - done)
        columns, taken = rows.block(element, lengths, wanted) if after <= rows.end else ({}, 0)
        if taken == 0:
            raise rows.cut_off(element, done)
        yield columns, taken
        done += taken
        if single:
            single -= 1
        elif taken == wanted:
            reach *= 2
        else:
            reach, single = _REACH, _SINGLE_ROWS if taken < _WORTHWHILE else 0
