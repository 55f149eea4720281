"""Pictures of materials as arrays: decoded, of a bounded size, from files or from memory.

Never looks for files and never decides what a picture is used for.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

MAX_TEXTURE = 2048  # pixels a side; a patch of 128 pixels never sees more
# Never those for which Pillow starts another program (EPS) or that hold no picture of a surface.
FORMATS = ("PNG", "JPEG", "BMP", "TGA", "TIFF", "WEBP", "GIF", "PPM", "DDS", "AVIF", "JPEG2000")
# A file of a few kilobytes can promise gigabytes: so many pixels are always decoded, more only
# where the file has a byte for every so many of them.
FREE_PIXELS, PIXELS_PER_BYTE = 36_000_000, 300
MOST_PIXELS = 2**28  # 16,384 a side


@dataclass(frozen=True)
class Picture:
    """A decoded picture: `pixels` (H, W, 3) uint8 sRGB, `alpha` (H, W) uint8 where it has one.

    `size` is width and height in the file, before large pictures were reduced.
    """

    pixels: NDArray[np.uint8]
    alpha: NDArray[np.uint8] | None
    size: tuple[int, int]


def decode_picture(content: bytes, where: str) -> Picture:
    """A picture file's bytes; `InputError` naming `where` if it is none."""
    from PIL import Image

    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None  # ours goes by the file's size
    try:
        with Image.open(io.BytesIO(content), formats=_formats()) as image:
            check_pixels(image.size, len(content), where)
            return _reduced(image)
    except InputError:
        raise
    except (OSError, ValueError, SyntaxError, MemoryError, Image.DecompressionBombError) as error:
        reason = str(error).split("<")[0].strip() or type(error).__name__
        raise InputError(f"{where} is not a readable picture ({reason}).") from error
    except Exception as error:  # Pillow's readers raise what they stumble upon
        raise InputError(f"{where} is not a readable picture ({type(error).__name__}).") from error
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def check_pixels(size: tuple[int, int], content: int, where: str) -> None:
    """Refuse a picture whose header promises far more than its bytes can hold."""
    count = size[0] * size[1]
    if count > FREE_PIXELS and count > PIXELS_PER_BYTE * content:
        raise InputError(
            f"{where} says {size[0]}×{size[1]} pixels but has only {content} bytes; it is damaged "
            "or made to fill the memory."
        )
    if count > MOST_PIXELS:
        raise InputError(
            f"{where} has {size[0]}×{size[1]} pixels; reduce it to 16384×16384 or less."
        )


def _formats() -> list[str]:
    from PIL import Image

    Image.init()
    return [name for name in FORMATS if name in Image.OPEN]


def _reduced(image: Any) -> Picture:
    from PIL import Image

    size = image.size
    image.draft(None, (MAX_TEXTURE, MAX_TEXTURE))  # JPEG: decode no more than is wanted
    steps = max(image.size) // (2 * MAX_TEXTURE)
    if steps > 1 and image.mode in ("RGB", "L", "CMYK", "YCbCr"):
        image = image.reduce(steps)  # at once, or a copy of the whole would need as much again
    if image.mode.startswith("I"):  # 16 bits: Pillow would clip instead of scale
        image = image.point(lambda value: value / 256)
    elif image.mode == "F":
        image = Image.fromarray(as_bytes(image, 255))
    has_alpha = image.mode in ("RGBA", "LA", "PA", "RGBa") or "transparency" in image.info
    image = image.convert("RGBA" if has_alpha else "RGB")
    scale = MAX_TEXTURE / max(image.size)
    channels = np.asarray(image, np.uint8)
    color, alpha = channels[..., :3], channels[..., 3] if has_alpha else None
    if scale < 1:  # each by itself: hidden parts keep their colour
        smaller = (max(1, round(image.size[0] * scale)), max(1, round(image.size[1] * scale)))
        color = np.asarray(
            Image.fromarray(np.ascontiguousarray(color)).resize(smaller, Image.Resampling.BOX)
        )
        if alpha is not None:
            shrunk = Image.fromarray(np.ascontiguousarray(alpha))
            alpha = np.asarray(shrunk.resize(smaller, Image.Resampling.BOX))
    return Picture(
        np.ascontiguousarray(color, np.uint8),
        None if alpha is None else np.ascontiguousarray(alpha),
        size,
    )


def as_bytes(values: Any, scale: float = 1.0) -> NDArray[np.uint8]:
    """Numbers times `scale` as bytes, rounded; what is outside of 0 to 255 is clipped, NaN is 0."""
    finite = np.nan_to_num(np.asarray(values)).clip(0, 255 / scale)  # first: no product overflows
    return np.asarray(np.rint(finite * scale), np.uint8)


def to_linear(values: NDArray[Any]) -> NDArray[np.float64]:
    """sRGB values from 0 to 255 as linear light in [0, 1]."""
    value = np.asarray(values, np.float64) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: Any) -> NDArray[np.uint8]:
    """Linear light as sRGB bytes; what is outside of [0, 1] is clipped."""
    value = np.nan_to_num(np.asarray(linear, np.float64)).clip(0, 1)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * encoded), np.uint8)


def tinted(pixels: NDArray[np.uint8], factor: Any) -> NDArray[np.uint8]:
    """A picture (H, W, 3) times a colour factor (3,) of linear light."""
    factor = np.asarray(factor, np.float64)[:3]
    if (factor == 1).all():
        return pixels
    table = to_linear(np.arange(256))[:, None] * factor  # (256, 3)
    lookup = to_srgb(table)
    return np.stack([lookup[pixels[..., k], k] for k in range(3)], -1)
