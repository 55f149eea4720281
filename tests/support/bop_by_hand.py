"""BOP's recalls of 2019 once more, from the files alone, in plain loops; used by the tests only.

Reads the columns of a result file as bop_toolkit does: seven fields a line, millimetres.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

# Half a turn about z around a point beside the origin.
TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
TURN[:3, 3] = (0.06, -0.02, 0.0)


def read_estimates(path: Path) -> dict[tuple[int, int, int], list[tuple[float, Any, Any]]]:
    """(score, R, t) by (scene, image, object), best first."""
    found: dict[tuple[int, int, int], list[tuple[float, Any, Any]]] = {}
    lines = path.read_text().splitlines()
    assert lines[0] == "scene_id,im_id,obj_id,score,R,t,time"
    for line in lines[1:]:
        scene, image, number, score, rotation, shift, seconds = line.split(",")
        float(seconds)
        r = np.array(rotation.split(" "), float).reshape(3, 3)
        t = np.array(shift.split(" "), float).reshape(3, 1)
        key = (int(scene), int(image), int(number))
        found.setdefault(key, []).append((float(score), r, t))
    return {key: sorted(rows, key=lambda row: -row[0]) for key, rows in found.items()}


def recalls(root: Path, split: str, results: Path, points: dict[int, Any]) -> dict[str, float]:
    """AR of MSSD and MSPD, from files; `points` (N, 3) of each object in millimetres."""
    info = json.loads((root / "models" / "models_info.json").read_text())
    targets = json.loads((root / "test_targets_bop19.json").read_text())
    estimates = read_estimates(results)
    symmetries = {number: symmetry_set(info[str(number)]) for number in points}
    hits = {kind: [0] * 10 for kind in ("mssd", "mspd")}
    total = 0
    for target in targets:
        scene, image, number = target["scene_id"], target["im_id"], target["obj_id"]
        folder = root / split / f"{scene:06d}"
        truth, info_of_truth, camera = (
            json.loads((folder / name).read_text())[str(image)]
            for name in ("scene_gt.json", "scene_gt_info.json", "scene_camera.json")
        )
        order = sorted(range(len(truth)), key=lambda k: -info_of_truth[k]["visib_fract"])
        valid = [truth[k] for k in order if truth[k]["obj_id"] == number][: target["inst_count"]]
        total += len(valid)
        rows = estimates.get((scene, image, number), [])[: target["inst_count"]]
        matrix = np.array(camera["cam_K"]).reshape(3, 3)
        errors: dict[str, list[list[float]]] = {"mssd": [], "mspd": []}
        for _, r, t in rows:
            pairs = [both(r, t, one, points[number], symmetries[number], matrix) for one in valid]
            errors["mssd"].append([pair[0] / info[str(number)]["diameter"] for pair in pairs])
            errors["mspd"].append([pair[1] * 640 / 160 for pair in pairs])
        for k in range(10):
            hits["mssd"][k] += greedy(errors["mssd"], 0.05 * (k + 1))
            hits["mspd"][k] += greedy(errors["mspd"], 5.0 * (k + 1))
    return {kind: sum(counts) / (10 * total) for kind, counts in hits.items()}


def greedy(rows: list[list[float]], limit: float) -> int:
    """How many true poses are taken."""
    used: set[int] = set()
    for row in rows:
        free = [(error, k) for k, error in enumerate(row) if k not in used and error < limit]
        if free:
            used.add(min(free)[1])
    return len(used)


def both(r: Any, t: Any, true: Any, points: Any, symmetries: Any, matrix: Any) -> Any:
    """MSSD and MSPD of one estimate against one true pose."""
    rotation, shift = np.array(true["cam_R_m2c"]).reshape(3, 3), np.array(true["cam_t_m2c"])
    found = r @ points.T + t
    surface, image = math.inf, math.inf
    for s, move in symmetries:
        other = rotation @ (s @ points.T + move[:, None]) + shift[:, None]
        surface = min(surface, np.linalg.norm(found - other, axis=0).max())
        a, b = matrix @ found, matrix @ other
        image = min(image, np.linalg.norm(a[:2] / a[2] - b[:2] / b[2], axis=0).max())
    return surface, image


def symmetry_set(info: Any) -> list[tuple[Any, Any]]:
    """R and t (mm): every turn of every axis on the left of every discrete symmetry."""
    discrete = [np.eye(4)] + [
        np.array(m).reshape(4, 4) for m in info.get("symmetries_discrete", [])
    ]
    turns = []
    for axis in info.get("symmetries_continuous", []):
        unit = np.array(axis["axis"]) / np.linalg.norm(axis["axis"])
        x, y, z = unit
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        steps = math.ceil(math.pi / 0.01)
        for k in range(1, steps):
            angle = 2 * math.pi * k / steps
            turn = np.cos(angle) * np.eye(3) + np.sin(angle) * cross
            turn = turn + (1 - np.cos(angle)) * np.outer(unit, unit)
            offset = np.array(axis["offset"])
            turns.append((turn, offset - turn @ offset))
    found = [(m[:3, :3], m[:3, 3]) for m in discrete]
    return found + [(r @ m[:3, :3], r @ m[:3, 3] + t) for m in discrete for r, t in turns]
