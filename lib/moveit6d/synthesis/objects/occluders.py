"""Meshes of occluders: a hand with its arm, a textured card or board, another object.

Never decides where they are. Lengths are metres for an object of 20 cm and are scaled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...geometry.mesh import Mesh
from ...typing import Float64, RGBImage
from . import primitives as make
from .primitives import Part
from .reshape import reshaped
from .shapes import random_object
from .textures import paint, photo_crop, random_palette, smooth_noise, weather

SKIN = ((255, 219, 188), (236, 188, 150), (206, 150, 112), (156, 104, 70), (98, 62, 42))


@dataclass(frozen=True)
class Occluder:
    """A mesh, the point of it that leads (centred frame) and its axis that points away from it.

    `along` is the direction (3,) towards the rest of the arm, None where any rotation will do.
    """

    kind: str
    mesh: Mesh
    tip: NDArray[np.float64]  # (3,)
    along: NDArray[np.float64] | None


def random_occluder(
    rng: np.random.Generator, scale: float = 1.0, photos: Sequence[RGBImage] | None = None
) -> Occluder:
    """A hand (half of the time), a card or an object; `scale` 1 suits an object of 20 cm."""
    kind = rng.choice(["hand", "card", "object"], p=[0.5, 0.25, 0.25])
    if kind == "hand":
        return hand(rng, scale)
    if kind == "card":
        return card(rng, scale, photos)
    mesh = random_object(rng, photos)
    factor = scale * rng.uniform(0.1, 0.16) / mesh.sphere_diameter
    return Occluder("object", reshaped(mesh, mesh.vertices * factor), np.zeros(3), None)


def card(
    rng: np.random.Generator, scale: float = 1.0, photos: Sequence[RGBImage] | None = None
) -> Occluder:
    """A thin card with a texture on both sides."""
    size = scale * np.array([rng.uniform(0.07, 0.12), rng.uniform(0.08, 0.15), 0.002])
    return Occluder("card", _textured_box(rng, "card", size, photos), np.zeros(3), None)


def board(
    rng: np.random.Generator, size: tuple[float, float], photos: Sequence[RGBImage] | None = None
) -> Mesh:
    """A flat textured board of width × height metres, centred in the file frame's origin."""
    return _textured_box(rng, "board", np.array([*size, 0.02 * min(size)]), photos)


def hand(rng: np.random.Generator, scale: float = 1.0) -> Occluder:
    """A stylised hand: palm, four fingers, thumb, forearm in a sleeve; fingers point along +y."""
    palm = make.superquadric((0.042, 0.05, 0.014), (0.7, 0.5), 18)
    parts = [palm]
    spread, curl = rng.uniform(0.0, 0.12), rng.uniform(0.0, 0.5)
    for finger, (x, length) in enumerate(
        [(-0.031, 0.070), (-0.0105, 0.080), (0.0105, 0.075), (0.031, 0.060)]
    ):
        turn = spread * (finger - 1.5) + rng.normal() * 0.02
        start = np.array([x, 0.040, 0.0])
        parts.append(_finger(start, turn, curl + rng.normal() * 0.06, length, 0.0095))
    thumb_turn = -rng.uniform(0.5, 0.9)
    parts.append(_finger(np.array([-0.036, -0.015, 0.0]), thumb_turn, 0.2, 0.062, 0.0115))
    wrist = np.array([[0, y, 0.0] for y in np.linspace(-0.03, -0.42, 9)])
    arm = make.tube(wrist, np.linspace(0.026, 0.042, 9), 20).scaled((1.1, 1, 0.8))
    uncovered = rng.random() < 0.4
    parts.append(arm if uncovered else replace(arm, skin=1))
    if not uncovered:
        cuff = make.tube(np.array([[0, -0.075, 0], [0, -0.10, 0.0]]), 0.036, 20)
        parts.append(replace(cuff.scaled((1.1, 1, 0.9)), skin=1))
    mirrored = (-1 if rng.random() < 0.5 else 1, 1, 1)
    parts = [part.scaled(mirrored).scaled(scale) for part in parts]
    texture, parts = _dressed(rng, parts)
    whole = make.join(parts)
    mesh = Mesh.from_arrays("hand", whole.vertices, whole.faces, uv=whole.uv, texture=texture)
    tip = np.array([0, 0.09 * scale, 0]) - mesh.center
    return Occluder("hand", mesh, tip, np.array([0.0, -1.0, 0.0]))


def _textured_box(
    rng: np.random.Generator, name: str, size: Float64, photos: Sequence[RGBImage] | None
) -> Mesh:
    part = make.box(size)
    if photos:
        texture = photo_crop(rng, photos, 256, 384)
    else:
        texture = paint(rng, 256, 384, random_palette(rng))
    return Mesh.from_arrays(name, part.vertices, part.faces, uv=part.uv, texture=texture)


def _finger(start: Float64, turn: float, curl: float, length: float, radius: float) -> Part:
    """A finger from `start` along +y turned in the palm's plane by `turn`, curling towards +z."""
    points, place, angle = [start], start, 0.0
    for joint in range(9):
        angle += curl * (0.25 if joint in (2, 3, 5, 6) else 0.02)
        step = np.array([np.sin(turn) * np.cos(angle), np.cos(turn) * np.cos(angle), np.sin(angle)])
        place = place + step * length / 9
        points.append(place)
    thickness = radius * np.array([1.0, 1.02, 0.98, 0.96, 0.98, 0.93, 0.9, 0.86, 0.75, 0.42])
    return make.tube(np.stack(points), thickness, 12)


def _dressed(rng: np.random.Generator, parts: list[Part]) -> tuple[RGBImage, list[Part]]:
    """Skin in the left half of the texture, sleeve in the right one."""
    first, second = rng.choice(len(SKIN), 2, p=[0.25, 0.25, 0.2, 0.15, 0.15])
    tone = np.array(SKIN[first]) * 0.7 + np.array(SKIN[second]) * 0.3
    blotches = 6 * smooth_noise(rng, 128, 128, 4, 4)[..., None] * (1.0, 0.7, 0.6)
    skin = weather(rng, (tone + blotches).clip(0, 255).astype(np.uint8), 3)
    sleeve = paint(rng, 128, 128, random_palette(rng), plain=rng.random() < 0.5)
    texture = np.concatenate([skin, sleeve], 1)
    placed = [
        replace(part, uv=(0.01 + 0.98 * part.uv) * (0.5, 1.0) + (0.5 * part.skin, 0.0))
        for part in parts
    ]
    return texture, placed
