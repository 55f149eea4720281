"""The compact correlation network: half the work of `CorrelationNet`, and descriptors.

Never renders and never applies an action. As `CorrelationNet` it matches observation and rendering
at strides 8 and 4 and solves for the whole pose delta; its decoder also looks at stride 16, its
confidence is told how well the match holds together, and its encoder's descriptors at stride 8 are
what a detector compares (docs/method.md).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..geometry.crop import Crop
from ..observation import GREY, Observation
from .blocks import Residual, attention_pool, conv_block
from .correlation import DAMPING, HEAD_SCALE, CorrelationOutput, dense_prediction
from .dense_prediction import DensePrediction
from .least_squares import jacobian, object_pixels, solve_delta, surface_points
from .matching import (
    centred,
    correlate,
    correlate_blocks,
    encoder_pictures,
    index_tables,
    side_by_side,
    warp_cells,
)
from .policy_output import PolicyOutput

_FACTS = 9  # numbers about the match that the confidence is told


@dataclass(frozen=True)
class CompactConfig:
    """Sizes of a `CompactCorrelationNet`."""

    channels: tuple[int, int, int] = (16, 32, 64)  # encoder at strides 2, 4, 8
    geometry: tuple[int, int, int] = (8, 16, 32)  # the rendering's own encoder
    context: int = 48
    decoder: int = 64  # stride 8
    coarsest: int = 96  # stride 16
    fine: int = 24  # stride 4: matching and decoder
    descriptor: int = 32
    radius: int = 4  # of the correlation at stride 8, cells
    fine_radius: int = 3  # at stride 4, cells
    use_depth: bool = True
    crop: Crop = "look_at"  # the kind of patches that it is trained on
    search_head: bool = False  # a confidence of its own for searches, fitted after the training


class CompactCorrelationNet(nn.Module):
    """Observation → prediction with 0.16 G multiply-adds and 0.52 M parameters."""

    offsets: Tensor
    coarse_index: Tensor
    fine_index: Tensor
    fine_pixels: Tensor

    def __init__(self, config: CompactConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or CompactConfig()
        c2, c4, c8 = config.channels
        g2, g4, g8 = config.geometry
        wide, fine = config.decoder, config.fine
        self.encode4 = nn.Sequential(
            conv_block(3, c2, 2, 5), conv_block(c2, c4, 2), conv_block(c4, c4)
        )
        self.encode8 = nn.Sequential(conv_block(c4, c8, 2), Residual(c8), nn.Conv2d(c8, c8, 1))
        self.describe = nn.Conv2d(c8, config.descriptor, 1)
        self.geometry4 = nn.Sequential(conv_block(5, g2, 2, 5), conv_block(g2, g4, 2))
        self.geometry8 = conv_block(g4, g8, 2)
        offsets = (2 * config.radius + 1) ** 2
        self.context = conv_block(2 * c8 + g8, config.context, 1, 1)
        self.volume = conv_block(offsets, config.context, 1, 1)
        self.decode = conv_block(2 * config.context + 2, wide)
        self.decode16 = nn.Sequential(
            conv_block(wide, config.coarsest, 2), Residual(config.coarsest),
            nn.Conv2d(config.coarsest, wide, 1),
        )  # fmt: skip
        self.merge = conv_block(wide, wide)
        self.answer = nn.Conv2d(wide, 4, 3, 1, 1)
        self.attend = nn.Conv2d(wide, 1, 1)
        self.fine_match = nn.Conv2d(c4, fine, 1)
        self.fine_context = conv_block(2 * fine + g4 + wide, fine, 1, 1)
        self.fine_volume = conv_block((2 * config.fine_radius + 1) ** 2, fine, 1, 1)
        self.fine_decode = nn.Sequential(conv_block(2 * fine + 2, fine), conv_block(fine, fine))
        self.fine_answer = nn.Conv2d(fine, 6, 3, 1, 1)
        self.head = nn.Sequential(
            nn.Linear(wide + fine + 6, 128), nn.ReLU(inplace=True), nn.Linear(128, 19)
        )
        self.confidence_head = nn.Sequential(
            nn.Linear(2 * wide + 2 * fine + _FACTS, 128), nn.ReLU(inplace=True), nn.Linear(128, 1)
        )
        if config.search_head:
            self.search_head = copy.deepcopy(self.confidence_head).requires_grad_(False)
        self.temperature = nn.Parameter(torch.tensor(2.5))  # logarithm
        self.damping = nn.Parameter(torch.tensor(DAMPING).log())
        self.view_temperature = nn.Parameter(torch.tensor(2.3))  # logarithm; of training alone
        for name, table in index_tables(config.radius, config.fine_radius).items():
            self.register_buffer(name, table, persistent=False)  # not part of the weights file

    def for_search(self) -> CompactCorrelationNet:
        """A copy whose confidence is that of its `search_head`: whether the loop ends right.

        Everything else is the same.
        """
        network = copy.deepcopy(self)
        network.config = replace(self.config, search_head=False)
        network.confidence_head = network.search_head
        del network.search_head
        return network

    def descriptors(self, images: Tensor) -> Tensor:
        """What each cell of 8 × 8 pixels looks like: images (B, 3, H, W) in [0, 1] → (B, D, h, w).

        h and w are H / 8 and W / 8, rounded up; not normalised. Around a rendering the image must
        be grey (`GREY`), as the network sees it.
        """
        features = self.encode4((images - GREY).contiguous(memory_format=torch.channels_last))
        described: Tensor = self.describe(self.encode8(features))
        return described

    def forward(
        self, observation: Observation, matching_only: bool = False, beside: Tensor | None = None
    ) -> CorrelationOutput:
        """Answer a batch; describe pictures (N, 3, 128, 128) `beside` it as `descriptors` does.

        With `matching_only` the gradient of everything after the correlation does not reach the
        encoder: the first training steps need it, or the correlation stays at chance.
        """
        batch = len(observation)
        depth = observation.depth if self.config.use_depth else torch.zeros_like(observation.depth)
        pictures = encoder_pictures(observation)
        rendering = pictures[batch:]
        if beside is not None:
            pictures = torch.cat([pictures, beside - GREY])
        shared4 = self.encode4(pictures.contiguous(memory_format=torch.channels_last))
        shared8 = self.encode8(shared4)
        described = None
        if beside is not None:
            apart = shared8[2 * batch :]
            described = self.describe(apart.detach() if matching_only else apart)
            shared4, shared8 = shared4[: 2 * batch], shared8[: 2 * batch]
        features = shared4, shared8
        shared8 = centred(shared8)
        geometry = torch.cat([rendering, depth, observation.mask], 1)
        geometry4 = self.geometry4(geometry.contiguous(memory_format=torch.channels_last))
        image8, render8 = shared8[:batch], shared8[batch:]

        correlation = correlate(
            functional.normalize(render8, dim=1),
            functional.normalize(image8, dim=1),
            self.coarse_index,
            self.config.radius,
        )  # (B, offsets, 16, 16)
        matching = correlation * self.temperature.exp()
        if matching_only:
            image8, render8, correlation = image8.detach(), render8.detach(), correlation.detach()
        context = self.context(side_by_side(image8, render8, self.geometry8(geometry4)))
        hidden, coarse = self._decode(correlation, context)
        fine, fine_hidden, likeness = self._refine(shared4, geometry4, hidden, coarse, batch)
        solved, information, residual = self._solve(observation, depth, fine)

        attention = torch.sigmoid(self.attend(hidden))
        object4 = functional.max_pool2d(observation.mask, 4)
        object8 = functional.max_pool2d(object4, 2)
        attended, near = attention_pool(hidden, attention), attention_pool(fine_hidden, object4)
        values = self.head(torch.cat([attended, near, solved / 10], 1))
        delta = solved + values[:, :6] * HEAD_SCALE
        # The confidence must not bend what the displacements are made of.
        facts = self._facts(fine, object4, object8, correlation, likeness, delta, residual)
        pooled = [attended, attention_pool(hidden, object8), near,
                  functional.adaptive_max_pool2d(fine_hidden * object4, 1)[..., 0, 0]]  # fmt: skip
        confidence = self.confidence_head(torch.cat([*pooled, facts.detach()], 1))[:, 0]
        prediction = PolicyOutput(
            values[:, 6:19], delta, torch.sigmoid(confidence), attention, information
        )
        return CorrelationOutput(
            matching.flatten(2).mT, coarse, fine, solved, confidence, prediction, described,
            features,
        )  # fmt: skip

    def _decode(self, volume: Tensor, context: Tensor) -> tuple[Tensor, DensePrediction]:
        """Features and answers at stride 8 from the correlation volume and its context."""
        with torch.autocast(volume.device.type, enabled=False):
            share = torch.softmax(volume.float() * self.temperature.exp(), 1)
        # Not a matrix product, whose numbers may be too short for places.
        parts = [(share * self.offsets[:, c, None, None]).sum(1) for c in (0, 1)]
        first = torch.stack(parts, 1)  # cells
        hidden = self.decode(side_by_side(self.volume(volume * 4), first / 8, context))
        around = functional.interpolate(self.decode16(hidden), scale_factor=2.0, mode="nearest")
        hidden = self.merge(torch.relu(hidden + around))
        return hidden, dense_prediction(self.answer(hidden), first * 8, 8.0)

    def _facts(
        self,
        fine: DensePrediction,
        object4: Tensor,
        object8: Tensor,
        volume: Tensor,
        likeness: Tensor,
        delta: Tensor,
        residual: Tensor,
    ) -> Tensor:
        """Numbers (B, 9) that tell how well the match holds together."""
        on4, on8 = object4.flatten(1), object8.flatten(1)
        visible = torch.sigmoid(fine.visibility).flatten(1)
        trusted = torch.sigmoid(fine.weight).flatten(1)
        pairs = (residual * trusted * on4).sum(1) / ((trusted * on4).sum(1) + 1e-3)
        return torch.stack(
            [
                _mean(visible, on4),
                _mean(trusted, on4),
                torch.log1p(pairs),
                torch.log1p(_mean(residual, on4)),
                _mean(volume.amax(1).flatten(1), on8),
                _mean(volume[:, volume.shape[1] // 2].flatten(1), on8),
                _mean(likeness.flatten(1), on4),
                torch.log1p(delta.norm(dim=1)) / 3,
                on4.mean(1) * 3,
            ],
            1,
        ).float()

    def _solve(
        self, observation: Observation, depth: Tensor, cells: DensePrediction
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The delta (B, 6) that the cells' answers amount to, and what is left (B, cells).

        Between them the delta's information (B, 6, 6), as `solve_delta` has it.
        """
        pixels, covered = object_pixels(observation.mask, 4)
        points = surface_points(depth, observation.distance, pixels)
        weight = torch.sigmoid(cells.weight).flatten(1) * covered
        moves = cells.displacement.flatten(2).mT.float()
        slopes = jacobian(points, observation.distance)
        with torch.autocast(depth.device.type, enabled=False):
            shape = cells.shape.flatten(2).mT.float()
            delta, information = solve_delta(
                moves, weight.float(), shape, slopes, self.damping.exp()
            )
            explained = (slopes @ delta[:, None, :, None])[..., 0]
        return delta, information, (moves - explained).square().sum(-1).add(1e-6).sqrt()

    def _refine(
        self,
        shared4: Tensor,
        geometry4: Tensor,
        hidden: Tensor,
        coarse: DensePrediction,
        batch: int,
    ) -> tuple[DensePrediction, Tensor, Tensor]:
        """Match again at stride 4 around the coarse answer; how alike both are there, too."""
        matched = centred(self.fine_match(shared4))
        image4 = functional.normalize(matched[:batch], dim=1)
        render4 = functional.normalize(matched[batch:], dim=1)
        start = functional.interpolate(
            coarse.displacement.detach(), scale_factor=2.0, mode="bilinear", align_corners=False
        )
        warped = warp_cells(image4, start, 4)
        correlation = correlate_blocks(render4, warped, self.fine_index, self.config.fine_radius)
        wide = functional.interpolate(hidden, scale_factor=2.0, mode="nearest")
        # The image's own features too: behind an outline the rendering has nothing to compare with.
        context = self.fine_context(side_by_side(matched[batch:], warped * 2, geometry4, wide))
        volume = self.fine_volume(correlation * 4)
        fine = self.fine_decode(side_by_side(volume, start / 16, context))
        middle = correlation[:, correlation.shape[1] // 2]
        return dense_prediction(self.fine_answer(fine), start, 4.0), fine, middle


def _mean(values: Tensor, where: Tensor) -> Tensor:
    """Weighted mean of each row (B, N)."""
    return (values * where).sum(1) / (where.sum(1) + 1e-3)
