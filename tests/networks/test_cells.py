"""The level at stride 2: it begins as no correction, and its means fit the coarser cells."""

import torch

from moveit6d.networks.cells import CellAnswer, FinestLevel, pool_cells
from moveit6d.networks.least_squares import cell_pixels


def some_cells(cells: int) -> CellAnswer:
    """Displacements that grow evenly over the patch, as a zoom has them."""
    stride = 128 // cells
    pixels = cell_pixels(stride).float().mT.reshape(1, 2, cells, cells)
    one = torch.ones(1, cells, cells)
    return CellAnswer(pixels * 0.1, one, one * 2, pixels * 0.01)


def test_it_begins_as_no_correction() -> None:
    level = FinestLevel(24, 12, 32, 16, 1).eval()
    generator = torch.Generator().manual_seed(0)
    shared = torch.randn(2, 24, 64, 64, generator=generator)
    geometry = torch.randn(1, 12, 64, 64, generator=generator)
    hidden = torch.randn(1, 32, 32, 32, generator=generator)
    before = some_cells(32)
    with torch.no_grad():
        after = pool_cells(level(shared, geometry, hidden, before))
    inner = slice(1, -1)  # at the border enlarging repeats the last cell
    torch.testing.assert_close(
        after.displacement[..., inner, inner], before.displacement[..., inner, inner]
    )
    torch.testing.assert_close(after.weight, before.weight)
    torch.testing.assert_close(after.visibility, before.visibility)


def test_means_of_finer_cells_belong_to_the_coarser_pixels() -> None:
    fine, coarse = some_cells(64), some_cells(32)
    torch.testing.assert_close(pool_cells(fine).displacement, coarse.displacement)
    torch.testing.assert_close(pool_cells(fine).shape, coarse.shape)
