"""Whatever lies in a folder is recognised, or what was looked for is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from moveit6d.datasets import open_dataset
from moveit6d.datasets.bop import Instance
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.datasets.catalog import FORMATS, SURROGATE, recognise, surrogate
from moveit6d.datasets.laval import write_laval_sequence
from moveit6d.datasets.rbot import write_rbot
from moveit6d.datasets.ycbv import write_ycbv_scene
from moveit6d.errors import InputError
from moveit6d.io import write_json


@pytest.fixture
def make(make_sequence: Callable[..., Any], scene: Any, brick: Any) -> Callable[..., Path]:
    """Makes a data set of two frames in a format."""

    def one(kind: str, root: Path) -> Path:
        frames = [(scene.image(k), scene.pose(k)) for k in range(2)]
        if kind == "folders":
            return make_sequence(frames=2).folder.parent
        if kind == "laval":
            write_laval_sequence(root, "dog_occlusion_0", brick, scene.camera, frames)
        elif kind == "rbot":
            write_rbot(root, "cat", brick, scene.camera, frames)
        elif kind == "ycbv":
            posed = [(image, {1: pose}) for image, pose in frames]
            write_ycbv_scene(root, 48, {1: brick}, scene.camera, posed)
        else:
            images = [
                BopImage(1, k, image, scene.camera, [Instance(1, pose)])
                for k, (image, pose) in enumerate(frames)
            ]
            write_bop(root, "test", {1: brick}, images)
        return root

    return one


@pytest.mark.parametrize("kind", sorted(FORMATS))
def test_every_format_is_recognised_and_opened(
    kind: str, make: Callable[..., Path], tmp_path: Path, scene: Any
) -> None:
    root = make(kind, tmp_path / "data")
    assert recognise(root) == kind
    (found,) = open_dataset(root)
    (same,) = open_dataset(root, kind)
    assert found.name == same.name and len(found.truth) == 2
    assert (found.truth[1].matrix - scene.pose(1).matrix).abs().max() < 1e-8
    assert (found.start.matrix - scene.pose(0).matrix).abs().max() < 1e-8
    assert [frame.error for frame in found.open()] == [None, None]
    assert found.load_mesh().diameter == pytest.approx(scene.mesh.diameter, rel=1e-4)


def test_nothing_known_says_what_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no data set that is known; .*poses\.npy"):
        open_dataset(tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        open_dataset(tmp_path / "nowhere")
    with pytest.raises(InputError, match="no kind of data set 'coco'; choose one of bop, folders"):
        open_dataset(tmp_path, "coco")


def test_a_made_data_set_says_so(tmp_path: Path) -> None:
    assert surrogate(tmp_path) == ""
    write_json(tmp_path / SURROGATE, {"what": "surrogate for Laval"})
    assert surrogate(tmp_path) == "surrogate for Laval"
