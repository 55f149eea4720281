"""What a policy gets wrong about one object, read where its pose is known.

A network sees an object a little too large or too small, and on the same side in every frame: its
mesh's colours, its camera and its light are not quite those of the training. Depth suffers most.
Never moves a pose.
"""

from __future__ import annotations

import numpy as np
import torch

from ..actions import PoseAction, pose_delta
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.visibility import why_unseen
from ..policies import ActionMode, Policy
from ..rendering.renderer import Renderer
from .frame import Frame
from .refine import FINE_SCALE, Target, refine_batch

PAIRS = 4  # starts on either side of the known pose
# How far they lie from it, in units: errors at one single pose are half noise.
AROUND = (1.0, 1.0, 1.0, 1.5, 1.5, 1.5)
LASTING = 0.6  # of what is found in one frame; the rest belongs to that frame's view of the object
MOST = 3.0  # units: more than that is no bias but a pose that is not exact, or something in front


def depth_bias(frame: Frame, mesh: Mesh, pose: Pose, policy: Policy, renderer: Renderer) -> float:
    """By how many units of t_z the policy's updates will lead past the object in later frames.

    Read in a frame where the pose is exact (mesh file's frame); at most `MOST` either way. 0 for a
    policy of single actions: it has no delta that could be corrected.
    """
    if policy.mode is ActionMode.SINGLE:
        return 0.0
    centred = mesh.inner(pose.to(torch.float64))
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    offsets = np.random.default_rng(0).normal(size=(PAIRS, 6)) * AROUND
    starts = [
        PoseAction.from_delta(torch.from_numpy(offset)).apply_centred(centred, diameter)
        for offset in np.concatenate([offsets, -offsets])
    ]
    targets = [
        Target(frame, frame.camera, mesh, mesh.outer(start), fine=True)
        for start in starts
        if why_unseen(start, mesh, frame.camera) is None
    ]
    ends = [
        mesh.inner(result.pose)
        for result in refine_batch(targets, policy=policy, renderer=renderer, max_iterations=1)
        if result.pose is not None
    ]
    past = [float(pose_delta(centred, end, diameter / FINE_SCALE)[2]) for end in ends]
    return float(np.clip(LASTING * np.mean(past), -MOST, MOST)) if past else 0.0
