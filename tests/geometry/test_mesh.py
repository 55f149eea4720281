"""Meshes: files of every format, sizes, frames, normals, sampling and what is refused."""

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh, bounding_sphere, largest_distance, sphere_diameters
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries
from tests.support import meshes
from tests.support.trimeshes import TEXTURE, colored, textured

# Files


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_textured_files(tmp_path, suffix):
    textured().export(tmp_path / f"box.{suffix}")
    mesh = Mesh.load(tmp_path / f"box.{suffix}")
    assert mesh.name == "box"
    assert mesh.vertex_colors is None
    np.testing.assert_array_equal(mesh.texture, TEXTURE)
    assert mesh.uv.shape == (len(mesh.vertices), 2)
    corners = {tuple(np.round(row, 6)) for row in mesh.uv}
    assert corners == {(0, 0), (0, 1), (1, 0), (1, 1)}


@pytest.mark.parametrize("suffix", ["ply", "glb", "obj"])
def test_vertex_coloured_files(tmp_path, suffix):
    colored().export(tmp_path / f"box.{suffix}")
    mesh = Mesh.load(tmp_path / f"box.{suffix}")
    assert mesh.texture is None
    np.testing.assert_array_equal(np.unique(mesh.vertex_colors, axis=0).shape, (6, 3))


def test_stl_is_plain(tmp_path):
    colored().export(tmp_path / "box.stl")
    mesh = Mesh.load(str(tmp_path / "box.stl"))
    assert len(mesh.faces) == 12
    assert (mesh.vertex_colors == 160).all()


def test_ply_with_a_named_texture_file(tmp_path):
    Image.fromarray(TEXTURE).save(tmp_path / "skin.png")
    vertices, faces, uv, _ = meshes.box_arrays()
    lines = ["ply", "format ascii 1.0", "comment TextureFile skin.png", "element vertex 24"]
    lines += [f"property float {name}" for name in ("x", "y", "z", "texture_u", "texture_v")]
    lines += ["element face 12", "property list uchar int vertex_indices", "end_header"]
    rows = np.concatenate([vertices, uv], 1)
    lines += [" ".join(map(str, row)) for row in rows]
    lines += ["3 " + " ".join(map(str, face)) for face in faces]
    (tmp_path / "box.ply").write_text("\n".join(lines) + "\n")
    np.testing.assert_array_equal(Mesh.load(tmp_path / "box.ply").texture, TEXTURE)


def test_plain_material_colour_of_an_obj(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1.0 0.0 0.0\n")
    (tmp_path / "m.obj").write_text(
        "mtllib m.mtl\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nusemtl red\nf 1 2 3\n"
    )
    np.testing.assert_array_equal(
        Mesh.load(tmp_path / "m.obj", allow_flat=True).vertex_colors, [[255, 0, 0]] * 3
    )


def test_gltf_colour_factor_is_linear_light(tmp_path):
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 55, 0, 255])
    vertices, faces, uv, _ = meshes.box_arrays()
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    trimesh.Trimesh(vertices, faces, visual=visual, process=False).export(tmp_path / "m.glb")
    colors = Mesh.load(tmp_path / "m.glb", allow_flat=True).vertex_colors
    np.testing.assert_allclose(colors[0], [255, 127, 0], atol=1)


def test_gltf_colour_factor_dims_a_texture_but_the_grey_that_trimesh_writes_does_not(tmp_path):
    vertices, faces, uv, _ = meshes.box_arrays()
    for factor, expected in (([55, 255, 255], [100, 200, 200]), ([102] * 3, [200] * 3)):
        material = trimesh.visual.material.PBRMaterial(
            baseColorFactor=[*factor, 255],
            baseColorTexture=Image.new("RGB", (8, 8), (200, 200, 200)),
        )
        visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
        trimesh.Trimesh(vertices, faces, visual=visual, process=False).export(tmp_path / "m.glb")
        np.testing.assert_allclose(
            Mesh.load(tmp_path / "m.glb", allow_flat=True).texture[0, 0], expected, atol=1
        )


