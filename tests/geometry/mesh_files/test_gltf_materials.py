"""Materials of glTF: colours, textures, samplers and masks are shown, or refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.read import read_mesh_file
from tests.support.gltf_files import load
from tests.support.patches import BOX, Glb, all_right, colored_glb, textured_glb

GREY = {"name": "grey", "pbrMetallicRoughness": {"metallicFactor": 0}}


def linear(colors: np.ndarray) -> np.ndarray:
    value = colors / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("material", [None, GREY])
@pytest.mark.parametrize("kind", ["bytes", "bytes4", "16 bits", "float", "float4"])
def test_vertex_colours_of_every_type(
    tmp_path: Path, kind: str, material: dict[str, Any] | None
) -> None:
    colors = BOX.quads()[2]
    if kind.endswith("4"):
        colors = np.concatenate([colors, np.full((96, 1), 255)], 1)
    values = {
        "bytes": lambda: colors.astype("u1"),
        "bytes4": lambda: colors.astype("u1"),
        "16 bits": lambda: np.rint(65535 * linear(colors)).astype("<u2"),
        "float": lambda: linear(colors).astype("<f4"),
        "float4": lambda: linear(colors).astype("<f4"),
    }[kind]()
    assert all_right(load(colored_glb(values, kind[0] != "f", material), tmp_path))


def test_vertex_colours_times_texture_times_factor(tmp_path: Path) -> None:
    """Half of the light of some sides in the vertices, half in the factor."""
    side = np.repeat([0.5, 1, 0.25, 1, 1, 0.5], 4)[:, None] * np.ones(3)
    glb = textured_glb()
    glb.add("COLOR_0", side.astype("<f4"))
    glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 0.5, 0.5, 1]
    mesh = load(glb, tmp_path)
    assert mesh.texture is not None and mesh.uv is not None
    for number, factor in enumerate((0.5, 1, 0.25, 1, 1, 0.5)):
        face = 2 * number
        uv = mesh.uv[mesh.faces[face]].mean(0)
        height, width = mesh.texture.shape[:2]
        shown = mesh.texture[int((1 - uv[1]) * height), int(uv[0] * width)]
        own = BOX.uv[BOX.faces[face]].mean(0)
        meant = BOX.picture[int((1 - own[1]) * 64), int(own[0] * 96)]
        np.testing.assert_allclose(linear(shown), linear(meant) * factor * 0.5, atol=0.02)


def test_texture_transform_and_coordinate_set(tmp_path: Path) -> None:
    """Coordinates made by undoing the transform: scale, then rotation, then offset, v down."""
    angle, scale, offset = 0.6, np.array([0.5, 0.8]), np.array([0.1, 0.2])
    wanted = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])  # counter-clockwise as a picture shows it (v down)
    stored = ((wanted - offset) @ np.linalg.inv(turn).T) / scale
    glb = textured_glb()
    glb.add("TEXCOORD_2", stored.astype("<f4"))
    info = glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    info["texCoord"] = 1
    info["extensions"] = {
        "KHR_texture_transform": {
            "rotation": angle, "scale": scale.tolist(), "offset": offset.tolist(), "texCoord": 2,
        }
    }  # fmt: skip
    assert all_right(load(glb, tmp_path))


@pytest.mark.parametrize(
    "material",
    [
        {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]},
         "emissiveTexture": {"index": 0}, "emissiveFactor": [1, 1, 1]},
        {"pbrMetallicRoughness": {}, "extensions": {"KHR_materials_pbrSpecularGlossiness":
         {"diffuseTexture": {"index": 0}}}},
        {"extensions": {"KHR_materials_unlit": {}}},
    ],
)  # fmt: skip
def test_other_kinds_of_materials(tmp_path: Path, material: dict[str, Any]) -> None:
    assert all_right(load(textured_glb(**material), tmp_path))


@pytest.mark.parametrize(("code", "wrap"), [(10497, "repeat"), (33648, "mirror"), (33071, "clamp")])
def test_samplers(tmp_path: Path, code: int, wrap: str) -> None:
    glb = textured_glb()
    uv = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1)
    if wrap == "repeat":
        uv += 3
    elif wrap == "mirror":
        uv = np.stack([2 - uv[:, 0], -uv[:, 1]], -1)
    glb.add("TEXCOORD_0", uv.astype("<f4"))
    glb.json["samplers"] = [{"wrapS": code, "wrapT": code}]
    glb.json["textures"][0]["sampler"] = 0
    assert all_right(load(glb, tmp_path))


def test_a_clamped_texture_goes_on_with_its_edge(tmp_path: Path) -> None:
    glb = textured_glb()
    glb.add(
        "TEXCOORD_0", np.tile([[1.5, 0.1], [2.5, 0.1], [1.5, 0.2], [2, 0.2]], (6, 1)).astype("<f4")
    )
    glb.json["samplers"] = [{"wrapS": 33071, "wrapT": 33071}]
    glb.json["textures"][0]["sampler"] = 0
    mesh = load(glb, tmp_path)
    assert mesh.uv is not None and mesh.texture is not None
    x = (mesh.uv[:, 0] * mesh.texture.shape[1]).astype(int).clip(0, mesh.texture.shape[1] - 1)
    y = ((1 - mesh.uv[:, 1]) * mesh.texture.shape[0]).astype(int)
    np.testing.assert_array_equal(mesh.texture[y, x], np.tile(BOX.picture[8, -1], (len(y), 1)))


@pytest.mark.parametrize("mode", ["MASK", "OPAQUE"])
def test_alpha_masks_are_holes(tmp_path: Path, mode: str) -> None:
    alpha = np.full((64, 96, 1), 255, np.uint8)
    alpha[:32, :16] = 0  # half of the side x = +0.05
    picture = BOX.png(np.concatenate([BOX.picture, alpha], 2))
    mesh = load(textured_glb(picture, alphaMode=mode), tmp_path)
    a, b, c = ((mesh.vertices + mesh.center)[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    side = (a + b + c)[:, 0] / 3 > 0.0499
    assert area[side].sum() == pytest.approx(0.08 * 0.06 / (2 if mode == "MASK" else 1), rel=0.05)
    assert area[~side].sum() == pytest.approx(0.08 * 0.06 + 4 * 0.1 * 0.07, rel=1e-3)


def _with_helper(mode: dict[str, Any], alpha: float, pictured: bool) -> Glb:
    """The box, and a large plane whose material has this alpha."""
    glb = textured_glb()
    base: dict[str, Any] = {"baseColorFactor": [0.2, 0.2, 0.2, alpha]}
    if pictured:
        base["baseColorTexture"] = {"index": 0}
    glb.json["materials"].append({"name": "helper", "pbrMetallicRoughness": base, **mode})
    plane = {
        "POSITION": glb.accessor(np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], "<f4")),
        "TEXCOORD_0": glb.accessor(np.array([[0, 0], [1, 0], [0, 1]], "<f4")),
    }
    glb.json["meshes"][0]["primitives"].append({"attributes": plane, "material": 1})
    return glb


@pytest.mark.parametrize("pictured", [False, True])
@pytest.mark.parametrize(
    ("mode", "alpha", "there"),
    [
        ({"alphaMode": "BLEND"}, 0.0, False),
        ({"alphaMode": "BLEND"}, 0.01, False),
        ({"alphaMode": "BLEND"}, 0.1, True),
        ({"alphaMode": "MASK"}, 0.4, False),
        ({"alphaMode": "MASK"}, 0.5, True),
        ({"alphaMode": "MASK", "alphaCutoff": 0.3}, 0.4, True),
        ({"alphaMode": "MASK", "alphaCutoff": 0}, 0.0, True),
        ({"alphaMode": "OPAQUE"}, 0.0, True),
        ({}, 0.0, True),
    ],
)
def test_planes_that_alpha_makes_invisible(
    tmp_path: Path, mode: dict[str, Any], alpha: float, there: bool, pictured: bool
) -> None:
    mesh = load(_with_helper(mode, alpha, pictured), tmp_path)
    assert len(mesh.faces) == 12 + there
    assert (np.ptp(mesh.vertices, axis=0)[0] > 1) == there
    if not there:
        assert all_right(mesh)
        content = read_mesh_file(tmp_path / "box.glb")[1]
        assert any("invisible" in note and "'helper'" in note for note in content.notes)


@pytest.mark.parametrize("mode", ["BLEND", "MASK"])
def test_an_object_that_alpha_would_hide_as_a_whole_is_shown(
    tmp_path: Path, mode: str, caplog: pytest.LogCaptureFixture
) -> None:
    glb = textured_glb(BOX.png(np.dstack([BOX.picture, np.full((64, 96), 255, np.uint8)])))
    entry = glb.json["materials"][0]
    entry["alphaMode"] = mode
    entry["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, 0]
    assert all_right(load(glb, tmp_path))
    assert "all of its materials invisible ('skin')" in caplog.text


def test_the_factor_s_alpha_multiplies_the_picture_s(tmp_path: Path) -> None:
    alpha = np.full((64, 96), 255, np.uint8)
    alpha[:32, :16] = 180  # half of the side x = +0.05; above the cutoff of 127.5 by itself
    glb = textured_glb(BOX.png(np.dstack([BOX.picture, alpha])), alphaMode="MASK")
    whole = _area(load(glb, tmp_path))
    glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, 0.6]
    assert whole - _area(load(glb, tmp_path)) == pytest.approx(0.08 * 0.06 / 2, rel=0.05)


def _area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
