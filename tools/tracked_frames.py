"""Frames of tracks, and how wrong the poses are: with the mesh's colours or without.

Of synthetic sequences in which the object goes away for a while, or of ones that were made before.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from moveit6d import Camera, Mesh, Pose, PoseTracker
from moveit6d.config import RecoveryConfig, TrackerConfig
from moveit6d.datasets.sequences import read_sequences
from moveit6d.evaluation.metrics import ADD_LIMIT, add_s
from moveit6d.policies import NetworkPolicy
from moveit6d.synthesis.sequences.sequence import Scene

DIFFICULTIES = ("occ", "fast", "hard")
FRAMES, GONE = 44, range(16, 30)  # of a sequence, and those that are other pictures
# Without colours a track drifts: longer ones, which start anew from the true pose after so many
# wrong frames in a row.
UNCOLOURED_FRAMES, UNCOLOURED_GONE = 60, range(44, 56)
WRONG = 8
NEVER = TrackerConfig(recovery=RecoveryConfig(enabled=False))
BORDERLINE = 1.5  # errors between the limit and so many times it are neither right nor wrong
POINTS = 1000  # on a surface
TURN = 30.0  # degrees
ROUND = 1.25  # how much farther apart surfaces are after a turn than points of one surface


@dataclass(frozen=True)
class Example:
    """A pose: its evidence, the confidence first; its error in diameters; and of which mesh."""

    evidence: tuple[float, float]
    error: float
    mesh: str

    @property
    def right(self) -> bool:
        """Whether the error is below the limit of ADD."""
        return self.error < ADD_LIMIT

    @property
    def borderline(self) -> bool:
        """Whether the pose is neither right nor wrong."""
        return ADD_LIMIT <= self.error < BORDERLINE * ADD_LIMIT


Views = Iterable[tuple[NDArray[np.uint8], Pose, bool]]


def tracked_frames(
    mesh: Mesh,
    photos: Sequence[NDArray[np.uint8]],
    policy: NetworkPolicy,
    seed: int,
    coloured: bool = True,
) -> Iterator[Example]:
    """Results that have a pose and the contour's agreement, which is their second evidence.

    The error is infinite where the object is away. Without `coloured` the tracker gets the mesh
    without its colours, and a solid of revolution is scored by ADD-S: nobody sees how it is turned.
    """
    random = np.random.default_rng(seed)
    frames, gone = (FRAMES, GONE) if coloured else (UNCOLOURED_FRAMES, UNCOLOURED_GONE)
    for order, difficulty in enumerate(DIFFICULTIES):
        scene = Scene(mesh, seed + 500 + order, frames, difficulty, photos)
        views = _views(scene, frames, gone, photos, random)
        yield from _followed(mesh, mesh.name, scene.camera, views, policy, coloured)


def uncoloured_frames(folder: Path, policy: NetworkPolicy) -> Iterator[Example]:
    """The same of the sequences DIFFICULTY_MESH in a folder, without the meshes' colours."""
    for sequence in read_sequences(folder):
        views = (
            (frame.image, sequence.truth[frame.index], False)
            for frame in sequence.open()
            if frame.image is not None and frame.index in sequence.truth
        )
        mesh, name = sequence.load_mesh(), sequence.name.partition("_")[2]
        yield from _followed(mesh, name, sequence.camera, views, policy, coloured=False)


def _views(
    scene: Scene,
    frames: int,
    gone: range,
    photos: Sequence[NDArray[np.uint8]],
    random: np.random.Generator,
) -> Views:
    """Pictures, true poses, and whether the picture is another one."""
    from PIL import Image

    size = (scene.camera.width, scene.camera.height)
    for k in range(frames):
        frame = scene.render_frame(k)
        image = frame.image
        if k in gone:
            photo = photos[int(random.integers(len(photos)))]
            image = np.array(Image.fromarray(photo).resize(size))
        yield image, frame.pose, k in gone


def _followed(
    mesh: Mesh, name: str, camera: Camera, views: Views, policy: NetworkPolicy, coloured: bool
) -> Iterator[Example]:
    """The track of the views after the first, which starts anew from where the object was away."""
    known = mesh if coloured else without_colours(mesh)
    symmetric = not coloured and is_round(mesh)
    points = torch.from_numpy(mesh.sample_points(POINTS if symmetric else POINTS // 2))
    every = iter(views)
    _, before, was_away = next(every)
    tracker, wrong = PoseTracker(known, camera, before, policy=policy, config=NEVER), 0
    for image, true, away in every:
        if was_away > away or (wrong == WRONG and not coloured):
            tracker.reset(before)
            wrong = 0
        result, error = tracker.update(image), np.inf
        if result.pose is not None and not away:
            error = float(add_s(result.pose, true, points, symmetric)) / mesh.diameter
        wrong = wrong + 1 if error >= ADD_LIMIT and not away else 0
        before, was_away = true, away
        if result.pose is not None and result.contour_agreement is not None:
            yield Example((result.confidence, result.contour_agreement), error, name)


def without_colours(mesh: Mesh) -> Mesh:
    """The mesh in one flat colour."""
    return Mesh.from_arrays(mesh.name, mesh.vertices + mesh.center, mesh.faces)


def is_round(mesh: Mesh) -> bool:
    """Whether the shape is a solid of revolution, as nearly as points on it tell."""
    points = mesh.sample_points(POINTS) - mesh.center
    others = torch.from_numpy(mesh.sample_points(POINTS, seed=1) - mesh.center)
    _, axes = np.linalg.eigh(np.cov(points.T))

    def apart(rotation: NDArray[np.float64]) -> float:
        turned = torch.from_numpy(points @ rotation.T)
        return float(torch.cdist(turned, others).amin(1).mean())

    turns = Rotation.from_rotvec(np.radians(TURN) * axes.T).as_matrix()
    return min(map(apart, turns)) < ROUND * apart(np.eye(3))
