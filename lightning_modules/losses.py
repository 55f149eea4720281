"""What the networks are trained to do: dense truth for every cell, losses, and one-step scores.

Never draws data and never optimises. docs/method.md has the terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from moveit6d.actions import PoseAction, expert_action
from moveit6d.estimation.detection.templates import CELL, cell_weights
from moveit6d.networks.correlation import CorrelationOutput
from moveit6d.networks.dense_prediction import DensePrediction
from moveit6d.networks.least_squares import (
    move_points,
    object_pixels,
    precision,
    project_points,
    slanted,
    surface_points,
)
from moveit6d.networks.matching import centred
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import GREY
from moveit6d.synthesis.training.pairs import TrainingBatch
from moveit6d.synthesis.training.views import ViewBatch

FARTHEST = 45.0  # pixels; cells that moved farther teach nothing
RIGHT = 0.10  # mean point error in diameters under which a pose counts as right, as ADD < 10 % d


@dataclass(frozen=True)
class LossWeights:
    """Weights of the terms, and the scale of each axis in the regression terms."""

    matching: float = 0.5
    coarse: float = 0.05
    fine: float = 0.3
    shape: float = 0.1
    visibility: float = 0.2
    weight: float = 0.2
    solved: float = 1.0
    delta: float = 1.5
    points: float = 2.0
    actions: float = 0.1
    confidence: float = 0.2
    views: float = 0.1
    teacher: float = 3.0  # at the first step
    # A unit of t_z moves a far object by a tenth of its diameter, so it must be the most exact.
    scale: tuple[float, float, float, float, float, float] = (4.0, 4.0, 2.0, 4.0, 4.0, 4.0)
    beta: float = 0.15


@dataclass(frozen=True)
class DenseTruth:
    """True displacement (B, M, 2) in pixels, visibility and being on the object (B, M) in 0..1."""

    displacement: Tensor
    visible: Tensor
    covered: Tensor


def dense_truth(batch: TrainingBatch, stride: int) -> DenseTruth:
    """Where each cell's surface point really is in the observed patch, and whether it shows."""
    observation = batch.observation
    pixels, covered = object_pixels(observation.mask, stride)
    points = surface_points(observation.depth, observation.distance, pixels)
    moved = _moved(batch, points, batch.delta)
    goal = project_points(moved, observation.distance)
    nearest = goal.round().long()
    size = observation.depth.shape[-1]
    inside = ((nearest >= 0) & (nearest < size)).all(-1)
    column, row = nearest.clamp(0, size - 1).unbind(-1)
    sample = torch.arange(len(observation), device=row.device)[:, None]
    surface = batch.true_depth[sample, 0, row, column] + observation.distance[:, None]
    shows = batch.visible[sample, 0, row, column] > 0.5
    same = (surface - moved[..., 2]).abs() < 0.06  # else another part of the object is in front
    visible = (inside & shows & same).float() * covered
    return DenseTruth(goal - pixels.to(goal), visible, covered)


def _moved(batch: TrainingBatch, points: Tensor, delta: Tensor) -> Tensor:
    """Surface points (B, M, 3) after a pose delta (B, 6), in float32 also within autocast.

    Its products of matrices have 8 bits: on average the points would lie 0.06 pixels off.
    """
    with torch.autocast(points.device.type, enabled=False):
        return move_points(points, batch.observation.distance, delta.float(), batch.direction)


def correlation_losses(
    output: CorrelationOutput, batch: TrainingBatch, radius: int, weights: LossWeights
) -> tuple[dict[str, Tensor], Tensor]:
    """Every term of the correlation network's loss, unweighted, by name; which (B,) are right."""
    coarse, fine = (dense_truth(batch, stride) for stride in (8, 4))
    coarse_flow, coarse_seen, coarse_weight = _dense_losses(output.coarse, coarse, 3.0)
    fine_flow, fine_seen, fine_weight = _dense_losses(output.fine, fine, 2.0)
    scale = batch.delta.new_tensor(weights.scale)
    delta = output.prediction.delta
    assert delta is not None
    error = point_error(batch, delta)
    right = is_right(batch, error.detach())
    near = batch.near

    def regression(found: Tensor) -> Tensor:
        loss = functional.smooth_l1_loss(
            found / scale, batch.delta / scale, beta=weights.beta, reduction="none"
        )
        return _mean_of(loss.mean(1), near)

    terms = {
        "matching": matching_loss(output.matching, coarse, radius),
        "coarse": coarse_flow,
        "fine": fine_flow,
        "shape": shape_loss(output.fine, fine),
        "visibility": coarse_seen + fine_seen,
        "weight": coarse_weight + fine_weight,
        "solved": regression(output.solved),
        "delta": regression(delta),
        "points": _mean_of(error.clamp_max(1.0), near),
        "actions": action_loss(output.prediction, batch),
        "confidence": functional.binary_cross_entropy_with_logits(output.confidence_logit, right),
    }
    return terms, right


