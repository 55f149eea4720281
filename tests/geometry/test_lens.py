"""The lens against OpenCV: maps, points, and patches seen through it without undistorting."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import PATCH_SIZE, View, crop_patch, look_at, patch_pixels
from moveit6d.geometry.lens import DistortionModel
from moveit6d.geometry.pose import Pose

K = np.array([[410.0, 0.0, 162.0], [0.0, 400.0, 118.0], [0.0, 0.0, 1.0]])
LENSES = {
    4: (-0.25, 0.08, 0.002, -0.001),
    5: (-0.3, 0.12, 0.001, -0.002, -0.02),
    8: (0.1, -0.05, 0.001, 0.002, 0.01, 0.2, 0.03, 0.01),
    12: (-0.2, 0.05, 0.001, -0.001, 0.0, 0.02, 0.01, 0.0, 0.003, -0.001, 0.002, 0.001),
    14: (-0.2, 0.05, 0.001, -0.001, 0.0, 0.02, 0.01, 0.0, 0.003, 0.0, 0.002, 0.0, 0.01, -0.02),
}
FISHEYE = (-0.05, 0.02, -0.01, 0.002)
CAMERAS = [
    *(Camera.from_matrix(K, 320, 240, lens) for lens in LENSES.values()),
    Camera.from_matrix(K, 320, 240, FISHEYE, "fisheye"),
]
NAMES = [*map(str, LENSES), "fisheye"]


def opencv_pixels(points: np.ndarray, camera: Camera) -> np.ndarray:
    zero, lens = np.zeros(3), np.array(camera.distortion)
    module = cv2.fisheye if camera.distortion_model == "fisheye" else cv2
    pixels, _ = module.projectPoints(points[:, None], zero, zero, camera.matrix.numpy(), lens)
    return np.asarray(pixels).reshape(-1, 2)


def opencv_undistorted(image: np.ndarray, camera: Camera) -> np.ndarray:
    matrix, lens = camera.matrix.numpy(), np.array(camera.distortion)
    if camera.distortion_model == "fisheye":
        return np.asarray(cv2.fisheye.undistortImage(image, matrix, lens, Knew=matrix))
    return np.asarray(cv2.undistort(image, matrix, lens))


def picture(width: int, height: int) -> np.ndarray:
    random = np.random.default_rng(0)
    noise = random.integers(0, 255, (height, width, 3), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 3))


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_directions_of_pixels_lead_back_to_them(camera: Camera) -> None:
    assert camera.lens is not None
    pixels = np.array([[162.0, 118.0], [10.0, 20.0], [300.0, 40.0], [60.0, 220.0]])
    rays = camera.lens.directions(pixels, camera.matrix.numpy())
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-9)
    np.testing.assert_allclose(opencv_pixels(rays, camera), pixels, atol=0.01)


def test_a_fisheye_has_directions_to_its_side_and_back() -> None:
    camera = Camera(100, 100, 0, 0, 400, 10, (0, 0, 0, 0), "fisheye")
    assert camera.lens is not None
    pixels = np.array([[100 * np.pi / 2, 0.0], [100 * np.radians(100), 0.0]])
    rays = camera.lens.directions(pixels, camera.matrix.numpy())
    angles = np.degrees(np.arctan2(rays[:, 0], rays[:, 2]))
    np.testing.assert_allclose(angles, [90, 100], atol=0.01)


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_points_of_arrays_and_of_tensors_land_where_opencv_puts_them(camera: Camera) -> None:
    random = np.random.default_rng(1)
    points = np.column_stack([random.uniform(-0.35, 0.35, (40, 2)), np.ones(40)])
    points *= random.uniform(0.3, 2.0, (40, 1))
    expected = opencv_pixels(points, camera)
    assert camera.lens is not None
    np.testing.assert_allclose(
        camera.lens.project(points, camera.matrix.numpy()), expected, atol=1e-9
    )
    np.testing.assert_allclose(
        camera.project(torch.from_numpy(points)).numpy(), expected, atol=1e-4
    )


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_whole_images_are_undistorted_as_opencv_does_it(camera: Camera) -> None:
    image = picture(320, 240)
    undone, pinhole = camera.undistort(torch.from_numpy(image).permute(2, 0, 1))
    assert pinhole.lens is None and pinhole.fx == camera.fx
    difference = undone.permute(1, 2, 0).numpy().astype(int) - opencv_undistorted(image, camera)
    assert np.abs(difference).max() <= 1
    floating, _ = camera.undistort(torch.from_numpy(image / 255.0).permute(2, 0, 1)[None])
    assert floating.shape == (1, 3, 240, 320) and floating.dtype == torch.float64
    assert (floating[0] * 255 - undone).abs().max() < 1.01


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_a_patch_through_the_lens_is_opencvs_undistorted_image(camera: Camera) -> None:
    """The virtual camera that looks ahead with the image's own K: no interpolation in between."""
    small = camera.crop(90, 50, PATCH_SIZE, PATCH_SIZE)
    image = picture(PATCH_SIZE, PATCH_SIZE)
    view = View(torch.eye(3).double(), small.matrix, torch.tensor(1.0).double())
    pixels = torch.from_numpy(image).permute(2, 0, 1)
    patch = crop_patch(pixels, view, small.matrix, small.lens) * 255
    difference = patch.permute(1, 2, 0).numpy() - opencv_undistorted(image, small)
    assert np.abs(difference[2:-2, 2:-2]).max() <= 1.5


