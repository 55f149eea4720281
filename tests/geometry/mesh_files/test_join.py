"""Parts become one surface: transforms, atlases, repeated textures."""

import numpy as np
import trimesh
from PIL import Image

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.mesh_files.content import MeshPart
from moveit6d.geometry.mesh_files.join import join
from tests.support import meshes
from tests.support.trimeshes import TEXTURE, colored, textured


def test_a_scene_is_joined_with_its_transforms(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(colored(), transform=trimesh.transformations.translation_matrix([0.2, 0, 0]))
    scene.add_geometry(colored())
    scene.export(tmp_path / "scene.glb")
    mesh = Mesh.load(tmp_path / "scene.glb")
    assert len(mesh.faces) == 24
    in_file = mesh.vertices + mesh.center
    np.testing.assert_allclose(in_file.min(0), [-0.05, -0.03, -0.02], atol=1e-6)
    np.testing.assert_allclose(in_file.max(0), [0.25, 0.03, 0.02], atol=1e-6)


def sampled(mesh: Mesh) -> np.ndarray:
    """The texture's colour at each vertex, moved a little towards its face's middle."""
    middle = mesh.uv[mesh.faces].mean(1, keepdims=True)
    uv = (0.7 * mesh.uv[mesh.faces] + 0.3 * middle).reshape(-1, 2)
    height, width = mesh.texture.shape[:2]
    x, y = (uv[:, 0] * width).astype(int), ((1 - uv[:, 1]) * height).astype(int)
    return mesh.texture[y, x].reshape(-1, 3, 3)


def test_several_textures_are_packed_into_one(tmp_path):
    red = np.full((8, 8, 3), (200, 0, 0), np.uint8)
    blue = np.full((20, 6, 3), (0, 0, 200), np.uint8)
    scene = trimesh.Scene([textured(red), textured(blue, shift=(0.2, 0, 0))])
    scene.export(tmp_path / "two.glb")
    mesh = Mesh.load(tmp_path / "two.glb")
    left = (mesh.vertices + mesh.center)[mesh.faces][:, 0, 0] < 0.1
    colors = sampled(mesh)
    np.testing.assert_array_equal(np.unique(colors[left].reshape(-1, 3), axis=0), [[200, 0, 0]])
    np.testing.assert_array_equal(np.unique(colors[~left].reshape(-1, 3), axis=0), [[0, 0, 200]])


def test_parts_that_share_a_texture_keep_it_as_it_is():
    vertices, faces, uv, _ = meshes.box_arrays()
    part = MeshPart(vertices, faces, 3 * uv.astype(np.float32), TEXTURE)
    joined = join([part, MeshPart(vertices + 1, faces, uv.astype(np.float32), TEXTURE.copy())])
    np.testing.assert_array_equal(joined.texture, TEXTURE)
    np.testing.assert_array_equal(joined.uv, np.concatenate([3 * uv, uv]).astype(np.float32))
    np.testing.assert_array_equal(joined.faces, np.concatenate([faces, faces + 24]))


def test_large_textures_are_reduced_to_fit_one_atlas():
    vertices, faces, uv, _ = meshes.box_arrays()
    parts = [
        MeshPart(vertices, faces, uv.astype(np.float32), np.full((2048, 2048, 3), grey, np.uint8))
        for grey in range(40, 45)
    ]
    joined = join(parts)
    assert max(joined.texture.shape) <= 4096 + 100
    assert set(np.unique(joined.texture)) >= set(range(40, 45))


def test_an_obj_with_a_texture_and_a_plain_material(tmp_path):
    Image.fromarray(np.full((8, 8, 3), (0, 200, 0), np.uint8)).save(tmp_path / "green.png")
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd green.png\nnewmtl b\nKd 1 0 0\n")
    (tmp_path / "m.obj").write_text(
        "mtllib m.mtl\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\n"
        "vt 0.1 0.1\nvt 0.9 0.1\nvt 0.1 0.9\nvt 0.9 0.9\n"
        "usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 2/2 4/4 3/3\n"
    )
    mesh = Mesh.load(tmp_path / "m.obj")
    colors = {tuple(color) for color in sampled(mesh).reshape(-1, 3)}
    assert colors == {(0, 200, 0), (255, 0, 0)}


def test_repeating_textures_of_several_materials_are_laid_out_in_the_atlas(tmp_path):
    green = textured(np.full((8, 8, 3), (0, 200, 0), np.uint8))
    green.visual.uv = green.visual.uv * 3.0
    trimesh.Scene([green, textured(TEXTURE, shift=(0.2, 0, 0))]).export(tmp_path / "two.glb")
    mesh = Mesh.load(tmp_path / "two.glb")
    left = (mesh.vertices + mesh.center)[mesh.faces][:, 0, 0] < 0.1
    colors = sampled(mesh)
    np.testing.assert_array_equal(np.unique(colors[left].reshape(-1, 3), axis=0), [[0, 200, 0]])
    assert len(np.unique(colors[~left].reshape(-1, 3), axis=0)) > 3


def test_too_many_faces_for_a_texture_take_the_texel_at_each_vertex(monkeypatch):
    monkeypatch.setattr("moveit6d.geometry.mesh_files.charts.MAX_SIDE", 4)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    top, bottom = (200, 0, 0), (0, 0, 200)
    picture = np.array([[top, top], [bottom, bottom]], np.uint8)
    uv = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)
    varied = np.array([[10, 20, 30], [40, 50, 60], [70, 80, 90], [1, 2, 3]], np.uint8)
    joined = join(
        [MeshPart(corners, faces, uv, picture), MeshPart(corners + 2, faces, colors=varied)]
    )
    assert joined.texture is None
    np.testing.assert_array_equal(joined.colors[:4], [bottom, bottom, top, top])
    np.testing.assert_array_equal(joined.colors[4:], varied)
