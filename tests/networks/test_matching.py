"""Fast correlations and warps against plain loops."""

import torch

from moveit6d.networks.matching import (
    correlate,
    correlate_blocks,
    warp_cells,
    window_index,
)


def plain_correlation(render: torch.Tensor, image: torch.Tensor, radius: int) -> torch.Tensor:
    batch, _, n, _ = render.shape
    side = 2 * radius + 1
    result = torch.zeros(batch, side * side, n, n)
    for y in range(n):
        for x in range(n):
            for k in range(side * side):
                v, u = y + k // side - radius, x + k % side - radius
                if 0 <= v < n and 0 <= u < n:
                    result[:, k, y, x] = (render[:, :, y, x] * image[:, :, v, u]).sum(1)
    return result


def test_fast_correlations_agree_with_a_plain_loop() -> None:
    generator = torch.Generator().manual_seed(0)
    render, image = torch.randn(2, 2, 5, 16, 16, generator=generator)
    expected = plain_correlation(render, image, 3)
    fast = correlate(render, image, window_index(16, 3), 3)
    blocks = correlate_blocks(render, image, window_index(8, 3), 3)
    for found in (fast, blocks):
        torch.testing.assert_close(found, expected, atol=1e-5, rtol=0)


def test_a_grid_of_another_size_is_correlated_as_well() -> None:
    render, image = torch.randn(2, 1, 5, 24, 24, generator=torch.Generator().manual_seed(0))
    expected, usual = plain_correlation(render, image, 3), window_index(16, 3)
    torch.testing.assert_close(correlate(render, image, usual, 3), expected, atol=1e-5, rtol=0)


def test_a_warp_looks_where_the_displacement_leads() -> None:
    features = torch.randn(1, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    still = warp_cells(features, torch.zeros(1, 2, 16, 16), 4)
    torch.testing.assert_close(still, features, atol=1e-5, rtol=0)
    moves = torch.tensor([8.0, -4.0])[None, :, None, None].expand(1, 2, 16, 16)  # 2, −1 cells
    moved = warp_cells(features, moves, 4)
    torch.testing.assert_close(moved[..., 1:, :14], features[..., :15, 2:], atol=1e-5, rtol=0)