def test_sixteen_bit_and_transparent_textures(tmp_path):
    wide = np.full((4, 4), 200 * 256, np.uint16)
    for name, picture in (
        ("wide.png", Image.fromarray(wide)),
        ("clear.png", Image.new("RGBA", (4, 4), (200, 200, 200, 0))),
    ):
        picture.save(tmp_path / name)
        (tmp_path / "m.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
        (tmp_path / "m.obj").write_text(
            "mtllib m.mtl\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
            "usemtl a\nf 1/1 2/2 3/3\n"
        )
        np.testing.assert_allclose(
            Mesh.load(tmp_path / "m.obj", allow_flat=True).texture, 200, atol=1
        )


# Frames and sizes


def test_the_frame_is_centred_on_the_bounding_sphere():
    mesh = meshes.colored_box((0.1, 0.06, 0.04), offset=(1, 2, 3))
    diagonal = np.linalg.norm((0.1, 0.06, 0.04))
    np.testing.assert_allclose(mesh.center, [1, 2, 3], atol=1e-9)
    assert mesh.sphere_diameter == pytest.approx(diagonal)
    assert mesh.diameter == pytest.approx(diagonal)
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(diagonal / 2, rel=1e-6)
    assert (mesh.vertices.dtype, mesh.faces.dtype, mesh.normals.dtype) == ("f4", "i4", "f4")


def test_sphere_diameters_are_those_of_the_meshes_in_order():
    sides = [(0.1, 0.06, 0.04), (0.3, 0.2, 0.1)]
    found = sphere_diameters(meshes.colored_box(one) for one in sides)
    assert found.dtype == torch.float64
    np.testing.assert_allclose(found, np.linalg.norm(sides, axis=1), rtol=1e-6)


def test_sphere_and_evaluation_diameters_differ_for_a_tetrahedron():
    corners = 0.1 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    mesh = Mesh.from_arrays("t", corners, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    assert mesh.sphere_diameter == pytest.approx(0.2 * np.sqrt(3))
    assert mesh.diameter == pytest.approx(0.2 * np.sqrt(2))


@pytest.mark.parametrize("flat", [(0, 1, 2), (0, 1), (0,)])
def test_bounding_sphere_of_few_and_flat_points(flat):
    points = np.zeros((50, 3))
    points[:, list(flat)] = np.random.default_rng(0).uniform(-1, 1, (50, len(flat)))
    center, diameter = bounding_sphere(points)
    farthest = np.linalg.norm(points - center, axis=1).max()
    assert 2 * farthest == pytest.approx(diameter)
    # No sphere can be smaller than the largest distance nor need be larger than Jung's bound.
    largest = max(np.linalg.norm(a - b) for a in points for b in points)
    assert largest_distance(points) == pytest.approx(largest)
    assert largest <= diameter * (1 + 1e-9)
    assert diameter <= largest * np.sqrt(1.5) * 1.001


def test_millimetres_are_converted():
    vertices, faces, _, _ = meshes.box_arrays((100, 60, 40))
    mesh = Mesh.from_arrays("box", vertices + 1000, faces, unit="mm")
    assert mesh.diameter == pytest.approx(np.linalg.norm((0.1, 0.06, 0.04)))
    np.testing.assert_allclose(mesh.center, [1, 1, 1], atol=1e-9)


@pytest.mark.parametrize(("unit", "metres"), [("cm", 0.01), ("in", 0.0254), ("mm", 0.001)])
def test_units_that_are_no_metres(unit, metres):
    vertices, faces, _, _ = meshes.box_arrays((10, 6, 4))
    mesh = Mesh.from_arrays("box", vertices, faces, unit=unit)
    assert mesh.diameter == pytest.approx(metres * np.linalg.norm((10, 6, 4)))


def test_vertices_without_a_face_do_not_count():
    vertices, faces, _, colors = meshes.box_arrays()
    vertices = np.concatenate([[[9, 9, 9]], vertices])
    colors = np.concatenate([[[1, 1, 1]], colors]).astype(np.uint8)
    mesh = Mesh.from_arrays("box", vertices, faces + 1, vertex_colors=colors)
    assert mesh.diameter == pytest.approx(np.linalg.norm((0.1, 0.06, 0.04)))
    np.testing.assert_array_equal(mesh.vertex_colors, colors[1:])


def test_inner_and_outer_undo_each_other_and_show_the_same_points():
    mesh = meshes.colored_box(offset=(0.3, -0.2, 0.1))
    turns = np.stack([meshes.rotation(seed) for seed in (1, 2)])
    outer = Pose(torch.tensor(turns), torch.tensor([[0, 0, 1.0], [0.1, 0.2, 0.5]]).double())
    inner = mesh.inner(outer)
    torch.testing.assert_close(mesh.outer(inner).translation, outer.translation)
    centred = torch.from_numpy(mesh.vertices).double().expand(2, -1, 3)
    in_file = centred + torch.from_numpy(mesh.center)
    torch.testing.assert_close(
        inner.transform(centred), outer.transform(in_file), atol=1e-6, rtol=0
    )


@pytest.mark.parametrize("way", ["inner", "outer"])
def test_a_pose_in_the_other_frame_is_a_copy(way):
    pose = Pose(torch.eye(3).double(), torch.tensor([0, 0, 1.0]).double())
    other = getattr(meshes.colored_box(), way)(pose)
    other.rotation.numpy()[1:] *= -1
    other.translation.numpy()[:] = 7
    assert torch.equal(pose.rotation, torch.eye(3).double()) and pose.translation[2] == 1


@pytest.mark.parametrize("factor", [0.97, 1.04])
def test_a_scaled_mesh_looks_as_one_nearer_or_farther_by_that_factor(factor):
    mesh = meshes.colored_box(offset=(0.02, 0, 0.01))
    larger = mesh.scaled(factor)
    assert larger.sphere_diameter == pytest.approx(factor * mesh.sphere_diameter)
    assert larger.diameter == pytest.approx(factor * mesh.diameter)
    pose = Pose.from_rvec([0.3, -0.2, 0.5], [0.02, 0.01, 0.6])
    near, far = mesh.inner(pose).translation, larger.inner(pose).translation * factor
    seen, same = (
        one.vertices @ pose.rotation.numpy().T + place.numpy()
        for one, place in ((mesh, near), (larger, far))
    )
    np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], same[:, :2] / same[:, 2:], atol=1e-6)


