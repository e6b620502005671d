"""Damage by chance: to bytes, to text, and to values that are written down again with a checksum that fits."""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

INTERESTING = (0, 1, 2, 127, 128, 255, 2**15 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
"""Lengths and counts at which programs go wrong."""

TOKENS = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e308",
        "-1e308",
        "1e-320",
        "0",
        "-1",
        "-0.0",
        "9223372036854775808",
        "1_0",
        "0x10",
        "1e3",
    ),
    *("true", "null", "[]", "{}", "[[[[1]]]]", "2020-01-01", "9" * 400, "9" * 5000, "[" * 3000),
    *('""', '"x"', '"\\u0000"', "\u0660", "\ufeff", "\x00"),
)
"""What may stand where a number or a word stood."""

WORD = re.compile(r"[-+]?\d[\d_.eE+-]*|\"[^\"\n]*\"|\b[A-Za-z_]\w*\b")


def damaged_bytes(chance: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """One to four kinds of damage, one after the other."""
    out = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        kind = chance.randrange(8)
        at = chance.randrange(len(out) + 1)
        if kind == 0 and out:
            out[at % len(out)] ^= 1 << chance.randrange(8)
        elif kind == 1 and out:
            out[at % len(out)] = chance.randrange(256)
        elif kind == 2:
            del out[at:]
        elif kind == 3:
            del out[at : at + chance.randint(1, 64)]
        elif kind == 4:
            out[at:at] = bytes(chance.randrange(256) for _ in range(chance.randint(1, 16)))
        elif kind == 5:  # a length or a count
            size = chance.choice((1, 2, 4, 8))
            value = chance.choice(INTERESTING) & ((1 << 8 * size) - 1)
            out[at : at + size] = value.to_bytes(size, chance.choice(("little", "big")))
        elif kind == 6 and out:  # two places change theirs
            long = chance.randint(1, 64)
            one, two = chance.randrange(len(out)), chance.randrange(len(out))
            out[one : one + long], out[two : two + long] = out[two : two + long], out[one : one + long]
        elif others:  # the end of another file
            other = chance.choice(others)
            out[at:] = other[chance.randrange(len(other) + 1) :]
    return bytes(out)


def damaged_text(chance: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Words and lines; now and then bytes."""
    if chance.random() < 0.25:
        return damaged_bytes(chance, data, others)
    text = data.decode("utf-8", "replace")
    for _ in range(chance.randint(1, 3)):
        words, lines = list(WORD.finditer(text)), text.split("\n")
        kind = chance.randrange(5)
        if kind <= 2 and words:
            word = chance.choice(words)
            new = chance.choice(words)[0] if kind == 2 else chance.choice(TOKENS)
            text = text[: word.start()] + new + text[word.end() :]
        elif kind == 3:
            lines.insert(chance.randrange(len(lines)), chance.choice(lines))
            text = "\n".join(lines)
        else:
            del lines[chance.randrange(len(lines))]
            text = "\n".join(lines)
    return text.encode("utf-8", "replace")


NAN, INF = float("nan"), float("inf")
NUMBERS = (0, -1, 1, 2**31, 2**63, 10**30, 0.5, -1e308, NAN, INF)
ODD: tuple[Any, ...] = (None, True, False, *NUMBERS, "", "x", "nan", [], [1], {}, {"a": 1})
"""Values that may stand where another stood."""


def damaged_values(chance: random.Random, values: Any) -> Any:
    """A nest of lists and dictionaries with one value in it that is another, missing, twice or one level deeper."""
    if isinstance(values, dict) and values and chance.random() < 0.85:
        name = chance.choice(list(values))
        kind = chance.randrange(8)
        if kind == 0:
            return {key: value for key, value in values.items() if key != name}
        if kind == 1:
            return values | {str(chance.choice(ODD)): values[name]}
        return values | {name: damaged_values(chance, values[name])}
    if isinstance(values, list) and values and chance.random() < 0.85:
        at = chance.randrange(len(values))
        kind = chance.randrange(8)
        if kind == 0:
            return values[:at] + values[at + 1 :]
        if kind == 1:
            return [*values[:at], values[at], *values[at:]]
        return [*values[:at], damaged_values(chance, values[at]), *values[at + 1 :]]
    if isinstance(values, int | float) and not isinstance(values, bool) and chance.random() < 0.3:
        return chance.choice((-values, values * 1000, values + 1, values / 3))
    return chance.choice((*ODD, [values], {"value": values}))


def damaged_arrays(chance: random.Random, arrays: dict[str, Any]) -> dict[str, Any]:
    """NumPy arrays by name with another shape, type or value, without one, or with one more."""
    out = dict(arrays)
    name = chance.choice(list(out))
    array, kind = np.asarray(out[name]), chance.randrange(8)
    if kind == 0:
        del out[name]
    elif kind == 1:
        out[name + chance.choice(("x", ".0", "", "\u00e9"))] = out.pop(name)
    elif kind == 2:
        out[name] = array[..., None] if chance.random() < 0.5 else array.reshape(-1)
    elif kind == 3:
        out[name] = array.astype(chance.choice(("float16", "float32", "float64", "int8", "int64", "bool", "uint8")))
    elif kind == 4:
        out[name] = np.zeros((0, *array.shape[1:]), array.dtype)
    elif kind == 5 and array.size and array.dtype.kind in "fiu":
        flat = array.copy().reshape(-1)
        odd = chance.choice((0, -1, 1e30, np.nan, np.inf, -np.inf) if array.dtype.kind == "f" else (0, 1, 127))
        flat[chance.randrange(flat.size)] = odd
        out[name] = flat.reshape(array.shape)
    elif kind == 6 and array.ndim:
        out[name] = np.concatenate([array, array], chance.randrange(array.ndim))
    else:
        out["more"] = np.arange(3.0)
    return out


def frame_bytes(chance: random.Random, frames: Sequence[bytes]) -> bytes:
    """A line on which frames come whole, damaged, cut and in the wrong order, with noise between."""
    parts = []
    for _ in range(chance.randint(1, 12)):
        frame = chance.choice(frames)
        kind = chance.randrange(4)
        noise = struct.pack("<Q", chance.getrandbits(64))[: chance.randint(0, 8)]
        parts.append((frame, damaged_bytes(chance, frame, frames), noise + frame, frame[: chance.randint(0, 9)])[kind])
    return b"".join(parts)
