"""Pictures, plain colours and charts share one texture and stay what they are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.content import MeshPart
from moveit6d.geometry.mesh_files.join import Surface, join

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
ATLAS = "moveit6d.geometry.mesh_files.atlas.MAX_ATLAS"
CHART = "moveit6d.geometry.mesh_files.charts.MAX_SIDE"


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def plain(count: int) -> list[MeshPart]:
    colors = [np.array([k % 256, (7 * k) % 256, 50], np.uint8) for k in range(count)]
    return [MeshPart(QUAD + (0, 0, k + 1), FACES, color=color) for k, color in enumerate(colors)]


def bilinear(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The texture between its texels, as renderers take it, at coordinates (N, 2), v up."""
    height, width = texture.shape[:2]
    x, y = uv[:, :1] * width - 0.5, (1 - uv[:, 1:]) * height - 0.5
    maps = x.astype(np.float32), y.astype(np.float32)
    return cv2.remap(texture.astype(np.float32), *maps, cv2.INTER_LINEAR)[:, 0]


def extent(surface: Surface, first: int) -> np.ndarray:
    """Width and height, texels, of the picture of the quad whose vertices begin at `first`."""
    assert surface.uv is not None and surface.texture is not None
    corners = surface.uv[first : first + 4]
    return (corners.max(0) - corners.min(0)) * surface.texture.shape[1::-1]


@pytest.mark.parametrize("count", [1, 60, 400])
def test_plain_colours_take_little_room_beside_a_picture(count: int) -> None:
    picture = noise(1024, 1024)
    surface = join([MeshPart(QUAD, FACES, UV, picture), *plain(count)])
    assert surface.texture is not None and surface.uv is not None
    np.testing.assert_allclose(extent(surface, 0), 1024, atol=0.01)
    assert surface.texture.size < 1.2 * picture.size and not surface.warnings
    shown = bilinear(surface.texture, surface.uv[4:])
    wanted = np.repeat([part.color for part in plain(count)], 4, axis=0)
    np.testing.assert_allclose(shown, wanted, atol=0.01)


def test_plain_colours_stay_pure_in_every_halving_down_to_their_size() -> None:
    surface = join([MeshPart(QUAD, FACES, UV, noise(100, 60)), *plain(9)])
    assert surface.texture is not None and surface.uv is not None
    texture = surface.texture.astype(np.float32)
    for _ in range(3):
        texture = texture.reshape(len(texture) // 2, 2, -1, 2, 3).mean((1, 3))
        shown = bilinear(texture, surface.uv[4:])
        wanted = np.repeat([part.color for part in plain(9)], 4, axis=0)
        np.testing.assert_allclose(shown, wanted, atol=0.01)


def test_pictures_of_any_shape_keep_their_texels_up_to_the_edge() -> None:
    pictures = [noise(h, w, h) for h, w in ((40, 9), (7, 64), (33, 33), (1, 1), (12, 80))]
    parts = [MeshPart(QUAD + k, FACES, UV, one) for k, one in enumerate(pictures)]
    surface = join([*parts, *plain(3)])
    assert surface.texture is not None and surface.uv is not None
    for k, picture in enumerate(pictures):
        corners = surface.uv[4 * k : 4 * k + 4].astype(np.float64)
        across, up = corners[1] - corners[0], corners[3] - corners[0]
        v, u = np.meshgrid(*(np.linspace(0, 1, 33),) * 2, indexing="ij")
        uv = corners[0] + u.reshape(-1, 1) * across + v.reshape(-1, 1) * up
        alone = np.pad(picture, ((1, 1), (1, 1), (0, 0)), mode="edge")
        size = np.array(picture.shape[1::-1])
        inside = (np.stack([u, v], -1).reshape(-1, 2) * size + 1) / (size + 2)
        np.testing.assert_allclose(
            bilinear(surface.texture, uv), bilinear(alone, inside), atol=3
        )  # float32 coordinates: a hundredth of a texel


def test_pictures_without_room_are_reduced_no_more_than_needed_and_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ATLAS, 256)
    four = [MeshPart(QUAD + k, FACES, UV, noise(128, 128, k)) for k in range(4)]
    whole = join([*four, *plain(20)])
    np.testing.assert_allclose(extent(whole, 0), 128, atol=0.01)
    assert not whole.warnings
    five = [*four, MeshPart(QUAD + 4, FACES, UV, noise(20, 40))]
    surface = join([*five, MeshPart(QUAD + 5, FACES, UV, noise(128, 128, 9))])
    assert 75 < extent(surface, 0)[0] < 128
    np.testing.assert_allclose(extent(surface, 16), (40, 20), atol=0.01)
    assert len(surface.warnings) == 1
    assert "5 of its 6 pictures are reduced, the largest from 128 to" in surface.warnings[0]


def test_a_picture_that_repeats_too_often_for_one_texture_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in (ATLAS, "moveit6d.geometry.mesh_files.join.MAX_ATLAS"):
        monkeypatch.setattr(name, 256)
    surface = join([MeshPart(QUAD, FACES, 4 * UV, noise(128, 128)), *plain(1)])
    assert "repeats 4×4 times is reduced from 128 to 64" in surface.warnings[0]


def test_charts_do_not_mix_faces_beside_a_large_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (ATLAS, CHART):
        monkeypatch.setattr(name, 256)
    count = 19
    x, y = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count))
    vertices = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    at = np.arange(count * count).reshape(count, count)
    a, b, c, d = (s.ravel() for s in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    odd = ((np.floor(vertices[:, :1] * 8) + np.floor(vertices[:, 1:2] * 8)) % 2) > 0
    colors = np.where(odd, (250, 20, 20), (20, 20, 250)).astype(np.uint8)
    picture = MeshPart(QUAD + (0, 0, 1), FACES, UV, noise(128, 128))
    surface = join([picture, MeshPart(vertices, faces, colors=colors)])
    assert surface.texture is not None and surface.uv is not None
    shown = bilinear(surface.texture, surface.uv[surface.faces[2:]].mean(1))
    assert np.abs(shown - colors[faces].mean(1)).max() < 2
    assert extent(surface, 0)[0] > 100


def test_too_many_faces_for_charts_cost_the_pictures_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(CHART, 4)
    colors = np.array([[10, 20, 30], [40, 50, 60], [70, 80, 90], [1, 2, 3]], np.uint8)
    parts = [MeshPart(QUAD, FACES, UV, noise(8, 8)), MeshPart(QUAD, FACES, colors=colors)]
    surface = join(parts)
    assert surface.texture is None
    assert "too many for a texture" in surface.warnings[0]


def test_what_no_face_shows_does_not_hide_that_all_is_of_one_colour(tmp_path: Path) -> None:
    for k, size in enumerate(((8, 8), (30, 5), (5, 30))):
        Image.new("RGB", size, (255, 255, 255)).save(tmp_path / f"{k}.png")
    rows = ["mtllib m.mtl", "vt 0 0", "vt 1 0", "vt 0 1"]
    for k in range(4):
        rows += [f"v 0 0 {k}", f"v 1 0 {k}", f"v 0 1 {k}", f"usemtl m{k}"]
        rows.append("f " + " ".join(f"{3 * k + i}/{i}" for i in (1, 2, 3)))
    library = [f"newmtl m{k}\nmap_Kd {k}.png\n" for k in range(3)] + ["newmtl m3\nKd 1 1 1\n"]
    (tmp_path / "m.mtl").write_text("".join(library))
    (tmp_path / "m.obj").write_text("\n".join(rows))
    with pytest.raises(InputError, match="of one colour"):
        Mesh.load(tmp_path / "m.obj")
