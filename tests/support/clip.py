"""A short clip on disk and the command that tracks it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from moveit6d.cli.main import main
from moveit6d.geometry.pose import Pose


class Clip:
    """A sequence folder and the command that tracks it."""

    def __init__(self, folder: Path, output: Path, true: Pose) -> None:
        self.folder, self.output, self.true = folder, output, true

    def track(self, *more: str, **changes: str) -> int:
        """Run the command, with options changed."""
        return self.search(*more, **{"start": str(self.folder / "start.json"), **changes})

    def search(self, *more: str, **changes: str) -> int:
        """Run the command without a start, with options changed."""
        options = {
            "mesh": str(self.folder / "mesh.ply"),
            "mesh_unit": "m",
            "video": str(self.folder / "frames"),
            "camera": str(self.folder / "camera.json"),
            "output": str(self.output),
            **changes,
        }
        words = [word for key, value in options.items() for word in (f"--{key}", value)]
        return main(["track", *words, *more])

    def summary(self) -> dict[str, Any]:
        """What summary.json says."""
        found: dict[str, Any] = json.loads((self.output / "summary.json").read_text())
        return found


def write_other(folder: Path) -> Path:
    """A mesh of the same shape as a folder's, in other colours: another object."""
    import trimesh

    mesh: Any = trimesh.load(folder / "mesh.ply")
    mesh.visual.vertex_colors = 255 - mesh.visual.vertex_colors[:, :3]
    path = folder / "other.ply"
    mesh.export(path)
    return path
