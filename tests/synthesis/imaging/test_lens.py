"""Lens errors: the largest displacement is the stated one, and no pose is in it."""

import torch

from moveit6d.synthesis.imaging.lens import apply_lens_error


def test_the_field_has_no_shift_and_no_scale() -> None:
    line = torch.arange(64).float()
    y, x = torch.meshgrid(line, line, indexing="ij")
    places = torch.stack([x, y])[None].repeat(20, 1, 1, 1)  # an image of its own coordinates
    coefficients = torch.rand(5, 20, 1, 1, generator=torch.Generator().manual_seed(0)) * 2 - 1
    pixels = torch.linspace(0.5, 1.5, 20)
    moved = (apply_lens_error(places, coefficients, pixels) - places)[..., 2:-2, 2:-2]
    size = moved.norm(dim=1).flatten(1).amax(1)
    assert (size <= pixels + 1e-3).all() and (size > 0.6 * pixels).all()
    inside = places[..., 2:-2, 2:-2] - 31.5
    scale = (moved * inside).sum((1, 2, 3)) / inside.square().sum((1, 2, 3))
    # The field itself has neither; two pixels less on each side leave a trace of them.
    assert moved.mean((2, 3)).abs().max() < 0.1 and (scale.abs() * 32).max() < 0.15
