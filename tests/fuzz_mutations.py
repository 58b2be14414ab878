"""Spoiling files: bytes, text, numbers, JSON, checksums, names. All is drawn from the given generator."""

from __future__ import annotations

import copy
import json
import re
import struct
import zlib
from pathlib import PurePosixPath

import numpy as np

NUMBERS = (
    b"nan", b"NaN", b"inf", b"-Infinity", b"1e308", b"-1e308", b"1e999", b"1e200", b"1e30", b"1e-320", b"0", b"-0", b"-1", b"1",
    b"2", b"3", b"255", b"256", b"65536", b"2147483647", b"2147483648", b"-2147483648", b"4294967295", b"9223372036854775808",
    b"99999999999999999999", b"9" * 400, b"9" * 5000, b"0x10", b"1_000", b"1e", b"", b"1.5", b"1,5", "٣".encode(),
    b"True",
)  # fmt: skip
WORDS = (
    b"", b"x", b"\0", b"\n", b"\r", b" ", b"\xff\xfe", b"\xc3\x28", b'"', b"'", b"<", b"&lt;", b"{", b"]", b"#", b"../", b"/",
    b"\\", b"C:\\", b"%00", b"%s", b"null", b"x" * 300, b"x" * 5000, b"a\tb", "é".encode("latin-1"), "🏺".encode(), b"-",
)  # fmt: skip
INTEGERS = (0, 1, 2, 3, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1, 10**9, 10**6)
NODES = (
    None, True, False, 0, 1, -1, 2**31, 2**63, 10**400, 1e308, -1e308, 1e-320, 0.5, float("nan"), float("inf"), "", "x", "0",
    "nan", "x" * 5000, "../../x", "a.png", "\0", "é\n", [], {}, [[]], [0], [0, 0, 0], [1, 2, 3, 4], [[0] * 3] * 3, [None],
    {"x": 1}, ["x"],
)  # fmt: skip