def _mean_of(values: Tensor, weight: Tensor) -> Tensor:
    """Weighted mean of values (B,)."""
    return (values * weight).sum() / weight.sum().clamp_min(1)


def matching_loss(logits: Tensor, truth: DenseTruth, radius: int) -> Tensor:
    """Cross-entropy of the correlation (B, cells, offsets) against the true displacement.

    The target is spread over the four nearest cells bilinearly, so its floor is about 1.1.
    """
    cells = truth.displacement / 8
    reach = radius - 0.01
    usable = (cells.abs().amax(-1) < reach) * truth.visible
    cells = cells.clamp(-reach, reach)
    low = cells.floor()
    part = cells - low
    score = torch.log_softmax(logits, -1)
    total = torch.zeros_like(usable)
    for dx in (0, 1):
        for dy in (0, 1):
            share_x = part[..., 0] if dx else 1 - part[..., 0]
            share_y = part[..., 1] if dy else 1 - part[..., 1]
            row, column = low[..., 1] + dy + radius, low[..., 0] + dx + radius
            index = (row * (2 * radius + 1) + column).long()
            total = total - score.gather(-1, index[..., None])[..., 0] * share_x * share_y
    return (total * usable).sum() / usable.sum().clamp_min(1)


def action_loss(prediction: PolicyOutput, batch: TrainingBatch) -> Tensor:
    """Cross-entropy of the 13 logits against the expert.

    It stands in for the paper's Hamming distance of one-hot vectors, which has no useful gradient.
    """
    loss = functional.cross_entropy(
        prediction.logits.float(), expert_action(batch.delta), reduction="none"
    )
    return _mean_of(loss, batch.near)


def action_losses(
    prediction: PolicyOutput, confidence_logit: Tensor, batch: TrainingBatch
) -> dict[str, Tensor]:
    """The terms of the loss of a network that chooses single actions, by name."""
    action = PoseAction.from_index(prediction.logits.argmax(-1))
    right = is_right(batch, point_error(batch, action.delta))
    return {
        "actions": action_loss(prediction, batch),
        "confidence": functional.binary_cross_entropy_with_logits(confidence_logit, right),
    }


def is_right(batch: TrainingBatch, error: Tensor) -> Tensor:
    """Which poses (B,) with these `point_error`s count as right, 1 or 0.

    By the object as it is, however large the patch shows it.
    """
    return (error < RIGHT * batch.zoom.to(error)).float() * batch.present


def point_error(batch: TrainingBatch, delta: Tensor) -> Tensor:
    """Mean distance (B,) of visible-side surface points after the move and at the truth, diameters.

    An ADD over the half of the surface that the rendering shows.
    """
    observation = batch.observation
    pixels, covered = object_pixels(observation.mask, 8)
    points = surface_points(observation.depth, observation.distance, pixels)
    moved, goal = (_moved(batch, points, one) for one in (delta, batch.delta))
    apart = slanted(moved - goal, batch.direction)
    distance = (apart.square().sum(-1) + 1e-8).sqrt()
    return (distance * covered).sum(1) / covered.sum(1).clamp_min(1)