@settings(max_examples=30, deadline=None)
@given(
    x=st.floats(-0.3, 0.3), y=st.floats(-0.2, 0.2), z=st.floats(0.4, 1.5),
    number=st.integers(0, len(CAMERAS) - 1),
)  # fmt: skip
def test_patch_pixels_are_the_projections_of_their_rays(
    x: float, y: float, z: float, number: int
) -> None:
    """Anywhere in the image: a point on a patch pixel's ray lies where OpenCV projects it."""
    camera = CAMERAS[number]
    pose = Pose(torch.eye(3).double(), torch.tensor([x * z, y * z, z]).double())
    view = look_at(pose, torch.tensor(0.1).double())
    u, v = patch_pixels(view, camera.matrix, camera.lens)
    places = np.array([[0.0, 0.0], [63.0, 64.0], [127.0, 3.0], [40.0, 127.0]])
    rays = np.column_stack([places, np.ones(4)]) @ np.linalg.inv(view.intrinsics.numpy()).T
    expected = opencv_pixels(rays @ view.rotation.numpy(), camera)
    row, column = places[:, 1].astype(int), places[:, 0].astype(int)
    found = np.column_stack([u.numpy()[row, column], v.numpy()[row, column]])
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_skew_shears_points_patches_and_whole_images_alike() -> None:
    skewed = Camera(400, 400, 160, 120, 320, 240, LENSES[5], skew=25.0)
    straight = Camera(400, 400, 160, 120, 320, 240, LENSES[5])
    point = torch.tensor([[0.1, 0.2, 1.0]]).double()
    moved = skewed.project(point) - straight.project(point)
    y = float(straight.project(point)[0, 1] - 120) / 400
    assert moved.tolist()[0] == pytest.approx([25 * y, 0.0], abs=1e-9)
    view = look_at(Pose(torch.eye(3).double(), point[0]), torch.tensor(0.1).double())
    u, v = patch_pixels(view, skewed.matrix, skewed.lens)
    middle = [float(plane[63:65, 63:65].mean()) for plane in (u, v)]
    assert middle == pytest.approx(skewed.project(point)[0].tolist(), abs=0.01)
    whole = Camera(400, 400, 160, 120, 320, 240, skew=25.0)
    expected = torch.linalg.inv(whole.matrix) @ torch.tensor([200.0, 180.0, 1.0]).double()
    assert whole.project(expected).tolist() == pytest.approx([200.0, 180.0])


@pytest.mark.parametrize(("lens", "model"), [(LENSES[5], "opencv"), (FISHEYE, "fisheye")])
def test_pixels_of_a_skewed_camera_are_those_of_its_pinhole(
    lens: tuple[float, ...], model: DistortionModel
) -> None:
    camera = Camera(400, 410, 160, 120, 320, 240, lens, model, skew=25.0)
    random = np.random.default_rng(2)
    points = np.column_stack([random.uniform(-0.3, 0.3, (40, 2)), np.ones(40)])
    matrix = camera.matrix.numpy()
    assert camera.lens is not None
    pixels = camera.lens.project(points, matrix)
    before = pixels.copy()
    expected = (points @ matrix.T)[:, :2]
    np.testing.assert_allclose(camera.lens.undistort(pixels, matrix), expected, atol=1e-6)
    np.testing.assert_array_equal(pixels, before)


