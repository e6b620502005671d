"""The two checksums of a frame."""

from __future__ import annotations


def table(polynomial: int, reflected: bool) -> list[int]:
    """CRC of every single byte."""
    result = []
    for byte in range(256):
        crc = byte if reflected else byte << 8
        for _ in range(8):
            if reflected:
                crc = crc >> 1 ^ (polynomial if crc & 1 else 0)
            else:
                crc = (crc << 1 ^ (polynomial if crc & 0x8000 else 0)) & 0xFFFF
        result.append(crc)
    return result


CCITT = table(0x1021, reflected=False)
DNP = table(0xA6BC, reflected=True)  # 0x3D65 read from the other end


def crc_ccitt(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, starts at 0xFFFF; of `b"123456789"` 0x29B1."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ CCITT[crc >> 8 ^ byte]
    return crc


def crc_dnp(data: bytes) -> int:
    """CRC-16/DNP: polynomial 0x3D65, reflected, inverted at the end; of `b"123456789"` 0xEA82."""
    crc = 0
    for byte in data:
        crc = crc >> 8 ^ DNP[(crc ^ byte) & 0xFF]
    return crc ^ 0xFFFF
