"""Photos of boards, drawn by OpenCV through known lenses."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from moveit6d.camera_calibration import Board
from moveit6d.geometry.camera import Camera

WIDTH = 480


HEIGHT = 360


STANDARD = Camera(400, 404, 236, 182, WIDTH, HEIGHT, (-0.25, 0.08, 0.001, -0.001, 0.0))


FISHEYE = Camera(380, 384, 243, 176, WIDTH, HEIGHT, (-0.03, 0.01, -0.004, 0.001), "fisheye")


SQUARE = 40  # pixels of the printed board


@lru_cache(maxsize=4)
def rays(camera: Camera) -> NDArray[np.float64]:
    """Where each pixel of a picture twice as fine looks, by OpenCV: (2H · 2W, 3)."""
    x, y = np.meshgrid(np.arange(2 * WIDTH), np.arange(2 * HEIGHT))
    pixels = ((np.stack([x, y], -1).reshape(-1, 1, 2) + 0.5) / 2 - 0.5).astype(np.float64)
    module = cv2.fisheye if camera.distortion_model == "fisheye" else cv2
    plane = module.undistortPoints(pixels, camera.matrix.numpy(), np.array(camera.distortion))
    return np.column_stack([plane.reshape(-1, 2), np.ones(len(pixels))])


def photo(board: Board, camera: Camera, turn: Any, shift: Any) -> NDArray[np.uint8]:
    """The board (x right, y down, in squares) before grey, as the camera sees it."""
    plane = np.column_stack([turn[:, 0], turn[:, 1], shift])
    place = rays(camera) @ np.linalg.inv(plane).T
    spot = ((place[:, :2] / place[:, 2:] + 1) * SQUARE - 0.5).astype(np.float32)
    spot = spot.reshape(2 * HEIGHT, 2 * WIDTH, 2)
    drawn = cv2.remap(
        board.draw(SQUARE, SQUARE), spot[..., 0], spot[..., 1], cv2.INTER_LINEAR, borderValue=128
    )
    small = cv2.resize(drawn, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return np.asarray(small)[..., None].repeat(3, -1)


def photos(board: Board, camera: Camera, count: int) -> list[NDArray[np.uint8]]:
    """Photos from all sides: near and far, tilted, in every part of the picture."""
    random = np.random.default_rng(0)
    middle, found = np.array([board.columns / 2, board.rows / 2, 0.0]), []
    for _ in range(count):
        angles = [*random.uniform(-40, 40, 2), random.uniform(-20, 20)]
        turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        depth = random.uniform(1.5, 2.2) * board.rows
        centre = np.array([*random.uniform(-0.25, 0.25, 2) * depth, depth])
        found.append(photo(board, camera, turn, centre - turn @ middle))
    return found
