"""Makes benchmark and demonstration clips: an object in hand-like motion, with its true poses.

Never tracks. Motion blur and smooth edges come from several renders within each exposure, each a
little off in time and place; the pose of a frame is that of the middle of its exposure.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from ...datasets.pose_files import POSE_COLUMNS, write_camera
from ...errors import InputError
from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...geometry.symmetry_file import write_symmetries
from ...io import refuse_foreign, replacing_folder, write_json
from ...rendering.backends import make_renderer
from ...threads import limited_threads
from ...typing import RGBImage
from ..objects.mesh_file import write_glb
from .board_occluder import plan_board_occluder
from .difficulty import Difficulty, find_difficulty
from .environment import LightOverTime, MovingBackground
from .layers import SceneMaterial, composite, render_layers
from .motion import SUBSTEPS, Motion, random_motion
from .occlusion import MovingOccluder, plan_passing_occluders, visible_fraction, visible_share
from .sensor import Sensor, expose
from .tabletop import TabletopObject, arrange_around

GENERATOR = "moveit6d synthesize"
WRITTEN = re.compile(
    r"frames|frames/\d{6,}\.jpg|camera\.json|mesh\.glb|mesh\.symmetry\.json|start\.json|poses\.csv"
    r"|info\.json"
)
BESIDE = 1  # stream of random numbers
OCCLUDER = SceneMaterial(0.0, 0.1)  # skin, cloth and paper
SEQUENCE_CAMERA = Camera(615.0, 615.0, 319.5, 239.5, 640, 480)


@dataclass(frozen=True)
class SyntheticFrame:
    """One frame of a scene: the picture, the true pose (mesh file's frame), what can be seen."""

    image: RGBImage  # (H, W, 3)
    pose: Pose
    visible_fraction: float
    others: tuple[tuple[Pose, float], ...] = ()  # the same of the objects that move with it


def write_sequence(
    folder: str | Path,
    *,
    mesh: Mesh,
    seed: int,
    frames: int = 120,
    difficulty: str | Difficulty = "medium",
    photos: Sequence[RGBImage] | None = None,
    camera: Camera | None = None,
    quality: int = 90,
    on_frame: Callable[[int], None] | None = None,
) -> Path:
    """Make a sequence folder: frames/%06d.jpg, camera.json, mesh.glb, start.json, poses.csv.

    The mesh's declared symmetries, if any, go into mesh.symmetry.json. `photos` (H, W, 3) uint8
    become backgrounds and textures; without them procedural pictures do. Nothing appears under
    `folder` before everything is written. An older sequence made here is replaced; a folder that
    holds anything else is refused with an `InputError`, and so is a camera with a lens,
    which is not rendered. `on_frame` is called with the number of each finished frame.
    """
    folder = Path(folder)
    check_replaceable(folder)
    scene = Scene(mesh, seed, frames, difficulty, photos, camera)
    with replacing_folder(folder) as work:
        (work / "frames").mkdir()
        rows = []
        for number in range(frames):
            one = scene.render_frame(number)
            name = f"frames/{number:06d}.jpg"
            Image.fromarray(one.image).save(work / name, quality=quality, subsampling="4:2:0")
            rows.append(_row(number, name, one))
            if number == 0:
                one.pose.save(work / "start.json")
            if on_frame is not None:
                on_frame(number)
        write_camera(work / "camera.json", scene.camera)
        write_glb(work / "mesh.glb", mesh)
        write_symmetries(work / "mesh.glb", mesh.symmetries)
        head = ",".join(("frame", "image", *POSE_COLUMNS, "visible_fraction"))
        (work / "poses.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
        write_json(work / "info.json", {**scene.facts(), "seed": seed, "jpeg_quality": quality})
    return folder


class Scene:
    """Everything that is in front of the camera, drawn once from a seed; see `render_frame`."""

    @limited_threads(1)
    def __init__(
        self,
        mesh: Mesh,
        seed: int,
        frames: int,
        difficulty: str | Difficulty = "medium",
        photos: Sequence[RGBImage] | None = None,
        camera: Camera | None = None,
        others: Sequence[Mesh] = (),
    ) -> None:
        if frames < 2:
            raise InputError(f"A sequence needs at least 2 frames, {frames} were asked for.")
        if camera is not None and camera.lens is not None:
            raise InputError(
                f"A scene is rendered without a lens, and the camera has {camera.distortion_model} "
                "coefficients; give camera.pinhole."
            )
        self.difficulty = find_difficulty(difficulty)
        self.mesh = mesh
        self.frames = frames
        self.camera = camera or SEQUENCE_CAMERA
        self._seed = seed
        self._renderer = make_renderer("embree")
        rng = np.random.default_rng(seed)
        wide = self.camera.width / 640
        self.motion = random_motion(
            rng,
            self.camera,
            mesh.sphere_diameter,
            frames,
            pixels_per_frame=rng.uniform(*self.difficulty.pixels_per_frame) * wide,
            degrees_per_frame=rng.uniform(*self.difficulty.degrees_per_frame),
            margin=self.difficulty.margin,
        )
        self.shutter = rng.uniform(*self.difficulty.shutter)
        self.occluders: list[MovingOccluder] = list(plan_passing_occluders(
            rng, self._renderer, mesh, self.motion, frames,
            share=rng.uniform(*self.difficulty.occluded_frames),
            occlusion=self.difficulty.occlusion, photos=photos,
        ))  # fmt: skip
        beside = np.random.default_rng([seed, BESIDE])  # what came later leaves older clips as is
        self.others = arrange_around(beside, mesh, others, self.motion, frames)
        if self.difficulty.board:
            self.occluders.append(plan_board_occluder(
                beside, self._renderer, mesh, self.motion, frames,
                side=self.difficulty.board, share=self.difficulty.board_occlusion, photos=photos,
            ))  # fmt: skip
        self._material = SceneMaterial(rng.uniform(0.0, 0.3), rng.uniform(0.05, 0.6))
        self._light = LightOverTime(rng, self.difficulty.light_change)
        self._background = MovingBackground(
            rng, self._renderer, self.camera, mesh, self.difficulty, photos
        )
        self._sensor = Sensor(rng.uniform(0.45, 0.65), 1.0, rng.uniform(0.001, 0.004),
                              rng.uniform(0.005, 0.02))  # fmt: skip
        self._visible: list[float] = []

    @limited_threads(1)
    def render_frame(self, number: int) -> SyntheticFrame:
        """Frame `number`; the same each time."""
        rng = np.random.default_rng([self._seed, number])
        times, offsets = self._samples(number)
        light, exposure = self._light(number)
        brightness = np.float32(self._light.brightness(number))
        things = [(self.mesh, self._poses(self.motion, times), self._material)]
        things += [(other.mesh, other.poses(times), self._material) for other in self.others]
        things += [
            (occluder.mesh, occluder.poses(times), OCCLUDER)
            for occluder in self.occluders
            if occluder.present(number)
        ]
        layers = [
            render_layers(self._renderer, thing, poses, self.camera, offsets, light, material)
            for thing, poses, material in things
        ]
        total = np.zeros((self.camera.height, self.camera.width, 3), np.float32)
        for sample, time in enumerate(times):
            picture = self._background(float(time), offsets[sample]) * brightness
            depth = np.full(picture.shape[:2], np.inf, np.float32)
            for layer in layers:
                if layer:
                    composite(picture, depth, layer[sample])
            total += picture
        sensor = replace(self._sensor, exposure=exposure)
        image = expose(rng, total / np.float32(len(times)), sensor)
        pose = self.motion.pose(number)
        occluders = [*self.occluders, *self.others]
        seen = visible_fraction(self._renderer, self.mesh, self.motion, occluders, number)
        self._visible.append(seen)
        beside = tuple(self._beside(one, number) for one in self.others)
        return SyntheticFrame(image, self.mesh.outer(pose), seen, beside)

    def _beside(self, one: TabletopObject, number: int) -> tuple[Pose, float]:
        """Of an object that moves with the first: its pose (file frame) and what is seen of it."""
        first = TabletopObject(self.mesh, self.motion, Pose.identity())
        occluders = [*self.occluders, first, *(other for other in self.others if other is not one)]
        pose = one.pose(number)
        seen = visible_share(self._renderer, one.mesh, pose, self.camera, occluders, number)
        return one.mesh.outer(pose), seen

    def facts(self) -> dict[str, object]:
        """What was drawn, for info.json."""
        way = self.motion.pixel(np.arange(self.frames, dtype=np.float64))
        step = np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1)
        turns = self.motion.rotations[::SUBSTEPS]
        cosine = (torch.einsum("nij,nij->n", turns[1:], turns[:-1]) - 1) / 2
        degrees = torch.rad2deg(torch.arccos(cosine.clamp(-1, 1)))
        return {
            "difficulty": self.difficulty.name,
            "object": self.mesh.name,
            "diameter_m": round(self.mesh.diameter, 5),
            "distance_m": [round(float(way[:, 2].min()), 3), round(float(way[:, 2].max()), 3)],
            "max_px_per_frame": round(float(step.max()), 2),
            "mean_px_per_frame": round(float(step.mean()), 2),
            "max_deg_per_frame": round(float(degrees.max()), 2),
            "mean_deg_per_frame": round(float(degrees.mean()), 2),
            "occluded_frames": round(float(np.mean(np.array(self._visible) < 0.99)), 3),
            "min_visible_fraction": round(min(self._visible), 4),
            "occluders": [occluder.kind for occluder in self.occluders],
            "shutter": round(self.shutter, 3),
            "fps": 30,
            "frames": self.frames,
            "made_by": GENERATOR,
            "settings": asdict(self.difficulty),
        }

    def _samples(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Moments (S,) within the exposure and the place within the pixel (S, 2) of each.

        Both are symmetric about the middle, so that neither shifts the picture.
        """
        ends = self.motion.pixel(np.array([-0.5, 0.5]) * self.shutter + number)[:, :2]
        count = int(np.clip(2 * math.ceil(np.linalg.norm(ends[1] - ends[0]) / 2), 6, 12))
        order = np.arange(count)
        times = number + self.shutter * ((order + 0.5) / count - 0.5)
        golden = 0.6180339887
        offsets = np.stack([(order * golden + 0.5) % 1, (order * golden**2 + 0.25) % 1], -1) - 0.5
        return times, offsets - offsets.mean(0)

    @staticmethod
    def _poses(motion: Motion, times: NDArray[np.float64]) -> Pose:
        return Pose.stack([motion.pose(float(time)) for time in times])


def _row(number: int, name: str, one: SyntheticFrame) -> str:
    numbers = [*one.pose.rotation.reshape(9).tolist(), *one.pose.translation.tolist()]
    cells = [str(number), name, *(f"{n:.8f}" for n in numbers), f"{one.visible_fraction:.4f}"]
    return ",".join(cells)


def check_replaceable(folder: Path) -> None:
    """`InputError` unless a folder is new, empty, or a sequence made here and nothing else."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    info = folder / "info.json"
    if not (info.is_file() and GENERATOR in info.read_text(encoding="utf-8", errors="replace")):
        raise InputError(f"{folder} exists and is not a sequence made here; give a new folder.")
    inside = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))
    foreign = [name for name in inside if not WRITTEN.fullmatch(name)]
    refuse_foreign(folder, foreign, "a sequence")
