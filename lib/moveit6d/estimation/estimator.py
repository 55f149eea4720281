"""One frame: from a pose that is roughly right to one that fits.

Never remembers anything between two calls.
"""

from __future__ import annotations

from typing import Any

from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy, load_policy
from ..rendering.renderer import Renderer, make_renderer
from .frame import prepare_frame
from .last_word import last_word
from .loop import Target, TrackingResult, refine_batch


class PoseEstimator:
    """Refines poses of one object seen by one camera.

    Args:
        mesh: the object.
        camera: the camera, lens distortion included if it has any.
        policy: who decides; the shipped network if None.
        renderer: the back end; embree if None.
        max_steps: limit of cycles; `MAX_STEPS` of the policy's mode if None.
        regions: after the policy's moves, fit the outline to where the object's colours end.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        max_steps: int | None = None,
        regions: bool = True,
    ) -> None:
        self.mesh, self.camera, self.max_steps, self.regions = mesh, camera, max_steps, regions
        self.policy: Policy = load_policy() if policy is None else policy
        self.renderer = make_renderer() if renderer is None else renderer

    def refine(self, image: Any, pose: Pose) -> TrackingResult:
        """The pose in an RGB image (H, W, 3) near `pose`; both in the mesh file's frame.

        Raises `InputError` if the image does not fit the camera or the pose is out of sight.
        """
        target = Target(prepare_frame(image, self.camera), self.camera, self.mesh, pose)
        result = refine_batch(
            [target], policy=self.policy, renderer=self.renderer, max_steps=self.max_steps
        )[0]
        return last_word(target, result, self.renderer)[0] if self.regions else result
