"""Errors of poses and what is counted from them.

Pure functions on tensors; never reads files. Poses and points belong to the mesh file's frame.
Estimates and true poses broadcast against each other; `InputError` for shapes that do not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...errors import InputError
from ...geometry.camera import project
from ...geometry.numbers import floating, vectors
from ...geometry.pose import Pose
from ...geometry.rotation import exp_so3, log_so3, rotation_angle

# A frame is right if its ADD is below this share of the object's diameter.
ADD_LIMIT = 0.10
# A track is lost where this many frames in a row are wrong.
LOST_RUN = 15
# Laval's rule: bad beyond these, lost when more than so many frames in a row are bad.
LAVAL_METRES, LAVAL_DEGREES, LAVAL_PATIENCE = 0.03, 20.0, 7
CHUNK = 500_000  # points moved at once

# From an estimate, the truth and what else an error needs to errors (...).
ErrorFunction = Callable[..., Tensor]
# Laval's files hold poses with OpenGL's axes (y up, z backwards).
OPENGL = (1.0, -1.0, -1.0)


def add(estimate: Pose, truth: Pose, points: Tensor) -> Tensor:
    """ADD: mean distance between points (N, 3) under two poses (...), metres: (...).

    Examples:
        >>> import torch
        >>> from moveit6d import Pose
        >>> truth = Pose(torch.eye(3), torch.tensor([0.0, 0.0, 0.5]))
        >>> estimate = Pose(torch.eye(3), torch.tensor([0.0, 0.003, 0.5]))
        >>> points = torch.rand(100, 3)
        >>> round(float(add(estimate, truth, points)), 6)
        0.003
    """
    estimate, truth = _together(estimate, truth)
    points = _points(points, truth)
    turn = estimate.rotation - truth.rotation
    shift = estimate.translation - truth.translation
    distance: Tensor = (points @ turn.mT + shift[..., None, :]).norm(dim=-1)
    return distance.mean(-1)


def adi(estimate: Pose, truth: Pose, points: Tensor) -> Tensor:
    """Mean distance from each true point to the nearest estimated one, metres: (...).

    For objects that look the same from several sides. The search goes from the truth to the
    estimate, as in BOP; the other way round gives slightly different numbers.

    Examples:
        >>> import torch
        >>> from moveit6d import Pose
        >>> truth = Pose(torch.eye(3), torch.tensor([0.0, 0.0, 0.5]))
        >>> estimate = Pose(torch.eye(3), torch.tensor([0.0, 0.003, 0.5]))
        >>> grid = torch.cartesian_prod(*[torch.arange(3) * 0.01] * 3)
        >>> round(float(adi(estimate, truth, grid)), 6)
        0.003
    """
    from scipy.spatial import cKDTree

    estimate, truth = (pose.detach() for pose in _together(estimate, truth))
    points = _points(points, truth).detach()
    # Seen from the estimate, so that one tree of the points serves all poses.
    moved = flattened(estimate.inverse() @ truth).transform(points).numpy()  # (B, N, 3)
    tree = cKDTree(points.numpy())
    means = [tree.query(one)[0].mean() for one in moved]
    return torch.tensor(means, dtype=torch.float64).reshape(truth.batch_shape)


def add_s(estimate: Pose, truth: Pose, points: Tensor, symmetric: bool) -> Tensor:
    """ADD(-S): ADI for an object that is declared symmetric, ADD for any other, metres: (...)."""
    return adi(estimate, truth, points) if symmetric else add(estimate, truth, points)


def translation_error(estimate: Pose, truth: Pose) -> Tensor:
    """Distance of the two origins, metres: (...).

    Examples:
        >>> import torch
        >>> from moveit6d import Pose
        >>> truth = Pose(torch.eye(3), torch.tensor([0.0, 0.0, 0.5]))
        >>> estimate = Pose(torch.eye(3), torch.tensor([0.0, 0.003, 0.5]))
        >>> round(float(translation_error(estimate, truth)), 6)
        0.003
    """
    estimate, truth = _together(estimate, truth)
    distance: Tensor = (estimate.translation - truth.translation).norm(dim=-1)
    return distance


def rotation_error(estimate: Pose, truth: Pose) -> Tensor:
    """Angle between two rotations (...), degrees: (...). Exact also for tiny and for half turns.

    Examples:
        >>> import torch
        >>> from moveit6d import Pose
        >>> from moveit6d.geometry.rotation import exp_so3
        >>> turned = exp_so3(torch.tensor([0.0, 0.0, 0.1], dtype=torch.float64))
        >>> still = Pose(torch.eye(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64))
        >>> round(float(rotation_error(Pose(turned, still.translation), still)), 3)
        5.73
    """
    estimate, truth = _together(estimate, truth)
    turn = estimate.rotation.mT @ truth.rotation
    skew = torch.stack(
        [
            turn[..., 2, 1] - turn[..., 1, 2],
            turn[..., 0, 2] - turn[..., 2, 0],
            turn[..., 1, 0] - turn[..., 0, 1],
        ],
        -1,
    )
    trace = turn.diagonal(dim1=-2, dim2=-1).sum(-1)
    return torch.rad2deg(torch.atan2(skew.norm(dim=-1), trace - 1))


def laval_rotation_error(estimate: Pose, truth: Pose) -> Tensor:
    """The rotation error of the Laval benchmark's own code, degrees: (...). Not the angle.

    The rotation vector of R_estimate R_truthᵀ, made positive component by component, is read as if
    it were Euler angles of Rx Ry Rz, and the angle of that rotation is the error: about 1 % above
    the angle at 20°, and from 87° to 100° at 90°. For Laval's tables only.
    (lvsn/6DOF_tracking_evaluation, evaluate_sequence.py.)
    """
    estimate, truth = _together(estimate, truth)
    return _euler_angle(log_so3(estimate.rotation @ truth.rotation.mT).abs())


def within(
    estimate: Pose, truth: Pose, metres: float = 0.05, degrees: float = 5.0, strict: bool = False
) -> Tensor:
    """Whether both origin and rotation are within the limits, bool: (...). RBOT's 5 cm, 5°.

    A pose at a limit is within, as in M3T's evaluator; `strict` counts it out, as DeepAC does.

    Examples:
        >>> import torch
        >>> from moveit6d import Pose
        >>> truth = Pose(torch.eye(3), torch.tensor([0.0, 0.0, 0.5]))
        >>> estimate = Pose(torch.eye(3), torch.tensor([0.0, 0.003, 0.5]))
        >>> bool(within(estimate, truth)), bool(within(estimate, truth, metres=0.002))
        (True, False)
    """
    shift, turn = translation_error(estimate, truth), rotation_error(estimate, truth)
    return (shift < metres) & (turn < degrees) if strict else (shift <= metres) & (turn <= degrees)


def reprojection_error(estimate: Pose, truth: Pose, points: Tensor, intrinsics: Tensor) -> Tensor:
    """Mean distance of the pixels of points (N, 3) under two poses (...), pixels: (...).

    `intrinsics` is (3, 3). (Brachmann et al., CVPR 2016; `proj` in bop_toolkit.)
    """
    estimate, truth = _together(estimate, truth)
    points, intrinsics = _points(points, truth), _like(truth, intrinsics, "intrinsics")
    found, true = (project(pose.transform(points), intrinsics) for pose in (estimate, truth))
    distance: Tensor = (found - true).norm(dim=-1)
    return distance.mean(-1)


def mssd(estimate: Pose, truth: Pose, points: Tensor, symmetries: Tensor) -> Tensor:
    """BOP's MSSD: largest distance between points (N, 3) under two poses (...), metres: (...).

    The smallest such distance over the object's own motions, `symmetries` (S, 4, 4) with the
    identity among them (`Symmetries.transforms`). (bop_toolkit, pose_error.mssd.)
    """
    return _largest(estimate, truth, points, symmetries, lambda seen: seen)


def mspd(
    estimate: Pose, truth: Pose, points: Tensor, symmetries: Tensor, intrinsics: Tensor
) -> Tensor:
    """BOP's MSPD: as `mssd`, between the pixels of the points, pixels: (...).

    `intrinsics` is (3, 3). BOP compares it with limits after × 640 / width of the image.
    (bop_toolkit, pose_error.mspd.)
    """
    _, truth = _together(estimate, truth)
    matrix = _like(truth, intrinsics, "intrinsics")
    return _largest(estimate, truth, points, symmetries, lambda seen: project(seen, matrix))


def stability(poses: Pose) -> tuple[Tensor, Tensor]:
    """How far each pose (N) is from the one before it, metres and degrees: (N - 1,) each.

    Of a camera and an object that both stand still, whatever moves is the tracker's jitter.
    """
    before, after = poses[:-1], poses[1:]
    return translation_error(after, before), rotation_error(after, before)


def laval_stability(poses: Pose) -> tuple[Tensor, Tensor]:
    """Stability as the Laval benchmark's own code has it, metres and degrees: (N,) each.

    The last value compares the last frame with the first; rotation vectors (of the poses with
    OpenGL's axes) are subtracted and the differences read as Euler angles. For Laval's tables only.
    (lvsn/6DOF_tracking_evaluation, evaluate_sequence.py.)
    """
    flip = poses.rotation.new_tensor(OPENGL)
    shift = poses.translation.roll(-1, 0) - poses.translation
    vector = log_so3(flip[:, None] * poses.rotation)
    return shift.norm(dim=-1), _euler_angle(vector.roll(-1, 0) - vector)


def accuracy(errors: Tensor, limit: float | Tensor) -> float:
    """Share of the errors (N,) strictly below the limit; an infinite error is never below.

    Examples:
        >>> import torch
        >>> accuracy(torch.tensor([0.001, 0.02, float("inf")]), limit=0.01)
        0.3333333333333333
    """
    if not len(errors):
        raise InputError("accuracy: there is no error to count.")
    return float((errors < limit).double().mean())


def laval_failures(translation: Tensor, rotation: Tensor) -> int:
    """How often Laval calls a track lost, from its errors (N,) in metres and (official) degrees.

    Each time that more than 7 frames in a row are beyond 3 cm or 20°; then counting starts anew.

    Examples:
        >>> import torch
        >>> laval_failures(torch.full((16,), 0.05), torch.zeros(16))
        2
    """
    failures = run = 0
    for bad in ((translation > LAVAL_METRES) | (rotation > LAVAL_DEGREES)).tolist():
        run = run + 1 if bad else 0
        if run > LAVAL_PATIENCE:
            failures, run = failures + 1, 0
    return failures


def frames_until_lost(errors: Tensor, limit: float, run: int = LOST_RUN) -> int:
    """Index + 1 of the first of the frames (N,) from which all of `run` frames are not below limit.

    Near the end the frames that are left are enough. N + 1 for a track that is never lost.

    Examples:
        >>> import torch
        >>> frames_until_lost(torch.tensor([0.001] * 3 + [1.0] * 20), limit=0.01)
        4
    """
    good = (errors < limit).tolist()
    for k in range(len(good)):
        if not any(good[k : k + run]):
            return k + 1
    return len(good) + 1


def auroc(scores: Tensor, correct: Tensor) -> float:
    """How well scores (N,) tell right (N,) from wrong: 1 perfectly, 0.5 not at all.

    The chance that a right one has a higher score than a wrong one, ties counting half; NaN if all
    are right or all are wrong.

    Examples:
        >>> import torch
        >>> auroc(torch.tensor([0.9, 0.8, 0.3]), torch.tensor([True, True, False]))
        1.0
    """
    right, wrong = scores[correct.bool()].double(), scores[~correct.bool()].double()
    if not len(right) or not len(wrong):
        return float("nan")
    ordered = wrong.sort().values
    below = torch.searchsorted(ordered, right)
    not_above = torch.searchsorted(ordered, right, right=True)
    return float((below + not_above).double().mean() / (2 * len(wrong)))


def errors_of(error: ErrorFunction, estimate: Pose, truth: Pose, *what: Any) -> Tensor:
    """Errors of single or batched poses (...) as (N,) float64, with misses counted: infinite.

    A miss is an estimate with a number that is not finite.
    """
    found, true = (flattened(pose) for pose in _together(estimate, truth))
    known = torch.isfinite(found.matrix).all(-1).all(-1)
    errors = torch.full((len(true),), float("inf"), dtype=torch.float64, device=known.device)
    if known.any():
        errors[known] = error(found[known], true[known], *what).to(errors)
    return errors


def flattened(pose: Pose) -> Pose:
    """Poses (...) as one batch (N)."""
    return Pose(pose.rotation.reshape(-1, 3, 3), pose.translation.reshape(-1, 3))


def _together(estimate: Pose, truth: Pose) -> tuple[Pose, Pose]:
    """Both in the batch shape and the dtype that the two make; `InputError` if there is none."""
    try:
        shape = np.broadcast_shapes(estimate.batch_shape, truth.batch_shape)
    except ValueError:
        raise InputError(
            f"Metrics: estimates of shape {tuple(estimate.batch_shape)} and true poses of shape "
            f"{tuple(truth.batch_shape)} do not fit together; give as many, or a single one."
        ) from None
    kind = torch.promote_types(estimate.translation.dtype, truth.translation.dtype)
    found, true = (
        Pose(pose.rotation.expand(*shape, 3, 3), pose.translation.expand(*shape, 3)).to(kind)
        for pose in (estimate, truth)
    )
    return found, true


def _points(points: Any, pose: Pose) -> Tensor:
    """Points (N, 3) in the pose's dtype and on its device; lists and arrays too."""
    found = vectors(points, 3, "Metrics", "the points").to(pose.translation)
    if found.dim() != 2 or not len(found):
        raise InputError(f"Metrics: the points must be (N, 3), found {tuple(found.shape)}.")
    return found


def _like(pose: Pose, values: Any, name: str) -> Tensor:
    return floating(values, "Metrics", name).to(pose.translation)


def _euler_angle(vector: Tensor) -> Tensor:
    """Angle of Rx Ry Rz for the three angles (..., 3) in radians, degrees: (...)."""
    x, y, z = exp_so3(torch.diag_embed(vector)).unbind(-3)
    return torch.rad2deg(rotation_angle(x @ y @ z))


def _largest(
    estimate: Pose,
    truth: Pose,
    points: Tensor,
    symmetries: Tensor,
    look: Callable[[Tensor], Tensor],
) -> Tensor:
    """Least over the symmetries of the largest distance of the points as `look` sees them: (...).

    What cannot be seen (a point in the camera's plane) is infinitely far.
    """
    estimate, truth = _together(estimate, truth)
    points = _points(points, truth)
    motions = Pose.from_matrix(_like(truth, symmetries, "symmetries"))
    size = max(1, CHUNK // len(points))
    moved = [motions[k : k + size].transform(points) for k in range(0, len(motions), size)]
    shape, errors = truth.batch_shape, []
    found, true = flattened(estimate), flattened(truth)
    for k in range(len(true)):
        there = look(found[k].transform(points))
        far = [(look(true[k].transform(one)) - there).norm(dim=-1).amax(-1) for one in moved]
        errors.append(torch.cat(far).nan_to_num(nan=float("inf"), posinf=float("inf")).min())
    return torch.stack(errors).reshape(shape) if errors else points.new_zeros(shape)
