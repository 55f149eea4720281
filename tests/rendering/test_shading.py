"""The plain lamp: known answers."""

import torch

from moveit6d.rendering.renderer import GBuffer
from moveit6d.rendering.shading import shade_plain


def test_known_brightness_face_on_slanted_and_edge_on():
    normal = torch.tensor([[0, 0, -1.0], [0.8, 0, -0.6], [1, 0, 0], [0, 0, 0]]).T.reshape(
        1, 3, 1, 4
    )
    albedo = torch.tensor([1.0, 0.5, 0.2])[None, :, None, None].expand(1, 3, 1, 4).clone()
    albedo[..., 3] = 0  # background
    depth = torch.ones(1, 1, 1, 4)
    shaded = shade_plain(GBuffer(albedo, normal, depth, depth))
    expected = torch.tensor([1.0, 0.45 + 0.55 * 0.6, 0.45, 0.0])
    torch.testing.assert_close(shaded[0, 0, 0], expected)
    torch.testing.assert_close(shaded[0, 1, 0], 0.5 * expected)


def test_a_normal_that_looks_away_is_not_darker_than_edge_on():
    normal = torch.tensor([0, 0, 1.0]).reshape(1, 3, 1, 1)
    one = torch.ones(1, 1, 1, 1)
    shaded = shade_plain(GBuffer(one.expand(1, 3, 1, 1), normal, one, one))
    torch.testing.assert_close(shaded, torch.full((1, 3, 1, 1), 0.45))
