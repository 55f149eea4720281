"""2D boxes of the objects in a BOP data set: a detector's, in BOP's file format, or the true ones.

Never sees an image. A detector's file is a JSON list of detections as BOP distributes its default
ones (COCO results with scene numbers): scene_id, image_id, category_id, bbox [x, y, width, height]
in pixels, score. Format: thodan/bop_toolkit docs/bop_challenge_2023.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from ..checks import entry, mapping, number, whole
from ..errors import InputError
from ..io import read_json_list
from .bop import BopDataset, BopTarget, Box, box_of

Boxes = Mapping[tuple[int, int, int], list[Box]]  # by scene, image and object; the best first

TRUTH = "truth"


def read_boxes(path: str | Path) -> Boxes:
    """A detector's boxes, those with the highest scores first; segmentations are not read."""
    path = Path(path)
    scored: dict[tuple[int, int, int], list[tuple[float, Box]]] = {}
    for n, content in enumerate(read_json_list(path), 1):
        where = f"{path}: detection {n}"
        one = mapping(content, where)
        scene, image, item = (
            whole(entry(one, key, where), f"{where}: {key}")
            for key in ("scene_id", "image_id", "category_id")
        )
        score = number(one.get("score", 1.0), f"{where}: score")
        box = box_of(entry(one, "bbox", where), f"{where}: bbox")
        scored.setdefault((scene, image, item), []).append((score, box))
    if not scored:
        raise InputError(f"{path} holds no detection.")
    return {
        key: [box for _, box in sorted(some, key=lambda one: -one[0])]
        for key, some in scored.items()
    }


def true_boxes(dataset: BopDataset, targets: Iterable[BopTarget]) -> Boxes:
    """Around what is visible of the objects in the targets' images: the most visible first."""
    found: dict[tuple[int, int, int], list[Box]] = {}
    for scene, image in dict.fromkeys((target.scene, target.image) for target in targets):
        truth = dataset.truth(scene, image)
        for one in sorted(truth, key=lambda instance: -instance.visible_fraction):
            if one.box is not None:
                found.setdefault((scene, image, one.object), []).append(one.box)
    if not found:
        raise InputError(
            f"{dataset.root}: no scene_gt_info.json says where objects are visible (bbox_visib)."
        )
    return found
