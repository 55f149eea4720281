"""The paper's attention figure: where networks of different training look in the same patches.

Never trains: the networks come as weights files, each one column.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ...actions import PoseAction
from ...datasets.sequences import Sequence as Video
from ...frame import prepare_frame
from ...geometry.crop import PATCH_SIZE, Crop
from ...observation import Observation, observe
from ...policies import LoopState, Policy
from ...rendering.renderer import Renderer
from ...visualization.charts import Panel, Sheet
from . import published_figures as published
from .convergence import Plan, frames_of, wanted_frames
from .reproduction import Cell, Reproduction, Table

MODEL = "model"  # name of the column of the model itself
OFFSET = (6.0, -4.0, 3.0, 4.0, -5.0, 6.0)  # the start's delta from the truth, action units


@dataclass(frozen=True)
class Patch:
    """One case: what a policy of each kind of crop sees, and where it stands."""

    name: str
    seen: Callable[[Crop], Observation]
    state: LoopState


def column_names(checkpoints: Sequence[tuple[Path, object]]) -> list[str]:
    """A name for each weights file with its steps (None: not known), all of them different.

    Its steps, else its name; its name too where others have the same; and a number where that
    does not tell them apart either.

    >>> column_names([(Path("cup.pt"), 9), (Path("can.pt"), 9), (Path("can.pt"), 5)])
    ['9 steps (cup)', '9 steps (can)', '5 steps']
    """
    short = [path.stem if steps is None else f"{steps} steps" for path, steps in checkpoints]
    found: list[str] = []
    for (path, _), name in zip(checkpoints, short, strict=True):
        if short.count(name) > 1 and name != path.stem:
            name = f"{name} ({path.stem})"
        number, wanted = 1, name
        while name in (*found, MODEL):
            number += 1
            name = f"{wanted} {number}"
        found.append(name)
    return found


def patches(videos: Sequence[Video], frames: int, renderer: Renderer) -> list[Patch]:
    """`frames` cases of every sequence that can be read, a little away from the truth."""
    found = []
    for video in videos:
        mesh = video.load_mesh()
        wanted = frames_of(video, Plan(frames=frames))
        diameter = torch.tensor([mesh.sphere_diameter], dtype=torch.float64)
        for frame in wanted_frames(video, wanted):
            if frame.image is None:
                continue
            picture = prepare_frame(frame.image, video.camera)
            inner = mesh.inner(video.truth[frame.index].to(torch.float64))
            delta = torch.tensor([OFFSET], dtype=torch.float64)
            start = PoseAction.from_delta(delta).apply_centred(inner[None], diameter)
            seen = cache(partial(observe, [picture], [mesh], start, diameter, renderer))
            state = LoopState(start, diameter, torch.zeros(1, dtype=torch.int64))
            found.append(Patch(f"{video.name}, frame {frame.index}", seen, state))
    return found


def reproduction(
    cases: Sequence[Patch], policies: Mapping[str, Policy], data: str, facts: Mapping[str, object]
) -> Reproduction:
    """Figure `fig:mask`: patch, rendering and one attention map a network, a row a case.

    The table says how the attention is shared between the rendered object and the rest.
    """
    panels: list[Panel] = []
    rows: list[tuple[Cell, ...]] = []
    crop = next(iter(policies.values())).crop  # of the patch in the picture
    for case in cases:
        panels += [
            Panel(case.name, _picture(case.seen(crop).image)),
            Panel("rendering", _picture(case.seen(crop).rendering)),
        ]
        for name, policy in policies.items():
            seen = case.seen(policy.crop)
            attention = policy.predict(seen, case.state).attention
            if attention is None:
                panels.append(Panel(f"{name}: none"))
                rows.append((case.name, name, None, None, None))
                continue
            panels.append(Panel(name, _map(attention)))
            rows.append((case.name, name, *_shares(attention, seen.mask)))
    head = ("case", "network", "mean on the object", "mean beside it", "share on the object %")
    sheet = Sheet("attention", "Attention", 2 + len(policies), tuple(panels))
    steps = ", ".join(map(str, published.ATTENTION_ITERATIONS))
    return Reproduction(
        "attention",
        "Attention maps of networks of different training",
        data,
        (
            Table(
                "attention", "Attention on the rendered object and beside it", head, tuple(rows), 3
            ),
        ),
        (sheet,),
        (
            f"The paper shows its object-specific network after {steps} iterations and prints no "
            "figures; here every weights file that is given is one column.",
            "The start is a few action units away from the truth, so that the rendered mask is "
            "not quite the object.",
        ),
        facts,
    )


def _shares(attention: Tensor, mask: Tensor) -> tuple[float, float, float]:
    """Mean attention on the mask and off it, and the mask's share of all of it in per cent."""
    size = attention.shape[-2:]
    on_object = functional.adaptive_avg_pool2d(mask, (size[0], size[1])).to(attention)
    inside = float((attention * on_object).sum() / on_object.sum().clamp_min(1e-6))
    outside = float((attention * (1 - on_object)).sum() / (1 - on_object).sum().clamp_min(1e-6))
    share = 100 * float((attention * on_object).sum() / attention.sum().clamp_min(1e-9))
    return inside, outside, share


def _picture(patch: Tensor) -> NDArray[np.uint8]:
    values = (255 * patch[0].clamp(0, 1)).round().to(torch.uint8)
    return np.asarray(values.permute(1, 2, 0).numpy())


def _map(attention: Tensor) -> NDArray[np.float64]:
    size = (PATCH_SIZE, PATCH_SIZE)
    large = functional.interpolate(attention.float(), size, mode="nearest")
    return np.asarray(large[0, 0].to(torch.float64).numpy())
