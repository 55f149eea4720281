"""Training pairs: truth fits picture, seeds repeat, augmentation keeps to its shares."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.geometry.crop import Crop
from moveit6d.geometry.mesh import Mesh
from moveit6d.networks.least_squares import cell_pixels, move_points, project_points, surface_points
from moveit6d.rendering.renderer import GBuffer
from moveit6d.synthesis.augmentation.backgrounds import procedural_photo
from moveit6d.synthesis.augmentation.config import AugmentConfig, OcclusionConfig
from moveit6d.synthesis.augmentation.lights import LightConfig
from moveit6d.synthesis.augmentation.occluder_bank import BankConfig
from moveit6d.synthesis.objects.shapes import random_object
from moveit6d.synthesis.objects.symmetric_shapes import symmetric_object
from moveit6d.synthesis.training.clusters import ClusterConfig
from moveit6d.synthesis.training.pairs import (
    PairConfig,
    PairGenerator,
    TrainingBatch,
    ZoomConfig,
)
from tests.support.meshes import square
from tests.support.pairs import objects, photos, preset


@pytest.fixture(scope="module")
def generator_parts() -> tuple[list[Mesh], list[np.ndarray]]:
    random = np.random.default_rng(0)
    photos = [procedural_photo(random, (160, 200)) for _ in range(4)]
    return [random_object(random, photos) for _ in range(3)], photos


def a_batch(parts: tuple[list[Mesh], list[np.ndarray]], seed: int = 0) -> TrainingBatch:
    return PairGenerator(*parts, PairConfig(), seed).batch(8)


def test_shapes_and_ranges(generator_parts: tuple[list[Mesh], list[np.ndarray]]) -> None:
    batch = a_batch(generator_parts)
    seen = batch.observation
    assert seen.image.shape == (8, 3, 128, 128) and seen.depth.shape == (8, 1, 128, 128)
    for picture in (seen.image, seen.rendering):
        assert picture.min() >= 0 and picture.max() <= 1 and torch.isfinite(picture).all()
    assert seen.depth.abs().max() < 0.6  # inside the sphere
    assert (seen.mask.flatten(1).mean(1) > 0.01).all()
    assert (batch.visible <= batch.true_mask).all()


def test_the_same_seed_gives_the_same_pairs_and_another_one_others(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    first, again = a_batch(generator_parts), a_batch(generator_parts)
    assert torch.equal(first.observation.image, again.observation.image)
    assert torch.equal(first.delta, again.delta)
    assert not torch.equal(a_batch(generator_parts, 1).delta, first.delta)


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
def test_the_delta_takes_the_rendering_to_the_observed_object(
    generator_parts: tuple[list[Mesh], list[np.ndarray]], crop: Crop
) -> None:
    """Surface points, moved by the delta, land on the true pose's surface where it is visible."""
    batch = PairGenerator(*generator_parts, PairConfig(crop=crop), 3).batch(8, "all_small")
    assert bool(batch.direction.abs().max() > 0.2) == (crop == "axis_parallel")
    seen = batch.observation
    pixels = cell_pixels(4)
    moved = move_points(
        surface_points(seen.depth, seen.distance, pixels),
        seen.distance,
        batch.delta,
        batch.direction,
    )
    on_object = seen.mask[:, 0, pixels[:, 1], pixels[:, 0]] > 0
    goal = project_points(moved, seen.distance).round().long().clamp(0, 127)
    sample = torch.arange(8)[:, None]
    depth = batch.true_depth[sample, 0, goal[..., 1], goal[..., 0]] + seen.distance[:, None]
    off = (depth - moved[..., 2]).abs()[on_object]
    assert (off < 0.03).float().mean() > 0.85  # the rest is hidden or on the contour


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
def test_the_true_delta_leaves_nothing(
    generator_parts: tuple[list[Mesh], list[np.ndarray]], crop: Crop
) -> None:
    """After the delta itself nothing is left, and the rendering is the true pose's."""
    generator = PairGenerator(*generator_parts, PairConfig(crop=crop), 4)
    batch = generator.batch(8, "all_large")
    there = generator.advance(batch, batch.delta)
    assert there.delta.abs().max() < 1e-3
    assert (there.observation.mask != there.true_mask).float().mean() < 1e-3
    assert (there.observation.depth - there.true_depth).abs().mean() < 1e-4
    assert torch.equal(there.mesh, batch.mesh)


