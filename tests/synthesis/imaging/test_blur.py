"""Blur: against OpenCV, and moments of what a point becomes."""

import cv2
import numpy as np
import pytest
import torch

from moveit6d.synthesis.imaging.blur import gaussian_blur, motion_blur, radial_blur


def test_gaussian_blur_is_opencv_s() -> None:
    image = torch.rand(2, 3, 24, 31, generator=torch.Generator().manual_seed(0))
    found = gaussian_blur(image, torch.tensor([0.5, 1.5]))
    for number, sigma in enumerate((0.5, 1.5)):
        wanted = cv2.GaussianBlur(
            image[number].permute(1, 2, 0).numpy(), (11, 11), sigma,
            borderType=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        np.testing.assert_allclose(found[number].permute(1, 2, 0), wanted, atol=1e-5)


def test_motion_blur_has_the_stated_variance_and_direction() -> None:
    point = torch.zeros(1, 1, 41, 41)
    point[..., 20, 20] = 1
    angle, length, sigma = 0.6, 9.0, 0.8
    parameters = torch.tensor([[sigma], [length], [angle]])
    spread = motion_blur(point, parameters[0], parameters[1], parameters[2], radius=18)[
        0, 0
    ].double()
    line = torch.arange(-20, 21, dtype=torch.float64)
    y, x = torch.meshgrid(line, line, indexing="ij")
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    assert float(spread.sum()) == pytest.approx(1, abs=1e-5)
    assert float((spread * along**2).sum()) == pytest.approx(sigma**2 + length**2 / 12, rel=0.01)
    assert float((spread * across**2).sum()) == pytest.approx(sigma**2, rel=0.02)
    assert abs(float((spread * along).sum())) < 1e-4


def test_radial_blur_grows_from_the_middle() -> None:
    image = torch.rand(1, 1, 65, 65, generator=torch.Generator().manual_seed(0))
    change = (radial_blur(image, torch.tensor([0.2])) - image).abs()[0, 0]
    assert change[32, 32] < 1e-4 < change[:8].mean()
    assert torch.allclose(radial_blur(image, torch.tensor([0.0])), image, atol=1e-5)
