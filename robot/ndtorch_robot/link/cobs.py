"""Consistent overhead byte stuffing: any bytes without a zero among them, so that zero can end a frame."""

from __future__ import annotations


def encode(data: bytes) -> bytes:
    """Up to 253 bytes stuffed, without the zero that ends a frame; one byte longer than `data`."""
    parts = data.split(b"\0")
    if any(len(part) > 253 for part in parts):
        raise ValueError("at most 253 bytes between zeros")
    return b"".join(bytes([len(part) + 1]) + part for part in parts)


def decode(coded: bytes) -> bytes | None:
    """What was stuffed, or None when it cannot have been made by `encode`."""
    out = bytearray()
    at = 0
    while at < len(coded):
        code = coded[at]
        end = at + code
        if code == 0 or end > len(coded) or 0 in coded[at + 1 : end]:
            return None
        out += coded[at + 1 : end]
        at = end
        if at < len(coded) and code != 0xFF:
            out.append(0)
    return bytes(out)