def test_beyond_its_reach_a_lens_shows_nothing() -> None:
    """A barrel polynomial turns back far outside: those rays would show the middle again."""
    camera = Camera(300, 300, 159.5, 119.5, 320, 240, (-0.35, 0.0, 0.0, 0.0))
    assert camera.lens is not None
    # r (1 − 0.35 r²) is largest where its derivative 1 − 1.05 r² is zero.
    assert camera.lens.reach == pytest.approx(1 / np.sqrt(1.05), abs=2e-3)
    assert camera.lens.shows(np.array([[0.9, 0, 1.0], [1.1, 0, 1.0], [0, 0, -1.0]])).tolist() == [
        True,
        False,
        False,
    ]
    pose = Pose(torch.eye(3).double(), torch.tensor([1.5, 0.0, 1.0]).double())
    view = look_at(pose, torch.tensor(0.2).double())
    white = torch.full((3, 240, 320), 255, dtype=torch.uint8)
    assert crop_patch(white, view, camera.matrix, camera.lens).max() == 0
    assert Camera(300, 300, 160, 120, 320, 240, (0.1, 0.0, 0.0, 0.0)).lens.reach == np.inf  # type: ignore[union-attr]


def test_beyond_its_reach_whole_images_are_black() -> None:
    camera = Camera(600, 580, 330.0, 235.0, 640, 480, (0.05, -0.1, 0, 0, -2), skew=4.0)
    white = torch.full((1, 480, 640), 255, dtype=torch.uint8)
    undone, pinhole = camera.undistort(white)
    v, u = torch.meshgrid(torch.arange(480), torch.arange(640), indexing="ij")
    tangent = pinhole.unproject(torch.stack([u, v], -1))[..., :2].norm(dim=-1)
    assert camera.lens is not None
    beyond = tangent >= camera.lens.reach
    assert 100 < beyond.sum() < 200_000 and (undone[0][beyond] == 0).all()
    assert (undone[0][tangent < 0.8 * camera.lens.reach] == 255).all()


def test_a_fisheye_of_zeros_is_still_no_pinhole() -> None:
    fisheye = Camera(200, 200, 160, 120, 320, 240, (0.0,) * 4, "fisheye")
    pixel = fisheye.project(torch.tensor([1.0, 0.0, 1.0]).double())
    assert float(pixel[0]) == pytest.approx(160 + 200 * np.pi / 4)  # equidistant: f·θ
    assert Camera(200, 200, 160, 120, 320, 240, (0.0,) * 5).lens is None


