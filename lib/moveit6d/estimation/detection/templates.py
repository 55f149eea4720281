"""Templates of a mesh: what it looks like from all sides, as descriptors to search images with.

Never sees an image of the real world and never decides where an object is.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import torch
from torch import Tensor
from torch.nn import functional

from ...config import TemplateConfig
from ...errors import InputError
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...geometry.rotation_grid import rotation_grid
from ...io import replacing
from ...observation import GREY
from ...policies import BATCH_SIZE
from ...rendering.renderer import Renderer
from ...rendering.shading import shade_plain

CELL = 8  # pixels a side that one descriptor stands for: the networks' stride
MARGIN = 2  # cells around the object in a rendering: descriptors are centred over all of it
# Of opponent colours in ordinary images: their unit. Their weight is `TemplateConfig.colour`.
COLOUR_SPREAD = 0.15
LOG = logging.getLogger("moveit6d")

Describe = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Templates:
    """One mesh from `N` sides.

    `rotations` (N, 3, 3) float64 are the object's as seen along the ray through its centre;
    `kernels` (N, C, k, k) the normalised descriptors, projected to the axes that tell the object's
    own cells apart best (`basis` (D, C or C − 3)), and with a weight three channels of colour,
    masked and divided by the mask's sum, so that the correlation with an image's is a
    mean over the object; `shares` (N, k, k) how much of that mean each cell is; `boxes` (N, 4) the
    silhouettes' left, top, right and bottom edges from the centre, in widths of the sphere.
    """

    rotations: Tensor
    kernels: Tensor
    shares: Tensor
    basis: Tensor
    boxes: Tensor

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def cells(self) -> int:
        """Cells a side of a template."""
        return self.kernels.shape[-1]

    @cached_property
    def rows(self) -> Tensor:
        """The kernels as rows (N, C·k·k), to be multiplied with windows of an image."""
        return self.kernels.flatten(1)  # a copy: the kernels' channels lie together

    def project(self, features: Tensor) -> Tensor:
        """Descriptors (B, D, h, w) of an image for these kernels, without colours."""
        return torch.einsum("bdhw,dc->bchw", features, self.basis)


@dataclass(frozen=True)
class TemplateBank:
    """A mesh prepared for detection: `coarse` templates find places, `fine` ones the view there.

    Both have one basis. Only the coarse ones have colours.
    """

    fine: Templates
    coarse: Templates


@torch.inference_mode()
def make_templates(
    mesh: Mesh, describe: Describe, renderer: Renderer, config: TemplateConfig
) -> TemplateBank:
    """Render a mesh from all sides and describe what is seen.

    `describe` takes images (B, 3, H, W) in [0, 1] to descriptors (B, D, H / 8, W / 8).
    """
    kinds = (config.rotations, config.width), (config.coarse_rotations, config.coarse_width)
    views = [
        _views(mesh, rotation_grid(count), describe, renderer, replace(config, width=width))
        for count, width in kinds
    ]
    fine = views[0]
    basis = _principal_axes(fine.features.permute(0, 2, 3, 1)[fine.weight > 0], config.channels)
    return TemplateBank(fine.templates(basis), views[1].templates(basis, config.colour))


@dataclass(frozen=True)
class _Views:
    """Normalised descriptors (N, D, h, w) and colours (N, 3, h, w) of renderings.

    `covered` (N, h, w) is the object's share of each cell.
    """

    rotations: Tensor
    features: Tensor
    colours: Tensor
    covered: Tensor
    boxes: Tensor

    @property
    def weight(self) -> Tensor:
        """Of each cell (N, h, w), see `cell_weights`."""
        return cell_weights(self.covered)

    def templates(self, basis: Tensor, colour: float | None = None) -> Templates:
        """Project to a basis (D, C) and cut the middle out, where the object is."""
        weight = self.weight[:, None]
        projected = torch.einsum("bchw,cd->bdhw", self.features, basis)
        shares = weight / (weight.sum((2, 3), keepdim=True) + 1e-6)
        channels = projected if colour is None else torch.cat([projected, colour * self.colours], 1)
        kernels = channels * shares
        inner = slice(MARGIN, -MARGIN)
        return Templates(
            self.rotations,
            kernels[..., inner, inner].contiguous(memory_format=torch.channels_last),
            shares[:, 0, inner, inner].contiguous(),
            basis,
            self.boxes,
        )


def _views(
    mesh: Mesh, rotations: Tensor, describe: Describe, renderer: Renderer, config: TemplateConfig
) -> _Views:
    features, colours, covered, boxes = [], [], [], []
    for first in range(0, len(rotations), BATCH_SIZE):
        some = rotations[first : first + BATCH_SIZE]
        images, mask = _render(mesh, some, renderer, config)
        described = describe(images)
        # The patch's mean says nothing about where a cell belongs on the object.
        described = described - described.mean((2, 3), keepdim=True)
        features.append(functional.normalize(described, dim=1))
        colours.append(colour_cells(images, described.shape[2:]))
        covered.append(functional.avg_pool2d(mask, CELL)[:, 0])
        boxes.append(_boxes(mask[:, 0], config.width))
    parts = (torch.cat(some) for some in (features, colours, covered, boxes))
    return _Views(rotations, *parts)


def cell_weights(covered: Tensor) -> Tensor:
    """Weights of cells (N, ..., h, w): the object's share of each, or 0 if that is small.

    Small is up to half of its largest share of any cell: slender objects fill none.

    >>> cell_weights(torch.tensor([[[1.0, 0.75, 0.25]], [[0.5, 0.375, 0.125]]])).tolist()
    [[[1.0, 0.75, 0.0]], [[0.5, 0.375, 0.0]]]
    """
    least = 0.5 * covered.amax((-2, -1), keepdim=True)
    return torch.where(covered > least, covered, 0.0)


def colour_cells(images: Tensor, size: Sequence[int]) -> Tensor:
    """Two opponent colours and the brightness of cells: (B, 3, H, W) in [0, 1] → (B, 3, *size).

    In units of `COLOUR_SPREAD`, about as large as the channels of a normalised descriptor.
    """
    cells = functional.interpolate(images - GREY, size=list(size), mode="area")
    red, green, blue = cells[:, :1], cells[:, 1:2], cells[:, 2:]
    opponents = [red - green, green - blue, 0.5 * cells.mean(1, keepdim=True)]
    return torch.cat(opponents, 1) / COLOUR_SPREAD


def _render(
    mesh: Mesh, rotations: Tensor, renderer: Renderer, config: TemplateConfig
) -> tuple[Tensor, Tensor]:
    """Images (B, 3, H, W) on grey and masks (B, 1, H, W) of a mesh, by rotations (B, 3, 3)."""
    count, size = len(rotations), config.width + 2 * MARGIN * CELL
    middle = (size - 1) / 2
    place = torch.tensor([0.0, 0.0, config.distance * mesh.sphere_diameter], dtype=torch.float64)
    focal = config.width * config.distance
    rows = [[focal, 0.0, middle], [0.0, focal, middle], [0.0, 0.0, 1.0]]
    intrinsics = torch.tensor(rows, dtype=torch.float64).expand(count, 3, 3)
    poses = Pose(rotations, place.expand(count, 3))
    seen = renderer.render([mesh] * count, poses, intrinsics, size)
    images = shade_plain(seen).clamp(0, 1) * seen.mask + GREY * (1 - seen.mask)
    return images, seen.mask


def _principal_axes(cells: Tensor, count: int) -> Tensor:
    """The `count` orthonormal directions (D, count) in which cells (N, D) differ most."""
    covariance = cells.mT @ cells / max(len(cells), 1)
    axes: Tensor = torch.linalg.eigh(covariance)[1]
    return axes[:, -min(count, axes.shape[1]) :].flip(1).contiguous()


def _boxes(masks: Tensor, width: int) -> Tensor:
    """Edges (B, 4) of masks (B, H, W) from their middle, in widths of the sphere; 0 if empty.

    `width` is the sphere's in pixels.
    """
    size = masks.shape[-1]
    line = torch.arange(size, dtype=torch.float32)
    found = []
    for axis in (1, 2):  # columns, then rows
        there = masks.amax(axis) > 0
        low = torch.where(there, line, float(size)).amin(1)
        high = torch.where(there, line + 1, 0.0).amax(1)
        found.append((low.minimum(high), high))
    edges = torch.stack([found[0][0], found[1][0], found[0][1], found[1][1]], 1)
    return (edges - size / 2) / width


class TemplateStore:
    """Templates that were made before: in memory and, with a folder, on disk.

    On disk a file's name is a digest of everything that decides about it: the mesh's surface and
    colours, the network (`network`, any text that names it) and the settings. What cannot be read
    is made anew, what cannot be written is kept in memory; both are logged.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder
        # Whose descriptors they are is kept too, or something else could come to have its id.
        self._known: dict[tuple[str, int], tuple[TemplateBank, Any]] = {}
        self._warned = False

    def get(
        self,
        mesh: Mesh,
        describe: Describe,
        renderer: Renderer,
        config: TemplateConfig,
        network: str = "",
    ) -> TemplateBank:
        """The templates of a mesh; made if they are not there yet.

        Those of a network without a name are kept in memory only, for that network alone.
        """
        owner = None if network else getattr(describe, "__self__", describe)
        digest = _digest(mesh, config, network)
        key = digest, id(owner)
        if key not in self._known:
            file = f"{digest}.safetensors"
            path = self.folder / file if self.folder is not None and network else None
            bank = None if path is None else _read(path)
            if bank is None:
                bank = make_templates(mesh, describe, renderer, config)
                if path is not None:
                    self._write(path, bank)
            self._known[key] = bank, owner
        return self._known[key][0]

    def _write(self, path: Path, bank: TemplateBank) -> None:
        """Keep templates on disk, if that can be done."""
        try:
            _write(path, bank)
        except InputError as error:
            if not self._warned:
                LOG.warning("Prepared meshes are kept in memory only: %s", error)
            self._warned = True


