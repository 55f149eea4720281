"""The environment of a sequence: light that changes and a background that moves.

Never knows the object's motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...rendering.renderer import Renderer
from ...typing import Float32, RGBImage
from ..augmentation.backgrounds import procedural_photo
from ..imaging.blur import gaussian_blur
from ..imaging.linear_light import to_linear
from ..objects.primitives import rotation
from ..objects.shapes import random_object
from .difficulty import Difficulty
from .layers import SceneLight, SceneMaterial, composite, render_layers
from .motion import SmoothPath
from .sensor import as_image

BACKGROUND_SCALE = 1.4  # the picture behind everything is so much larger than a frame


def background_size(camera: Camera) -> tuple[int, int]:
    """Width and height of the picture behind everything, pixels: no photograph needs more."""
    return int(camera.width * BACKGROUND_SCALE), int(camera.height * BACKGROUND_SCALE)


class LightOverTime:
    """Light and exposure over time."""

    def __init__(self, rng: np.random.Generator, change: float) -> None:
        self._change = change
        self._way = SmoothPath(rng, 6)
        self._pace = 2 * np.pi / rng.uniform(40, 90)
        self._azimuth, self._height = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.1)
        self._strength, self._around = rng.uniform(0.6, 1.0), rng.uniform(0.35, 0.6)
        self._warmth = rng.uniform(-0.1, 0.1)

    def __call__(self, number: int) -> tuple[SceneLight, float]:
        """The light (camera frame) and the exposure of a frame."""
        turn, rise, strength, warm, around, exposure = self._way(number * self._pace) * self._change
        azimuth, height = self._azimuth + 1.5 * turn, self._height + 0.4 * rise
        # Behind the camera, turned by the azimuth and lifted by the height.
        x, y = math.sin(azimuth) * math.cos(height) * 0.8, -math.sin(height)
        z = -math.sqrt(max(0.05, 1 - x * x - y * y))
        length = math.sqrt(x * x + y * y + z * z)
        key = self._strength * math.exp(0.7 * strength)
        tint = self._warmth + 0.25 * warm
        color = (key * (1 + tint), key, key * (1 - tint))
        dim = self._around * math.exp(0.3 * around)
        light = SceneLight((x / length, y / length, z / length), color, (dim, dim, dim))
        return light, math.exp(0.25 * exposure)

    def brightness(self, number: int) -> float:
        """How bright the background is."""
        light, _ = self(number)
        return 0.6 + 0.4 * (light.key[1] + light.ambient[1]) / (self._strength + self._around)


class MovingBackground:
    """A picture larger than the frame behind everything, moving slowly, out of focus."""

    def __init__(
        self,
        rng: np.random.Generator,
        renderer: Renderer,
        camera: Camera,
        mesh: Mesh,
        difficulty: Difficulty,
        photos: Sequence[RGBImage] | None,
    ) -> None:
        self._size = (camera.width, camera.height)
        wide, high = background_size(camera)
        large = (high, wide)
        if photos:
            chosen = photos[int(rng.integers(len(photos)))]
            picture = _covering(chosen, large)
        else:
            picture = procedural_photo(rng, large)
        if difficulty.colour_similarity:
            picture = _recolored(picture, mesh, difficulty.colour_similarity)
        sigma = torch.tensor([rng.uniform(1.2, 3.0) * camera.width / 640])
        light = to_linear(as_image(np.float32(1 / 255) * picture.astype(np.float32)))
        blurred = gaussian_blur(light, sigma)[0].permute(1, 2, 0)
        self._picture: Float32 = blurred.contiguous().numpy()
        depth = np.full(large, np.inf, np.float32)
        for _ in range(int(rng.integers(difficulty.clutter[0], difficulty.clutter[1] + 1))):
            self._add_clutter(rng, renderer, depth, photos)
        self._way = SmoothPath(rng, 4)
        # Slow sequences drift about 1 pixel a frame, fast ones a few.
        speed = 0.5 + 0.03 * sum(difficulty.pixels_per_frame)
        self._pace = 2 * math.pi / 120 * speed
        self._middle = ((large[1] - 1) / 2, (large[0] - 1) / 2)

    def __call__(self, time: float, offset: NDArray[np.float64]) -> Float32:
        """The part of the picture that the frame sees at a moment, sampled `offset` pixels off."""
        import cv2

        x, y, turn, zoom = self._way(time * self._pace)
        angle, scale = 0.06 * turn, 1 + 0.07 * zoom
        c, s = scale * math.cos(angle), scale * math.sin(angle)
        width, height = self._size
        # Frame pixel → picture pixel.
        center = np.array([self._middle[0] + 0.11 * width * x, self._middle[1] + 0.11 * height * y])
        frame = np.array([(width - 1) / 2, (height - 1) / 2]) - offset
        turned = np.array([[c, -s], [s, c]])
        matrix = np.concatenate([turned, (center - turned @ frame)[:, None]], 1)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(
            cv2.warpAffine(
                self._picture, matrix, self._size, flags=flags, borderMode=cv2.BORDER_REFLECT
            )
        )

    def _add_clutter(
        self,
        rng: np.random.Generator,
        renderer: Renderer,
        depth: NDArray[np.float32],
        photos: Sequence[RGBImage] | None,
    ) -> None:
        """Paint one more object onto the picture, where it lies still."""
        height, width = depth.shape
        thing = random_object(rng, photos)
        camera = Camera(width, width, (width - 1) / 2, (height - 1) / 2, width, height)
        away = thing.sphere_diameter * width / rng.uniform(0.08 * width, 0.2 * width)
        x, y = rng.uniform(-0.45, 0.45, 2) * (1, height / width) * away
        place = torch.tensor([[x, y, away]], dtype=torch.float64)
        batch = Pose(torch.from_numpy(rotation(rng))[None], place)
        light = SceneLight((0.3, -0.8, -0.52), (0.7, 0.7, 0.7), (0.45, 0.45, 0.45))
        zero = np.zeros((1, 2))
        for layer in render_layers(renderer, thing, batch, camera, zero, light, SceneMaterial()):
            composite(self._picture, depth, layer)


def _covering(photo: RGBImage, size: tuple[int, int]) -> RGBImage:
    """The middle of a photograph, scaled to cover (height, width)."""
    height, width = size
    scale = max(height / photo.shape[0], width / photo.shape[1])
    w, h = math.ceil(photo.shape[1] * scale), math.ceil(photo.shape[0] * scale)
    big = np.asarray(Image.fromarray(photo).resize((w, h), Image.Resampling.BICUBIC))
    top, left = (h - height) // 2, (w - width) // 2
    return np.ascontiguousarray(big[top : top + height, left : left + width])


def _recolored(picture: RGBImage, mesh: Mesh, share: float) -> RGBImage:
    """The picture with its colours' mean and spread pulled towards the object's."""
    surface = mesh.texture if mesh.texture is not None else mesh.vertex_colors
    assert surface is not None
    own = surface.reshape(-1, 3).astype(np.float32)
    flat = picture.reshape(-1, 3).astype(np.float32)
    spread = np.maximum((own.std(0) + 8) / (flat.std(0) + 8), 0.6)
    matched = (picture - flat.mean(0)) * spread + own.mean(0)
    return np.asarray((picture + share * (matched - picture)).clip(0, 255), np.uint8)
