"""Templates: normalised, masked, in the middle; kept in memory and on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load, save

from moveit6d import InputError, Mesh, make_renderer
from moveit6d.config import TemplateConfig
from moveit6d.estimation.detection.templates import (
    COLOUR_SPREAD,
    TemplateBank,
    TemplateStore,
    colour_cells,
    default_store,
    make_templates,
)
from moveit6d.observation import GREY
from moveit6d.policies import NetworkPolicy
from tests.support import meshes

FEW = TemplateConfig(rotations=12, coarse_rotations=4, channels=8)


def test_a_template_matches_itself_best(box: Mesh, network: NetworkPolicy) -> None:
    bank = make_templates(box, network.descriptors, make_renderer(), FEW)
    fine = bank.fine
    assert (len(fine), len(bank.coarse), fine.cells, bank.coarse.cells) == (12, 4, 15, 8)
    assert fine.kernels.shape == (12, 8, 15, 15) and bank.coarse.kernels.shape == (4, 8 + 3, 8, 8)
    axes = fine.basis.T @ fine.basis
    torch.testing.assert_close(axes, torch.eye(8), atol=1e-5, rtol=0)
    assert torch.equal(bank.coarse.basis, fine.basis)
    # Without the colours, kernels times the mask's sum are unit vectors or shorter (projected).
    scores = fine.kernels.flatten(1) @ fine.kernels.flatten(1).T
    assert (scores.argmax(1) == torch.arange(12)).all()


def test_boxes_are_the_silhouettes(network: NetworkPolicy) -> None:
    ball = meshes.sphere(subdivisions=3)
    boxes = make_templates(ball, network.descriptors, make_renderer(), FEW).fine.boxes
    expected = torch.tensor([-0.5, -0.5, 0.5, 0.5]).expand(12, 4)
    torch.testing.assert_close(boxes, expected, atol=0.03, rtol=0)
    small = replace(FEW, width=48, distance=8.0)
    bank = make_templates(ball, network.descriptors, make_renderer(), small)
    assert bank.fine.cells == 6
    torch.testing.assert_close(bank.fine.boxes, expected, atol=0.04, rtol=0)


def test_an_object_that_fills_no_cell_is_described_too(network: NetworkPolicy) -> None:
    rod = meshes.colored_box((0.005, 0.005, 0.2))
    coarse = make_templates(rod, network.descriptors, make_renderer(), FEW).coarse
    torch.testing.assert_close(coarse.shares.sum((1, 2)), torch.ones(4), atol=1e-3, rtol=0)


def test_an_image_is_projected_as_the_kernels_are(box: Mesh, network: NetworkPolicy) -> None:
    fine = make_templates(box, network.descriptors, make_renderer(), FEW).fine
    draw = torch.Generator().manual_seed(0)
    features = torch.randn(2, len(fine.basis), 3, 4, generator=draw)
    channels = fine.project(features)
    assert channels.shape == (2, fine.kernels.shape[1], 3, 4)
    torch.testing.assert_close(channels[1, :, 2, 1], features[1, :, 2, 1] @ fine.basis)


def test_grey_has_no_colour_and_red_has() -> None:
    grey = torch.full((1, 3, 16, 16), GREY)
    assert colour_cells(grey, (2, 2)).abs().max() < 1e-6
    red = grey.clone()
    red[:, 0] += COLOUR_SPREAD
    first, second, brightness = colour_cells(red, (2, 2))[0, :, 0, 0].tolist()
    assert first == pytest.approx(1.0) and second == pytest.approx(0.0)
    assert brightness == pytest.approx(1 / 6)


def test_templates_are_made_once_and_kept_on_disk(
    box: Mesh, network: NetworkPolicy, tmp_path: Path
) -> None:
    calls = []

    def describe(images: torch.Tensor) -> torch.Tensor:
        calls.append(len(images))
        return network.descriptors(images)

    renderer = make_renderer()
    store = TemplateStore(tmp_path / "kept")
    first = store.get(box, describe, renderer, FEW, "net")
    made = len(calls)
    assert store.get(box, describe, renderer, FEW, "net") is first and len(calls) == made
    again = TemplateStore(tmp_path / "kept").get(box, describe, renderer, FEW, "net")
    assert len(calls) == made
    assert torch.equal(again.fine.kernels, first.fine.kernels)
    assert torch.equal(again.coarse.rotations, first.coarse.rotations)
    assert len(list((tmp_path / "kept").iterdir())) == 1
    # Another colour, another network and other settings are other templates.
    other = replace(box, vertex_colors=np.zeros_like(box.vertex_colors))
    TemplateStore(tmp_path / "kept").get(other, describe, renderer, FEW, "net")
    TemplateStore(tmp_path / "kept").get(box, describe, renderer, FEW, "another")
    assert len(list((tmp_path / "kept").iterdir())) == 3


def test_a_file_may_hold_more_than_is_read(
    box: Mesh, network: NetworkPolicy, tmp_path: Path
) -> None:
    first = TemplateStore(tmp_path).get(box, network.descriptors, make_renderer(), FEW, "net")
    (file,) = tmp_path.iterdir()
    values = load(file.read_bytes())
    file.write_bytes(save({**values, "fine.masks": torch.zeros(12, 8, 8)}))
    again = TemplateStore(tmp_path).get(box, network.descriptors, make_renderer(), FEW, "net")
    assert torch.equal(again.fine.rows, first.fine.rows)


def test_a_damaged_file_is_named_and_made_anew(
    box: Mesh, network: NetworkPolicy, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def get() -> TemplateBank:
        renderer = make_renderer()
        return TemplateStore(tmp_path).get(box, network.descriptors, renderer, FEW, "net")

    first = get()
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    for damaged in (b"", whole[:100], b"\0" * 2000, save({"a": torch.zeros(2)})):
        file.write_bytes(damaged)
        caplog.clear()
        assert torch.equal(get().fine.rows, first.fine.rows) and file.name in caplog.text
        assert file.read_bytes() == whole
    caplog.clear()
    get()
    assert not caplog.records


def test_where_nothing_can_be_written_templates_are_kept_in_memory(
    box: Mesh, network: NetworkPolicy, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    store = TemplateStore(tmp_path / "file" / "templates")
    first = store.get(box, network.descriptors, make_renderer(), FEW, "net")
    assert store.get(box, network.descriptors, make_renderer(), FEW, "net") is first
    store.get(box, network.descriptors, make_renderer(), FEW, "another")
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "kept in memory only" in caplog.text


def test_without_a_home_nothing_is_kept_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert default_store() is None
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    assert default_store() == Path("/cache/moveit6d/templates")


def test_networks_without_a_name_share_nothing(
    box: Mesh, network: NetworkPolicy, tmp_path: Path
) -> None:
    class Nameless:
        def __init__(self, sign: float) -> None:
            self.sign = sign

        def descriptors(self, images: torch.Tensor) -> torch.Tensor:
            return self.sign * network.descriptors(images)

    store, renderer, one = TemplateStore(tmp_path), make_renderer(), Nameless(1.0)
    first = store.get(box, one.descriptors, renderer, FEW)
    assert store.get(box, one.descriptors, renderer, FEW) is first
    made = {id(first)}
    for sign in (-1.0, 1.0, -1.0):  # each is gone when the next one is made
        made.add(id(store.get(box, Nameless(sign).descriptors, renderer, FEW)))
    assert len(made) == 4 and not list(tmp_path.iterdir())


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="1 or more"):
        TemplateConfig(rotations=0)
