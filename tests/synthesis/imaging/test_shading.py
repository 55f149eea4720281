"""Shading: against the Blinn-Phong formula pixel by pixel."""

import numpy as np
import pytest
import torch

from moveit6d.synthesis.imaging.shading import Illumination, Material, ShadedSurface, shade


def a_surface(count: int = 3, size: int = 5) -> ShadedSurface:
    """Random normals that face the camera, in the left half of each view."""
    generator = torch.Generator().manual_seed(0)
    normal = torch.randn(count, 3, size, size, generator=generator)
    normal[:, 2] = -normal[:, 2].abs()
    mask = torch.zeros(count, 1, size, size)
    mask[..., : size // 2] = 1
    intrinsics = torch.tensor([[9.0, 0, 2], [0, 9, 2], [0, 0, 1]]).expand(count, 3, 3)
    return ShadedSurface.of(
        torch.rand(count, 3, size, size, generator=generator),
        torch.nn.functional.normalize(normal, dim=1),
        4 + torch.rand(count, 1, size, size, generator=generator),
        mask,
        intrinsics,
        torch.tensor([[0.0, 0.0, 4.5]]).expand(count, 3),
    )


def some_lights(count: int = 3, hemisphere: float = 0.0) -> tuple[Illumination, Material]:
    """A point light and one far away, in each view."""
    point, far = torch.tensor([0.3, -1.0, -2.0, 1.0]), torch.tensor([0.6, 0.0, -0.8, 0.0])
    position = torch.stack([point, far])[:, None].expand(2, count, 4)
    light = Illumination(
        position,
        torch.tensor([[0.7], [0.4]]).expand(2, count),
        torch.tensor([[1.0, 0.9, 0.5]]).expand(count, 3),
        torch.full((count,), 1.2),
        torch.tensor([[0.3, 0.2, 0.4]]).expand(count, 3),
        hemisphere,
    )
    return light, Material(torch.linspace(0, 0.8, count), torch.linspace(0.1, 0.7, count))


@pytest.mark.parametrize("hemisphere", [0.0, 0.5])
def test_every_pixel_has_the_colour_of_the_formula(hemisphere: float) -> None:
    surface = a_surface()
    light, material = some_lights(hemisphere=hemisphere)
    found = shade(surface, light, material)
    assert len(found) == 3 * 5 * 2
    for k in range(len(found)):
        view = int(surface.view[k])
        base, normal, point, ray = (
            getattr(surface, name)[k].double().numpy()
            for name in ("albedo", "normal", "point", "ray")
        )
        metal, smooth = float(material.metallic[view]), float(material.smoothness[view])
        towards = [np.array([0.3, -1.0, -2.0]) - point, np.array([0.6, 0.0, -0.8])]
        eye = -ray / np.linalg.norm(ray)
        diffuse = specular = 0.0
        for strength, vector in zip((0.7, 0.4), towards, strict=True):
            unit = vector / np.linalg.norm(vector)
            half = (unit + eye) / np.linalg.norm(unit + eye)
            diffuse += strength * max(normal @ unit, 0)
            specular += strength * max(normal @ half, 0) ** (2 ** (8 * smooth + 1))
        colour = np.array([1.0, 0.9, 0.5])
        ambient = np.array([0.3, 0.2, 0.4]) * (1 - hemisphere * (1 + normal[1]) / 2)
        wanted = base * (1 - 0.3 * metal) * (ambient + colour * 1.2 * diffuse)
        wanted = wanted + smooth * specular * (0.4 + 0.6 * metal * base) * colour
        np.testing.assert_allclose(found[k], wanted, rtol=1e-4, atol=1e-5)


def test_what_no_light_reaches_is_ambient() -> None:
    surface = a_surface()
    light, material = some_lights()
    dark = shade(surface, light, material, torch.zeros(len(surface.view)))
    matte = 1 - 0.3 * material.metallic[surface.view][:, None]
    assert torch.allclose(dark, surface.albedo * matte * light.ambient[0], atol=1e-6)


def test_points_project_to_their_pixels_and_images_hold_their_colours() -> None:
    surface = a_surface()
    x, y, z = (surface.point + torch.tensor([0.0, 0.0, 4.5])).T
    assert torch.allclose(9 * x / z + 2, surface.column.float(), atol=1e-4)
    assert torch.allclose(9 * y / z + 2, surface.row.float(), atol=1e-4)
    image = surface.image(surface.albedo)
    assert image.shape == (3, 3, 5, 5) and image[..., 2:].abs().max() == 0
    assert torch.equal(image[surface.view, :, surface.row, surface.column], surface.albedo)
