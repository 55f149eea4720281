"""Random objects that look the same from several sides, and say so: cans, cones, blocks, prisms.

Never has a texture that breaks the symmetry. A share of them among the training objects teaches a
network that there are turns which nobody can see.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.mesh import Mesh
from ...geometry.symmetry import ContinuousSymmetry, Symmetries
from ...typing import Float64, RGBImage
from . import primitives as make
from .part_symmetries import plain_symmetries
from .primitives import Part
from .shapes import SIZES, assembled
from .textures import paint, random_palette

TEXTURE = 128  # pixels a side


def symmetric_object(rng: np.random.Generator, photos: Sequence[RGBImage] | None = None) -> Mesh:
    """A new object of 7 to 35 cm with declared symmetries, in a frame that is not centred.

    Half of them are turned on a lathe and ringed with colours, the others are plain blocks and
    prisms. With `photos` rings are taken from photographs too.
    """
    palette = random_palette(rng)
    if rng.random() < 0.5:
        name, part = "turned", _turned(rng)
        rings = paint(rng, TEXTURE, TEXTURE, palette, photos)[:, :1]
        texture = np.ascontiguousarray(rings.repeat(TEXTURE, 1))
        axis = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3))
        symmetries = Symmetries(continuous=(axis,))
    else:
        name, part = "block", _block(rng)
        colour = palette[int(rng.integers(len(palette)))]
        texture = np.full((TEXTURE, TEXTURE, 3), colour, np.uint8)
        symmetries = plain_symmetries([part])
    size = float(np.exp(rng.uniform(*np.log(SIZES))))
    turn, offset = make.rotation(rng), 0.3 * size * rng.uniform(-1, 1, 3)
    return assembled(name, [part], texture, size, turn, offset, symmetries)


def _turned(rng: np.random.Generator) -> Part:
    """A can, cone, vase, ring or spindle about z."""
    count = int(rng.integers(2, 7))
    knots = np.exp(rng.uniform(-1.0, 0.2, count)) if rng.random() < 0.7 else np.ones(count)
    at = np.linspace(0, 1, 24)
    radii: Float64 = np.interp(at, np.linspace(0, 1, count), knots)
    radii = np.concatenate([[0.0], radii, [0.0]])
    height = rng.uniform(0.4, 3.2)
    z = height * (0.5 - np.concatenate([at[:1], at, at[-1:]]))
    return make.lathe(radii, z)


def _block(rng: np.random.Generator) -> Part:
    """A block, rounded or not, at times with a square side; or a regular prism."""
    kind = int(rng.integers(3))
    sizes = np.exp(rng.uniform(-1.2, 0.2, 3))
    if rng.random() < 0.4:
        sizes[1] = sizes[0]
    if kind == 0:
        return make.box(sizes)
    if kind == 1:
        rounding = rng.uniform(0.1, 0.4)
        return make.superquadric(sizes / 2, (rounding, rounding), 20)
    corners = int(rng.integers(2, 9))
    angle = np.arange(6 * corners) * 2 * np.pi / (6 * corners)
    radius = 1 + rng.uniform(0.05, 0.3) * np.cos(corners * angle)
    outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    return make.prism(outline, float(rng.uniform(0.2, 1.5)))