NUMBER = re.compile(rb"(?<![A-Za-z_])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def pick(rng, choices):
    return choices[int(rng.integers(len(choices)))]


def place(rng, data) -> int:
    """Return a place in data, in the first part of it as often as anywhere: there are the headers."""
    end = len(data) if rng.random() < 0.5 else min(len(data), 400)
    return int(rng.integers(end + 1))


# Each takes data, a generator, and the data of all seeds.


def cut(data, rng, others):
    return data[: place(rng, data)]


def flip_bits(data, rng, others):
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if made:
            made[min(place(rng, made), len(made) - 1)] ^= 1 << int(rng.integers(8))
    return bytes(made)


def set_bytes(data, rng, others):
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        if made:
            made[min(place(rng, made), len(made) - 1)] = pick(rng, (0, 1, 127, 128, 255, int(rng.integers(256))))
    return bytes(made)


def set_integer(data, rng, others):
    """Put a number of 2, 4 or 8 bytes somewhere, or of floats."""
    size, mark = pick(rng, ((2, "H"), (4, "I"), (8, "Q"), (4, "f"), (8, "d")))
    at = place(rng, data) // pick(rng, (1, size)) * pick(rng, (1, 1, size))
    if mark in "fd":
        value = pick(rng, (float("nan"), float("inf"), -1e30, 1e30, 0.0, -0.0, 1e-40))
    else:
        value = pick(rng, INTEGERS) % (1 << 8 * size)
    return data[:at] + struct.pack(pick(rng, "<>") + mark, value) + data[at + size :]


def delete(data, rng, others):
    at = place(rng, data)
    return data[:at] + data[at + int(rng.integers(1, pick(rng, (3, 30, 300)))) :]


def insert(data, rng, others):
    at = place(rng, data)
    return data[:at] + rng.integers(0, 256, int(rng.integers(1, 40)), np.uint8).tobytes() + data[at:]


def repeat(data, rng, others):
    at, from_ = place(rng, data), place(rng, data)
    return data[:at] + data[from_ : from_ + int(rng.integers(1, 200))] * int(rng.integers(1, 4)) + data[at:]


def splice(data, rng, others):
    """Go on with a part of another file, or end with one."""
    other = pick(rng, others)
    at = place(rng, data)
    if rng.random() < 0.5:
        return data[:at] + other[place(rng, other) :]
    from_ = place(rng, other)
    size = int(rng.integers(1, 100))
    return data[:at] + other[from_ : from_ + size] + data[at + size :]


def other_file(data, rng, others):
    return pick(rng, others)


def blank(data, rng, others):
    return pick(
        rng, (b"", b"\n", b" \n\t", b"\0" * 50, b"\0" * 2000, b"\xff" * 500, b"#\n#\n", b"0", b"x" * 20000, b"\xef\xbb\xbf")
    )


def change_numbers(data, rng, others):
    found = list(NUMBER.finditer(data))
    if rng.random() < 0.5:
        found = [f for f in found if f.start() < 500]
    made = data
    for hit in sorted({pick(rng, found).span() for _ in range(int(rng.integers(1, 4)))}, reverse=True) if found else ():
        made = made[: hit[0]] + pick(rng, NUMBERS) + made[hit[1] :]
    return made


def shift_number(data, rng, others):
    """Make one number a little, or a lot, larger or smaller."""
    found = list(NUMBER.finditer(data))
    if not found:
        return data
    hit = pick(rng, found)
    try:
        value = float(hit[0]) * pick(rng, (1, 1, 2, -1, 10, 1e6)) + pick(rng, (1, -1, 0, 0.5))
    except ValueError:
        return data
    text = str(int(value)) if abs(value) < 1e15 and value == int(value) else repr(value)
    return data[: hit.start()] + text.encode() + data[hit.end() :]


def change_words(data, rng, others):
    found = list(re.finditer(rb"[A-Za-z_][A-Za-z_0-9.]*", data[:20000]))
    if not found:
        return data
    hit, other = pick(rng, found), pick(rng, found)
    new = pick(rng, WORDS) if rng.random() < 0.6 else other[0]
    return data[: hit.start()] + new + data[hit.end() :]


def insert_word(data, rng, others):
    at = place(rng, data)
    return data[:at] + pick(rng, WORDS) + data[at:]


def change_lines(data, rng, others):
    lines = data.split(b"\n")
    at, to = int(rng.integers(len(lines))), int(rng.integers(len(lines)))
    kind = rng.integers(4)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(to, lines[at])
    elif kind == 2:
        lines[at], lines[to] = lines[to], lines[at]
    else:
        words = lines[at].split()
        lines[at] = b" ".join(words[: int(rng.integers(len(words) + 1))])
    return b"\n".join(lines)


def other_encoding(data, rng, others):
    kind = rng.integers(4)
    if kind == 0:
        return data.replace(b"\n", pick(rng, (b"\r\n", b"\r", b"\n\n", b" \n")))
    text = data.decode("latin-1")
    return text.encode(pick(rng, ("utf-16", "utf-16-be", "utf-8-sig", "utf-32")))


def nest(data, rng, others):
    """Put thousands of brackets in, or around what is there."""
    opened, closed = pick(rng, ((b"[", b"]"), (b'{"a":', b"}"), (b"<a>", b"</a>"), (b"(", b")")))
    count = pick(rng, (30, 900, 3000, 60000))
    kind = rng.integers(3)
    if kind == 0:
        return opened * count + data + closed * count
    at = place(rng, data)
    return data[:at] + opened * count + (closed * count if kind == 1 else b"") + data[at:]


def change_json(data, rng, others):
    """Replace, remove or repeat nodes of a JSON document; of one within another file if the new one is no longer."""
    start = data.find(b"{") if not data.lstrip().startswith(b"[") else data.find(b"[")
    if start < 0:
        return data
    text = data[start:].decode("latin-1")
    try:
        document, length = json.JSONDecoder().raw_decode(text)
    except (ValueError, RecursionError):
        return data
    if not isinstance(document, dict | list):
        return data
    for _ in range(int(rng.integers(1, 3))):
        change_node(document, rng)
    made = json.dumps(document, separators=pick(rng, ((",", ":"), (", ", ": ")))).encode()
    if start + length >= len(data.rstrip()):
        return data[:start] + made
    if data[:4] == b"glTF":
        made += b" " * (-len(made) % 4)
        rest = data[start + length :].lstrip(b" ")
        whole = data[:12] + struct.pack("<I", len(made)) + data[16:20] + made + rest
        return whole[:8] + struct.pack("<I", len(whole)) + whole[12:]
    return data[:start] + made.ljust(length) + data[start + length :] if len(made) <= length else data


def change_node(document, rng):
    way = []

    def walk(node, depth):
        if depth > 50:
            return
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            way.append((node, key))
            if isinstance(node[key], dict | list):
                walk(node[key], depth + 1)

    walk(document, 0)
    if not way:
        return
    node, key = pick(rng, way)
    other, other_key = pick(rng, way)
    kind = rng.random()
    if kind < 0.6:
        node[key] = copy.deepcopy(pick(rng, NODES))
    elif kind < 0.75:
        del node[key]
    elif kind < 0.85:
        # A copy: a node within itself is no JSON.
        node[key] = json.loads(json.dumps(other[other_key]))
    elif isinstance(node, list):
        node.insert(key, json.loads(json.dumps(other[other_key])))
    else:
        node[key] = [node[key]] * int(rng.integers(2, 4))


MUTATIONS = {
    "bytes": (cut, flip_bits, set_bytes, set_integer, set_integer, delete, insert, repeat, splice),
    "text": (change_numbers, change_numbers, shift_number, change_words, insert_word, change_lines, other_encoding, nest),
    "json": (change_json, change_json, change_json, nest),
    "whole": (other_file, blank, cut),
}


def is_text(data: bytes) -> bool:
    return b"\0" not in data[:2000] and sum(c > 127 for c in data[:2000]) * 10 <= len(data[:2000])


def spoil(data: bytes, rng, others) -> bytes:
    """Return other bytes than these, in most cases."""
    roll = rng.random()
    if roll < 0.04:
        return pick(rng, MUTATIONS["whole"])(data, rng, others)
    has_json = b'{"' in data or data.lstrip()[:1] in (b"{", b"[")
    for _ in range(pick(rng, (1, 1, 1, 2, 3))):
        kinds = ["text", "text", "bytes"] if is_text(data) else ["bytes", "bytes", "text"]
        kind = pick(rng, kinds + ["json"] * (3 if has_json else 0))
        data = pick(rng, MUTATIONS[kind])(data, rng, others)
    return mend_checksums(data) if rng.random() < 0.8 else data


# Damage behind a right checksum is what readers have to find out themselves.


def mend_checksums(data: bytes) -> bytes:
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return mend_png(data)
    if data.startswith(b"ASTM-E57"):
        return mend_e57(data)
    return data


def mend_png(data: bytes) -> bytes:
    made, at = bytearray(data[:8]), 8
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        if at + 12 + size > len(data):
            break
        body = data[at + 4 : at + 8 + size]
        made += data[at : at + 4] + body + zlib.crc32(body).to_bytes(4, "big")
        at += 12 + size
    return bytes(made) + data[at:]


def _table():
    table = []
    for k in range(256):
        for _ in range(8):
            k = k >> 1 ^ (0x82F63B78 if k & 1 else 0)
        table.append(k)
    return table


CASTAGNOLI = _table()


def mend_e57(data: bytes) -> bytes:
    """Set the sums of E57's pages: CRC32C of 1020 bytes, in big order."""
    made = bytearray(data)
    for page in range(0, len(data) - 1023, 1024):
        value = 0xFFFFFFFF
        for byte in data[page : page + 1020]:
            value = value >> 8 ^ CASTAGNOLI[(value ^ byte) & 255]
        made[page + 1020 : page + 1024] = (value ^ 0xFFFFFFFF).to_bytes(4, "big")
    return bytes(made)


# Files and their names


def spoil_files(seed, rng, others, suffixes) -> tuple[dict[str, bytes], str]:
    """Return a seed's files with something wrong, and the entry, which may have another suffix."""
    files, entry = dict(seed.files), seed.entry
    roll = rng.random()
    names = sorted(files)
    name = entry if entry in files and rng.random() < 0.75 else pick(rng, names)
    if entry not in files and rng.random() < 0.7:
        # Of folders, what describes the rest.
        told = [n for n in names if not n.endswith((".png", ".jpg", ".exr", ".tif"))]
        name = pick(rng, told) if told else name
    if roll < 0.03 and len(files) > 1:
        del files[pick(rng, [n for n in names if n != entry])]
        return files, entry
    if roll < 0.05 and len(files) > 1:
        # A folder of this name.
        gone = pick(rng, [n for n in names if n != entry])
        del files[gone]
        files[f"{gone}/inner"] = b"x"
        return files, entry
    if roll < 0.10 and entry in files:
        renamed = str(PurePosixPath(entry).with_suffix(pick(rng, suffixes)))
        files[renamed] = files.pop(entry) if rng.random() < 0.7 else files[entry]
        return files, renamed
    files[name] = spoil(files[name], rng, others)
    if rng.random() < 0.1:
        other = pick(rng, names)
        files[other] = spoil(files[other], rng, others)
    return files, entry
