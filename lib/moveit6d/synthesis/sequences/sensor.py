"""The camera of a sequence: linear light becomes a picture, with lens blur, exposure and noise.

Never moves: motion blur comes from several renders within an exposure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...typing import Float32, RGBImage
from ..imaging.blur import gaussian_blur
from ..imaging.linear_light import to_display
from ..imaging.sensor import add_noise, to_bytes


@dataclass(frozen=True)
class Sensor:
    """What the camera adds: blur of the lens, exposure and noise."""

    blur: float  # pixels, standard deviation
    exposure: float
    read_noise: float  # of full white
    shot_noise: float  # of full white, at full white


def expose(rng: np.random.Generator, frame: Float32, sensor: Sensor) -> RGBImage:
    """The picture (H, W, 3) uint8 that a camera makes of linear light (H, W, 3)."""
    light = gaussian_blur(as_image(frame), torch.tensor([sensor.blur])) * sensor.exposure
    noise = as_image(rng.standard_normal(frame.shape, np.float32))
    light = add_noise(light, noise, sensor.read_noise, sensor.shot_noise)
    return to_bytes(to_display(light.clamp(0, 1)))[0].permute(1, 2, 0).contiguous().numpy()


def as_image(array: Float32) -> Tensor:
    """An array (H, W, 3) as the image (1, 3, H, W) that `imaging` takes."""
    return torch.from_numpy(array).permute(2, 0, 1)[None].contiguous()
