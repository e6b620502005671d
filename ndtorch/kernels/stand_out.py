"""One pass over a picture and its ground: what stands out, what may be shadow, and both ratios of light."""

from __future__ import annotations

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def stand_out(
    picture: Array,
    gain: Array,
    ground: Array,
    deviation: Array,
    noise: Array,
    spread: float,
    mean_size: float,
    offset: float,
    darkest: float,
    tint: float,
    pure: float,
    corrected: Array,
    grey: Array,
    light: Array,
    out: Array,
    may_be: Array,
    pale: Array,
) -> None:
    """See `ndtorch.vision.camera.figures.stand_out`.

    Args:
        picture, ground, deviation: `[3, h, w]`.
        gain, noise: of each color, `[3]`.
        spread, mean_size, offset, darkest, tint, pure: constants.
        corrected: becomes the picture without its gain, `[3, h, w]`.
        grey, light: become the mean of its colors, and of their ratios to the ground, `[h, w]`.
        out, may_be, pale: become 1 where a pixel stands out, where it may be shadow, and where so with hardly any tint,
            `[h, w]` uint8.
    """
    kind = picture.dtype.type
    r_gain, g_gain, b_gain = kind(1) / gain[0], kind(1) / gain[1], kind(1) / gain[2]
    r_least, g_least, b_least = kind(spread) * noise[0], kind(spread) * noise[1], kind(spread) * noise[2]
    third, own, small = kind(1 / 3), kind(spread / mean_size), kind(offset)
    low, shade, least_tint = kind(darkest), kind(2 * tint), kind(2 * pure)
    one = kind(1)
    for y in range(picture.shape[1]):
        for x in range(picture.shape[2]):
            red, green, blue = picture[0, y, x] * r_gain, picture[1, y, x] * g_gain, picture[2, y, x] * b_gain
            r_ground, g_ground, b_ground = ground[0, y, x], ground[1, y, x], ground[2, y, x]
            corrected[0, y, x], corrected[1, y, x], corrected[2, y, x] = red, green, blue
            grey[y, x] = (red + green + blue) * third
            out[y, x] = (
                (abs(red - r_ground) > max(r_least, own * deviation[0, y, x]))
                | (abs(green - g_ground) > max(g_least, own * deviation[1, y, x]))
                | (abs(blue - b_ground) > max(b_least, own * deviation[2, y, x]))
            )
            r = (red + small) / (r_ground + small)
            g = (green + small) / (g_ground + small)
            b = (blue + small) / (b_ground + small)
            mean = (r + g + b) * third
            light[y, x] = mean
            apart, dimmed = max(r, g, b) - min(r, g, b), (mean < one) & (mean > low)
            may_be[y, x] = dimmed & (apart <= shade * mean)
            pale[y, x] = dimmed & (apart <= least_tint * mean)
