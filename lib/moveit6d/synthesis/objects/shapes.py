"""Random objects by code: cartons, vessels, toys, tools, figures, blobs, with painted textures.

Never reads files; fast enough to make a new object for training whenever one is wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...geometry.mesh import Mesh
from ...geometry.symmetry import Symmetries
from ...typing import Float64, RGBImage
from . import primitives as make
from .part_symmetries import placed, plain_symmetries
from .primitives import Part
from .textures import Colour, paint, random_palette

TEXTURE = 256  # pixels a side
SIZES = (0.07, 0.35)  # metres, the objects' largest extent


def random_object(
    rng: np.random.Generator, photos: Sequence[NDArray[np.uint8]] | None = None
) -> Mesh:
    """A new textured object, 7 to 35 cm, in a frame of its own that is not centred.

    With `photos` (H, W, 3) uint8 some of its textures are parts of photographs. The same generator
    state gives the same object.

    Examples:
        >>> import numpy as np
        >>> mesh = random_object(np.random.default_rng(0))
        >>> 0.05 < mesh.diameter < 0.5
        True
    """
    family = FAMILIES[int(rng.integers(len(FAMILIES)))]
    parts = family(rng)
    size = float(np.exp(rng.uniform(*np.log(SIZES))))
    turn = make.rotation(rng)
    texture, parts, plain = _skinned(rng, parts, photos)
    # Dirt of a few grey levels is no texture: a plain can is a body of revolution.
    symmetries = plain_symmetries(parts) if plain else Symmetries()
    offset = 0.3 * size * rng.uniform(-1, 1, 3)
    return assembled(family.__name__.strip("_"), parts, texture, size, turn, offset, symmetries)


def assembled(
    name: str,
    parts: list[Part],
    texture: RGBImage,
    size: float,
    turn: Float64,
    offset: Float64,
    symmetries: Symmetries,
) -> Mesh:
    """Parts about the origin as one object of a largest extent `size`, turned, then shifted."""
    whole = make.join(parts)
    points = whole.vertices @ turn.T
    points = points * (size / float(np.ptp(points, axis=0).max())) + offset
    return Mesh.from_arrays(
        name,
        points,
        whole.faces,
        uv=whole.uv,
        texture=texture,
        symmetries=placed(symmetries, turn, offset),
    )


def _skinned(
    rng: np.random.Generator, parts: list[Part], photos: Sequence[RGBImage] | None
) -> tuple[RGBImage, list[Part], bool]:
    """A texture with a tile for each skin, parts with coordinates in it, and if all is plain."""
    palette = random_palette(rng)
    skins = sorted({part.skin for part in parts})
    columns = int(np.ceil(np.sqrt(len(skins))))
    side = TEXTURE // columns
    texture = np.zeros((TEXTURE, TEXTURE, 3), np.uint8)
    plain = rng.random() < 0.12
    for number, skin in enumerate(skins):
        charts = max(part.charts for part in parts if part.skin == skin)
        unprinted = plain or (len(skins) > 1 and rng.random() < 0.2)
        tile = _tile(rng, side, charts, palette, photos, unprinted)
        row, column = divmod(number, columns)
        texture[row * side : (row + 1) * side, column * side : (column + 1) * side] = tile
    tiles = [(skins.index(part.skin), columns, side, TEXTURE) for part in parts]
    return texture, [in_tile(part, *tile) for part, tile in zip(parts, tiles, strict=True)], plain


def in_tile(part: Part, number: int, columns: int, side: int, texture: int) -> Part:
    """The part with its coordinates in tile `number` of a square texture; lengths in pixels."""
    row, column = divmod(number, columns)
    inner = (1.5 + (side - 3) * part.uv) / texture  # 1.5 pixels away from the neighbours
    left, bottom = column * side / texture, 1 - (row + 1) * side / texture
    return replace(part, uv=inner + (left, bottom))


def _tile(
    rng: np.random.Generator,
    side: int,
    charts: tuple[int, int],
    palette: Sequence[Colour],
    photos: Sequence[RGBImage] | None,
    plain: bool,
) -> RGBImage:
    columns, rows = charts
    if charts == (1, 1) or plain or rng.random() < 0.3:
        return paint(rng, side, side, palette, photos, plain)
    tile = np.zeros((side, side, 3), np.uint8)
    xs = np.linspace(0, side, columns + 1).astype(int)
    ys = np.linspace(0, side, rows + 1).astype(int)
    for x0, x1 in pairwise(xs):
        for y0, y1 in pairwise(ys):
            tile[y0:y1, x0:x1] = paint(rng, int(y1 - y0), int(x1 - x0), palette, photos)
    return tile


# -- families: each draws its parts ----------------------------------------------------------------


def _carton(rng: np.random.Generator) -> list[Part]:
    """A box as on a shelf, sometimes with a second one on it."""
    sizes = np.exp(rng.uniform(-1.2, 0.3, 3))
    if rng.random() < 0.4:
        rounding = rng.uniform(0.1, 0.35)
        body = make.superquadric(sizes / 2, (rounding, rounding), 28)
    else:
        body = make.box(sizes)
    body = _deformed(rng, body, 0.3)
    if rng.random() < 0.3:
        lid = make.box(sizes * rng.uniform(0.3, 0.9, 3))
        shift = (rng.uniform(-0.5, 0.5, 3) + (0, 0, 1)) * sizes / 2
        return [body, lid.moved(shift, 1)]
    return [body]


def _vessel(rng: np.random.Generator) -> list[Part]:
    """A bottle, can, cup, jar or vase; perhaps with a handle or a lid of another colour."""
    height = rng.uniform(0.6, 3.0)
    count = int(rng.integers(2, 7))
    knots = np.exp(rng.uniform(-0.7, 0.2, count)) if rng.random() < 0.7 else np.ones(count)
    at = np.linspace(0, 1, 22)
    radii = np.interp(at, np.linspace(0, 1, count), knots)
    if rng.random() < 0.7:  # round off
        kernel = np.array([0.25, 0.5, 0.25])
        for _ in range(int(rng.integers(1, 5))):
            radii[1:-1] = np.convolve(radii, kernel, "valid")
    z = height * (0.5 - at)
    if rng.random() < 0.4:  # open: the wall turns back inside
        inner = radii[::-1] - 0.06
        radii = np.concatenate([inner[1:].clip(0.05), radii, [0.0]])
        z = np.concatenate([z[::-1][1:], z, [z[-1]]])
        radii[0], z[0] = 0.0, z[20] + 0.06
    else:
        radii, z = np.concatenate([[0.0], radii, [0.0]]), np.concatenate([z[:1], z, z[-1:]])
    parts = [_deformed(rng, make.lathe(radii, z), 0.15)]
    if rng.random() < 0.45:
        reach, width = rng.uniform(0.4, 0.9), rng.uniform(0.25, 0.45) * height
        t = np.linspace(-np.pi / 2, np.pi / 2, 14)
        radius = float(np.interp(0.5, at, np.interp(at, np.linspace(0, 1, count), knots)))
        path = np.stack([radius * 0.9 + reach * np.cos(t), 0 * t, width * np.sin(t)], -1)
        parts.append(replace(make.tube(path, rng.uniform(0.06, 0.15)), skin=int(rng.integers(2))))
    if rng.random() < 0.4:
        cap = make.cylinder(rng.uniform(0.2, 0.9) * float(knots[0]), rng.uniform(0.15, 0.5))
        parts.append(cap.moved((0, 0, height / 2), 2))
    return parts


def _blob(rng: np.random.Generator) -> list[Part]:
    """One bumpy, bent, twisted superquadric."""
    body = make.superquadric(np.exp(rng.uniform(-0.9, 0.2, 3)), rng.uniform(0.2, 1.6, 2), 34)
    return [replace(body, vertices=_warped(rng, body.vertices, 1.0))]


def _creature(rng: np.random.Generator) -> list[Part]:
    """A figure: body, head, and limbs, ears or wings in mirrored pairs."""
    sizes = np.exp(rng.uniform(-0.6, 0.1, 3))
    body = make.superquadric(sizes, rng.uniform(0.6, 1.2, 2), 22)
    parts = [_deformed(rng, body, 0.25)]
    head_place = np.array([0, rng.uniform(-0.4, 0.9) * sizes[1], rng.uniform(0.8, 1.3) * sizes[2]])
    head = rng.uniform(0.35, 0.75) * np.exp(rng.uniform(-0.2, 0.2, 3))
    parts.append(make.superquadric(head, rng.uniform(0.6, 1.2, 2), 18).moved(head_place, 1))
    for pair in range(int(rng.integers(1, 4))):
        length, thick = rng.uniform(0.3, 0.9), rng.uniform(0.08, 0.25)
        limb = make.superquadric((thick, thick * rng.uniform(0.5, 1.6), length), (0.8, 1.0), 13)
        limb = limb.turned(
            make.about(0, rng.uniform(-2, 2)) @ make.about(1, rng.uniform(-1.2, 1.2))
        )
        place = np.array([0.8, rng.uniform(-0.8, 0.8), rng.uniform(-1, 1)]) * sizes
        if pair == 2:  # ears
            place = head_place + (0.5 * head[0], 0, 0.8 * head[2])
            limb = limb.scaled(0.5)
        limb = limb.moved(place, 2 + pair)
        parts += [limb, limb.scaled((-1, 1, 1))]
    if rng.random() < 0.7:  # eyes
        eye = make.superquadric(0.16 * head, detail=10)
        eye = eye.moved(head_place + head * (0.45, 0.8, 0.25), 6)
        parts += [eye, eye.scaled((-1, 1, 1))]
    return parts


def _tool(rng: np.random.Generator) -> list[Part]:
    """A handle along z with a head across it: hammer, brush, torch, paddle, drill."""
    length, thick = rng.uniform(1.2, 2.4), rng.uniform(0.1, 0.28)
    at = np.linspace(0, 1, 14)
    radii = thick * (1 + 0.25 * np.sin(2 * np.pi * (rng.uniform(0.5, 2) * at + rng.random())))
    radii[[0, -1]] = 0
    handle = make.lathe(radii, length * (0.5 - at), 18)
    handle = handle.scaled((1, rng.uniform(0.5, 1.0), 1))
    parts = [_deformed(rng, handle, 0.15)]
    for skin in range(1, int(rng.integers(2, 4))):
        sizes = np.exp(rng.uniform(-1.1, 0.1, 3)) * 0.9
        head = _block(rng, sizes)
        shift = (rng.uniform(-0.3, 0.3), 0, length * rng.choice([0.5, 0.45, -0.45]))
        parts.append(head.turned(make.about(1, rng.choice([0, np.pi / 2]))).moved(shift, skin))
    return parts


def _badge(rng: np.random.Generator) -> list[Part]:
    """An extruded star, gear, polygon or cookie, with something on top at times."""
    count = int(rng.integers(3, 12))
    steps = 6 * count
    angle = np.arange(steps) * 2 * np.pi / steps
    kind = int(rng.integers(3))
    if kind == 0:
        radius = 1 + rng.uniform(0.1, 0.45) * np.cos(count * angle)
    elif kind == 1:
        radius = np.where(np.arange(steps) % 6 < 3, 1.0, rng.uniform(0.65, 0.9))
    else:
        knots = rng.uniform(0.5, 1.0, count)
        radius = np.interp(angle, np.arange(count + 1) * 2 * np.pi / count, [*knots, knots[0]])
    outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    outline *= np.exp(rng.uniform(-0.4, 0.0, 2))
    height = rng.uniform(0.12, 1.0)
    parts = [make.prism(outline, height)]
    if rng.random() < 0.5:
        sizes = np.exp(rng.uniform(-1.5, -0.5, 3))
        parts.append(_block(rng, sizes).moved((*rng.uniform(-0.4, 0.4, 2), height / 2), 1))
    return parts


def _vehicle(rng: np.random.Generator) -> list[Part]:
    """Body, cabin and wheels, as of a toy car, van, train or tractor."""
    length, width, height = rng.uniform(1.2, 2.4), rng.uniform(0.6, 1.0), rng.uniform(0.3, 0.7)
    parts = [_block(rng, np.array([length, width, height]))]
    cabin = np.array([rng.uniform(0.3, 0.7) * length, 0.92 * width, rng.uniform(0.3, 0.8)])
    shift = rng.uniform(-0.4, 0.4) * (length - cabin[0])
    upper = _block(rng, cabin)
    upper = replace(upper, vertices=make.taper(upper.vertices, rng.uniform(0, 0.5)))
    parts.append(upper.moved((shift, 0, height / 2 + 0.4 * cabin[2]), 1))
    radius, thick = rng.uniform(0.18, 0.38), rng.uniform(0.1, 0.25)
    wheel = make.cylinder(radius, thick, 20).turned(make.about(0, np.pi / 2))
    for x in np.linspace(-0.35, 0.35, int(rng.integers(2, 4))) * length:
        for y in (-0.5, 0.5):
            parts.append(wheel.moved((x, y * width, -height / 2), 2))
    if rng.random() < 0.5:  # a funnel, a lamp, a mast
        mast = make.cylinder(rng.uniform(0.05, 0.2), rng.uniform(0.3, 0.9), 14)
        parts.append(mast.moved((-np.sign(shift) * 0.3 * length, 0, height * 0.8), 3))
    return parts


def _construct(rng: np.random.Generator) -> list[Part]:
    """Blocks, cylinders and balls stuck together, each touching an earlier one."""
    places = [np.zeros(3)]
    parts: list[Part] = []
    for number in range(int(rng.integers(2, 7))):
        sizes = np.exp(rng.uniform(-1.0, 0.1, 3))
        near = places[int(rng.integers(len(places)))]
        place = near + rng.uniform(-0.6, 0.6, 3) * (number > 0)
        block = _block(rng, sizes)
        if rng.random() < 0.3:
            block = block.turned(make.rotation(rng))
        parts.append(block.moved(place, number))
        places.append(place)
    return parts


def _stick(rng: np.random.Generator) -> list[Part]:
    """Something long and slender, perhaps wider at an end: a pen, spoon, wrench, file, spatula."""
    flat = rng.uniform(0.3, 1.0)
    thick = rng.uniform(0.03, 0.09)
    at = np.linspace(0, 1, 18)
    radii = thick * np.interp(at, np.linspace(0, 1, 4), np.exp(rng.uniform(-0.5, 0.2, 4)))
    radii[[0, -1]] = 0
    shaft = make.lathe(radii, 2 * (0.5 - at), 24).scaled((1, flat, 1))
    parts = [_deformed(rng, shaft, 0.15)]
    for skin, end in enumerate((1, -1)[: int(rng.integers(0, 3))], 1):
        sizes = thick * np.array([rng.uniform(1.2, 3.5), rng.uniform(0.6, 1.3), rng.uniform(2, 7)])
        parts.append(_block(rng, 2 * sizes).moved((0, 0, end * rng.uniform(0.8, 1.0)), skin))
    if rng.random() < 0.3:  # a sleeve of another colour
        sleeve = make.cylinder(1.1 * thick, rng.uniform(0.2, 0.8)).scaled((1, max(flat, 0.6), 1))
        parts.append(sleeve.moved((0, 0, rng.uniform(-0.5, 0.5)), 3))
    return parts


def _pincers(rng: np.random.Generator) -> list[Part]:
    """Two slender arms that cross at a pin, with rings or handles: scissors, pliers, tongs."""
    opened, pin = rng.uniform(0.0, 0.5), rng.uniform(-0.2, 0.4)
    width, thick = rng.uniform(0.08, 0.22), rng.uniform(0.03, 0.1)
    ring, handle = rng.uniform(0.16, 0.3), rng.uniform(0.03, 0.07)
    ringed = rng.random() < 0.6
    around = np.linspace(0, 2 * np.pi, 18)
    one_skin = int(rng.integers(2))  # blades and handles of one colour, or of two
    arms: list[Part] = []
    for side in (-1, 1):
        blade = make.box((thick, width, 1.0))
        blade = replace(blade, vertices=make.taper(blade.vertices, rng.uniform(0.3, 1.4)))
        arm = [blade.moved((0, 0, 0.5), 0), make.box((thick, 0.7 * width, 0.5)).moved((0, 0, -0.2))]
        if ringed:
            path = np.stack([0 * around, ring * np.cos(around), 1.4 * ring * np.sin(around)], -1)
            grip = make.tube(path, handle, 8).moved((0, side * 0.6 * ring, -0.4 - ring), one_skin)
        else:
            long = rng.uniform(0.5, 1.0)
            at = np.linspace(0, 1, 10)
            path = np.stack([0 * at, side * 0.25 * np.sin(2.5 * at) * long, -0.3 - long * at], -1)
            grip = replace(make.tube(path, 1.4 * handle, 8), skin=one_skin)
        turn = make.about(0, side * opened / 2)
        shift = (0.5 * side * thick, 0, pin)
        arms += [part.turned(turn).moved(shift, part.skin) for part in (*arm, grip)]
    if rng.random() < 0.5:
        head = make.cylinder(0.35 * width, 4 * thick).turned(make.about(1, np.pi / 2))
        arms.append(head.moved((0, 0, pin), 2))
    return arms


def _block(rng: np.random.Generator, sizes: Float64) -> Part:
    """A box, rounded box, cylinder, cone-like or ball-like body with the given extents (3,)."""
    kind = int(rng.integers(4))
    if kind == 0:
        return make.box(sizes)
    if kind == 1:
        return make.superquadric(sizes / 2, rng.uniform(0.15, 0.4, 2), 20)
    if kind == 2:
        turned = make.cylinder(0.5, 1.0)
        ends = make.taper(turned.vertices, rng.choice([0.0, rng.uniform(0, 1.4)]))
        return replace(turned, vertices=ends).scaled(sizes)
    return make.superquadric(sizes / 2, rng.uniform(0.5, 1.2, 2), 18)


def _deformed(rng: np.random.Generator, part: Part, chance: float) -> Part:
    if rng.random() >= chance:
        return part
    return replace(part, vertices=_warped(rng, part.vertices, 0.6))


def _warped(rng: np.random.Generator, points: Float64, strength: float) -> Float64:
    reach = float(np.abs(points).max())
    unit = points / reach
    if rng.random() < 0.8:
        unit = make.bumps(rng, unit, strength * rng.uniform(0.1, 0.7))
    if rng.random() < 0.4:
        unit = make.twist(unit, strength * rng.uniform(-1.2, 1.2))
    if rng.random() < 0.4:
        unit = make.taper(unit, strength * rng.uniform(-0.6, 0.6))
    if rng.random() < 0.4:
        unit = make.bend(unit, strength * rng.uniform(-0.5, 0.5))
    return unit * reach


Family = Callable[[np.random.Generator], list[Part]]
FAMILIES: tuple[Family, ...] = (
    _carton, _vessel, _vessel, _blob, _creature, _tool, _badge, _vehicle, _construct,
    _stick, _stick, _pincers, _pincers,
)  # fmt: skip
