"""Results kept while a command runs: a line for each finished part, which the same command does not run again."""

from __future__ import annotations

import json
import math
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ndtorch.utils.files import read_bytes

Row = dict[str, Any]
"""Values by name, fit for JSON; None where there is none."""


class RowStore:
    """Rows of finished parts by key, in a file with a checksum and JSON on each line.

    Several processes may add at once. A line that was cut off or damaged does not count: its part is run again.

    Attributes:
        rows: those of the file, and those added here.
        damaged: lines that did not count.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, list[Row]] = {}
        self.damaged = 0
        self.load()

    def load(self) -> dict[str, list[Row]]:
        """Read the file again."""
        self.rows, self.damaged = {}, 0
        for line in read_bytes(self.path).splitlines() if self.path.is_file() else ():
            mark, _, text = line.partition(b" ")
            if mark == checksum(text):
                key, rows = json.loads(text)
                self.rows[key] = rows
            elif line:
                self.damaged += 1
        return self.rows

    def add(self, parts: Mapping[str, list[Row]]) -> None:
        """Keep the rows of some parts."""
        plain = {key: [{name: number(v) for name, v in row.items()} for row in rows] for key, rows in parts.items()}
        texts = [json.dumps([key, rows]).encode() for key, rows in plain.items()]
        # One write at the end of the file, which begins with the end of a line that may have been cut off.
        descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            data = b"\n" + b"".join(checksum(text) + b" " + text + b"\n" for text in texts)
            written = os.write(descriptor, data)
            while written < len(data):
                written += os.write(descriptor, data[written:])
        finally:
            os.close(descriptor)
        self.rows |= plain


def checksum(text: bytes) -> bytes:
    """Eight hexadecimal digits."""
    return f"{zlib.crc32(text):08x}".encode()


def number(value: Any) -> Any:
    """A value as JSON has it; None for a number that is not finite."""
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value