def test_a_mesh_is_not_scaled_by_what_is_no_size():
    mesh = meshes.colored_box(offset=(0.02, 0, 0.01))
    assert mesh.scaled(1.0) is mesh
    for factor in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="cannot be scaled by"):
            mesh.scaled(factor)


def test_half_turns_that_are_symmetries_are_left_out():
    vertices, faces, _, _ = meshes.box_arrays((0.1, 0.06, 0.04))
    offset = np.array([0.3, -0.2, 0.1])

    def left(discrete=(), continuous=()):
        motions = np.array([np.diag([*signs, 1.0]) for signs in discrete]).reshape(-1, 4, 4)
        motions[:, :3, 3] = offset - motions[:, :3, :3] @ offset
        mesh = Mesh.from_arrays(
            "box", vertices + offset, faces, symmetries=Symmetries(motions, continuous)
        )
        return sorted(np.diag(turn)[:3].round(6).tolist() for turn in mesh.half_turns)

    x, y, z = [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]
    assert left() == [z, y, x]
    assert left([x]) == [z, y]
    assert left([x, y, z]) == []
    axis = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), offset)
    assert left(continuous=(axis,)) == [y, x]
    assert left([x], (axis,)) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vertices": [[0, 0, 0], [1, 0]]}, "box: the vertices must be numbers"),
        ({"vertices": [["a", "b", "c"]] * 8}, "box: the vertices must be numbers"),
        ({"vertices": None}, r"box: vertices must be \(V, 3\)"),
        ({"faces": [[0, 1, 2], [0, 1]]}, "box: the faces must be an array"),
        ({"faces": [["a", "b", "c"]]}, "box: faces must be integers"),
        ({"vertex_colors": [[0, 0, 0], [1, 0]]}, "box: the vertex colours must be an array"),
        ({"uv": [["a", "b"]] * 8, "texture": np.zeros((2, 2, 3), np.uint8)}, "must be numbers"),
        ({"uv": [[0, 0]] * 8, "texture": [[0], [1, 2]]}, "box: the texture must be an array"),
        ({"symmetries": np.eye(4)}, "symmetries must be a Symmetries"),
    ],
)
def test_what_are_no_arrays_is_said(change, words):
    vertices, faces, *_ = meshes.box_arrays((0.1, 0.1, 0.05))
    given = {"name": "box", "vertices": vertices, "faces": faces, **change}
    with pytest.raises(InputError, match=words):
        Mesh.from_arrays(**given)


def test_tensors_make_a_mesh_too():
    vertices, faces, *_ = meshes.box_arrays((0.1, 0.1, 0.05))
    points = torch.tensor(np.asarray(vertices)).requires_grad_()
    mesh = Mesh.from_arrays("box", points, torch.tensor(np.asarray(faces)))
    assert mesh.diameter == pytest.approx(0.15)


def test_a_generator_names_its_whole_group_as_in_a_file():
    vertices, faces, *_ = meshes.box_arrays((0.1, 0.1, 0.05))
    quarter = np.eye(4)
    quarter[:2, :2] = [[0, -1], [1, 0]]
    declared = Symmetries(quarter[None])
    mesh = Mesh.from_arrays("box", vertices, faces, symmetries=declared)
    assert len(mesh.motions) == 4 and mesh.symmetries is declared


def test_meshes_are_equal_only_to_themselves():
    first, second = meshes.colored_box(), meshes.colored_box()
    assert first == first
    assert first != second
    assert len({first, second, first}) == 2


