"""--texture_from_start: paints meshes without colours at the start, or once they are tracked.

Never finds a pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .messages import note

if TYPE_CHECKING:
    from ..config import TextureConfig
    from ..datasets.pose_files import PoseRow
    from ..datasets.video import VideoFrame
    from ..evaluation.run_tracker import AnyTracker
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose
    from .starting import Beginning

FACT = "texture_from_start"  # in summaries: from which frame each mesh has its colours
NEVER = "the object was never tracked."


def painted(
    mesh: Mesh, pose: Pose, shown: VideoFrame, camera: Camera, config: TextureConfig
) -> Mesh:
    """A mesh with the colours that a frame shows of it; `InputError` if it shows too little."""
    from ..frame import prepare_frame

    frame = prepare_frame(shown.image, camera).undistorted
    image = frame.pixels.permute(1, 2, 0).numpy()
    return mesh.textured_from(image, pose, frame.camera, config)


class Painting:
    """The paint of a track's meshes.

    Args:
        meshes: those of all objects.
        names: the objects' names; empty for a single one.
        camera: the camera.
        config: how they are painted.
        wanted: whether meshes without colours are painted.

    `kept` says, for the summary, from which frame on each mesh is painted, or why it is not.
    """

    def __init__(
        self,
        meshes: Sequence[Mesh],
        names: Sequence[str],
        camera: Camera,
        config: TextureConfig,
        wanted: bool,
    ) -> None:
        self.meshes, self.names = list(meshes), names
        self.camera, self.config = camera, config
        self.waiting = [k for k, mesh in enumerate(meshes) if wanted and not mesh.has_colours]
        self._facts: dict[str, Any] = {}
        self.kept = {FACT: self._facts} if self.waiting else {}
        for number in self.waiting:
            self._record(number, None, NEVER)

    def begin(self, tracker: AnyTracker, beginning: Beginning) -> None:
        """Paint the meshes whose pose in the first frame is known; the tracker follows those.

        `InputError` where the frame shows too little of an object at a given pose.
        """
        for number in list(self.waiting):
            pose, first = beginning.starts[number], beginning.first
            if pose is None or first is None or not beginning.exact[number]:
                continue
            try:
                mesh = painted(self.meshes[number], pose, first, self.camera, self.config)
                tracker.replace_mesh(number, mesh, pose)
            except InputError as error:
                if not beginning.found:
                    raise
                self._record(number, None, str(error))
            else:
                self._keep(number, mesh, first)
        for number in self.waiting:
            note(
                f"{self._prefix(number)}--texture_from_start: the pose in the first frame is not "
                "known; the mesh is painted once the object is tracked."
            )

    def see(self, tracker: AnyTracker, frame: VideoFrame, rows: Sequence[PoseRow]) -> None:
        """Paint what waits for it and is tracked in this frame; the tracker then follows that."""
        from ..estimation.states import TrackingState

        for number in list(self.waiting):
            pose = rows[number].pose
            if pose is None or rows[number].state != TrackingState.TRACKING or frame.image is None:
                continue
            try:
                mesh = painted(self.meshes[number], pose, frame, self.camera, self.config)
                tracker.replace_mesh(number, mesh, pose)
            except InputError as error:
                self._record(number, None, str(error))
            else:
                self._keep(number, mesh, frame)
                note(f"{self._prefix(number)}frame {frame.index}: the mesh is painted from here.")

    def end(self) -> None:
        """Say what was not painted."""
        for number in self.waiting:
            said = self._facts[self.names[number]] if self.names[number] else self._facts
            note(f"{self._prefix(number)}the mesh was not painted: {said['reason']}")

    def _keep(self, number: int, mesh: Mesh, frame: VideoFrame) -> None:
        self.meshes[number] = mesh
        self.waiting.remove(number)
        self._record(number, frame.index)

    def _record(self, number: int, frame: int | None, reason: str | None = None) -> None:
        fact = {"frame": frame} if reason is None else {"frame": frame, "reason": reason}
        name = self.names[number]
        if not name:
            self._facts.clear()
            self._facts.update(fact)
        else:
            self._facts[name] = fact

    def _prefix(self, number: int) -> str:
        return f"{self.names[number]}: " if self.names[number] else ""
