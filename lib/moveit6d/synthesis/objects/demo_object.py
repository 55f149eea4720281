"""The demonstration's object: a toy robot, made and painted by code, that no training has seen.

Never random: it is the same object every time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...geometry.mesh import Mesh
from . import primitives as make
from .primitives import Part
from .shapes import in_tile
from .textures import Colour, smooth_noise

SIDE = 256  # pixels of one of the texture's four tiles
BODY, HEAD, LIMBS, FEET = range(4)
CREAM, TEAL, RED, INK, YELLOW = (
    (238, 228, 205), (38, 125, 132), (205, 66, 48), (34, 38, 46), (240, 186, 52),
)  # fmt: skip


def demo_object() -> Mesh:
    """A toy robot of about 19 cm, standing on z = 0 and looking along -y; nothing is symmetric."""
    parts = [
        replace(make.box((0.092, 0.062, 0.090)), skin=BODY).moved((0, 0, 0.075)),
        replace(make.box((0.066, 0.056, 0.046)), skin=HEAD).moved((0.004, -0.002, 0.145)),
        make.cylinder(0.018, 0.016).moved((0.004, 0, 0.118), LIMBS),  # neck
        _rod([(0.024, 0.0, 0.165), (0.028, 0.004, 0.185), (0.038, 0.006, 0.197)], 0.003, LIMBS),
        make.superquadric((0.008, 0.008, 0.008), detail=12).moved((0.039, 0.006, 0.199), FEET),
        # One arm hangs, the other one waves.
        _rod([(-0.044, 0, 0.105), (-0.066, -0.006, 0.092), (-0.070, -0.014, 0.060)], 0.0085, LIMBS),
        make.superquadric((0.012, 0.012, 0.013), detail=14).moved((-0.070, -0.016, 0.054), FEET),
        _rod([(0.044, 0, 0.105), (0.070, -0.004, 0.112), (0.078, -0.012, 0.140)], 0.0085, LIMBS),
        make.superquadric((0.012, 0.012, 0.013), detail=14).moved((0.079, -0.014, 0.147), FEET),
        *(_foot(x) for x in (-0.026, 0.026)),
        make.cylinder(0.016, 0.062).moved((-0.020, 0.040, 0.080), LIMBS),  # tank on its back
        replace(make.box((0.030, 0.022, 0.040)), skin=HEAD).moved((0.020, 0.040, 0.085)),
    ]
    placed = [in_tile(part, part.skin, 2, SIDE, 2 * SIDE) for part in parts]
    whole = make.join(placed)
    return Mesh.from_arrays(
        "toy_robot", whole.vertices, whole.faces, uv=whole.uv, texture=_texture()
    )


def _rod(points: list[tuple[float, float, float]], radius: float, skin: int) -> Part:
    knots = np.array(points)
    at = np.linspace(0, len(points) - 1, 9)
    path = np.stack([np.interp(at, range(len(points)), knots[:, k]) for k in range(3)], -1)
    path[1:-1] = (path[:-2] + 2 * path[1:-1] + path[2:]) / 4
    return replace(make.tube(path, radius, 14), skin=skin)


def _foot(x: float) -> Part:
    foot = make.superquadric((0.019, 0.030, 0.017), (0.5, 0.5), 18)
    leg = make.cylinder(0.010, 0.040).moved((0, 0.006, 0.025))
    return replace(make.join([foot, leg]), skin=FEET).moved((x, -0.006, 0.017))


def _texture() -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    sheet = Image.new("RGB", (2 * SIDE, 2 * SIDE))
    sheet.paste(_box_print(CREAM, [_side(TEAL), _side(RED), _back(), _front(), None, None]), (0, 0))
    sheet.paste(_box_print(TEAL, [_ear(), _ear(), None, _face(), _top(), None]), (SIDE, 0))
    sheet.paste(_rings(INK, YELLOW), (0, SIDE))
    sheet.paste(_rings(RED, CREAM), (SIDE, SIDE))
    rng = np.random.default_rng(6)
    wear = 5 * smooth_noise(rng, 2 * SIDE, 2 * SIDE, 6, 6)
    return (np.asarray(sheet) + wear[..., None]).clip(0, 255).astype(np.uint8)


def _box_print(ground: Colour, sides: list[Image.Image | None]) -> Image.Image:
    """A tile for a box: upright pictures of the sides +x, -x, +y, -y, +z, -z on a ground."""
    tile = Image.new("RGB", (SIDE, SIDE), ground)
    for number, picture in enumerate(sides):
        if picture is None:
            continue
        # The charts of the sides +y and -y lie on their side, see `primitives.box`.
        turn = {2: -90, 3: 90}.get(number, 0)
        x0, x1 = round(number % 3 * SIDE / 3), round((number % 3 + 1) * SIDE / 3)
        y0 = (1 - number // 3) * SIDE // 2
        turned = picture.rotate(turn, expand=True)
        tile.paste(turned.resize((x1 - x0, SIDE // 2), Image.Resampling.BILINEAR), (x0, y0))
    return tile


def _canvas(ground: Colour) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    image = Image.new("RGB", (200, 200), ground)
    return image, ImageDraw.Draw(image)


def _text(
    draw: ImageDraw.ImageDraw, place: tuple[int, int], text: str, size: int, ink: Colour
) -> None:
    draw.text(place, text, fill=ink, font=ImageFont.load_default(size))


def _front() -> Image.Image:
    image, draw = _canvas(CREAM)
    draw.rectangle((12, 14, 188, 74), fill=TEAL)
    _text(draw, (26, 20), "MOVE-IT", 40, CREAM)
    draw.ellipse((16, 88, 86, 158), fill=INK)
    draw.ellipse((22, 94, 80, 152), fill=(250, 250, 245))
    draw.line((51, 123, 72, 104), fill=RED, width=5)
    for row, color in enumerate((RED, YELLOW, TEAL)):
        draw.rectangle((104, 92 + 24 * row, 180, 108 + 24 * row), fill=color)
    _text(draw, (16, 164), "No. 6  13 steps", 22, INK)
    return image


def _back() -> Image.Image:
    image, draw = _canvas(CREAM)
    for row in range(6):
        draw.rectangle((20, 24 + 28 * row, 180, 34 + 28 * row), fill=INK)
    draw.polygon([(20, 190), (70, 110), (120, 190)], fill=YELLOW)
    return image


def _side(color: Colour) -> Image.Image:
    image, draw = _canvas(CREAM)
    for stripe in range(-200, 200, 50):
        draw.line((stripe, 200, stripe + 200, 0), fill=color, width=16)
    draw.ellipse((66, 66, 134, 134), fill=YELLOW if color == RED else INK)
    return image


def _face() -> Image.Image:
    image, draw = _canvas(TEAL)
    for x, size in ((58, 34), (140, 26)):
        draw.ellipse((x - size, 78 - size, x + size, 78 + size), fill=CREAM)
        draw.ellipse((x - 10, 74 - 10, x + 14, 74 + 14), fill=INK)
    draw.rectangle((50, 136, 156, 170), fill=INK)
    for x in range(60, 150, 18):
        draw.rectangle((x, 142, x + 10, 164), fill=YELLOW)
    return image


def _ear() -> Image.Image:
    image, draw = _canvas(TEAL)
    draw.ellipse((50, 50, 150, 150), fill=YELLOW)
    draw.ellipse((75, 75, 125, 125), fill=INK)
    return image


def _top() -> Image.Image:
    image, draw = _canvas(RED)
    for x in range(0, 200, 50):
        for y in range(x // 50 % 2 * 50, 200, 100):
            draw.rectangle((x, y, x + 49, y + 49), fill=CREAM)
    return image


def _rings(ground: Colour, band: Colour) -> Image.Image:
    image = Image.new("RGB", (SIDE, SIDE), ground)
    draw = ImageDraw.Draw(image)
    for y in range(30, SIDE, 72):
        draw.rectangle((0, y, SIDE, y + 22), fill=band)
    draw.rectangle((0, 0, 24, SIDE), fill=YELLOW if band != YELLOW else RED)
    return image
