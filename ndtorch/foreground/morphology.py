"""Binary morphology with squares, compiled: dilation, opening, closing and majority filter.

A mask is a string of bits, 64 in a word: row after row, each followed by a margin of zeros, with as many rows of zeros
above and below. A step by some pixels along rows or columns is one shift of the whole string.
"""

from __future__ import annotations

import numpy as np

from ndtorch.foreground.arrays import Array
from ndtorch.utils.jit import jit

WORD = 64


@jit
def any_nonzero(row: Array) -> bool:
    """Whether a row of whole numbers has one that is not 0. Most rows have none and are skipped by this test."""
    some = np.int32(0)
    for x in range(row.shape[0]):
        some |= np.int32(row[x])
    return bool(some != 0)


@jit
def inside_row(width: int, margin: int) -> Array:
    """1 for the pixels of a row, 0 in the margin behind it."""
    inside = np.zeros((width + margin + WORD - 1) // WORD, np.uint64)
    for x in range(width):
        inside[x // WORD] |= np.uint64(1) << np.uint64(x % WORD)
    return inside


@jit
def row_of(marks: Array, y: int, line: int, margin: int) -> Array:
    """One row of so many words of a mask with margins."""
    return marks[(y + margin) * line : (y + margin + 1) * line]


@jit
def pack(row: Array, bits: Array) -> None:
    """A row of bytes, 1 or 0, as bits."""
    for k in range(bits.shape[0]):
        bits[k] = packed(row[WORD * k : WORD * (k + 1)])


@jit
def packed(row: Array) -> Array:
    """Up to 64 bytes as one word."""
    word = np.uint64(0)
    for n in range(row.shape[0]):
        word |= np.uint64(row[n]) << np.uint64(n)
    return word


@jit
def unpack(bits: Array, row: Array) -> None:
    """Bits as a row of bytes. Most words are zero."""
    for k in range(bits.shape[0]):
        part, word = row[WORD * k : WORD * (k + 1)], bits[k]
        if word:
            for n in range(part.shape[0]):
                part[n] = (word >> np.uint64(n)) & np.uint64(1)
        else:
            part[:] = 0


@jit
def opening(marks: Array, side: int, inside: Array, margin: int, room: tuple[Array, Array]) -> None:
    """`cv2.MORPH_OPEN` with a square.

    Args:
        marks: a mask with margins; changed in place.
        side: of the square, odd.
        inside: of `inside_row`.
        margin: pixels beyond each edge, at least `side`.
        room: two buffers like the mask.
    """
    invert(marks, inside, margin)
    dilate(marks, side, inside, margin, room)
    invert(marks, inside, margin)
    dilate(marks, side, inside, margin, room)


@jit
def closing(marks: Array, side: int, inside: Array, margin: int, room: tuple[Array, Array]) -> None:
    """`cv2.MORPH_CLOSE` with a square; the arguments are those of `opening`."""
    dilate(marks, side, inside, margin, room)
    invert(marks, inside, margin)
    dilate(marks, side, inside, margin, room)
    invert(marks, inside, margin)


@jit
def dilate(marks: Array, side: int, inside: Array, margin: int, room: tuple[Array, Array]) -> None:
    """`cv2.dilate` with a square; the arguments are those of `opening`. The window grows by doubling."""
    line, (one, other) = inside.shape[0], room
    one[:] = marks
    for unit in (1, WORD * line):
        size = 1
        while size < side:
            step = min(size, side - size)
            union(one, unit * step, other)
            one, other = other, one
            size += step
    back = side // 2 * (WORD * line + 1)
    whole, part = back // WORD, np.uint64(back % WORD)
    rest, first, last = np.uint64(WORD - 1) - part, margin * line, marks.shape[0] - margin * line
    here, before, to = one[first - whole :], one[first - whole - 1 :], marks[first:last]
    for n in range(to.shape[0]):
        to[n] = (here[n] << part) | ((before[n] >> np.uint64(1)) >> rest)
    for y in range(marks.shape[0] // line - 2 * margin):
        row = row_of(marks, y, line, margin)
        for k in range(line):
            row[k] &= inside[k]


@jit
def invert(marks: Array, inside: Array, margin: int) -> None:
    """1 becomes 0 and 0 becomes 1, except in the margins."""
    line = inside.shape[0]
    for y in range(marks.shape[0] // line - 2 * margin):
        row = row_of(marks, y, line, margin)
        for k in range(line):
            row[k] ^= inside[k]


@jit
def union(one: Array, step: int, found: Array) -> None:
    """Marks of a string of bits, and of itself so many pixels further on."""
    whole, part = step // WORD, np.uint64(step % WORD)
    rest, end = np.uint64(WORD - 1) - part, one.shape[0] - whole - 1
    here, after = one[whole:], one[whole + 1 :]
    for n in range(end):
        # In two steps: by 64 at once is no shift.
        found[n] = one[n] | (here[n] >> part) | ((after[n] << np.uint64(1)) << rest)
    found[end] = one[end] | (here[end] >> part)
    for n in range(end + 1, one.shape[0]):
        found[n] = one[n]


@jit
def majority_filter(marks: Array, width: int, inside: Array, margin: int, found: Array) -> None:
    """1 where at least five of the 3 x 3 pixels around are 1; edges are mirrored. Both are masks with margins."""
    line = inside.shape[0]
    height = marks.shape[0] // line - 2 * margin
    # Sums of three rows in binary; the first word is what is left of the row.
    ones, twos = np.zeros(line + 2, np.uint64), np.zeros(line + 2, np.uint64)
    for y in range(height):
        upper = row_of(marks, mirrored(y - 1, height), line, margin)
        middle, lower = row_of(marks, y, line, margin), row_of(marks, mirrored(y + 1, height), line, margin)
        for k in range(line):
            odd = upper[k] ^ middle[k]
            ones[k + 1], twos[k + 1] = odd ^ lower[k], (upper[k] & middle[k]) | (odd & lower[k])
        mirror_ends(ones, width)
        mirror_ends(twos, width)
        mark_five(ones, twos, inside, row_of(found, y, line, margin))


@jit
def mirror_ends(bits: Array, width: int) -> None:
    """Mirror a row that begins at its second word: the pixels before and after it are its second and last but one."""
    end, one = width - 2 + WORD, np.uint64(1)
    bits[0] = (bits[1] >> one) << np.uint64(WORD - 1)
    last = (bits[end // WORD] >> np.uint64(end % WORD)) & one
    bits[(end + 2) // WORD] |= last << np.uint64((end + 2) % WORD)


@jit
def mark_five(ones: Array, twos: Array, inside: Array, found: Array) -> None:
    """Where three neighbours among such sums are five together."""
    near, far = np.uint64(1), np.uint64(WORD - 1)
    for k in range(found.shape[0]):
        left, right = (ones[k + 1] << near) | (ones[k] >> far), (ones[k + 1] >> near) | (ones[k + 2] << far)
        odd = left ^ ones[k + 1]
        single, pair = odd ^ right, (left & ones[k + 1]) | (odd & right)
        left, right = (twos[k + 1] << near) | (twos[k] >> far), (twos[k + 1] >> near) | (twos[k + 2] << far)
        # Of four pairs three, or two and a single one.
        some, both, others, all_others = pair ^ left, pair & left, twos[k + 1] ^ right, twos[k + 1] & right
        three = (both & (others | all_others)) | (all_others & (some | both))
        two = both | all_others | (some & others)
        found[k] = (three | (two & single)) & inside[k]


@jit
def mirrored(at: int, size: int) -> int:
    """Index of the pixel shown at a place beyond the edges (`cv2.BORDER_REFLECT_101`)."""
    while at < 0 or at >= size:
        at = -at if at < 0 else 2 * size - 2 - at
        if size == 1:
            return 0
    return at
