"""The two checksums of a frame. The standard library has the first; the second is ours, for want of it there."""

from __future__ import annotations

import binascii


def table() -> list[int]:
    """CRC-16/DNP of every single byte."""
    result = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA6BC if crc & 1 else 0)  # 0x3D65 read from the other end
        result.append(crc)
    return result


DNP = table()


def crc_ccitt(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, starts at 0xFFFF; of `b"123456789"` 0x29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


def crc_dnp(data: bytes) -> int:
    """CRC-16/DNP: polynomial 0x3D65, reflected, inverted at the end; of `b"123456789"` 0xEA82."""
    crc = 0
    for byte in data:
        crc = crc >> 8 ^ DNP[(crc ^ byte) & 0xFF]
    return crc ^ 0xFFFF
