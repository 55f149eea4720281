"""Paints surface textures by code: noise, stripes, labels, logos, patches, plain ones too.

Never knows geometry and never reads files; given photographs it uses parts of them.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ...typing import RGBImage

Colour = tuple[int, int, int]
LETTERS = "eeeaaoiurnstlmdcpbghkvwxyz    0123456789&!"


def random_palette(rng: np.random.Generator, count: int = 5) -> list[Colour]:
    """Colours that go together: a base hue, its relatives, an opposite, a light and a dark one."""
    # Reds to yellows and blues are what people paint things with, but every hue occurs.
    hue = float(rng.choice([rng.random(), rng.normal(0.07, 0.06), rng.normal(0.6, 0.05)]))
    spread = rng.choice([0.04, 0.1, 0.35])
    strength = rng.choice([0.15, 0.55, 0.85], p=[0.25, 0.4, 0.35])
    colours: list[Colour] = []
    for index in range(count):
        turn = 0.5 if index == 1 and rng.random() < 0.4 else rng.normal() * spread
        saturation = float(np.clip(strength * rng.uniform(0.5, 1.3), 0, 1))
        light, middle, dark = rng.uniform(0.75, 1), rng.uniform(0.35, 0.8), rng.uniform(0.05, 0.3)
        value = rng.choice([light, middle, dark], p=[0.4, 0.4, 0.2])
        if index > 1 and rng.random() < 0.35:
            saturation *= 0.1  # whites, greys and blacks are everywhere
        colours.append(_rgb(hue + turn, saturation, float(value)))
    return colours


def paint(
    rng: np.random.Generator,
    height: int,
    width: int,
    palette: Sequence[Colour],
    photos: Sequence[RGBImage] | None = None,
    plain: bool = False,
) -> RGBImage:
    """One texture: a base colour, patterns on it, wear; `plain` leaves out the patterns."""
    colour = palette[int(rng.integers(len(palette)))]
    if plain:
        picture = np.empty((height, width, 3), np.uint8)
        picture[:] = colour
        return weather(rng, picture, rng.uniform(0, 8))
    if photos and rng.random() < 0.4:
        picture = photo_crop(rng, photos, height, width)
    else:
        ground = GROUNDS[int(rng.integers(len(GROUNDS)))]
        picture = ground(rng, height, width, palette)
    image = Image.fromarray(picture)
    for _ in range(int(rng.integers(0, 7))):
        DECORATIONS[int(rng.integers(len(DECORATIONS)))](rng, image, palette)
    return weather(rng, np.asarray(image), rng.uniform(0, 10))


def photo_crop(
    rng: np.random.Generator, photos: Sequence[RGBImage], height: int, width: int
) -> RGBImage:
    """A random part of a random photograph, resized to height × width."""
    photo = photos[int(rng.integers(len(photos)))]
    tall, wide = photo.shape[:2]
    scale = rng.uniform(0.35, 1.0) * min(tall / height, wide / width)
    # Of a picture of one line no more than that.
    h, w = min(tall, max(2, int(height * scale))), min(wide, max(2, int(width * scale)))
    y, x = int(rng.integers(tall - h + 1)), int(rng.integers(wide - w + 1))
    part = Image.fromarray(photo[y : y + h, x : x + w])
    return np.array(part.resize((width, height), Image.Resampling.BILINEAR))


def smooth_noise(
    rng: np.random.Generator, height: int, width: int, coarsest: int = 3, octaves: int = 4
) -> NDArray[np.float32]:
    """1/f noise (height, width), about zero, standard deviation about one."""
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        cells = coarsest * 2**octave
        rows = max(2, cells * height // max(height, width))
        columns = max(2, cells * width // max(height, width))
        coarse = rng.standard_normal((rows, columns), np.float32) / 2**octave
        fine = Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC)
        total += np.asarray(fine)
    spread = float(total.std())
    return np.asarray(total / spread if spread > 1e-6 else 0 * total, np.float32)


def weather(rng: np.random.Generator, picture: RGBImage, amount: float) -> RGBImage:
    """Dirt and uneven colour: brightness noise of about `amount` grey levels, large and small."""
    height, width = picture.shape[:2]
    wear = amount * smooth_noise(rng, height, width, 4, 3)
    grain = 0.4 * amount * rng.standard_normal((height, width), np.float32)
    return (picture + (wear + grain)[..., None]).clip(0, 255).astype(np.uint8)


# -- grounds ---------------------------------------------------------------------------------------


def _solid(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> RGBImage:
    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = palette[int(rng.integers(len(palette)))]
    return picture


def _gradient(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> RGBImage:
    a, b = _two(rng, palette)
    angle = rng.uniform(0, 2 * np.pi)
    y, x = np.mgrid[0:height, 0:width] / max(height, width)
    along = np.cos(angle) * x + np.sin(angle) * y
    along = (along - along.min()) / max(float(np.ptp(along)), 1e-6)
    return _mix(along.astype(np.float32), a, b)


def _marble(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> RGBImage:
    noise = smooth_noise(rng, height, width, int(rng.integers(2, 7)), 5)
    a, b = _two(rng, palette)
    if rng.random() < 0.5:  # camouflage: steps instead of a passage
        colours = np.array(palette, np.uint8)
        level = np.digitize(noise, np.linspace(-1.2, 1.2, len(colours) - 1))
        return np.asarray(colours[level])
    return _mix(1 / (1 + np.exp(-rng.uniform(0.8, 3) * noise)), a, b)


def _wood(rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]) -> RGBImage:
    light = np.array(_rgb(rng.uniform(0.05, 0.11), rng.uniform(0.3, 0.7), rng.uniform(0.5, 0.9)))
    y, x = np.mgrid[0:height, 0:width].astype(np.float32) / max(height, width)
    bent = y * rng.uniform(8, 25) + 1.2 * smooth_noise(rng, height, width, 2, 2)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (bent + 0.1 * x))
    return np.asarray(light * (0.7 + 0.3 * rings[..., None]), np.uint8)


def _stripes(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> RGBImage:
    colours = np.array(palette, np.uint8)
    angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
    y, x = np.mgrid[0:height, 0:width] / max(height, width)
    along = np.cos(angle) * x + np.sin(angle) * y
    count = int(rng.integers(3, 12))
    order = rng.integers(len(colours), size=2 * count + 2)
    return np.asarray(colours[order[(along * count).astype(np.int64) % len(order)]])


def _checks(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> RGBImage:
    count = int(rng.integers(3, 10))
    y, x = np.mgrid[0:height, 0:width] * count // max(height, width)
    if rng.random() < 0.5:  # a chess board
        chosen = np.array(_two(rng, palette), np.uint8)
        return np.asarray(chosen[(x + y) % 2])
    colours = np.array(palette, np.uint8)  # patchwork
    return np.asarray(colours[rng.integers(len(colours), size=(count + 1, count + 1))[y, x]])


def _cells(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> RGBImage:
    count = int(rng.integers(6, 30))
    seeds = rng.random((count, 2), np.float32) * np.array([height, width], np.float32)
    rows, columns = -(-height // 2), -(-width // 2)  # at half the resolution: four times faster
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32) * 2
    distance = (y[..., None] - seeds[:, 0]) ** 2 + (x[..., None] - seeds[:, 1]) ** 2
    colours = np.array(palette, np.uint8)[rng.integers(len(palette), size=count)]
    small = colours[distance.argmin(-1)]
    return np.asarray(small.repeat(2, 0).repeat(2, 1)[:height, :width])


def _dots(rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]) -> RGBImage:
    a, b = _two(rng, palette)
    image = Image.new("RGB", (width, height), a)
    draw = ImageDraw.Draw(image)
    if rng.random() < 0.5:  # a lattice
        step = max(6, int(max(height, width) / rng.integers(4, 12)))
        radius = step * rng.uniform(0.15, 0.4)
        for y in range(step // 2, height, step):
            for x in range(step // 2, width, step):
                draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=b)
    else:  # confetti
        for x, y in rng.random((60, 2)) * (width, height):
            radius = rng.uniform(0.01, 0.06) * max(height, width)
            fill = palette[int(rng.integers(len(palette)))]
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=fill)
    return np.array(image)


# -- decorations -----------------------------------------------------------------------------------


def _label(rng: np.random.Generator, image: Image.Image, palette: Sequence[Colour]) -> None:
    """A rectangle with lines of writing, as on a package."""
    draw = ImageDraw.Draw(image)
    w, h = rng.uniform(0.3, 0.9) * image.width, rng.uniform(0.2, 0.6) * image.height
    left, top = rng.uniform(0, image.width - w), rng.uniform(0, image.height - h)
    ground, ink = _two(rng, [*palette, (245, 245, 240), (20, 20, 25)])
    draw.rectangle((left, top, left + w, top + h), fill=ground)
    line = top + 0.08 * h
    while line < top + 0.9 * h:
        size = float(rng.choice([rng.uniform(0.08, 0.15), rng.uniform(0.2, 0.5)])) * h
        _write(rng, draw, (left + 0.06 * w, line, left + 0.94 * w), max(4.0, size), ink)
        line += max(4.0, size) * 1.3


def _title(rng: np.random.Generator, image: Image.Image, palette: Sequence[Colour]) -> None:
    """One line of big letters."""
    size = rng.uniform(0.1, 0.4) * image.height
    left, top = rng.uniform(0, 0.4) * image.width, rng.uniform(0, 0.8) * image.height
    ink = palette[int(rng.integers(len(palette)))]
    _write(rng, ImageDraw.Draw(image), (left, top, image.width), size, ink)


def _logo(rng: np.random.Generator, image: Image.Image, palette: Sequence[Colour]) -> None:
    """Nested discs, stars or polygons around one point."""
    draw = ImageDraw.Draw(image)
    x, y = rng.uniform(0.1, 0.9) * image.width, rng.uniform(0.1, 0.9) * image.height
    radius = rng.uniform(0.08, 0.35) * min(image.size)
    corners = int(rng.choice([3, 4, 5, 6, 8, 40]))
    spike, turn = rng.uniform(0.4, 1.0), rng.uniform(0, 2 * np.pi)
    for ring in range(int(rng.integers(1, 4))):
        r = radius * (1 - 0.3 * ring)
        angles = turn + np.arange(2 * corners) * np.pi / corners
        radii = np.where(np.arange(2 * corners) % 2, r * spike, r)
        points = np.stack([x + radii * np.cos(angles), y + radii * np.sin(angles)], -1)
        fill = palette[int(rng.integers(len(palette)))]
        draw.polygon([(float(px), float(py)) for px, py in points], fill=fill)


def _band(rng: np.random.Generator, image: Image.Image, palette: Sequence[Colour]) -> None:
    """A straight band across the picture."""
    draw = ImageDraw.Draw(image)
    ends = rng.uniform(-0.2, 1.2, 2)
    thickness = int(rng.uniform(0.02, 0.2) * image.height)
    fill = palette[int(rng.integers(len(palette)))]
    if rng.random() < 0.5:
        path = [(0.0, ends[0] * image.height), (float(image.width), ends[1] * image.height)]
    else:
        path = [(ends[0] * image.width, 0.0), (ends[1] * image.width, float(image.height))]
    draw.line(path, fill=fill, width=max(1, thickness))


def _bars(rng: np.random.Generator, image: Image.Image, palette: Sequence[Colour]) -> None:
    """A bar code: dark lines of random width on white."""
    draw = ImageDraw.Draw(image)
    w, h = rng.uniform(0.15, 0.3) * image.width, rng.uniform(0.1, 0.25) * image.height
    if w < 12:
        return
    left, top = rng.uniform(0, image.width - w), rng.uniform(0, image.height - h)
    draw.rectangle((left, top, left + w, top + h), fill=(250, 250, 250))
    x = left + 0.05 * w
    while x < left + 0.93 * w:
        bar = int(max(1, rng.uniform(0.01, 0.05) * w))
        draw.line((x, top + 0.08 * h, x, top + 0.85 * h), fill=(15, 15, 15), width=bar)
        x += bar + max(1.0, rng.uniform(0.01, 0.05) * w)


def _write(
    rng: np.random.Generator,
    draw: ImageDraw.ImageDraw,
    span: tuple[float, float, float],
    size: float,
    ink: Colour,
) -> None:
    """A line of random letters or invented signs of height `size` from (left, top) to right."""
    left, top, right = span
    count = int((right - left) / (0.6 * size)) + 1
    if rng.random() < 0.15:
        count = int(rng.integers(1, count + 1))  # lines end early
    if rng.random() < 0.6:
        letters = rng.integers(len(LETTERS), size=count)
        text = "".join(LETTERS[int(index)] for index in letters)
        text = text.upper() if rng.random() < 0.4 else text
        # The font's letters fill about three quarters of its size.
        draw.text((left, top - 0.2 * size), text, fill=ink, font=_font(max(5, int(1.3 * size))))
        return
    thickness = max(1, round(size * rng.uniform(0.08, 0.2)))
    for x in left + 0.62 * size * np.arange(count):
        if rng.random() > 0.15 and x + 0.5 * size < right:  # else a space between words
            nodes = rng.integers(0, 3, (int(rng.integers(3, 6)), 2)) * (0.23 * size, 0.45 * size)
            points = [(float(x + dx), float(top + dy)) for dx, dy in nodes]
            draw.line(points, fill=ink, width=thickness, joint="curve")


@cache
def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)  # comes with Pillow


def _two(rng: np.random.Generator, palette: Sequence[Colour]) -> tuple[Colour, Colour]:
    first, second = rng.choice(len(palette), 2, replace=False)
    return palette[int(first)], palette[int(second)]


def _mix(share: NDArray[np.float32], a: Colour, b: Colour) -> RGBImage:
    low, high = np.array(a, np.float32), np.array(b, np.float32)
    return (low + share[..., None] * (high - low)).clip(0, 255).astype(np.uint8)


def _rgb(hue: float, saturation: float, value: float) -> Colour:
    r, g, b = colorsys.hsv_to_rgb(hue % 1.0, saturation, value)
    return round(255 * r), round(255 * g), round(255 * b)


BasePattern = Callable[[np.random.Generator, int, int, Sequence[Colour]], RGBImage]
Decoration = Callable[[np.random.Generator, Image.Image, Sequence[Colour]], None]
GROUNDS: tuple[BasePattern, ...] = (
    _solid, _gradient, _marble, _wood, _stripes, _checks, _cells, _dots,
)  # fmt: skip
DECORATIONS: tuple[Decoration, ...] = (
    _label, _label, _title, _logo, _logo, _band, _bars,
)  # fmt: skip
