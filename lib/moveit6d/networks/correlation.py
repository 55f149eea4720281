"""The correlation network: match observation and rendering, solve for the whole pose delta.

Never renders and never applies a pose delta. docs/method.md: one encoder for both pictures, local
correlation at stride 8 and again at stride 4 around the first answers, displacement, visibility and
weight a cell, a differentiable least squares, and a head with a correction, the 13 action logits
and the confidence.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..geometry.crop import Crop
from ..observation import GREY, Observation
from .blocks import Residual, attention_pool, conv_block, with_extra_blocks
from .dense_prediction import DensePrediction
from .least_squares import jacobian, solve_delta, surface_points
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

# Prior of the least squares for t_x, t_y, t_z and the three turns; learnable. Measured to matter:
# with 1e-3 everywhere its loss stays a fifth higher.
DAMPING = (4e-3, 4e-3, 1e-2, 8e-3, 8e-3, 8e-3)
HEAD_SCALE = 3.0  # units that an output of 1 of the head stands for


@dataclass(frozen=True)
class CorrelationConfig:
    """Sizes of a `CorrelationNet`; that of examples/correlation has `extra_blocks` (1, 2, 1)."""

    channels: tuple[int, int, int] = (24, 32, 64)  # encoder at strides 2, 4, 8
    geometry: tuple[int, int, int] = (12, 24, 32)  # the rendering's own encoder
    context: int = 48
    decoder: int = 64  # stride 8
    fine: int = 32  # stride 4: matching and decoder
    radius: int = 4  # of the correlation at stride 8, cells
    fine_radius: int = 3  # at stride 4, cells
    # Additional residual blocks in the encoder and in the decoders at strides 8 and 4.
    extra_blocks: tuple[int, int, int] = (0, 0, 0)
    use_depth: bool = True
    crop: Crop = "look_at"  # the kind of patches that it is trained on


@dataclass(frozen=True)
class CorrelationOutput:
    """Everything that training looks at; `prediction` is what the loop needs.

    `matching` (B, cells, offsets) are scaled correlation logits at stride 8, `solved` (B, 6) the
    least squares before the head's correction, `features` the encoder's at strides 4 and 8, of the
    images and then of the renderings (2 B, C, …), where the network gives them.
    """

    matching: Tensor
    coarse: DensePrediction
    fine: DensePrediction
    solved: Tensor
    confidence_logit: Tensor
    prediction: PolicyOutput
    described: Tensor | None = None  # descriptors of further pictures (`CompactCorrelationNet`)
    features: tuple[Tensor, Tensor] | None = None


class CorrelationNet(nn.Module):
    """Observation → prediction; 0.35 M parameters by default, 0.6 M in examples/correlation."""

    offsets: Tensor
    coarse_index: Tensor
    fine_index: Tensor
    fine_pixels: Tensor

    def __init__(self, config: CorrelationConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or CorrelationConfig()
        c2, c4, c8 = config.channels
        g2, g4, g8 = config.geometry
        self.encode4 = nn.Sequential(conv_block(3, c2, 2, 5), conv_block(c2, c4, 2), Residual(c4))
        more8, more_decoder, more_fine = config.extra_blocks
        self.encode8 = with_extra_blocks(
            [conv_block(c4, c8, 2), Residual(c8)], c8, more8, [nn.Conv2d(c8, c8, 1)]
        )
        self.geometry4 = nn.Sequential(conv_block(5, g2, 2, 5), conv_block(g2, g4, 2))
        self.geometry8 = conv_block(g4, g8, 2)
        offsets = (2 * config.radius + 1) ** 2
        self.context = conv_block(2 * c8 + g8, config.context, 1, 1)
        self.decode = with_extra_blocks(
            [conv_block(offsets + config.context + 2, config.decoder), Residual(config.decoder)],
            config.decoder,
            more_decoder,
        )
        self.answer = nn.Conv2d(config.decoder, 4, 3, 1, 1)
        self.attend = nn.Conv2d(config.decoder, 1, 1)
        fine = config.fine
        self.fine_match = nn.Conv2d(c4, fine, 1)
        self.fine_context = conv_block(2 * fine + g4 + config.decoder, fine, 1, 1)
        fine_offsets = (2 * config.fine_radius + 1) ** 2
        self.fine_decode = with_extra_blocks(
            [conv_block(fine_offsets + fine + 2, fine), conv_block(fine, fine)], fine, more_fine
        )
        self.fine_answer = nn.Conv2d(fine, 6, 3, 1, 1)
        self.head = nn.Sequential(
            nn.Linear(config.decoder + fine + 6, 128), nn.ReLU(inplace=True), nn.Linear(128, 20)
        )
        self.temperature = nn.Parameter(torch.tensor(2.5))  # logarithm
        self.damping = nn.Parameter(torch.tensor(DAMPING).log())
        for name, table in index_tables(config.radius, config.fine_radius).items():
            self.register_buffer(name, table, persistent=False)  # not part of the weights file

    def forward(self, observation: Observation, matching_only: bool = False) -> CorrelationOutput:
        """Answer a batch.

        With `matching_only` the gradient of everything after the correlation does not reach the
        encoder: the first training steps need it, or the correlation stays at chance.
        """
        batch = len(observation)
        depth = observation.depth if self.config.use_depth else torch.zeros_like(observation.depth)
        pictures = encoder_pictures(observation)
        rendering = pictures[batch:]
        shared4 = self.encode4(pictures)
        shared8 = centred(self.encode8(shared4))
        geometry = torch.cat([rendering, depth, observation.mask], 1)
        geometry4 = self.geometry4(geometry.contiguous(memory_format=torch.channels_last))
        image8, render8 = shared8[:batch], shared8[batch:]

        correlation = correlate(
            functional.normalize(render8, dim=1),
            functional.normalize(image8, dim=1),
            self.coarse_index,
            self.config.radius,
        )  # (B, offsets, 16, 16)
        if matching_only:
            image8, render8 = image8.detach(), render8.detach()
        matching = correlation * self.temperature.exp()
        volume = correlation.detach() if matching_only else correlation
        share = torch.softmax((volume * self.temperature.exp()).float(), 1)
        with torch.autocast(share.device.type, enabled=False):  # 8 bits are too few for places
            first = torch.einsum("bkyx,kc->bcyx", share, self.offsets)  # cells
        context = self.context(side_by_side(image8, render8, self.geometry8(geometry4)))
        hidden = self.decode(side_by_side(volume * 4, first / 8, context))
        coarse = dense_prediction(self.answer(hidden), first * 8, 8.0)

        fine, fine_hidden = self._refine(shared4, geometry4, hidden, coarse, batch)
        solved = self._solve(observation, depth, fine)

        attention = torch.sigmoid(self.attend(hidden))
        object_cells = functional.max_pool2d(observation.mask, 4)
        pooled = torch.cat(
            [
                attention_pool(hidden, attention),
                attention_pool(fine_hidden, object_cells),
                solved / 10,
            ],
            1,
        )
        values = self.head(pooled)
        delta = solved + values[:, :6] * HEAD_SCALE
        confidence = values[:, 19]
        prediction = PolicyOutput(values[:, 6:19], delta, torch.sigmoid(confidence), attention)
        return CorrelationOutput(
            matching.flatten(2).mT, coarse, fine, solved, confidence, prediction
        )

    def descriptors(self, images: Tensor) -> Tensor:
        """What each cell of 8 × 8 pixels looks like: images (B, 3, H, W) in [0, 1] → (B, C, h, w).

        h and w are H / 8 and W / 8, rounded up; not normalised.
        """
        pictures = (images - GREY).contiguous(memory_format=torch.channels_last)
        described: Tensor = self.encode8(self.encode4(pictures))
        return described

    def _solve(self, observation: Observation, depth: Tensor, cells: DensePrediction) -> Tensor:
        """The pose delta (B, 6) that fits the dense predictions, solved in float32."""
        points = surface_points(depth, observation.distance, self.fine_pixels)
        covered = observation.mask[:, 0, self.fine_pixels[:, 1], self.fine_pixels[:, 0]]
        weight = torch.sigmoid(cells.weight.float()).flatten(1) * covered
        moves, shape = (one.flatten(2).mT.float() for one in (cells.displacement, cells.shape))
        slopes = jacobian(points, observation.distance)
        with torch.autocast(depth.device.type, enabled=False):
            return solve_delta(moves, weight, shape, slopes, self.damping.exp())[0]

    def _refine(
        self,
        shared4: Tensor,
        geometry4: Tensor,
        hidden: Tensor,
        coarse: DensePrediction,
        batch: int,
    ) -> tuple[DensePrediction, Tensor]:
        """Match again at stride 4 around the coarse answer."""
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
        fine = self.fine_decode(side_by_side(correlation * 4, start / 16, context))
        return dense_prediction(self.fine_answer(fine), start, 4.0), fine


def dense_prediction(values: Tensor, start: Tensor, stride: float) -> DensePrediction:
    """Outputs (B, 4 or 6, n, n) around displacements to start from (B, 2, n, n), patch pixels."""
    return DensePrediction(
        start + values[:, :2] * stride, values[:, 2], values[:, 3], values[:, 4:]
    )