def test_projection_through_a_lens_has_gradients() -> None:
    camera = CAMERAS[1]
    point = torch.tensor([0.1, 0.05, 0.8], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(camera.project, (point,))


@pytest.mark.parametrize(
    ("lens", "model", "words"),
    [
        ((0.1,) * 3, "opencv", "4 or 5 or 8 or 12 or 14"),
        ((0.1,) * 5, "fisheye", "k1, k2, k3, k4"),
        ((1e308, 0, 0, 0), "opencv", "no lens"),
        ((float("nan"), 0, 0, 0), "opencv", "finite"),
        ((0.1,) * 4, "omni", "'opencv' or 'fisheye'"),
        (None, "fisheye", "coefficients"),
        (np.zeros((2, 3)), "opencv", "list of numbers"),
        (["a"], "opencv", "numbers"),
    ],
)
def test_impossible_lenses_are_refused(lens: object, model: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Camera(400, 400, 160, 120, 320, 240, lens, model)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("lens", "model", "words"),
    [
        ((-0.9, 0, 0, 0, 0), "opencv", "fold the picture 250 pixels from its centre"),
        ((-0.9, 0, 0, 0, 0, 0, 0, 0), "opencv", "fold the picture 250 pixels"),
        ((-0.7, 0, 0, 0), "fisheye", "fold the picture 283 pixels"),
        ((100, -200, 0, 0, 0), "opencv", r"corners out to 3\.8 times"),
        ((0.1, 0.2, 0, 0, 0, -5, 0, 0), "opencv", r"corners out to 2\.0 times"),  # divides by zero
    ],
)
@pytest.mark.filterwarnings("error")
def test_pictures_that_fold_are_refused(
    lens: tuple[float, ...], model: DistortionModel, words: str
) -> None:
    with pytest.raises(InputError, match=words + ".*check the calibration"):
        Camera.from_matrix([[615, 0, 319.5], [0, 615, 239.5], [0, 0, 1]], 640, 480, lens, model)


@pytest.mark.parametrize(
    ("numbers", "lens", "model"),
    [
        # Published: EuRoC, KITTI, TUM RGB-D, Azure Kinect (rational), TUM VI, RealSense T265.
        ((458.7, 457.3, 367.2, 248.4, 752, 480), (-0.2834, 0.07396, 0.0002, 0.0), "opencv"),
        ((984, 981, 690, 233, 1392, 512), (-0.3729, 0.2037, 0.002, 0.001, -0.072), "opencv"),
        ((517.3, 516.5, 318.6, 255.3, 640, 480), (0.262, -0.953, -0.005, 0.003, 1.163), "opencv"),
        ((607, 607, 638, 367, 1280, 720), (0.5, -2.7, 0, 0, 1.56, 0.38, -2.5, 1.48), "opencv"),
        ((191, 191, 254.9, 256.9, 512, 512), (0.00348, 0.000715, -0.00205, 0.0002), "fisheye"),
        ((286, 286, 415, 398, 848, 800), (-0.0066, 0.0385, -0.0363, 0.0061), "fisheye"),
        # Folds close to the corners; and a long lens, of large coefficients that mean little.
        ((300, 300, 159.5, 119.5, 320, 240), (-0.45, 0.0, 0.0, 0.0), "opencv"),
        ((20000, 20000, 959.5, 539.5, 1920, 1080), (5, -3000, 0, 0, 1e5), "opencv"),
    ],
)
def test_strong_and_long_lenses_are_none_of_those(
    numbers: tuple[float, float, float, float, int, int],
    lens: tuple[float, ...],
    model: DistortionModel,
) -> None:
    fx, fy, cx, cy, width, height = numbers
    k = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    camera = Camera.from_matrix(k, width, height, lens, model)
    assert camera == Camera(*numbers, lens, model)


WEBCAM = Camera(1000, 1000, 639.5, 359.5, 1280, 720, (-0.3, 0.09, 0.0, 0.0, 0.0))


def shown_by(camera: Camera, pinhole: Camera) -> np.ndarray:
    """Which of pixels all over a camera's picture a pinhole camera shows, too, within 2 pixels."""
    assert camera.lens is not None
    x, y = np.meshgrid(np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 25))
    pixels = np.stack([x, y], -1).reshape(-1, 2)
    rays = camera.lens.directions(pixels, camera.matrix.numpy())
    places = pinhole.project(rays).numpy()
    ahead = (rays[:, 2] > 0)[:, None]
    return (ahead & (places > -2) & (places < [pinhole.width + 1, pinhole.height + 1])).all(1)


@pytest.mark.parametrize("camera", [WEBCAM, *CAMERAS], ids=["webcam", *NAMES])
def test_the_full_pinhole_shows_all_that_the_lens_does(camera: Camera) -> None:
    found = camera.full_pinhole
    assert found.lens is None and (found.fx, found.fy) == (camera.fx, camera.fy)
    assert shown_by(camera, found).all()
    assert (found.cx - camera.cx).is_integer() and (found.cy - camera.cy).is_integer()


def test_the_usual_pinhole_loses_the_border_of_a_barrel_lens() -> None:
    assert shown_by(WEBCAM, WEBCAM.pinhole).mean() < 0.85


@pytest.mark.parametrize(
    "lens", [(0.2, 0.05, 0.0, 0.0), (0.1, 0.0, 0.001, 0.001), (-1e-5, 0, 0, 0)]
)
def test_where_nothing_is_lost_the_full_pinhole_is_the_usual_one(lens: tuple[float, ...]) -> None:
    camera = Camera(400, 400, 159.5, 119.5, 320, 240, lens)
    assert camera.full_pinhole == camera.pinhole


@pytest.mark.parametrize(("focal", "shown"), [(1200, 1.0), (611, 0.9), (500, 0.75)])
def test_the_full_pinhole_is_of_a_bounded_size(focal: int, shown: float) -> None:
    camera = Camera(focal, focal, 639.5, 479.5, 1280, 960, (0.0,) * 4, "fisheye")
    found = camera.full_pinhole
    assert 1280 * 960 < found.width * found.height <= 3 * 1280 * 960
    assert shown_by(camera, found).mean() >= shown > shown_by(camera, camera.pinhole).mean()
    assert np.degrees(np.arctan(found.width / 2 / focal)) < 65.1
    # So wide a lens shows more than 65 degrees within the usual image.
    wider = Camera(200, 200, 639.5, 479.5, 1280, 960, (0.0,) * 4, "fisheye")
    assert wider.full_pinhole == wider.pinhole


def test_a_window_beside_the_axis_has_a_full_pinhole() -> None:
    window = WEBCAM.crop(900, 50, 300, 200)  # the axis is outside of it
    assert shown_by(window, window.full_pinhole).all()
