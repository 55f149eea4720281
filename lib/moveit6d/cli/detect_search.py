"""The objects that `moveit6d detect --image` looks for in every image, and what is known of them.

Never reads images and never writes.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..config import SeedDetectorConfig
from ..errors import InputError
from .common import Setting, make_tools
from .messages import note
from .narrowing import OF_ONE_FRAME, known_of
from .objects import object_names
from .seed_options import seeds_of

if TYPE_CHECKING:
    from ..datasets.video import Image
    from ..estimation.detection import Detection, PoseDetector
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh

OF_ONE = (*OF_ONE_FRAME, "start")  # what is known of one object alone


@dataclass(frozen=True)
class ImageSearch:
    """Looks for objects in one image after the other.

    `names` and `detectors` are those of the objects, in the order of --mesh; `groups` the indices
    of those of one mesh, which are instances of it; `instances` is how many of each there may be;
    `known` is what is known of where they are, as `PoseDetector.detect` takes it.
    """

    names: Sequence[str]
    detectors: Sequence[PoseDetector]
    groups: Sequence[Sequence[int]]
    instances: int
    known: Mapping[str, Any]

    def detections(self, image: Image) -> list[Detection]:
        """What is found of each object."""
        from ..estimation.detection import Detection, SearchRegion, detect_objects

        if len(self.detectors) == 1:
            return [self.detectors[0].detect(image, instances=self.instances, **self.known)]
        first = [self.detectors[group[0]] for group in self.groups]
        anywhere = SearchRegion.checked(first[0].camera, distance=self.known["distance"])
        counts = [self.instances * len(group) for group in self.groups]
        found = detect_objects(first, image, counts, [anywhere] * len(first))
        own: dict[int, Detection] = {}
        for group, one in zip(self.groups, found, strict=True):
            for place, index in enumerate(group):
                begin = place * self.instances
                some = one.instances[begin : begin + self.instances]
                own[index] = Detection(some, one.rejected)
        return [own[index] for index in range(len(self.detectors))]


def image_search(
    args: argparse.Namespace,
    setting: Setting,
    meshes: Sequence[Mesh],
    camera: Camera,
    known: Mapping[str, Any],
) -> ImageSearch:
    """The search that the options ask for."""
    from ..estimation import PoseDetector, TemplateStore
    from ..estimation.detection import default_store

    policy, renderer = make_tools(setting)
    store = TemplateStore(default_store())
    detectors = [
        PoseDetector(
            mesh,
            camera,
            policy=policy,
            renderer=renderer,
            config=setting.config,
            method=args.method,
            seeds=seeds_of(args, SeedDetectorConfig(), setting.config.loop),
            store=store,
            threads=setting.threads,
        )
        for mesh in meshes
    ]
    names = object_names(args.mesh)
    return ImageSearch(names, detectors, _groups(meshes), args.instances, known)


def check_objects(args: argparse.Namespace) -> None:
    """`InputError` for what is for one object where there are several; a note on odd points."""
    given = [f"--{name}" for name in OF_ONE if getattr(args, name) is not None]
    if len(args.mesh) > 1 and given:
        raise InputError(
            f"{', '.join(given)} is for one object; leave it out with several (--distance holds "
            "for all), or look for one after the other."
        )
    if args.method == "seeds" and (len(args.mesh) > 1 or len(args.image) > 1):
        raise InputError("--method seeds takes one --mesh and one --image.")
    if args.points is not None and len(args.image) > 1:
        note(
            f"--points are pixels of one image and are taken for all {len(args.image)}: object and "
            "camera must stand still in them."
        )


def known_by(args: argparse.Namespace, meshes: Sequence[Mesh]) -> dict[str, Any]:
    """What is known of where the objects are, as `PoseDetector.detect` takes it."""
    from ..geometry.pose import Pose, in_metres

    start = None
    if args.start is not None:
        start = in_metres(Pose.load(args.start), str(args.start), meshes[0].center)
    return {**known_of(args, args.mesh_unit[0]), "start": start}


def _groups(meshes: Sequence[Mesh]) -> list[list[int]]:
    """The indices of those that are one mesh, under whatever names."""
    from ..estimation.detection.instances import same_meshes

    groups = [sorted([index, *others]) for index, others in enumerate(same_meshes(meshes))]
    return [group for index, group in enumerate(groups) if group[0] == index]
