"""YCB-Video's figures of the keyframes: areas under ADD and ADD-S, as its toolbox has them.

Never tracks. One row is one object in one keyframe; a row without a pose is infinitely wrong, and
false detections cost nothing. Poses and points belong to the object frames of YCB-Video (BOP's
YCB-V has others). (yuxng/YCB_Video_toolbox, evaluate_poses_keyframe.m.)
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...datasets.ycbv import SYMMETRIC
from ...errors import InputError
from ...geometry.pose import Pose
from ...io import replacing
from .. import metrics
from ..metrics import auc
from ..tables import markdown

NOT_METHODS = ("scene", "frame", "obj_id", "object_names", "gt")
CLOSE = 0.02  # metres; DenseFusion's "< 2 cm"
Area = Callable[[Tensor], float]


@dataclass(frozen=True)
class Keyframes:
    """True poses and estimates: `objects` (N,) from 1, `truth` (N), `estimates` (N) by method.

    An estimate that is missing is NaN. `names` are those of objects 1, 2, ….
    """

    objects: Tensor
    names: tuple[str, ...]
    truth: Pose
    estimates: Mapping[str, Pose]


@dataclass(frozen=True)
class KeyframeErrors:
    """ADD and ADD-S (N,) of one method in metres, infinite for misses; `symmetric` (N,) by row."""

    objects: Tensor
    add: Tensor
    add_s: Tensor
    symmetric: Tensor

    @property
    def mixed(self) -> Tensor:
        """ADD(-S): ADD-S for objects declared symmetric, ADD for the others."""
        return torch.where(self.symmetric, self.add_s, self.add)


def read_keyframe_poses(path: str | Path, methods: Sequence[str] = ()) -> Keyframes:
    """Poses of an .npz file: `obj_id` (N,) from 1, `object_names`, `gt` and one array a method.

    A pose is `qw qx qy qz tx ty tz` in metres; quaternions need not be unit ones, and one of zeros
    means that there is no pose. All methods of the file unless some are named.
    """
    path = Path(path)
    arrays = _load(path)
    missing = [name for name in ("obj_id", "object_names", "gt") if name not in arrays]
    if missing:
        raise InputError(
            f"{path} holds no {', '.join(missing)}; needed are obj_id, object_names, gt."
        )
    there = [name for name in arrays if name not in NOT_METHODS]
    unknown = [name for name in methods if name not in there]
    if unknown or not there:
        raise InputError(
            f"{path} holds no estimates {', '.join(unknown)}; "
            f"there are {', '.join(there) or 'none'}."
        )
    numbers = _floats(arrays["obj_id"], f"{path}: obj_id")
    if numbers.ndim != 1 or not (numbers == numbers.round()).all():
        raise InputError(f"{path}: obj_id must be (N,) whole numbers of objects.")
    objects = torch.from_numpy(numbers.astype(np.int64))
    names = tuple(str(name) for name in np.atleast_1d(arrays["object_names"]))
    if len(objects) == 0 or int(objects.min()) < 1 or int(objects.max()) > len(names):
        raise InputError(f"{path}: obj_id must be 1 … {len(names)}, a number of object_names.")
    truth = _poses(arrays["gt"], len(objects), f"{path}: gt")
    if not torch.isfinite(truth.rotation).all():
        raise InputError(f"{path}: gt holds a row without a pose.")
    chosen = {
        name: _poses(arrays[name], len(objects), f"{path}: {name}") for name in (methods or there)
    }
    return Keyframes(objects, names, truth, chosen)


def read_points(path: str | Path) -> dict[int, Tensor]:
    """Evaluation points (M, 3) in metres by object, of an .npz file with the keys 01, 02, …."""
    path = Path(path)
    arrays = _load(path)
    try:
        numbered = {int(key): values for key, values in arrays.items()}
    except ValueError:
        raise InputError(f"{path}: the keys must be numbers of objects, 01, 02, ….") from None
    found = {
        number: torch.from_numpy(_floats(values, f"{path}: points of object {number}"))
        for number, values in numbered.items()
    }
    for number, points in found.items():
        if points.dim() != 2 or points.shape[1] != 3 or not len(points):
            raise InputError(f"{path}: points of object {number} must be (M, 3).")
        if float(points.abs().max()) > 10:
            raise InputError(f"{path}: object {number} looks like millimetres; metres are needed.")
    return found


def write_keyframe_poses(path: str | Path, keyframes: Keyframes) -> None:
    """Write what `read_keyframe_poses` reads."""
    content: dict[str, Any] = {
        "obj_id": keyframes.objects.numpy(),
        "object_names": np.array(keyframes.names),
        "gt": _rows(keyframes.truth),
    }
    content |= {name: _rows(pose) for name, pose in keyframes.estimates.items()}
    with replacing(Path(path)) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **content)


def keyframe_errors(
    keyframes: Keyframes,
    method: str,
    points: Mapping[int, Tensor],
    symmetric: Iterable[str] = SYMMETRIC,
) -> KeyframeErrors:
    """Errors of every row of one method; `symmetric` names the objects whose metric is ADD-S."""
    estimate = keyframes.estimates[method]
    add = torch.full((len(keyframes.objects),), float("inf"), dtype=torch.float64)
    add_s = add.clone()
    for number in _numbers_in(keyframes.objects):
        if number not in points:
            name = keyframes.names[number - 1]
            raise InputError(f"there are no evaluation points of object {number} ({name}).")
        rows = keyframes.objects == number
        for errors, function in ((add, metrics.add), (add_s, metrics.adi)):
            errors[rows] = metrics.errors_of(
                function, estimate[rows], keyframes.truth[rows], points[number]
            )
    declared = set(symmetric)
    flags = torch.tensor([name in declared for name in keyframes.names])
    return KeyframeErrors(keyframes.objects, add, add_s, flags[keyframes.objects - 1])


def figures(errors: Tensor, objects: Tensor, area: Area) -> tuple[float, float]:
    """One curve over all rows, and the mean of the objects' own curves: both are published.

    `area` is `voc_auc` for the toolbox's tables or `exact_auc`.
    """
    classes = [area(errors[objects == number]) for number in _numbers_in(objects)]
    return area(errors), sum(classes) / len(classes)


def keyframes_table(found: Mapping[str, KeyframeErrors], area: Area = auc.voc_auc) -> str:
    """Markdown table: one row a method, areas in percent, pooled and as the mean of objects."""
    head = [
        "method",
        "rows",
        "missing",
        "ADD",
        "ADD-S",
        "ADD(-S)",
        "mean of objects: ADD",
        "ADD-S",
        "ADD(-S)",
        "ADD-S<2cm",
    ]
    rows = []
    for name, one in found.items():
        pairs = [figures(errors, one.objects, area) for errors in (one.add, one.add_s, one.mixed)]
        cells = [name, str(len(one.add)), str(int(torch.isinf(one.add).sum()))]
        cells += [f"{100 * pooled:.2f}" for pooled, _ in pairs]
        cells += [f"{100 * mean:.2f}" for _, mean in pairs]
        rows.append([*cells, f"{100 * metrics.accuracy(one.add_s, CLOSE):.2f}"])
    return markdown(head, rows)


def objects_table(
    found: Mapping[str, KeyframeErrors], names: Sequence[str], area: Area = auc.voc_auc
) -> str:
    """Markdown table: one row an object, ADD and ADD-S areas of every method in percent."""
    head = ["object", *(f"{name} {kind}" for name in found for kind in ("ADD", "ADD-S"))]
    some = next(iter(found.values()))
    rows = []
    for number in _numbers_in(some.objects):
        mine = some.objects == number
        star = " *" * bool(some.symmetric[mine][0])
        cells = [f"{names[number - 1]}{star}"]
        for one in found.values():
            cells += [f"{100 * area(errors[mine]):.2f}" for errors in (one.add, one.add_s)]
        rows.append(cells)
    return markdown(head, rows)


def _numbers_in(objects: Tensor) -> list[int]:
    return sorted(set(objects.tolist()))


def _load(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    except (OSError, ValueError, AttributeError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is not an .npz file of arrays: {error}.") from None


def _floats(values: NDArray[Any], where: str) -> NDArray[np.float64]:
    """An array of numbers, also of a type that torch does not know."""
    if values.dtype.kind not in "iuf":
        raise InputError(f"{where} must be numbers, found an array of {values.dtype.name}.")
    return values.astype(np.float64)


def _poses(rows: NDArray[Any], count: int, where: str) -> Pose:
    """Poses (N) of rows qw qx qy qz tx ty tz; NaN for quaternions of zeros."""
    from scipy.spatial.transform import Rotation

    if rows.shape != (count, 7):
        raise InputError(f"{where} must be ({count}, 7), qw qx qy qz tx ty tz; found {rows.shape}.")
    values = _floats(rows, where)
    known = np.isfinite(values).all(1) & (np.linalg.norm(values[:, :4], axis=1) > 1e-6)
    rotation, shift = np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan)
    rotation[known] = Rotation.from_quat(values[known, :4], scalar_first=True).as_matrix()
    shift[known] = values[known, 4:]
    return Pose(torch.from_numpy(rotation), torch.from_numpy(shift))


def _rows(pose: Pose) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    known = torch.isfinite(pose.rotation).all(-1).all(-1).numpy()
    rows = np.zeros((len(pose), 7))
    turns = Rotation.from_matrix(pose.rotation.numpy()[known])
    rows[known, :4] = turns.as_quat(scalar_first=True)
    rows[known, 4:] = pose.translation.numpy()[known]
    return rows
