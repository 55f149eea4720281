"""Does a network read bright objects as too near? Edges that mix light, or colours, against it.

    python tools/light_bias.py MESHES PHOTOS [--weights FILE] [--batches N]

Pairs of the held-out meshes, uncovered, near the truth, once with colours that mix at edges and in
blurs and once with light that does, as in a camera. What the network is off by in t_z, in units
(1 is about 1.1 % of the distance, nearer), where the object is brighter than what lies around it
and where it is darker.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from lightning_modules.cli import read_data
from moveit6d.geometry.mesh import Mesh
from moveit6d.policies import NetworkPolicy, load_policy
from moveit6d.synthesis.augmentation.config import (
    CastShadowConfig,
    ImageBorderConfig,
    LensErrorConfig,
    OcclusionConfig,
)
from moveit6d.synthesis.augmentation.hands import HandConfig
from moveit6d.synthesis.augmentation.photos import load_photos
from moveit6d.synthesis.training.pairs import (
    FarRotationConfig,
    PairConfig,
    PairGenerator,
    TrainingBatch,
    ZoomConfig,
)
from moveit6d.synthesis.training.views import ViewConfig

CONFIG = Path(__file__).parents[1] / "configs/fit/compact.yaml"
BATCH = 48
CONTRAST = 0.15  # of brightness, from which an object counts as brighter or darker
LOST = 4.0  # units: what is farther off is no bias


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("photos", type=Path)
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--batches", type=int, default=6)
    args = parser.parse_args()
    torch.set_num_threads(1)
    data = read_data([f"--config={CONFIG}", f"--data.meshes={args.meshes}"])
    meshes = [Mesh.load(path) for path in data.mesh_paths()[1]]
    photos = load_photos(args.photos, 200)
    policy = load_policy(args.weights)
    print("| what mixes | object | pairs | mean error of t_z, units | ± |")
    print("|---|---|---|---|---|")
    for name, gamma in (("colours", 1.0), ("light", 2.2)):
        generator = PairGenerator(meshes, photos, _clear(data.pairs, gamma), 5)
        batches = [generator.batch(BATCH, "near") for _ in range(args.batches)]
        error = torch.cat([_error(policy, batch) for batch in batches])
        contrast = torch.cat([_contrast(batch) for batch in batches])
        sides = (("brighter", contrast > CONTRAST), ("darker", contrast < -CONTRAST))
        for side, chosen in (*sides, ("all", contrast > -1)):
            few = error[chosen & (error.abs() < LOST)]
            spread = float(few.std()) / np.sqrt(len(few))
            print(f"| {name} | {side} | {len(few)} | {float(few.mean()):+.2f} | {spread:.2f} |")
    return 0


def _clear(pairs: PairConfig, gamma: float) -> PairConfig:
    """The pairs without what hides or distorts an object."""
    augment = replace(
        pairs.augment,
        gamma=(gamma, gamma),
        occlusion=OcclusionConfig(probability=0.0),
        cast_shadow=CastShadowConfig(probability=0.0),
        lens_error=LensErrorConfig(probability=0.0),
        image_border=ImageBorderConfig(probability=0.0),
    )
    return replace(
        pairs,
        augment=augment,
        hands=HandConfig(),
        views=ViewConfig(),
        far_rotation=FarRotationConfig(),
        absent_probability=0.0,
        zoom=ZoomConfig(),
    )


def _error(policy: NetworkPolicy, batch: TrainingBatch) -> Tensor:
    delta = policy.network(batch.observation).delta
    assert delta is not None
    return delta[:, 2] - batch.delta[:, 2]


def _contrast(batch: TrainingBatch) -> Tensor:
    """How much brighter an object's edge is than what lies around it, of 1: (B,)."""
    mask, light = batch.true_mask, batch.observation.image.mean(1, keepdim=True)
    around = functional.max_pool2d(mask, 9, 1, 4) - mask
    inside = mask + functional.max_pool2d(-mask, 9, 1, 4)
    inner, outer = (
        (light * ring).sum((1, 2, 3)) / ring.sum((1, 2, 3)).clamp_min(1)
        for ring in (inside, around)
    )
    return inner - outer


if __name__ == "__main__":
    sys.exit(main())
