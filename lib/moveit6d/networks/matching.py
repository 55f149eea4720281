"""Local correlation: each cell of the rendering against the cells of the image around it.

Never learns anything: pictures, index tables and matrix products. Answers are channels_last in
memory, as the convolutions after them want them.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from ..geometry.crop import PATCH_SIZE
from ..observation import GREY, Observation
from .least_squares import cell_pixels

BLOCK = 8  # cells a side of the blocks in which the correlation of a large grid is computed


def encoder_pictures(observation: Observation) -> Tensor:
    """What an encoder sees of a batch: the images, then the renderings, (2 B, 3, H, W).

    Grey, not black, around the object: a dark one would have no outline.
    """
    rendering = (observation.rendering - GREY) * observation.mask
    pictures = torch.cat([observation.image - GREY, rendering])
    return pictures.contiguous(memory_format=torch.channels_last)


def centred(features: Tensor) -> Tensor:
    """Without the picture's mean feature, which says nothing about where a cell belongs."""
    return features - features.mean((2, 3), keepdim=True)


def window_index(cells: int, radius: int) -> Tensor:
    """For each of cells² cells, where its (2r + 1)² window lies in the padded grid, flattened."""
    line, reach = torch.arange(cells), torch.arange(-radius, radius + 1)
    y, x = torch.meshgrid(line, line, indexing="ij")
    dy, dx = torch.meshgrid(reach, reach, indexing="ij")
    row = y.reshape(-1, 1) + dy.reshape(1, -1) + radius
    column = x.reshape(-1, 1) + dx.reshape(1, -1) + radius
    return row * (cells + 2 * radius) + column


def index_tables(radius: int, fine_radius: int) -> dict[str, Tensor]:
    """What a network looks up in the correlation at strides 8 and 4, by the names it has there."""
    line = torch.arange(-radius, radius + 1, dtype=torch.float32)
    dy, dx = torch.meshgrid(line, line, indexing="ij")
    return {
        "offsets": torch.stack([dx, dy], -1).reshape(-1, 2),
        "coarse_index": window_index(PATCH_SIZE // 8, radius),
        "fine_index": window_index(BLOCK, fine_radius),
        "fine_pixels": cell_pixels(4),
    }


def correlate(render: Tensor, image: Tensor, index: Tensor, radius: int) -> Tensor:
    """Products of each rendering cell with the image cells around it: (B, (2r+1)², n, n).

    All pairs by one matrix product, then a gather: 30 times faster than unfolding the windows.
    """
    batch, _, n, _ = render.shape
    if len(index) != n * n:  # of a network's usual patches
        index = window_index(n, radius).to(index.device)
    padded = functional.pad(image, [radius] * 4).flatten(2)
    products = render.flatten(2).mT @ padded
    window = products.gather(2, index[None].expand(batch, -1, -1))
    return window.reshape(batch, n, n, -1).permute(0, 3, 1, 2)


def correlate_blocks(render: Tensor, image: Tensor, index: Tensor, radius: int) -> Tensor:
    """As `correlate` for a large grid, in blocks so that far pairs are never computed."""
    batch, channels, n, _ = render.shape
    blocks, width = n // BLOCK, BLOCK + 2 * radius
    cells = render.reshape(batch, channels, blocks, BLOCK, blocks, BLOCK)
    cells = cells.permute(0, 2, 4, 3, 5, 1).reshape(-1, BLOCK * BLOCK, channels)
    windows = functional.pad(image, [radius] * 4).unfold(2, width, BLOCK).unfold(3, width, BLOCK)
    windows = windows.permute(0, 2, 3, 1, 4, 5).reshape(-1, channels, width * width)
    products = (cells @ windows).gather(2, index[None].expand(len(cells), -1, -1))
    products = products.reshape(batch, blocks, blocks, BLOCK, BLOCK, -1)
    return products.transpose(2, 3).reshape(batch, n, n, -1).permute(0, 3, 1, 2)


def side_by_side(*maps: Tensor) -> Tensor:
    """Maps (B, Ci, n, n) as one, channels_last: where one of them is not, `cat` would answer in
    the other layout and the convolution after it would spend longer on that than on its work."""
    return torch.cat([one.contiguous(memory_format=torch.channels_last) for one in maps], 1)


def warp_cells(features: Tensor, displacement: Tensor, stride: int) -> Tensor:
    """Features (B, C, n, n) of the image where each cell's displacement (B, 2, n, n) leads.

    Displacements in patch pixels, cells of `stride` pixels.
    """
    cells = features.shape[-1]
    line = torch.arange(cells, dtype=displacement.dtype, device=features.device)
    line = line * stride + (stride - 1) / 2
    y, x = torch.meshgrid(line, line, indexing="ij")
    places = torch.stack([x, y], -1) + displacement.permute(0, 2, 3, 1)
    grid = (places + 0.5) * (2 / (cells * stride)) - 1
    return functional.grid_sample(features, grid, align_corners=False)