def test_halfway_leaves_the_rest_and_shows_the_same_picture(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    """The remaining delta leads to the same truth, and the image follows the crop."""
    generator = PairGenerator(*generator_parts, PairConfig(), 5)
    batch = generator.batch(8, "all_small")
    halfway = generator.advance(batch, batch.delta / 2)
    assert halfway.delta.norm(dim=1) == pytest.approx(batch.delta.norm(dim=1) / 2, rel=0.05)
    again = generator.advance(halfway, halfway.delta)
    direct = generator.advance(batch, batch.delta)
    assert torch.allclose(again.observation.distance, direct.observation.distance, rtol=1e-4)
    seen = (again.clear * direct.clear) > 0.5
    off = (again.observation.image - direct.observation.image).abs().mean(1, keepdim=True)[seen]
    assert off.mean() < 0.03, "sampled twice it is a little softer"


ZOOMED = PairConfig(zoom=ZoomConfig(0.5, (1.5, 1.9)))


def test_zoomed_pairs_show_the_same_larger(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    meshes = generator_parts[0]
    generator = PairGenerator(*generator_parts, ZOOMED, 7)
    batch = generator.batch(64, "near")
    larger = batch.zoom > 1
    assert 20 <= larger.sum() <= 44
    assert ((batch.zoom[larger] >= 1.5) & (batch.zoom[larger] <= 1.9)).all()
    assert (batch.zoom[~larger] == 1).all()
    area = batch.observation.mask.flatten(1).mean(1)
    assert area[larger].mean() > 1.5 * area[~larger].mean()
    # Back in metres the pair is one about the object as it is.
    sphere = torch.tensor([meshes[int(i)].sphere_diameter for i in batch.mesh])
    metres = batch.observation.distance * sphere / batch.zoom
    low, high = ZOOMED.distance
    assert ((metres > 0.99 * low * sphere) & (metres < 1.01 * high * sphere)).all()


def test_policies_states_keep_their_zoom(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    generator = PairGenerator(*generator_parts, ZOOMED, 8)
    batch = generator.batch(8, "all_small")
    there = generator.advance(batch, batch.delta)
    assert torch.equal(there.zoom, batch.zoom) and there.delta.abs().max() < 1e-4
    assert (there.observation.depth - there.true_depth).abs().mean() < 1e-4


def test_deltas_that_lose_the_object_are_not_applied(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    generator = PairGenerator(*generator_parts, PairConfig(), 6)
    batch = generator.batch(4, "all_large")
    away = generator.advance(batch, -10 * batch.delta)
    assert torch.allclose(away.delta, batch.delta, atol=1e-3)
    assert torch.allclose(away.observation.distance, batch.observation.distance, rtol=1e-5)


def test_symmetric_objects_get_the_nearest_delta() -> None:
    """No delta holds a rotation about the axis, and it still leads to the observed image."""
    random = np.random.default_rng(0)
    meshes = [symmetric_object(random) for _ in range(6)]
    meshes = [mesh for mesh in meshes if mesh.symmetries.continuous]
    pictures = [procedural_photo(random, (160, 200)) for _ in range(2)]
    generator = PairGenerator(meshes, pictures, PairConfig(), 0)
    drawn = torch.zeros(12, 6, dtype=torch.float64)
    drawn[:, 3:] = 8 * (torch.arange(36).reshape(12, 3) % 5 - 2)
    batch = generator.compose(torch.arange(12) % len(meshes), drawn)
    angles = batch.delta[:, 3:].norm(dim=1)
    assert (angles <= drawn[:, 3:].norm(dim=1).float() + 0.6).all()
    assert (angles < 0.8 * drawn[:, 3:].norm(dim=1).float()).any()
    there = generator.advance(batch, batch.delta)
    assert there.delta.abs().max() < 1.0
    assert (there.observation.mask != there.true_mask).float().mean() < 0.005


@pytest.mark.parametrize("name", ["paper", "realistic"])
def test_presets_draw_whole_pairs(name: str) -> None:
    generator = PairGenerator(list(objects()), list(photos()), preset(name), 0)
    batch = generator.batch(10)
    image = batch.observation.image
    assert image.min() >= 0 and image.max() <= 1 and torch.isfinite(image).all()
    assert ((image * 255).round() - image * 255).abs().max() < 1e-4
    assert ((batch.clear == 0) | (batch.clear == 1)).all()
    shown = batch.visible.flatten(1).sum(1) / batch.true_mask.flatten(1).sum(1).clamp_min(1)
    assert 0.3 < shown.mean() < 1.0
    again = PairGenerator(list(objects()), list(photos()), preset(name), 0).batch(10)
    assert torch.equal(again.observation.image, image)


def test_the_paper_s_pairs_have_its_other_numbers() -> None:
    paper = preset("paper")
    assert paper.clusters.shares() == (0.2, 0.2, 0.2, 0.2, 0.2, 0.0)
    assert paper.clusters == ClusterConfig(), "the ranges are tested in test_clusters"
    augment = paper.augment
    assert augment.blur_and_colour_of == "layers" and paper.hands.probability == 0
    assert (augment.blur.probability, augment.radial_blur.probability) == (0.75, 0.25)
    assert (augment.blur.motion.length_sigma, augment.radial_blur.zoom_sigma) == (0.05, 0.05)


def test_the_paper_s_photos_are_neither_blurred_nor_recoloured() -> None:
    """Blur and colour of the layers leave the photo behind them as it is."""
    grey = [np.full((150, 150, 3), 100, np.uint8)]
    batch = PairGenerator(list(objects()), grey, preset("paper"), 0).batch(8)
    corner = batch.observation.image[:, :, :6, :6]
    untouched = (batch.clear * (1 - batch.true_mask))[:, :, :6, :6] > 0.5
    assert untouched.float().mean() > 0.3
    assert (corner == 100 / 255)[untouched.expand_as(corner)].float().mean() > 0.9


def test_parts_hold_every_pair_once_with_its_views() -> None:
    config = preset("linear_light")
    whole = PairGenerator(list(objects()), list(photos()), config, 0).batch(10)
    first, second = whole.parts(2)
    assert whole.views is not None and first.views is not None and second.views is not None
    assert torch.equal(first.mesh, whole.mesh[::2]) and torch.equal(second.mesh, whole.mesh[1::2])
    assert torch.equal(second.observation.image, whole.observation.image[1::2])
    assert torch.equal(second.views.image, whole.views.image[1::2])
    assert len(first.views.image) == config.views.count(5), "and so those of the first pairs"


def sheet(*colour: int) -> Mesh:
    """A sheet of one colour."""
    return square(colors=np.tile(np.uint8(colour), (4, 1)))


def shown_where_absent(meshes: list[Mesh], monkeypatch: pytest.MonkeyPatch) -> GBuffer:
    """What is drawn instead of the first mesh in 40 images that do not show it."""
    generator = PairGenerator(meshes, list(photos()), PairConfig(absent_probability=1.0), 0)
    picture, seen = generator.composer.picture, list[GBuffer]()

    def looked_at(observed: GBuffer, *others: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        seen.append(observed)
        return picture(observed, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(generator.composer, "picture", looked_at)
    batch = generator.compose(
        torch.zeros(40, dtype=torch.long), torch.zeros(40, 6, dtype=torch.float64)
    )
    assert batch.present.max() == 0 and batch.true_mask.max() == 0
    return seen[0]


def test_an_only_object_that_is_absent_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown_where_absent([objects()[0]], monkeypatch).mask.max() == 0


def test_another_object_or_none_is_shown_instead_of_an_absent_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = shown_where_absent([sheet(255, 0, 0), sheet(0, 255, 0)], monkeypatch)
    assert seen.albedo[:, 0].max() == 0 and seen.albedo[:, 1].max() == 1
    shown = seen.mask.flatten(1).amax(1).mean()
    assert 0.25 < shown < 0.75


OPEN = AugmentConfig(
    occlusion=OcclusionConfig(probability=1.0, scale=(1.0, 1.0), photo_probability=0.0),
    clutter=replace(AugmentConfig().clutter, probability=0.0),
    image_border=replace(AugmentConfig().image_border, probability=0.0),
)


@pytest.mark.parametrize("bank", [0, 8])
def test_given_occluders_are_put_in_front_with_and_without_a_bank(bank: int) -> None:
    config = PairConfig(
        augment=OPEN, lights=LightConfig(unlit_probability=1.0), bank=BankConfig(size=bank)
    )
    grey = [np.full((150, 150, 3), 100, np.uint8)]
    batch = PairGenerator([sheet(0, 0, 255)], grey, config, 0, [sheet(255, 0, 0)]).batch(8)
    covered = (batch.clear == 0).expand(-1, 3, -1, -1)
    red, _, blue = batch.observation.image.transpose(0, 1)[:, covered[:, 0]]
    assert len(red) > 1000 and (red > blue + 0.2).float().mean() > 0.9


def test_without_other_occluders_the_objects_are_in_front_of_each_other() -> None:
    config = PairConfig(augment=OPEN, lights=LightConfig(unlit_probability=1.0))
    grey = [np.full((150, 150, 3), 100, np.uint8)]
    batch = PairGenerator([sheet(0, 0, 255)], grey, config, 0).batch(8)
    red, _, blue = batch.observation.image.transpose(0, 1)[:, batch.clear[:, 0] == 0]
    assert len(red) > 1000 and (blue > red + 0.2).float().mean() > 0.9


def test_deltas_that_are_not_finite_are_not_applied(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    generator = PairGenerator(*generator_parts, PairConfig(), 9)
    batch = generator.batch(4, "all_small")
    batch = replace(batch, near=torch.tensor([1.0, 1.0, 0.0, 0.0]))
    delta = batch.delta / 2
    delta[1, 0] = delta[2, 4] = torch.nan
    after = generator.advance(batch, delta)
    assert after.observation.image.isfinite().all() and after.delta.isfinite().all()
    assert torch.allclose(after.delta[1:3], batch.delta[1:3], atol=1e-3)
    assert (after.delta[[0, 3]].norm(dim=1) < 0.7 * batch.delta[[0, 3]].norm(dim=1)).all()
