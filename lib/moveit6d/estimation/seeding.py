"""Seeds over an image: where one iteration at each of them wants to go, and where that leads.

Never refines a pose and never knows a true one. Paper, "Initialization & Detection";
docs/method.md. The vectors point *toward* the object, so the field converges there: with the usual
sign its divergence is most negative at the object, and what the paper calls the maximum of W is the
maximum of −∇·V.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ..config import ActionMode, SeedDetectorConfig
from ..errors import InputError
from ..frame import Frame
from ..geometry.camera import Camera
from ..geometry.crop import View, look_at, patch_to_image
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..networks.policy_output import PolicyOutput
from ..observation import observe_shared
from ..policies import BATCH_SIZE, LoopState, Policy
from ..rendering.renderer import Renderer

FEWEST = 3  # seeds a row or column: the central differences of the divergence need as many
DEFAULT = SeedDetectorConfig()


@dataclass(frozen=True)
class SeedField:
    """What one iteration at every seed of a grid said; rows × columns = h × w.

    `centres` (h, w, 2) are the seeds' pixels; `vectors` (h, w, 2) the predicted shifts in the
    image, of length 1 for one seeded pose and their mean for several; `sink`
    (h, w) is −∇·V of the field after smoothing times `size`, a pure number;
    `confidence` (h, w) is the policy's at each seed; `size` the width in pixels of the object's
    sphere as seeded.
    """

    centres: Tensor
    vectors: Tensor
    sink: Tensor
    confidence: Tensor
    size: float


@dataclass(frozen=True)
class Sink:
    """Where a field converges.

    `centre` (2,) in pixels, `strength` is the peak of −∇·V (a pure number), `size` the object's
    width in pixels that the extent of the sink speaks for.
    """

    centre: Tensor
    strength: float
    size: float


def seed_field(
    frame: Frame,
    mesh: Mesh,
    rotations: Tensor,
    size: float,
    policy: Policy,
    renderer: Renderer,
    config: SeedDetectorConfig = DEFAULT,
) -> SeedField:
    """One iteration from each seed of a grid over the image, in batches.

    Every seed shows the object in the same rotation, as seen along its own ray, and `size` pixels
    wide, so that one rendering serves all. With several `rotations` (R, 3, 3) the vectors of each
    seed are averaged: what does not depend on the seeded pose stays. Policies that only choose
    single actions give the vector by the odds of their t_x and t_y. Raises `InputError` for a
    policy of axis-parallel crops, in which one rendering does not look the same everywhere.
    """
    if policy.crop != "look_at":
        raise InputError(
            f"Detection needs a policy that sees look-at crops; this one's are {policy.crop!r}: "
            "give other weights or start poses."
        )
    centres = seed_grid(frame.camera, size, config)
    found = [_shifts(frame, mesh, turn, size, centres, policy, renderer) for turn in rotations]
    vectors = torch.stack([shifts for shifts, _ in found]).mean(0).reshape(centres.shape)
    confidence = torch.stack([belief for _, belief in found]).amax(0)
    step = spacing(centres)
    smooth = smoothed(vectors, config.smoothing * size / step)
    sink = size * sink_of(smooth, step)
    return SeedField(centres, vectors, sink, confidence.reshape(centres.shape[:2]), size)


def _shifts(
    frame: Frame,
    mesh: Mesh,
    rotation: Tensor,
    size: float,
    centres: Tensor,
    policy: Policy,
    renderer: Renderer,
) -> tuple[Tensor, Tensor]:
    """Unit vectors (N, 2) in the image and confidences (N,) at the seeds, for one rotation."""
    pixels = centres.reshape(-1, 2)
    pose = seed_poses(pixels, rotation, mesh.sphere_diameter, size, frame.camera)
    diameter = torch.full((len(pixels),), mesh.sphere_diameter, dtype=torch.float64)
    view = look_at(pose, diameter)
    gbuffer = renderer.render([mesh], view.to_virtual(pose)[:1], view.intrinsics[:1])
    shifts, confidences = [], []
    for rows in torch.split(torch.arange(len(pixels)), BATCH_SIZE):
        part = view[rows]
        observation = observe_shared(frame, gbuffer, part, diameter[rows])
        state = LoopState(pose[rows], diameter[rows], torch.zeros_like(rows))
        prediction = policy.predict(observation, state)
        shifts.append(_in_image(planar_shift(prediction, policy.mode), part, frame.camera))
        confidences.append(prediction.confidence.to(torch.float64))
    return torch.cat(shifts), torch.cat(confidences)


def seed_poses(
    pixels: Tensor, rotation: Tensor, sphere_diameter: float, size: float | Tensor, camera: Camera
) -> Pose:
    """Centred poses (N) at pixels (N, 2), about `size` pixels wide: one size, or (N,).

    `rotation` (3, 3) or (N, 3, 3) is the object's as seen along the ray through the pixel: with one
    for all, all look the same.
    """
    ray = functional.normalize(camera.unproject(pixels), dim=1)
    distance = camera.fx * sphere_diameter / torch.as_tensor(size, dtype=ray.dtype)
    place = ray * distance.expand(len(pixels))[:, None]
    turned = Pose(rotation.expand(len(pixels), 3, 3), place)
    view = look_at(turned, torch.full((len(pixels),), sphere_diameter, dtype=torch.float64))
    return Pose(view.rotation.mT @ rotation, place)


def planar_shift(prediction: PolicyOutput, mode: ActionMode) -> Tensor:
    """What a prediction says of t_x and t_y: (B, 2), only the direction has a meaning."""
    if mode is ActionMode.ALL_AXES and prediction.delta is not None:
        return prediction.delta[:, :2].to(torch.float64)
    odds = torch.softmax(prediction.logits.to(torch.float64), -1)
    return torch.stack([odds[:, 0] - odds[:, 1], odds[:, 2] - odds[:, 3]], -1)


def smoothed(vectors: Tensor, sigma: float) -> Tensor:
    """A field (h, w, 2) blurred by a Gaussian, `sigma` in cells; beyond the edge nothing counts."""
    reach = max(1, math.ceil(3 * sigma))
    line = torch.arange(-reach, reach + 1, dtype=torch.float64)
    kernel = torch.exp(-0.5 * (line / max(sigma, 1e-6)) ** 2)
    field = torch.cat([vectors.permute(2, 0, 1), torch.ones(1, *vectors.shape[:2])])[:, None]
    for shape in ((1, 1, -1, 1), (1, 1, 1, -1)):
        weights = kernel.reshape(shape).to(field)
        padding = (reach, 0) if shape[2] == -1 else (0, reach)
        field = functional.conv2d(field, weights, padding=padding)
    return (field[:2, 0] / field[2:, 0]).permute(1, 2, 0)


def sink_of(field: Tensor, step: float) -> Tensor:
    """−∇·V of a field (h, w, 2) on a grid with `step` pixels between cells: (h, w), per pixel.

    Central differences; the field goes on beyond the edge as it is there, because differences to
    one side only would make the edge's noise twice that of the rest, and the strongest sinks.
    """
    padded = functional.pad(field.permute(2, 0, 1)[None], [1] * 4, mode="replicate")[0]
    across = padded[0, 1:-1, 2:] - padded[0, 1:-1, :-2]
    down = padded[1, 2:, 1:-1] - padded[1, :-2, 1:-1]
    return -(across + down) / (2 * step)


def find_sinks(field: SeedField, count: int, config: SeedDetectorConfig = DEFAULT) -> list[Sink]:
    """The `count` strongest sinks (fewer if there are not as many), the strongest first.

    Peaks lie at least a cell apart; each is placed to a fraction of a cell.
    """
    values = field.sink[None, None]
    peaks = (values == functional.max_pool2d(values, 3, 1, 1))[0, 0] & (field.sink > 0)
    places = peaks.nonzero().tolist()
    places.sort(key=lambda place: -float(field.sink[place[0], place[1]]))
    return [_sink(field, row, column, config) for row, column in places[:count]]


def _sink(field: SeedField, row: int, column: int, config: SeedDetectorConfig) -> Sink:
    """The sink with its peak in that cell."""
    from scipy.ndimage import label

    top, left = max(row - 1, 0), max(column - 1, 0)
    near = field.sink[top : row + 2, left : column + 2].clamp_min(0)
    places = field.centres[top : row + 2, left : column + 2]
    centre = (places * near[..., None]).sum((0, 1)) / near.sum()
    peak = float(field.sink[row, column])
    regions, _ = label((field.sink > 0.5 * peak).numpy())
    cells = int((regions == regions[row, column]).sum())
    extent = 2 * spacing(field.centres) * math.sqrt(cells / math.pi)
    low, high = config.extent_ratio
    size = min(max(extent / config.extent, low * field.size), high * field.size)
    return Sink(centre, peak, size)


def seed_grid(camera: Camera, size: float, config: SeedDetectorConfig = DEFAULT) -> Tensor:
    """Pixels (h, w, 2) of seeds, `spacing` of the size apart and centred on the image."""
    step = max(config.spacing * size, max(camera.width, camera.height) / config.max_seeds)
    step = min(step, (min(camera.width, camera.height) - 1) / (FEWEST - 1))
    lines = []
    for length in (camera.width, camera.height):
        count = int((length - 1) / step) + 1
        lines.append((length - 1) / 2 + step * (torch.arange(count).double() - (count - 1) / 2))
    y, x = torch.meshgrid(lines[1], lines[0], indexing="ij")
    return torch.stack([x, y], -1)


def spacing(centres: Tensor) -> float:
    """Pixels between neighbouring seeds of a grid (h, w, 2)."""
    return float(centres[0, 1, 0] - centres[0, 0, 0])


def _in_image(shifts: Tensor, view: View, camera: Camera) -> Tensor:
    """Unit vectors (B, 2) in the image for shifts (B, 2) in the crops; zero stays zero."""
    back = patch_to_image(view, camera.matrix.expand(len(shifts), 3, 3))
    middle = view.intrinsics[:, :2, 2]
    start = _mapped(back, middle)
    direction = functional.normalize(shifts, dim=1)
    return functional.normalize(_mapped(back, middle + direction) - start, dim=1)


def _mapped(homography: Tensor, pixels: Tensor) -> Tensor:
    ones = torch.ones_like(pixels[:, :1])
    moved = (homography @ torch.cat([pixels, ones], 1)[..., None])[..., 0]
    return moved[:, :2] / moved[:, 2:]