# Normals


# Sampling


def test_sampled_points_lie_on_the_surface_evenly():
    mesh = meshes.colored_box((0.1, 0.06, 0.04), offset=(1, 0, 0))
    points = mesh.sample_points(6000, seed=3)
    assert points.shape == (6000, 3) and points.dtype == np.float64
    scaled = np.abs(points - (1, 0, 0)) / (0.05, 0.03, 0.02)
    np.testing.assert_allclose(scaled.max(1), 1, atol=1e-5)
    areas = np.array([0.06 * 0.04, 0.1 * 0.04, 0.1 * 0.06])
    share = np.bincount(scaled.argmax(1), minlength=3) / 6000
    np.testing.assert_allclose(share, areas / areas.sum(), atol=0.03)
    np.testing.assert_array_equal(points, mesh.sample_points(6000, seed=3))


# Bad input


def test_files_that_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such mesh file"):
        Mesh.load(tmp_path / "none.obj")
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(InputError, match="must be one of"):
        Mesh.load(tmp_path / "notes.txt")
    (tmp_path / "broken.glb").write_bytes(b"glTF broken")
    with pytest.raises(InputError, match="cannot be read"):
        Mesh.load(tmp_path / "broken.glb")
    (tmp_path / "points.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0 0 0\n"
    )
    with pytest.raises(InputError, match="no faces"):
        Mesh.load(tmp_path / "points.ply")


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".glb"])
def test_an_empty_file_is_refused(tmp_path, suffix):
    (tmp_path / f"empty{suffix}").write_bytes(b"")
    with pytest.raises(InputError, match=f"empty{suffix}"):
        Mesh.load(tmp_path / f"empty{suffix}")


def test_units_that_cannot_be_are_refused_with_the_likely_one():
    vertices, faces, _, _ = meshes.box_arrays((100, 60, 40))
    with pytest.raises(InputError, match=r"123 m across.*looks like unit 'cm' or 'mm' or 'in'"):
        Mesh.from_arrays("drill.ply", vertices, faces, unit="m")
    with pytest.raises(InputError, match="looks like unit 'm'"):
        Mesh.from_arrays("drill.ply", vertices / 1000, faces, unit="mm")
    with pytest.raises(InputError, match="scale the mesh"):
        Mesh.from_arrays("drill.ply", vertices * 1e6, faces, unit="m")
    with pytest.raises(InputError, match="'inch'"):
        Mesh.from_arrays("drill.ply", vertices, faces, unit="inch")


BOX = meshes.box_arrays()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vertices": np.full((24, 3), np.nan)}, "24 vertices are not finite numbers; repair"),
        ({"vertices": np.zeros((24, 3))}, "0 m across"),
        ({"vertices": BOX[0][:, :2]}, "must be .V, 3."),
        ({"faces": np.empty((0, 3), int)}, "no faces"),
        ({"faces": BOX[1] + 20}, "a vertex that is not there"),
        ({"faces": BOX[1].astype(float)}, "faces must be integers"),
        ({"texture": TEXTURE}, "together"),
        ({"texture": TEXTURE, "uv": np.full((24, 2), np.inf)}, "finite"),
        ({"texture": TEXTURE, "uv": BOX[2][:5]}, "texture coordinates"),
        ({"texture": TEXTURE / 255, "uv": BOX[2]}, "uint8"),
        ({"texture": TEXTURE, "uv": BOX[2], "vertex_colors": BOX[3]}, "not both"),
        ({"vertex_colors": BOX[3][:3]}, "vertex colours"),
        ({"vertex_colors": BOX[3] / 255}, "uint8"),
    ],
)
def test_arrays_that_are_refused(change, words):
    arrays = {"vertices": BOX[0], "faces": BOX[1], **change}
    with pytest.raises(InputError, match=words):
        Mesh.from_arrays("box.obj", arrays.pop("vertices"), arrays.pop("faces"), **arrays)


def test_vertices_that_no_face_uses_need_not_be_finite():
    vertices, faces, _, _ = meshes.box_arrays()
    plain = Mesh.from_arrays("box", vertices, faces)
    for wrong in (np.nan, np.inf):
        more = np.concatenate([np.full((2, 3), wrong), vertices, np.full((1, 3), wrong)])
        mesh = Mesh.from_arrays("box", more, faces + 2)
        np.testing.assert_array_equal(mesh.vertices, plain.vertices)
        np.testing.assert_array_equal(mesh.center, plain.center)
        assert (mesh.diameter, mesh.sphere_diameter) == (plain.diameter, plain.sphere_diameter)