def _dense_losses(
    answer: DensePrediction, truth: DenseTruth, softness: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Robust displacement error on visible cells, visibility and weight on the object's cells."""
    found = answer.displacement.flatten(2).mT
    error = (found - truth.displacement).abs().sum(-1)
    near = (truth.displacement.abs().amax(-1) < FARTHEST).float()
    use = truth.visible * near
    displacement = ((error.square() + 0.01).sqrt() * use).sum() / use.sum().clamp_min(1)
    good = truth.visible * torch.exp(-error.detach() / softness)
    return (
        displacement,
        _mean_entropy(answer.visibility.flatten(1), truth.visible, truth.covered),
        _mean_entropy(answer.weight.flatten(1), good, truth.covered),
    )


def shape_loss(answer: DensePrediction, truth: DenseTruth) -> Tensor:
    """Length of the displacements' errors as the stated precision measures it.

    The precision has determinant 1, so this is least where it is the errors' inverse covariance up
    to scale. The errors themselves are not moved by it.
    """
    error = (answer.displacement.flatten(2).mT - truth.displacement).detach()
    known = precision(answer.shape.flatten(2).mT.float())  # from 8 bits: a sixth off
    x, y = error.unbind(-1)
    measured = known[..., 0, 0] * x * x + 2 * known[..., 0, 1] * x * y + known[..., 1, 1] * y * y
    use = truth.visible * (truth.displacement.abs().amax(-1) < FARTHEST)
    return ((measured + 0.01).sqrt() * use).sum() / use.sum().clamp_min(1)


def _mean_entropy(logits: Tensor, target: Tensor, where: Tensor) -> Tensor:
    entropy = functional.binary_cross_entropy_with_logits(logits, target, reduction="none")
    return (entropy * where).sum() / where.sum().clamp_min(1)


_NEVER = -10.0  # the score of what is not to be chosen; an infinite one has no gradient
# Cells by which a template is put beside its place.
_BESIDE = ((3, 0), (-3, 0), (0, 3), (0, -3), (4, 4), (-4, 4), (4, -4), (-4, -4), (6, 0), (0, 6))


def view_pictures(views: ViewBatch) -> Tensor:
    """The pictures and then the templates of views, as the encoder sees them: (N (2 + K), 3, …)."""
    templates, masks = views.templates.flatten(0, 1), views.masks.flatten(0, 1)
    return torch.cat([views.image, (templates - GREY) * masks + GREY])


def view_loss(described: Tensor, views: ViewBatch, mesh: Tensor, temperature: Tensor) -> Tensor:
    """How well descriptors of `view_pictures` tell the right template and its place from others.

    Cross-entropy of the right template among those of other sides and other objects, and of its
    place among those beside it and in other pictures; scores are mean cosines on the template.
    """
    count, each = views.masks.shape[:2]
    described = functional.normalize(centred(described.float()), dim=1)
    image = described[:count]
    templates = described[count:].reshape(count, each, *image.shape[1:])
    masks = (cell_weights(functional.avg_pool2d(views.masks.flatten(0, 1), CELL)) > 0).float()
    masks = masks.reshape(count, each, *masks.shape[1:])  # (N, 1 + K, 1, 16, 16)
    size = masks.flatten(2).sum(2).clamp_min(1)
    masked = templates * masks
    own = (masked * image[:, None]).flatten(2).sum(2) / size  # (N, 1 + K)
    across = image.flatten(1) @ masked[:, 0].flatten(1).T / size[None, :, 0]  # (picture, template)
    mesh = mesh[:count].to(across.device)
    never = across.new_tensor(_NEVER)
    across = torch.where(mesh[:, None] == mesh[None], never, across)
    others = torch.where(views.positive[:, 1:] > 0.5, never, own[:, 1:])
    scale = temperature.exp().clamp_max(50.0)
    weight = views.visible * (views.visible > 0.3) * (size[:, 0] > 4)
    target = torch.zeros(count, dtype=torch.long, device=image.device)
    by_view = torch.cat([own[:, :1], others, across], 1) * scale
    by_place = torch.cat([own[:, :1], _beside(masked[:, 0], masks[:, 0], image), across.T], 1)
    losses = functional.cross_entropy(by_view, target, reduction="none")
    losses = losses + functional.cross_entropy(by_place * scale, target, reduction="none")
    return _mean_of(losses, weight)


def _beside(masked: Tensor, mask: Tensor, image: Tensor) -> Tensor:
    """Scores (N, places) of templates (N, D, 16, 16) that are put in the wrong places."""
    cells, found = image.shape[-1], []
    total = mask.flatten(1).sum(1)
    for x, y in _BESIDE:
        rows = slice(max(0, -y), cells - max(0, y))
        columns = slice(max(0, -x), cells - max(0, x))
        moved = image[..., max(0, y) : cells + min(0, y), max(0, x) : cells + min(0, x)]
        inside = mask[..., rows, columns].flatten(1).sum(1)
        score = (masked[..., rows, columns] * moved).flatten(1).sum(1) / inside.clamp_min(1)
        found.append(torch.where(inside > 0.4 * total, score, _NEVER))
    return torch.stack(found, 1)
