"""Verification: rises with both kinds of evidence; similarity is high where the object is."""

from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from moveit6d import Pose, make_renderer
from moveit6d.config import VerificationConfig
from moveit6d.estimation.detection import Evidence
from moveit6d.estimation.detection.verification import similarities
from moveit6d.frame import prepare_frame
from moveit6d.geometry.rotation import exp_so3
from moveit6d.policies import NetworkPolicy
from tests.estimation.detection.conftest import Picture
from tests.support import pictures

share = st.floats(0, 1)


@given(share, share, share, share)
def test_more_evidence_is_more_probable(a: float, b: float, c: float, d: float) -> None:
    less = Evidence(min(a, b), min(c, d)).probability(VerificationConfig())
    more = Evidence(max(a, b), max(c, d)).probability(VerificationConfig())
    assert 0 < less <= more < 1


def test_the_right_pose_is_the_most_similar(seen: Picture, network: NetworkPolicy) -> None:
    frame = prepare_frame(seen.image, pictures.CAMERA)
    about = exp_so3(torch.tensor([0.0, 1.2, 0.0], dtype=torch.float64))
    aside = Pose(seen.pose.rotation, seen.pose.translation + torch.tensor([-0.1, 0.0, 0.0]))
    poses = [seen.pose, Pose(seen.pose.rotation @ about, seen.pose.translation), aside]
    poses = [seen.mesh.inner(pose) for pose in poses]
    right, turned, beside = similarities(frame, seen.mesh, poses, network, make_renderer())
    assert right > 0.7 and right > turned + 0.1 and right > beside + 0.3
    assert similarities(frame, seen.mesh, [], network, make_renderer()) == []
