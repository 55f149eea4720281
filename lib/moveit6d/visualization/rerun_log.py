"""Writes a run for the rerun viewer: frames, the object in space, the true pose, curves, messages.

Never holds more than one frame. Needs rerun-sdk (`pip install 'moveit6d[rerun]'`).
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any
from uuid import uuid4

import numpy as np
import torch

from ..datasets.pose_files import PoseRow
from ..datasets.video import VideoFrame
from ..errors import InputError
from ..extras import require
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..io import discard, replacing

OBJECT, TRUTH, VIEW = "camera/object", "camera/truth", "camera/image"
CURVES = ("confidence", "iterations", "milliseconds")
JPEG_QUALITY = 85
LEAST_SPACE = 1 << 20  # bytes that must be free on the disk


class RerunLog:
    """An .rrd file in the making: use as a context manager and `write` frames with their rows.

    The file appears under its name when the block ends, whatever ends it (Ctrl-C too); a block that
    wrote no frame leaves no file.
    `truth` are the true poses by frame number, where they are known. Frames are shown without
    their lens distortion, and not at all if they are not of the camera's size. `InputError` if
    rerun-sdk is missing or the file cannot be written.
    """

    def __init__(
        self, path: Path, mesh: Mesh, camera: Camera, truth: Mapping[int, Pose] | None = None
    ) -> None:
        self.path, self.mesh, self.camera = path, mesh, camera
        self.truth = truth or {}
        self._rerun = _load()
        self._place = replacing(self.path)
        self._stream: Any = None
        self._empty = True
        self._shown: set[str] = set()  # entities

    def __enter__(self) -> RerunLog:
        rr = self._rerun
        temporary = self._place.__enter__()
        # An id of its own: the viewer shows recordings of one id as one.
        self._stream = rr.RecordingStream("moveit6d", recording_id=f"{self.path.stem} {uuid4()}")
        try:
            if shutil.disk_usage(self.path.parent).free < LEAST_SPACE:  # rerun would wait forever
                raise OSError("the disk is full")
            self._stream.save(temporary, _blueprint(rr))
        except (OSError, RuntimeError) as error:
            discard(self._place)
            raise InputError(f"{self.path} cannot be written: {error}.") from error
        lens = rr.Pinhole(
            image_from_camera=self.camera.matrix.numpy(),
            resolution=[self.camera.width, self.camera.height],
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        self._stream.log("camera", rr.ViewCoordinates.RDF, static=True)
        self._stream.log(VIEW, lens, static=True)
        return self

    def write(self, frame: VideoFrame, row: PoseRow, error: str | None = None) -> None:
        """Append one frame: its image, its row, and why it has no pose."""
        rr, stream = self._rerun, self._stream
        self._empty = False
        stream.set_time("frame", sequence=frame.index)
        size = (self.camera.height, self.camera.width)
        if frame.image is not None and frame.image.shape[:2] == size:
            pixels = torch.from_numpy(np.ascontiguousarray(frame.image)).permute(2, 0, 1)
            flat = self.camera.undistort(pixels)[0].permute(1, 2, 0).numpy()
            stream.log(VIEW, rr.Image(np.ascontiguousarray(flat)).compress(JPEG_QUALITY))
        else:
            stream.log(VIEW, rr.Clear(recursive=False))  # not the picture before
        self._show(OBJECT, row.pose)
        self._show(TRUTH, self.truth.get(frame.index))
        for name in CURVES:
            value = getattr(row, name)
            if value is not None:
                stream.log(f"curves/{name}", rr.Scalars(float(value)))
        if frame.index in self.truth and row.pose is not None:
            shift = row.pose.translation - self.truth[frame.index].translation
            stream.log("curves/origin_error_mm", rr.Scalars(1000 * float(shift.norm())))
        if error is not None or row.reset:
            text = error if error is not None else "set to the true pose"
            stream.log("messages", rr.TextLog(text, level="WARN"))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._stream.flush()
        except RuntimeError as broken:  # its writing thread ended before: the disk is full
            discard(self._place)
            raise InputError(f"{self.path} cannot be written: {broken}.") from broken
        finally:
            self._stream.disconnect()
        if self._empty:
            discard(self._place)
        else:
            self._place.__exit__(None, None, None)

    def _show(self, entity: str, pose: Pose | None) -> None:
        """Where the object, or its true box, is now; nothing is shown while there is no pose."""
        rr, stream = self._rerun, self._stream
        if pose is None:
            if entity in self._shown:
                stream.log(entity, rr.Clear(recursive=False))
            self._shown.discard(entity)
            return
        stream.log(entity, _transform(rr, pose))
        if entity not in self._shown:  # not static: a `Clear` takes away only what has a time
            draw = _surface if entity == OBJECT else _edges
            stream.log(entity, draw(rr, self.mesh))
        self._shown.add(entity)


def _load() -> ModuleType:
    require("rerun", "--rerun")
    import rerun

    module: ModuleType = rerun
    return module


def _blueprint(rr: Any) -> Any:
    """The viewer's first look: image and space side by side, curves and messages below."""
    views = rr.blueprint
    return views.Blueprint(
        views.Vertical(
            views.Horizontal(
                views.Spatial2DView(origin=VIEW, contents=["/camera/**"], name="image"),
                views.Spatial3DView(origin="camera", name="space"),
            ),
            views.Horizontal(
                views.TimeSeriesView(origin="curves", name="curves"),
                views.TextLogView(origin="messages", name="messages"),
            ),
            row_shares=[3, 1],
        )
    )


def _transform(rr: Any, pose: Pose) -> Any:
    return rr.Transform3D(
        translation=pose.translation.tolist(), mat3x3=pose.rotation.to(torch.float64).numpy()
    )


def _surface(rr: Any, mesh: Mesh) -> Any:
    """The mesh in its file's frame, with its colours."""
    look: dict[str, Any] = {}
    if mesh.texture is not None and mesh.uv is not None:
        # rerun counts v from the top.
        look = {
            "albedo_texture": mesh.texture,
            "vertex_texcoords": np.stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]], -1),
        }
    elif mesh.vertex_colors is not None:
        look = {"vertex_colors": mesh.vertex_colors}
    return rr.Mesh3D(
        vertex_positions=mesh.vertices + mesh.center.astype(np.float32),
        triangle_indices=mesh.faces,
        vertex_normals=mesh.normals,
        **look,
    )


def _edges(rr: Any, mesh: Mesh) -> Any:
    """The box around the object, in white: where it truly is."""
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    return rr.Boxes3D(
        centers=[(low + high) / 2 + mesh.center], sizes=[high - low], colors=[(255, 255, 255)]
    )
