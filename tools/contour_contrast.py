"""Which poses fit the pictures better, those of a BOP result file or the true ones?

    .venv/bin/python tools/contour_contrast.py DATASET SPLIT RESULTS.csv

The contrast of a pose is how steeply the picture's colours change across its rendered outline, a
mean over the outline, in thousandths of full scale a patch pixel. It says how good true poses are:
where one is off by a pixel or two, the outline of a better pose has more contrast. Of an object
that occurs several times in a picture the first true pose counts. Never used to move or to choose a
pose.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import torch

from moveit6d.config import ContourConfig
from moveit6d.contour.extraction import find_contour
from moveit6d.datasets.bop import BopDataset, Estimate, by_image, read_results
from moveit6d.evaluation.bop.add_recall import score_results, targets_of
from moveit6d.evaluation.tables import markdown, percent
from moveit6d.frame import Frame, prepare_frame
from moveit6d.geometry.crop import View, crop_patch, look_at
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.rendering.renderer import Renderer

BLUR = 1.0  # patch pixels
POINTS = 400


def contrast(frame: Frame, mesh: Mesh, pose: Pose, view: View, renderer: Renderer) -> float:
    """Mean change of colour a pixel, across the outline of the mesh, in the patch of a view."""
    camera = frame.camera
    patch = crop_patch(frame.pixels, view, camera.matrix, camera.lens).permute(1, 2, 0)
    patch = cv2.GaussianBlur(patch.numpy(), (0, 0), BLUR)
    virtual = view.to_virtual(mesh.inner(pose.to(torch.float64)))
    seen = renderer.render([mesh], Pose.stack([virtual]), view.intrinsics[None])
    contour = find_contour(seen.mask[0, 0].numpy() > 0.5, POINTS, ContourConfig().normal_blur)
    if contour is None:
        return float("nan")
    along = [cv2.Sobel(patch, cv2.CV_32F, *axis, ksize=1) / 2 for axis in ((1, 0), (0, 1))]
    places = contour.points.astype(np.float32).reshape(-1, 1, 2)
    slope = [cv2.remap(side, places, None, cv2.INTER_LINEAR)[:, 0] for side in along]
    steep = slope[0] * contour.normals[:, :1] + slope[1] * contour.normals[:, 1:]
    return float(np.average(np.linalg.norm(steep, axis=1), weights=contour.lengths))


def main(root: Path, split: str, results: Path) -> None:
    """Print the table."""
    dataset, renderer = BopDataset(root, split), make_renderer()
    estimates = read_results(results)
    wanted = set(targets_of(estimates, dataset))
    rows: dict[int, list[tuple[bool, float, float]]] = {}
    for (scene, image), numbers in by_image(estimates):
        picture = dataset.image(scene, image)
        camera = dataset.camera(scene, image, (picture.shape[1], picture.shape[0]))
        frame = prepare_frame(picture, camera)
        for estimate in (estimates[number] for number in numbers):
            if (scene, image, estimate.object) not in wanted:
                continue
            rows.setdefault(estimate.object, []).append(
                _compare(dataset, estimate, frame, renderer)
            )
    head = [
        "object",
        "poses",
        "ADD(-S)<10%d",
        "contrast",
        "of the truth",
        "more than the truth",
        "more, of those not <10%d",
    ]
    every = [row for some in rows.values() for row in some]
    print(markdown(head, [_row(str(k), rows[k]) for k in sorted(rows)] + [_row("all", every)]))


def _compare(
    dataset: BopDataset, estimate: Estimate, frame: Frame, renderer: Renderer
) -> tuple[bool, float, float]:
    """Whether an estimate is right, its contrast and the true pose's, in the same patch."""
    mesh = dataset.mesh(estimate.object)
    found = dataset.truth(estimate.scene, estimate.image)
    truth = next(one.pose for one in found if one.object == estimate.object)
    error = score_results(
        dataset, [estimate], [(estimate.scene, estimate.image, estimate.object)]
    ).errors
    view = look_at(mesh.inner(truth.to(torch.float64)), torch.tensor(mesh.sphere_diameter).double())
    both = [contrast(frame, mesh, pose, view, renderer) for pose in (estimate.pose, truth)]
    return float(error[0]) < 0.1, both[0], both[1]


def _row(name: str, rows: list[tuple[bool, float, float]]) -> list[str]:
    right, found, true = (np.array(column) for column in zip(*rows, strict=True))
    more, wrong = found > true, ~right.astype(bool)
    return [
        name,
        str(len(rows)),
        percent(float(right.mean())),
        f"{1e3 * np.nanmean(found):.1f}",
        f"{1e3 * np.nanmean(true):.1f}",
        percent(float(more.mean())),
        percent(float(more[wrong].mean())) if wrong.any() else "-",
    ]


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
