"""A BOP split as sequences: the images of a scene as a video, one sequence an object.

Never invents an order: images come by number, which in most test sets leaves gaps between them.
"""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.pose import Pose
from .bop import BopDataset
from .sequences import Sequence
from .video import first_size

# Which split is taken where the folder of the whole data set is given, the first one there.
SPLITS = ("test", "test_primesense", "test_all", "val", "val_primesense", "train_real", "train")


def read_bop_sequences(path: str | Path) -> list[Sequence]:
    """The sequences of a split (`lmo/test`) or of a data set's test split (`lmo`).

    Named `000002.8` by scene and object, grouped by object. An object that occurs several times in
    an image is left out there, as nothing tells which instance is which. An image that is missing
    or damaged is a frame with an error, one of which scene_gt.json says nothing has no truth.
    `symmetric` is what models_info.json declares.
    """
    dataset = open_split(path)
    scenes = dataset.scenes()
    if not scenes:
        raise InputError(
            f"{dataset.root / dataset.split} holds no scene such as 000001/; image-wise splits and "
            "webdataset shards (.tar) are not read, convert them with the bop_toolkit."
        )
    found = [sequence for scene in scenes for sequence in _read_scene(dataset, scene)]
    if not found:
        raise InputError(f"{dataset.root / dataset.split} holds no true pose (scene_gt.json).")
    return found


def is_bop(path: str | Path) -> bool:
    """Whether a BOP data set or one of its splits lies at `path`."""
    path = Path(path)
    return any(path.glob("[0-9]*/scene_camera*.json")) or any(
        path.glob("*/[0-9]*/scene_camera*.json")
    )


def open_split(path: str | Path) -> BopDataset:
    """The split at `path`, or the test split of the data set there."""
    path = Path(path)
    if any(path.glob("[0-9]*/scene_camera*.json")):
        return BopDataset(path.resolve().parent, path.resolve().name)
    there = [name for name in SPLITS if (path / name).is_dir()]
    return BopDataset(path, there[0] if there else SPLITS[0])


def _read_scene(dataset: BopDataset, scene: int) -> list[Sequence]:
    images = dataset.images(scene)
    folder = dataset.folder(scene)
    truth: dict[int, dict[int, Pose]] = {}
    for frame, image in enumerate(images):
        instances = dataset.truth(scene, image) if dataset.has_truth(scene, image) else []
        listed = [one.object for one in instances]
        for one in instances:
            if listed.count(one.object) == 1:
                truth.setdefault(one.object, {})[frame] = one.pose
    paths = tuple(dataset.expected_path(scene, image) for image in images)
    camera = _camera(dataset, scene, images, paths)
    return [
        Sequence(
            name=f"{scene:06d}.{number}",
            folder=folder,
            mesh=dataset.mesh_path(number),
            frames=folder,
            camera=camera,
            start=next(iter(poses.values())),
            first=next(iter(poses)),
            truth=poses,
            mesh_unit=dataset.mesh_unit,
            images=paths,
            group=str(number),
            object=str(number),
            symmetric=dataset.is_symmetric(number),
            symmetries=dataset.symmetries(number),
        )
        for number, poses in sorted(truth.items())
    ]


def _camera(dataset: BopDataset, scene: int, images: list[int], paths: tuple[Path, ...]) -> Camera:
    size = first_size(paths)
    first = dataset.camera(scene, images[0], size)
    for image in images:
        if dataset.camera(scene, image, size) != first:
            raise InputError(
                f"scene {scene} of {dataset.root / dataset.split}: image {image} has other "
                "intrinsics than the first one; it is no video of one camera."
            )
    return first
