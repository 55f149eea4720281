"""Small sources of training pairs; used by the tests only."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import torch
from jsonargparse import ArgumentParser
from PIL import Image

from moveit6d.geometry.mesh import Mesh
from moveit6d.synthesis.augmentation.backgrounds import procedural_photo
from moveit6d.synthesis.augmentation.random_source import RandomSource
from moveit6d.synthesis.objects.shapes import random_object
from moveit6d.synthesis.training.pairs import PairConfig
from moveit6d.synthesis.training.shards import ShardPlan, ShardWriter
from moveit6d.synthesis.training.source import PairSource

CONFIGS = Path(__file__).parents[2] / "configs"


@cache
def photos() -> tuple[np.ndarray, ...]:
    """Four generated pictures."""
    random = np.random.default_rng(0)
    return tuple(procedural_photo(random, (160, 200)) for _ in range(4))


@cache
def objects() -> tuple[Mesh, ...]:
    """Three procedural objects."""
    random = np.random.default_rng(0)
    return tuple(random_object(random, photos()) for _ in range(3))


def small_source(folder: Path) -> PairSource:
    """One procedural shape before three pictures, which are written to the folder."""
    for number, picture in enumerate(photos()[:3]):
        Image.fromarray(picture).save(folder / f"{number}.png")
    return PairSource((), "m", folder, None, 1, PairConfig())


def write_every_shard(source: PairSource, plan: ShardPlan, folder: Path) -> Path:
    """All shards of a plan in a folder, written by one writer."""
    writer = ShardWriter(source, plan, folder)
    writer.claim()
    for number in range(plan.shards):
        writer.write(number)
    return folder


def rng(seed: int = 0) -> RandomSource:
    """A random source of its own."""
    return RandomSource(torch.Generator().manual_seed(seed))


@cache
def preset(name: str) -> PairConfig:
    """What a file of configs/pairs says."""
    parser = ArgumentParser()
    parser.add_argument("--pairs", type=PairConfig)
    path = CONFIGS / "pairs" / f"{name}.yaml"
    config = parser.instantiate_classes(parser.parse_args([f"--pairs={path}"])).pairs
    assert isinstance(config, PairConfig)
    return config