def default_store() -> Path | None:
    """Where the command line keeps prepared meshes: the user's cache folder, None without one."""
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(base or Path.home() / ".cache") / "moveit6d" / "templates"
    except RuntimeError:  # no home
        return None


_DIGESTS: WeakKeyDictionary[Mesh, dict[str, str]] = WeakKeyDictionary()


def _digest(mesh: Mesh, config: TemplateConfig, network: str) -> str:
    settings = f"{config!r} {network} {_VERSION}"
    known = _DIGESTS.setdefault(mesh, {})
    if settings not in known:
        digest = hashlib.sha256(settings.encode())
        for array in (mesh.vertices, mesh.faces, mesh.uv, mesh.texture, mesh.vertex_colors):
            digest.update(b"-" if array is None else array.tobytes())
        known[settings] = digest.hexdigest()[:32]
    return known[settings]


_VERSION = 3  # of what templates are: files of another one are not found
_FIELDS = ("rotations", "kernels", "shares", "basis", "boxes")
_LEVELS = ("fine", "coarse")


def _write(path: Path, bank: TemplateBank) -> None:
    from safetensors.torch import save

    values = {
        f"{level}.{name}": getattr(getattr(bank, level), name).contiguous().clone()
        for level in _LEVELS
        for name in _FIELDS
    }
    with replacing(path) as temporary:
        temporary.write_bytes(save(values))


def _read(path: Path) -> TemplateBank | None:
    """The templates of a file; None if there is none, or none that can be used."""
    from safetensors import SafetensorError
    from safetensors.torch import load

    try:
        values = load(path.read_bytes())
        return TemplateBank(
            *(Templates(*(values[f"{level}.{name}"] for name in _FIELDS)) for level in _LEVELS)
        )
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, SafetensorError, KeyError) as error:
        LOG.warning("%s is not a file of templates (%s); they are made anew.", path, error)
        return None
