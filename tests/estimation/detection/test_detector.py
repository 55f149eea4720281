"""The whole detection: from nothing, from what is known, and of what is not there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from moveit6d import InputError, OraclePolicy, Pose
from moveit6d.config import DetectorConfig, RegionConfig, TemplateConfig, TrackerConfig
from moveit6d.estimation.detection import (
    PoseDetector,
    SearchRegion,
    TemplateStore,
    detect_objects,
)
from moveit6d.estimation.detection.places import Place, PlaceFinder
from moveit6d.estimation.detection.proposals import Proposals
from moveit6d.estimation.detection.templates import TemplateBank
from moveit6d.evaluation.metrics import add
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.rotation import exp_so3
from moveit6d.geometry.visibility import seen_box
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.inference import Compute
from moveit6d.networks.weights_file import load_network
from moveit6d.policies import SHIPPED_WEIGHTS, NetworkPolicy
from tests.estimation.detection.conftest import SMALL, Picture
from tests.support import pictures
from tests.support.lens_pictures import lens_picture


def off(seen: Picture, pose: Pose | None) -> float:
    """ADD in diameters."""
    assert pose is not None
    points = torch.from_numpy(seen.mesh.sample_points(200))
    return float(add(pose, seen.pose, points)) / seen.mesh.diameter


def test_found_from_nothing(seen: Picture, detector: PoseDetector) -> None:
    found = detector.detect(seen.image)
    assert found.found and off(seen, found.pose) < 0.05
    assert found.probability > 0.5 and found.instances[0].result.confidence == found.probability


def test_evidence_is_the_confidence_for_searches(seen: Picture) -> None:
    loaded = load_network(SHIPPED_WEIGHTS).network
    assert isinstance(loaded, CompactCorrelationNet) and loaded.config.search_head
    with torch.no_grad():
        loaded.search_head[-1].weight.zero_()
        loaded.search_head[-1].bias.fill_(0.25)
    detector = PoseDetector(seen.mesh, pictures.CAMERA, policy=NetworkPolicy(loaded))
    found = detector.detect(seen.image).best
    assert found is not None and found.evidence is not None
    assert found.evidence.confidence == pytest.approx(1 / (1 + np.exp(-0.25)), abs=1e-3)


def test_absent_is_an_answer(detector: PoseDetector) -> None:
    found = detector.detect(pictures.mottled(3))
    assert not found.found and found.pose is None and found.probability < 0.5
    assert found.best is not None and found.rejected


def test_where_nothing_is_accepted_more_places_are_looked_into(
    seen: Picture, detector: PoseDetector, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong, places = Place(1e3, (20.0, 20.0), 40.0), PlaceFinder.places

    def late(finder: PlaceFinder, count: int, known: Sequence[Place] = ()) -> list[Place]:
        return places(finder, count) if known else [wrong] * count

    monkeypatch.setattr(PlaceFinder, "places", late)
    assert off(seen, detector.detect(seen.image).pose) < 0.05
    match = replace(detector.config.match, more_places=0)
    detector.config = replace(detector.config, match=match)
    assert not detector.detect(seen.image).found


def test_what_is_known_narrows(seen: Picture, detector: PoseDetector) -> None:
    centred = seen.mesh.inner(seen.pose)
    u, v = pictures.CAMERA.project(centred.translation).tolist()
    half = 0.5 * 300 * seen.mesh.sphere_diameter / 0.4
    box = (u - half, v - half, 2 * half, 2 * half)
    mask = np.zeros((256, 256), np.uint8)
    mask[int(v - 0.6 * half) : int(v + 0.6 * half), int(u - 0.7 * half) : int(u + 0.7 * half)] = 255
    near = Pose(seen.pose.rotation, seen.pose.translation + torch.tensor([0.01, 0.0, 0.03]))
    assert off(seen, detector.detect(seen.image, box=box, distance=(0.3, 0.5)).pose) < 0.05
    assert off(seen, detector.detect(seen.image, mask=mask).pose) < 0.05
    assert off(seen, detector.detect(seen.image, start=near).pose) < 0.05
    # The same box where the object is not.
    elsewhere = detector.detect(seen.image, box=(5, 150, 90, 90))
    best = elsewhere.best
    assert best is None or off(seen, best.pose) > 0.5 or not elsewhere.found


def test_a_known_place_has_stages_of_its_own(seen: Picture, detector: PoseDetector) -> None:
    u, v = pictures.CAMERA.project(seen.mesh.inner(seen.pose).translation).tolist()
    half = 0.5 * 300 * seen.mesh.sphere_diameter / 0.4
    region = RegionConfig(stages=((6, 1),))
    detector.config = replace(detector.config, region=region)
    boxed = detector.detect(seen.image, box=(u - half, v - half, 2 * half, 2 * half)).best
    anywhere = detector.detect(seen.image).best
    assert boxed is not None and boxed.result.iterations == 1
    assert anywhere is not None and anywhere.result.iterations > 1


def test_clicked_points_are_enough(seen: Picture, detector: PoseDetector) -> None:
    corners = torch.from_numpy(seen.mesh.vertices[::5].astype(np.float64) + seen.mesh.center)
    pixels = pictures.CAMERA.project(seen.pose.transform(corners))
    rows = torch.cat([pixels + torch.tensor([2.0, -2.0]), corners], 1)
    assert off(seen, detector.detect(seen.image, points=rows).pose) < 0.05


def test_steps_are_short_and_lead_to_the_same(seen: Picture, detector: PoseDetector) -> None:
    steps, count = detector.steps(seen.image), 0
    while True:
        try:
            next(steps)
            count += 1
        except StopIteration as end:
            assert off(seen, end.value.pose) < 0.05
            break
    assert count >= 6


def test_two_instances_and_two_objects(seen: Picture, detector: PoseDetector) -> None:
    centred = seen.mesh.inner(seen.pose)
    left = Pose(centred.rotation, centred.translation * torch.tensor([-1.6, 0.0, 1.0]))
    image = pictures.picture(seen.mesh, left, seen.image).permute(1, 2, 0).contiguous().numpy()
    found = detector.detect(image, instances=2)
    assert len(found.instances) == 2
    places = [seen.mesh.inner(one.pose).translation for one in found.instances]
    expected = [centred.translation, left.translation]
    for truth in expected:
        assert min(float((place - truth).norm()) for place in places) < 0.02
    one, other = detect_objects([detector, detector], seen.image)
    assert off(seen, one.pose) < 0.05 and torch.equal(one.pose.rotation, other.pose.rotation)


def test_preparing_and_several_objects_take_the_detectors_own_threads(
    seen: Picture, detector: PoseDetector, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = replace(
        detector.config,
        templates=TemplateConfig(rotations=4, coarse_rotations=4),
        stages=((2, 1),),
    )
    counted: list[int] = []

    class Counting(NetworkPolicy):
        def descriptors(self, images: Tensor) -> Tensor:
            counted.append(torch.get_num_threads())
            return super().descriptors(images)

    policy = Counting(load_network(SHIPPED_WEIGHTS).network)
    config = replace(detector.settings, detection=few)
    own = [
        PoseDetector(seen.mesh, pictures.CAMERA, policy=policy, config=config, threads=threads)
        for threads in (1, 2)
    ]
    monkeypatch.setattr(own[1], "pyramid_of", None)  # it is the first one's
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        for one in own:
            one.prepare()
        prepared = counted.copy()
        counted.clear()
        detect_objects(own, seen.image)
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)
    assert prepared == [1, 1, 2, 2]  # two levels each
    assert counted == sorted(counted) and set(counted) == {1, 2}


def test_what_is_found_agrees_with_what_is_known(
    seen: Picture, detector: PoseDetector, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = seen.pose.matrix.numpy()
    assert off(seen, detector.detect(seen.image, start=start).pose) < 0.05
    near = 0.5 * float(seen.mesh.inner(seen.pose).translation.norm())
    far = (2 * near * 1.3 + seen.mesh.sphere_diameter, 9.0)
    assert not detector.detect(seen.image, distance=far).found
    # Candidates that drift to the object from elsewhere are not what was asked for.
    monkeypatch.setattr(Proposals, "_allowed", lambda _: None)
    monkeypatch.setattr(SearchRegion, "window", lambda *_: None)
    monkeypatch.setattr(SearchRegion, "widths", lambda *_: (60.0, 120.0))
    assert detector.detect(seen.image, distance=(0.3, 0.5)).found
    for known in ({"distance": far}, {"box": (0.0, 180.0, 60.0, 60.0)}):
        found = detector.detect(seen.image, **known)  # type: ignore[arg-type]
        assert not found.found and (found.best is None or off(seen, found.best.pose) > 0.5)


def test_what_cannot_be_used_is_refused(seen: Picture, detector: PoseDetector) -> None:
    with pytest.raises(InputError, match="no descriptors"):
        PoseDetector(seen.mesh, pictures.CAMERA, policy=OraclePolicy(Pose.identity(1)))
    with pytest.raises(InputError, match="256×256"):
        detector.detect(np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(InputError, match="behind the camera"):
        detector.detect(seen.image, start=Pose.identity())
    with pytest.raises(InputError, match=r"Pose or a 4×4 matrix.*shape \(3, 3\)"):
        detector.detect(seen.image, start=np.eye(3))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="start pose and box 0 200 40 40 contradict each other"):
        detector.detect(seen.image, start=seen.pose, box=(0, 200, 40, 40))
    for instances, words in ((0, "1 or more, found 0"), (1.5, "whole number"), ("2", "a number")):
        with pytest.raises(InputError, match=f"^instances must be {words}|^instances must be a"):
            detector.detect(seen.image, instances=instances)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="config must be a TrackerConfig, found DetectorConfig"):
        PoseDetector(seen.mesh, pictures.CAMERA, config=DetectorConfig())  # type: ignore[arg-type]


def test_several_objects_are_refused_by_a_sentence(seen: Picture, detector: PoseDetector) -> None:
    assert detect_objects([], seen.image) == []
    both = [detector, detector]
    with pytest.raises(InputError, match="counts: 2 are needed, found 1"):
        detect_objects(both, seen.image, [1])
    with pytest.raises(InputError, match="regions: 2 are needed, found 3"):
        detect_objects(both, seen.image, regions=[SearchRegion()] * 3)
    seeds = PoseDetector(seen.mesh, pictures.CAMERA, policy=detector.policy, method="seeds")
    with pytest.raises(InputError, match="is for the method templates, found one of seeds"):
        detect_objects([detector, seeds], seen.image)


def test_templates_are_those_of_the_numbers_that_a_network_computes_with(
    seen: Picture, tmp_path: Path
) -> None:
    few = TrackerConfig(
        detection=DetectorConfig(templates=TemplateConfig(rotations=4, coarse_rotations=4))
    )
    loaded = load_network(SHIPPED_WEIGHTS).network

    def prepare(source: str, compute: Compute) -> TemplateBank:
        policy = NetworkPolicy(loaded, source, compute)
        return PoseDetector(
            seen.mesh, pictures.CAMERA, policy=policy, config=few, store=TemplateStore(tmp_path)
        ).prepare()

    files = []
    kinds: list[tuple[str, Compute]]
    kinds = [("a", "float32"), ("a", "bfloat16"), ("b", "float32"), ("", "float32")]
    for source, compute in kinds:
        prepare(source, compute)
        files.append(len(list(tmp_path.iterdir())))
    assert files == [1, 2, 3, 3]  # what has no name is not kept


BARREL = Camera(500, 500, 319.5, 179.5, 640, 360, (-0.3, 0.09, 0.0, 0.0, 0.0))
FISHEYE = Camera(305, 305, 319.5, 239.5, 640, 480, (0.0, 0.0, 0.0, 0.0), "fisheye")


@pytest.mark.parametrize(
    ("camera", "pixel", "distance", "what"),
    [(BARREL, (600, 35), 1.2, "box"), (FISHEYE, (597, 240), 0.5, "start")],
)
def test_what_the_lens_shows_near_the_border_is_found(
    box: Mesh,
    detector: PoseDetector,
    camera: Camera,
    pixel: tuple[int, int],
    distance: float,
    what: str,
) -> None:
    assert camera.lens is not None
    ray = camera.lens.directions(np.array([pixel], np.float64), camera.matrix.numpy())[0]
    turn = exp_so3(torch.tensor([0.5, 0.7, 0.2], dtype=torch.float64))
    centred = Pose(turn, distance * torch.from_numpy(ray))
    u, v = camera.pinhole.project(centred.translation).tolist()
    assert not (0 < u < camera.width and 0 < v < camera.height), "a pinhole would not show it"
    seen = Picture(box, box.outer(centred), lens_picture(box, centred, camera))
    left, top, right, bottom = seen_box(centred, box, camera)
    near = PoseDetector(
        box, camera, config=SMALL, policy=detector.policy, renderer=detector.renderer,
        store=detector.store,
    )  # fmt: skip
    around = (left - 3, top - 3, right - left + 6, bottom - top + 6)
    # Fifty to eighty pixels wide, the distance is less sure than in the other pictures.
    known: dict[str, Any] = {"box": around, "start": seen.pose}
    assert off(seen, near.detect(seen.image, **{what: known[what]}).pose) < 0.1


def test_a_lens_that_hides_nothing_changes_nothing(seen: Picture, detector: PoseDetector) -> None:
    camera = replace(pictures.CAMERA, distortion=(0.2, 0.0, 0.0, 0.0))
    tools = {"config": SMALL, "policy": detector.policy, "renderer": detector.renderer}
    near = Pose(seen.pose.rotation, seen.pose.translation + torch.tensor([0.01, 0.0, 0.03]))
    flat, pinhole = camera.undistort(seen.image)
    found = [
        PoseDetector(seen.mesh, one, store=detector.store, **tools).detect(image, start=near).best
        for one, image in ((camera, seen.image), (pinhole, flat))
    ]
    assert found[0] is not None and found[1] is not None
    assert torch.equal(found[0].pose.translation, found[1].pose.translation)
    assert torch.equal(found[0].pose.rotation, found[1].pose.rotation)
    assert found[0].evidence == found[1].evidence


def test_objects_are_looked_for_as_wide_as_in_the_image_that_was_taken(
    seen: Picture, detector: PoseDetector
) -> None:
    tried: list[tuple[float, float]] = []

    class Asked(SearchRegion):
        def widths(self, *given: Any, **more: Any) -> tuple[float, float]:
            tried.append(super().widths(*given, **more))
            return tried[-1]

    for camera in (BARREL, BARREL.pinhole):
        looking = PoseDetector(
            seen.mesh, camera, config=SMALL, policy=detector.policy, store=detector.store
        )
        steps = looking.steps(torch.zeros(3, 360, 640), Asked())
        for _ in range(2):
            next(steps)
    assert BARREL.full_pinhole.height > 360
    assert tried == [pytest.approx((0.3 * 360, 0.6 * 360))] * 2
