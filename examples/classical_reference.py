"""Reference poses of a textured box in a video, by classical means: corner points and edges.

Never uses the library's network, so that the tracker has something independent to be compared
with. Points are followed from frame to frame (Lucas-Kanade, forward and backward), the edges of
the box are searched for along their normals, and both together give the pose by robust
Gauss-Newton. On a sharp, slow video of a printed box this is good to about a pixel.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from moveit6d import Camera, Pose
from moveit6d.geometry.rotation import exp_so3

Floats = NDArray[np.float64]
Grey = NDArray[np.uint8]  # (H, W)
FEWEST_POINTS = 120
SEARCH = 6  # pixels on each side of an edge


def follow_box(
    corners: Floats, sides: NDArray[np.int64], camera: Camera, start: Pose, frames: Iterable[Grey]
) -> Iterator[Pose]:
    """A pose for each grey frame (H, W) uint8.

    The box has corners (8, 3) in metres and sides (6, 4), each four corners in order as seen from
    outside or inside. `start` is roughly right in the first frame.
    """
    pose, before = start, None
    pixels, points = np.zeros((0, 2), np.float32), np.zeros((0, 3))
    for frame in frames:
        if before is None:
            for _ in range(4):
                pose = _fit(pose, camera, frame, corners, sides, pixels, points)
        else:
            pixels, points = _tracked(before, frame, pixels, points)
            # First the points alone: they know where the box has gone.
            pose = _fit(pose, camera, None, corners, sides, pixels, points)
            pose = _fit(pose, camera, frame, corners, sides, pixels, points)
            near = np.linalg.norm(_project(pose, camera, points) - pixels, axis=1) < 1.5
            pixels, points = pixels[near], points[near]
        if len(pixels) < FEWEST_POINTS:
            pixels, points = _new_points(frame, pose, camera, corners, sides)
        before = frame
        yield pose


def visible_sides(pose: Pose, corners: Floats, sides: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The sides (4,) that look towards the camera."""
    seen = pose.transform(torch.from_numpy(corners)).numpy()
    middle = seen.mean(0)
    found = []
    for side in sides:
        a, b, c, _ = seen[side]
        normal = np.cross(b - a, c - a)
        center = seen[side].mean(0)
        normal = normal * np.sign(normal @ (center - middle))
        if normal @ center < -0.05 * np.linalg.norm(normal) * np.linalg.norm(center):
            found.append(side)
    return found


def _tracked(
    before: Grey, frame: Grey, pixels: NDArray[np.float32], points: Floats
) -> tuple[NDArray[np.float32], Floats]:
    window, levels = (15, 15), 3
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, frame, pixels[:, None], None, winSize=window, maxLevel=levels
    )
    back, found2, _ = cv2.calcOpticalFlowPyrLK(
        frame, before, there, None, winSize=window, maxLevel=levels
    )
    error = np.linalg.norm(back[:, 0] - pixels, axis=1)
    good = (found[:, 0] == 1) & (found2[:, 0] == 1) & (error < 0.5)
    return there[good, 0], points[good]


def _new_points(
    frame: Grey, pose: Pose, camera: Camera, corners: Floats, sides: NDArray[np.int64]
) -> tuple[NDArray[np.float32], Floats]:
    """Good features on the visible sides, and where on the box they are."""
    pixels, points = [], []
    placed = pose.transform(torch.from_numpy(corners)).numpy()
    for side in visible_sides(pose, corners, sides):
        outline = camera.project(torch.from_numpy(placed[side])).numpy()
        mask = np.zeros(frame.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.rint(outline).astype(np.int32), 255)
        mask = cv2.erode(mask, np.ones((9, 9), np.uint8))
        found = cv2.goodFeaturesToTrack(frame, 120, 0.01, 4, mask=mask)
        if found is None:
            continue
        a, b, c, _ = placed[side]
        normal = np.cross(b - a, c - a)
        rays = (
            np.concatenate([found[:, 0], np.ones((len(found), 1))], 1)
            @ np.linalg.inv(camera.matrix.numpy()).T
        )
        hit = rays * (normal @ a / (rays @ normal))[:, None]
        back = pose.inverse().transform(torch.from_numpy(hit)).numpy()
        pixels.append(found[:, 0])
        points.append(back)
    return np.concatenate(pixels).astype(np.float32), np.concatenate(points)


