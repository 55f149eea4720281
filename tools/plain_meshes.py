"""How well is an object followed whose mesh has no colours: as it is, painted, with keyframes?

    python tools/plain_meshes.py MESHES PHOTOS CLIPS

Clips of the held-out meshes, made under CLIPS where they are not there yet. The tracker gets each
mesh without its colours and the exact first pose, from which it calibrates. Per cent of the frames
with ADD below 10, 5 and 2 % of the diameter.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np
import torch

from lightning_modules.pair_data_module import PairDataModule
from moveit6d.config import KeyframeConfig, TrackerConfig
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.sequences import Sequence, read_sequences
from moveit6d.datasets.video import open_frames
from moveit6d.estimation import PoseTracker
from moveit6d.evaluation.track_scores import EvaluationPoints, frame_errors
from moveit6d.geometry.mesh import Mesh
from moveit6d.policies import NetworkPolicy, load_policy
from moveit6d.synthesis.sequences.sequence import write_sequence

CLIPS = {"medium": 700, "fast": 900}  # seeds
FRAMES, TRACKED = 60, {"fast": 30}  # frames made, and tracked where that is fewer
PHOTOS = 60
LIMITS = (0.1, 0.05, 0.02)  # of the diameter


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("meshes", "photos", "clips"):
        parser.add_argument(name, type=Path)
    args = parser.parse_args()
    torch.set_num_threads(1)
    _make(args.meshes, args.photos, args.clips)
    policy = load_policy()
    print("| clip | looks of the mesh | < 10 % | < 5 % | < 2 % |")
    print("|---|---|---|---|---|")
    for sequence in read_sequences(args.clips):
        for looks in ("plain", "painted", "keyframes"):
            error = _errors(sequence, looks, policy)
            cells = " | ".join(f"{100 * (error < limit).mean():.1f}" for limit in LIMITS)
            print(f"| {sequence.name} | {looks} | {cells} |", flush=True)
    return 0


def _make(meshes: Path, photos: Path, clips: Path) -> None:
    """The clips that are missing."""
    read = itertools.islice(open_frames(photos / "*"), PHOTOS)
    backgrounds = [photo.image for photo in read if photo.image is not None]
    for level, seed in CLIPS.items():
        for number, path in enumerate(PairDataModule(meshes=meshes).mesh_paths()[1]):
            folder = clips / f"{level}_{number:02d}"
            if not folder.exists():
                write_sequence(
                    folder,
                    mesh=Mesh.load(path),
                    seed=seed + number,
                    frames=FRAMES,
                    difficulty=level,
                    photos=backgrounds,
                )


def _errors(sequence: Sequence, looks: str, policy: NetworkPolicy) -> np.ndarray:
    """ADD of each frame after the first, of 1 diameter; infinite where there is no pose."""
    own, count = sequence.load_mesh(), TRACKED.get(sequence.level, FRAMES)
    frames = [frame.image for frame in itertools.islice(sequence.open(), count)]
    first = frames[0]
    assert first is not None
    mesh = Mesh.from_arrays(own.name, own.vertices + own.center, own.faces)
    if looks == "painted":
        mesh = mesh.textured_from(first, sequence.start, sequence.camera)
    config = TrackerConfig(keyframes=KeyframeConfig(enabled=looks == "keyframes"))
    tracker = PoseTracker(mesh, sequence.camera, sequence.start, policy=policy, config=config)
    tracker.calibrate(first)
    rows = {0: PoseRow(frame=0, pose=sequence.start)}
    for number, image in enumerate(frames[1:], 1):
        rows[number] = PoseRow(frame=number, pose=tracker.update(image).pose)
    surface = EvaluationPoints.of(own)
    truth = {frame: pose for frame, pose in sequence.truth.items() if frame < count}
    errors = frame_errors(rows, truth, surface)
    return np.array([error.add for error in errors]) / surface.diameter


if __name__ == "__main__":
    sys.exit(main())
