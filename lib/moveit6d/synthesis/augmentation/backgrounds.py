"""Pictures by code that serve where photographs are not at hand: rooms, walls, tables, clutter.

Never reads files and never renders meshes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from ..objects.textures import Colour, Picture, paint, random_palette, smooth_noise


def procedural_photo(rng: np.random.Generator, size: tuple[int, int] = (480, 640)) -> Picture:
    """A scene (height, width, 3) uint8: wall and floor, things in it, light, blur and grain."""
    height, width = size
    palette = [*random_palette(rng), *random_palette(rng, 3)]
    image = _room(rng, height, width, palette)
    for _ in range(int(rng.integers(4, 26))):
        _thing(rng, image, palette)
    if rng.random() < 0.35:
        _leaves(rng, image, palette)
    picture = np.asarray(image, np.float32) * _light(rng, height, width)[..., None]
    grey = picture.mean(-1, keepdims=True)  # real rooms are less colourful than paint
    picture = grey + rng.uniform(0.3, 0.9) * (picture - grey)
    picture *= 1 + rng.uniform(-0.12, 0.12, 3).astype(np.float32)  # white balance
    blurred = Image.fromarray(picture.clip(0, 255).astype(np.uint8))
    blurred = blurred.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 1.6) * width / 640))
    grain = rng.standard_normal((height, width, 1), np.float32) * rng.uniform(0.5, 3)
    return (np.asarray(blurred, np.float32) + grain).clip(0, 255).astype(np.uint8)


def _room(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> Image.Image:
    """A wall above and a floor or table below, the floor in perspective; or one surface alone."""
    edge = int(rng.uniform(0.25, 0.75) * height)
    if rng.random() < 0.4:
        edge = int(rng.choice([0, height]))
    image = Image.new("RGB", (width, height))
    if edge > 0:
        image.paste(Image.fromarray(_surface(rng, edge, width, palette)), (0, 0))
    if edge < height:
        floor = Image.fromarray(_surface(rng, height, width, palette))
        taper = rng.uniform(0.0, 0.35) * width
        corners = (0, 0, -taper * 0.2, height, width + taper * 0.2, height, width, 0)
        if taper > 1:  # seen obliquely: the far edge shows more of the floor
            squeeze = (taper / width * 2) / height
            data = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, squeeze)
            floor = floor.transform(
                (width, height), Image.Transform.PERSPECTIVE, data, Image.Resampling.BILINEAR
            )
        else:
            floor = floor.transform((width, height), Image.Transform.QUAD, corners)
        image.paste(floor.resize((width, height - edge), Image.Resampling.BILINEAR), (0, edge))
    return image


def _surface(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> Picture:
    kind = rng.random()
    if kind < 0.3:
        return _bricks(rng, height, width, palette)
    if kind < 0.6:  # plaster, carpet, sky
        colour = np.array(palette[int(rng.integers(len(palette)))], np.float32)
        coarse = smooth_noise(rng, height, width, int(rng.integers(2, 12)), 6)
        rough = rng.uniform(2, 25) * coarse[..., None]
        return (0.5 * colour + 60 + rough).clip(0, 255).astype(np.uint8)
    half = paint(rng, -(-height // 2), -(-width // 2), palette)
    return np.asarray(half.repeat(2, 0).repeat(2, 1)[:height, :width])


def _bricks(
    rng: np.random.Generator, height: int, width: int, palette: Sequence[Colour]
) -> Picture:
    """Bricks, tiles, planks or books on a shelf: rows of blocks with joints between them."""
    tall = int(rng.uniform(0.04, 0.25) * max(height, width)) + 4
    wide = int(tall * np.exp(rng.uniform(-0.7, 1.8))) + 4
    shift = int(rng.choice([0, wide // 2]))
    joint = int(rng.integers(1, max(2, tall // 8) + 1))
    y, x = np.mgrid[0:height, 0:width]
    row = y // tall
    x = x + shift * (row % 2)
    column = x // wide
    blocks = (int(row.max()) + 1, int(column.max()) + 1)
    chosen = np.array(palette, np.float32)[rng.integers(len(palette), size=blocks)]
    if rng.random() < 0.7:  # all of one kind
        chosen[:] = palette[int(rng.integers(len(palette)))]
    chosen += rng.normal(0, rng.uniform(2, 20), (*blocks, 1))
    picture = chosen[row, column]
    picture += 6 * smooth_noise(rng, height, width, 8, 4)[..., None]
    picture[(y % tall < joint) | (x % wide < joint)] *= rng.uniform(0.4, 1.5)
    return np.asarray(picture.clip(0, 255), np.uint8)


def _thing(rng: np.random.Generator, image: Image.Image, palette: Sequence[Colour]) -> None:
    """A textured polygon, disc or box with shading across it and a soft shadow beside it."""
    width, height = image.size
    w = int(np.exp(rng.uniform(np.log(0.04), np.log(0.45))) * width) + 6
    h = int(w * np.exp(rng.uniform(-0.8, 0.8))) + 6
    x, y = int(rng.uniform(-0.3 * w, width - 0.7 * w)), int(rng.uniform(-0.2 * h, height - 0.6 * h))
    coarse = (min(w, 160), min(h, 160))
    skin = Image.fromarray(paint(rng, coarse[1], coarse[0], palette, plain=rng.random() < 0.4))
    shade = _gradient(rng, h, w)
    lit = np.asarray(skin.resize((w, h), Image.Resampling.BILINEAR)) * shade[..., None]
    shape = _silhouette(rng, w, h)
    dark = Image.new("RGB", (w, h), (12, 12, 14))
    shadow = shape.filter(ImageFilter.GaussianBlur(0.04 * w + 1)).point(lambda v: v * 0.55)
    offset = (x + int(rng.uniform(-0.1, 0.1) * w), y + int(rng.uniform(0, 0.1) * h))
    image.paste(dark, offset, shadow)
    image.paste(Image.fromarray(lit.clip(0, 255).astype(np.uint8)), (x, y), shape)


def _silhouette(rng: np.random.Generator, width: int, height: int) -> Image.Image:
    mask = Image.new("L", (width, height))
    draw = ImageDraw.Draw(mask)
    kind = int(rng.integers(4))
    if kind == 0:
        draw.ellipse((0, 0, width - 1, height - 1), fill=255)
    elif kind == 1:
        draw.rounded_rectangle(
            (0, 0, width - 1, height - 1), radius=rng.uniform(0, 0.4) * min(width, height), fill=255
        )
    else:  # a polygon: four corners of a box face, or many of anything
        count = 4 if kind == 2 else int(rng.integers(3, 14))
        angle = np.sort(rng.uniform(0, 2 * np.pi, count))
        radius = rng.uniform(0.45, 1.0, count)
        xs = width * (0.5 + 0.5 * radius * np.cos(angle))
        ys = height * (0.5 + 0.5 * radius * np.sin(angle))
        draw.polygon([(float(a), float(b)) for a, b in zip(xs, ys, strict=True)], fill=255)
    return mask


def _leaves(rng: np.random.Generator, image: Image.Image, palette: Sequence[Colour]) -> None:
    """Foliage, wires, fringes: many strokes that grow from one place."""
    draw = ImageDraw.Draw(image)
    width, height = image.size
    x, y = rng.uniform(0, width), rng.uniform(0.3, 1.0) * height
    colour = np.array(palette[int(rng.integers(len(palette)))], np.float64)
    reach = rng.uniform(0.1, 0.4) * width
    for _ in range(int(rng.integers(15, 120))):
        angle, length = rng.normal(-np.pi / 2, 0.8), reach * rng.uniform(0.3, 1.0)
        bend = angle + rng.normal() * 0.5
        middle = (x + 0.5 * length * np.cos(angle), y + 0.5 * length * np.sin(angle))
        end = (middle[0] + 0.5 * length * np.cos(bend), middle[1] + 0.5 * length * np.sin(bend))
        r, g, b = (colour * rng.uniform(0.5, 1.3)).clip(0, 255).astype(int).tolist()
        path = [
            (float(x), float(y)),
            (float(middle[0]), float(middle[1])),
            (float(end[0]), float(end[1])),
        ]
        draw.line(path, fill=(r, g, b), width=int(rng.integers(1, 6)), joint="curve")


def _light(rng: np.random.Generator, height: int, width: int) -> NDArray[np.float32]:
    """How bright each place is: lamps, window light, dark corners; about 1 on average."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32) / max(height, width)
    total = np.full((height, width), 0.5, np.float32)
    for _ in range(int(rng.integers(1, 4))):
        light, reach = rng.uniform(-0.3, 1.3, 2), rng.uniform(0.2, 1.2)
        total += np.exp(-((x - light[0]) ** 2 + (y - light[1]) ** 2) / reach**2)
    return np.asarray(total / total.mean() * rng.uniform(0.75, 1.2), np.float32)


def _gradient(rng: np.random.Generator, height: int, width: int) -> NDArray[np.float32]:
    """Shading across a thing, as of something round or tilted."""
    x = np.linspace(-1, 1, width, dtype=np.float32)[None]
    y = np.linspace(-1, 1, height, dtype=np.float32)[:, None]
    a, b = rng.uniform(-0.35, 0.35, 2)
    round_off = rng.choice([0.0, rng.uniform(0, 0.5)])
    return np.asarray(1 + a * x + b * y - round_off * (x * x), np.float32)