def _fit(
    pose: Pose,
    camera: Camera,
    frame: Grey | None,
    corners: Floats,
    sides: NDArray[np.int64],
    pixels: NDArray[np.float32],
    points: Floats,
) -> Pose:
    """Robust Gauss-Newton on point distances and, with a frame, on distances from image edges."""
    for _ in range(8):
        rows, errors = _point_equations(pose, camera, pixels, points)
        if frame is not None:
            more, distances = _edge_equations(pose, camera, frame, corners, sides)
            rows, errors = np.concatenate([rows, more]), np.concatenate([errors, distances])
        scale = max(1.5 * float(np.median(np.abs(errors))), 0.3)
        weight = np.clip(1 - (errors / (3 * scale)) ** 2, 0, None) ** 2  # Tukey
        normal = rows.T @ (weight[:, None] * rows) + 1e-9 * np.eye(6)
        step = np.linalg.solve(normal, rows.T @ (weight * errors))
        turn = exp_so3(torch.from_numpy(step[:3]))
        # Turned about the box's own origin: pose = (turn · R, t + step).
        pose = Pose(turn @ pose.rotation, pose.translation + torch.from_numpy(step[3:]))
    return pose


def _point_equations(
    pose: Pose, camera: Camera, pixels: NDArray[np.float32], points: Floats
) -> tuple[Floats, Floats]:
    if len(points) == 0:
        return np.zeros((0, 6)), np.zeros(0)
    jacobian = _jacobian(pose, camera, points)
    error = pixels - _project(pose, camera, points)
    return jacobian.reshape(-1, 6), error.reshape(-1)


def _edge_equations(
    pose: Pose, camera: Camera, frame: Grey, corners: Floats, sides: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """For places along visible edges: the strongest step across the edge nearby."""
    edges = {
        tuple(sorted((int(side[k]), int(side[(k + 1) % 4]))))
        for side in visible_sides(pose, corners, sides)
        for k in range(4)
    }
    share = np.linspace(0.06, 0.94, 30)[:, None]
    smooth = cv2.GaussianBlur(frame.astype(np.float32), (0, 0), 1.0)
    rows, errors = [], []
    for first, second in sorted(edges):
        places = corners[first] + share * (corners[second] - corners[first])
        pixels = _project(pose, camera, places)
        along = pixels[-1] - pixels[0]
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        reach = np.arange(-SEARCH - 1, SEARCH + 2)
        lines = pixels[:, None] + reach[:, None] * across  # (30, 15, 2)
        profile = cv2.remap(smooth, lines.astype(np.float32), None, cv2.INTER_LINEAR)
        slope = np.abs(profile[:, 2:] - profile[:, :-2])
        best = slope.argmax(1)
        strong = (slope.max(1) > 8) & (best > 0) & (best < slope.shape[1] - 1)
        index = np.flatnonzero(strong)
        left, top, right = (slope[index, best[index] + d] for d in (-1, 0, 1))
        fine = 0.5 * (left - right) / np.minimum(left - 2 * top + right, -1e-6)
        rows.append(np.einsum("k,nkj->nj", across, _jacobian(pose, camera, places[index])))
        errors.append(best[index] - SEARCH + fine)
    return np.concatenate(rows), np.concatenate(errors)


def _jacobian(pose: Pose, camera: Camera, points: Floats) -> Floats:
    """Pixels of points by turn (about the origin of the box) and shift: (N, 2, 6)."""
    turned = points @ pose.rotation.numpy().T
    x, y, z = (turned + pose.translation.numpy()).T
    zero = np.zeros_like(x)
    by_place = np.stack(
        [
            np.stack([camera.fx / z, zero, -camera.fx * x / z**2], -1),
            np.stack([zero, camera.fy / z, -camera.fy * y / z**2], -1),
        ],
        1,
    )
    a, b, c = turned.T
    by_turn = np.stack(
        [np.stack([zero, c, -b], -1), np.stack([-c, zero, a], -1), np.stack([b, -a, zero], -1)], 1
    )
    return np.concatenate([by_place @ by_turn, by_place], -1)


def _project(pose: Pose, camera: Camera, points: Floats) -> Floats:
    return np.asarray(camera.project(pose.transform(torch.from_numpy(points))).numpy())
