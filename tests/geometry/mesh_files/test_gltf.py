"""glTF and GLB: what the file says of its looks and its shape is shown, or refused by name."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.patches import BOX, Glb, all_right, colored_glb, textured_glb

GREY = {"name": "grey", "pbrMetallicRoughness": {"metallicFactor": 0}}


def linear(colors: np.ndarray) -> np.ndarray:
    value = colors / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def load(glb: Glb, folder: Path, **options: Any) -> Mesh:
    glb.write(folder / "box.glb")
    return Mesh.load(folder / "box.glb", **options)


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


def gltf_file(folder: Path, uri: str) -> Path:
    glb = textured_glb()
    glb.json["images"] = [{"uri": uri}]
    glb.json["buffers"] = [{"byteLength": len(glb.binary), "uri": "box%20data.bin"}]
    (folder / "box data.bin").write_bytes(glb.binary)
    (folder / "box.gltf").write_text("\ufeff" + json.dumps(glb.json), encoding="utf-8")
    return folder / "box.gltf"


@pytest.mark.parametrize("uri", ["my%20skin.png", "./My Skin.PNG", "textures\\my skin.png"])
def test_escaped_names(tmp_path: Path, uri: str) -> None:
    BOX.write_picture(tmp_path / "my skin.png")
    assert all_right(Mesh.load(gltf_file(tmp_path, uri)))


def test_a_missing_picture_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = gltf_file(tmp_path, "gone.png")
    with pytest.raises(InputError, match=r"material 'skin'.*gone.png.*not there"):
        Mesh.load(path)
    Mesh.load(path, allow_untextured=True)
    assert "gone.png" in caplog.text


def test_quantised_positions_and_coordinates(tmp_path: Path) -> None:
    glb = textured_glb()
    scaled = np.rint(BOX.vertices / 0.05 * 32767).astype("<i2")
    glb.add("POSITION", np.concatenate([scaled, np.zeros((24, 1), "<i2")], 1)[:, :3].copy(), True)
    down = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1)
    glb.add("TEXCOORD_0", np.rint(down * 65535).astype("<u2"), True)
    glb.json["nodes"][0]["scale"] = [0.05] * 3
    glb.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    assert all_right(load(glb, tmp_path))


def test_nodes_scenes_and_mirrors(tmp_path: Path) -> None:
    glb = textured_glb()
    glb.json["nodes"] = [
        {"children": [1], "translation": [0.1, 0.2, 0.3], "rotation": [0, 0, 0.6, 0.8]},
        {"mesh": 0, "matrix": [2, 0, 0, 0, 0, -3, 0, 0, 0, 0, 4, 0, 0.1, 0, 0, 1]},
        {"mesh": 0, "translation": [9, 9, 9]},  # in no scene
    ]
    mesh = load(glb, tmp_path)
    local = BOX.vertices * (2, -3, 4) + (0.1, 0, 0)
    turned = local @ np.array([[0.28, -0.96, 0], [0.96, 0.28, 0], [0, 0, 1]]).T + (0.1, 0.2, 0.3)
    np.testing.assert_allclose(mesh.vertices + mesh.center, turned, atol=1e-6)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(1) > 0).all()  # faces still look outwards


def test_other_modes_of_triangles(tmp_path: Path) -> None:
    sheet = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0]], "<f4") / 10
    for mode, count, area in ((5, 3, 0.015), (6, 3, None)):
        glb = Glb()
        glb.add("POSITION", sheet)
        glb.primitive["mode"] = mode
        mesh = load(glb, tmp_path)
        assert len(mesh.faces) == count
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        if area is not None:
            normals = np.cross(b - a, c - a)
            assert np.linalg.norm(normals, axis=1).sum() / 2 == pytest.approx(area)
            assert (normals[:, 2] < 0).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extensionsRequired": ["KHR_texture_basisu"]}, "requires KHR_texture_basisu"),
        ({"extensionsRequired": ["NV_meshopt_2"]}, "requires NV_meshopt_2"),
        ({"extensionsRequired": ["NV_new"]}, "requires NV_new"),
        ({"asset": {"version": "1.0"}}, "glTF 1.0"),
        ({"textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]}, "basisu"),
        ({"materials": [{"name": "m"}]}, "material m, but the whole object is of one colour"),
        ({"nodes": [{"children": [0], "mesh": 0}]}, "hangs below"),
        ({"nodes": [{"mesh": 7}]}, "cannot be read as a mesh"),
        ({"nodes": 5}, "cannot be read as a mesh"),
        ({"accessors": []}, "cannot be read as a mesh"),
    ],
)
def test_what_is_not_understood_is_refused_by_name(
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    glb = textured_glb()
    glb.json.update(change)
    with pytest.raises(InputError, match=words) as error:
        load(glb, tmp_path)
    assert len(str(error.value)) < 400 and "\n" not in str(error.value)


def test_a_file_that_was_cut_off_says_so(tmp_path: Path) -> None:
    textured_glb().write(tmp_path / "box.glb")
    whole = (tmp_path / "box.glb").read_bytes()
    for length in (30, len(whole) // 2, len(whole) - 3):
        (tmp_path / "box.glb").write_bytes(whole[:length])
        with pytest.raises(InputError, match="cut off"):
            Mesh.load(tmp_path / "box.glb")


def test_draco_is_decoded(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy", reason="pip install 'moveit6d[draco]'")
    down = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1)
    packed = draco.encode(
        BOX.vertices.astype(np.float32), BOX.faces.astype(np.uint32),
        tex_coord=down, quantization_bits=14, preserve_order=True,
    )  # fmt: skip
    numbers = {one["attribute_type"]: one["unique_id"] for one in draco.decode(packed).attributes}
    glb = textured_glb()
    glb.primitive["extensions"] = {
        "KHR_draco_mesh_compression": {
            "bufferView": glb.view(packed),
            "attributes": {"POSITION": numbers[0], "TEXCOORD_0": numbers[3]},
        }
    }
    glb.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    assert all_right(load(glb, tmp_path))


def packed_with_meshopt(name: str) -> Glb:
    """The textured box whose vertices and faces lie in compressed views, as gltfpack writes them.

    What the views unfold to has a buffer of its own, which has no data.
    """
    meshopt = pytest.importorskip("meshopt", reason="pip install 'moveit6d[meshopt]'")
    glb, version = textured_glb(), 1 if name.startswith("KHR") else 0
    down = np.stack([BOX.uv[:, 0], 1 - BOX.uv[:, 1]], -1).astype("<f4")
    positions = BOX.vertices.astype("<f4")
    faces = BOX.faces.reshape(-1).astype("<u4")
    for view, values, mode in (
        (0, positions, "ATTRIBUTES"), (1, down, "ATTRIBUTES"), (2, faces, "TRIANGLES"),
    ):  # fmt: skip
        packed = meshopt.encode_gltf_buffer(values, mode, version)
        place = glb.json["bufferViews"][glb.view(packed)]
        stride = values.itemsize * (1 if values.ndim == 1 else values.shape[1])
        glb.json["bufferViews"][view] = {
            "buffer": 1, "byteOffset": 0, "byteLength": values.nbytes,
            "extensions": {name: {**place, "byteStride": stride, "count": len(values),
                                  "mode": mode}},
        }  # fmt: skip
    glb.json["extensionsRequired"] = [name]
    return glb


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_is_decoded(tmp_path: Path, name: str) -> None:
    assert all_right(load(packed_with_meshopt(name), tmp_path))


def test_what_meshopt_filters_is_unfiltered(tmp_path: Path) -> None:
    meshopt = pytest.importorskip("meshopt", reason="pip install 'moveit6d[meshopt]'")
    glb = packed_with_meshopt("EXT_meshopt_compression")
    rough = meshopt.encode_filter_exp(BOX.vertices.astype("<f4"), 12)
    place = glb.json["bufferViews"][glb.view(meshopt.encode_gltf_buffer(rough, "ATTRIBUTES"))]
    glb.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"].update(
        place, filter="EXPONENTIAL"
    )
    assert all_right(load(glb, tmp_path))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"count": 10**9}, "cannot hold 1000000000 rows"),
        ({"count": -3}, "cannot hold -3 rows"),
        ({"count": 23}, "beyond its data|damaged"),
        ({"byteStride": 13}, "damaged"),
        ({"mode": "OTHER"}, "damaged"),
        ({"filter": "OTHER"}, "damaged"),
        ({"byteLength": 10}, "damaged"),
        ({"byteLength": 10**6}, "cut off or damaged"),
        ({"buffer": 7}, "cannot be read as a mesh"),
    ],
)
def test_damaged_meshopt_data_is_one_sentence(
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    glb = packed_with_meshopt("EXT_meshopt_compression")
    glb.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"].update(change)
    with pytest.raises(InputError, match=words) as error:
        load(glb, tmp_path)
    assert len(str(error.value)) < 400 and "\n" not in str(error.value)


def test_meshopt_without_its_package_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    glb = packed_with_meshopt("EXT_meshopt_compression")
    monkeypatch.setitem(sys.modules, "meshopt", None)
    with pytest.raises(InputError, match=r"compressed with meshopt; pip install 'moveit6d\["):
        load(glb, tmp_path)
