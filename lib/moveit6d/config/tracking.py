"""Settings of tracking, and all of them together.

Never computes anything.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from ..errors import InputError
from .calibration import CalibrationConfig
from .detection import DetectorConfig
from .loop import LoopConfig
from .ranges import check_range
from .recovery import RecoveryConfig
from .types import check_types


@dataclass(frozen=True)
class PerturbationConfig:
    """Random starts around a pose.

    Args:
        count: how many starts.
        shift: largest shift on t_x, t_y and t_z, in action units.
        rotation: smallest and largest rotation, in degrees.
        fine: start in the fine stage.
    """

    count: int
    shift: tuple[float, float, float]
    rotation: tuple[float, float]
    fine: bool = False

    def __post_init__(self) -> None:
        check_range(self, "0 or more", "count")
        check_range(self, "0 or more and finite", "shift", "rotation")
        if not self.rotation[0] <= self.rotation[1]:
            raise InputError(
                "PerturbationConfig: rotation must be two numbers, the smaller first, found "
                f"{self.rotation}."
            )


@dataclass(frozen=True)
class MultiStartConfig:
    """Refinement from perturbed starts while the confidence is low (mode all_axes only).

    Args:
        enabled: refine from perturbed starts at all.
        recovery: in a video: starts around each of the three recovery poses (the last pose, the
            last confident one, and where its motion leads). Wider ones find a lost object no more
            often, and more often something else.
        recovery_first: in a video: the first frames of low confidence in a row, so many of them,
            have recovery starts.
        recovery_every: in a video: after those, one frame in so many has recovery starts, so that a
            lost object costs a few times the time of one that is followed, not twenty times.
        race: in a video: after one iteration only the most confident recovery start goes on.
        below: in a single image: confidence below which other starts are tried.
        around_start: in a single image: starts around the given pose.
        around_result: in a single image: starts around the refined pose.
        rounds: in a single image: how often to try.
        batch_size: starts refined in one batch, which bounds the memory.
        duplicate_delta: two starts within so many action units on every axis lead to the same pose,
            so that one of them is enough.
    """

    enabled: bool = True
    recovery: PerturbationConfig = PerturbationConfig(3, (25.0, 25.0, 8.0), (10.0, 30.0))
    recovery_first: int = 2
    recovery_every: int = 3
    race: bool = True
    below: float = 0.8
    around_start: PerturbationConfig = PerturbationConfig(6, (15.0, 15.0, 8.0), (5.0, 20.0))
    around_result: PerturbationConfig = PerturbationConfig(4, (3.0, 3.0, 3.0), (2.0, 6.0), True)
    rounds: int = 2
    batch_size: int = 32
    duplicate_delta: float = 3.0

    def __post_init__(self) -> None:
        if not 0 <= self.below <= 1:
            raise InputError(f"MultiStartConfig: below must be a confidence, found {self.below}.")
        check_range(self, "1 or more", "recovery_every", "batch_size")
        check_range(self, "0 or more", "recovery_first", "rounds", "duplicate_delta")


@dataclass(frozen=True)
class SingleImageConfig:
    """The probability that a single image's pose is right, by logistic regression on log odds.

    Of networks with a confidence for searches; others' own confidence is it. Fitted on rendered
    single images, tabletops among them, of eight training meshes that were held out
    (`tools/fit_probabilities.py`).

    Args:
        confidence: weight of the network's confidence at the end of the refinement.
        search_confidence: weight of its confidence for searches, at the pose found.
        intercept: intercept of the regression.
    """

    confidence: float = 1.41
    search_confidence: float = 0.43
    intercept: float = -0.45


@dataclass(frozen=True)
class MotionConfig:
    """The constant-velocity model of a track.

    Args:
        enabled: frames start where the motion leads and at the last confident pose, too; otherwise,
            as in the paper, at the last pose alone.
        slow_delta: an object that moved by less than this on every axis, in action units, starts
            the next frame in the fine stage.
        velocity_rate: share of the mean velocity that each confident frame replaces.
        velocity_decay: share of its velocity that an unseen object keeps from frame to frame, below
            1: its way has an end.
    """

    enabled: bool = True
    slow_delta: float = 6.0
    velocity_rate: float = 0.5
    velocity_decay: float = 0.93

    def __post_init__(self) -> None:
        check_range(self, "0 or more", "slow_delta")
        check_range(self, "from 0 to 1", "velocity_rate")
        if not 0 <= self.velocity_decay < 1:
            raise InputError(
                "MotionConfig: velocity_decay must be 0 or more and below 1, found "
                f"{self.velocity_decay}."
            )


@dataclass(frozen=True)
class ContourConfig:
    """Region-based refinement of the pose after the loop (SRT3D's terms).

    Args:
        enabled: refine the contour at all.
        moves_below: confidence of the network from which its pose stays as it is, and the contour
            says only how well it agrees; above 1 it moves every pose.
        scales: pixels a segment of the correspondence lines, one Gauss-Newton step each; one
            rendering for each inner list.
        lines: correspondence lines at most.
        min_lines: below this many the pose is left as it is.
        prior: standard deviation of the given pose on the six axes, in action units: the smaller,
            the less the contour weighs.
        correlation: so many neighbouring lines, which err alike, weigh as one.
        outlier: pixels beyond which a line loses weight: something occludes the contour there.
        max_step: largest step on an axis, in action units.
        max_delta: largest change in all, in action units; beyond it the given pose is kept.
        reach: contour distances compared, in segments to either side.
        window: segments to either side of a contour distance that it is judged by.
        amplitude: amplitude of the smoothed step function: 0.5 would trust every pixel.
        slope: slope of the smoothed step function, in segments.
        min_deviation: no line is taken to be more exact than this, in segments.
        agreement_error: pixels from the contour within which a sharp change of colours counts as
            agreement.
        normal_blur: pixels over which the direction of the contour is averaged.
        bins: bins of a colour channel in the histograms.
        bin_blur: standard deviation of the blur of the histograms, in bins.
        band: pixels to either side of the contour whose colours are counted.
        min_pixels: below this many on either side there are no histograms.
        rare: density under which a colour says nothing.
        pixel_error: the least probability that a single pixel is wrong.
        histogram_rate: share of a track's histograms that each frame replaces.
    """

    enabled: bool = True
    moves_below: float = 0.95
    scales: tuple[tuple[int, ...], ...] = ((2, 2), (1, 1))
    lines: int = 200
    min_lines: int = 20
    prior: tuple[float, float, float, float, float, float] = (0.4, 0.4, 0.9, 0.9, 0.9, 0.6)
    correlation: float = 5.0
    outlier: float = 3.0
    max_step: float = 5.0
    max_delta: float = 8.0
    reach: int = 6
    window: int = 4
    amplitude: float = 0.36
    slope: float = 0.8
    min_deviation: float = 0.7
    agreement_error: float = 1.5
    normal_blur: float = 2.0
    bins: int = 32
    bin_blur: float = 1.0
    band: float = 16.0
    min_pixels: int = 30
    rare: float = 1e-6
    pixel_error: float = 0.02
    histogram_rate: float = 0.2

    def __post_init__(self) -> None:
        if not self.scales or not all(some and min(some) >= 1 for some in self.scales):
            raise InputError(
                "ContourConfig: scales must be one or more lists of one or more numbers of pixels, "
                f"each 1 or more, found {self.scales}."
            )
        if not 1 <= self.bins <= 256:
            raise InputError(f"ContourConfig: bins must be from 1 to 256, found {self.bins}.")
        if not 0 <= self.amplitude <= 0.5:
            raise InputError(
                f"ContourConfig: amplitude must be from 0 to 0.5, found {self.amplitude}."
            )
        if not 0 < self.pixel_error < 0.5:
            raise InputError(
                "ContourConfig: pixel_error must be above 0 and below 0.5, found "
                f"{self.pixel_error}."
            )
        check_range(self, "1 or more", "lines", "reach", "window", "min_pixels")
        check_range(self, "above 0", "correlation", "outlier", "slope", "min_deviation")
        check_range(self, "above 0", "bin_blur", "band")
        check_range(self, "above 0 and finite", "prior", "normal_blur", "rare")
        check_range(self, "0 or more", "moves_below", "min_lines", "max_step", "max_delta")
        check_range(self, "0 or more", "agreement_error")
        check_range(self, "from 0 to 1", "histogram_rate")


@dataclass(frozen=True)
class TextureConfig:
    """How a mesh without colours is painted from an image (`Mesh.textured_from`).

    Args:
        pieces: triangles are divided until no edge is longer than the object's diameter over this.
        max_faces: number of faces beyond which triangles are not divided any further.
        min_facing: cosine to the viewing ray below which a face is too slanted to be painted.
        hidden: a face so far behind the nearest one of its pixels, in diameters, is hidden.
    """

    pieces: int = 24
    max_faces: int = 40_000
    min_facing: float = 0.2
    hidden: float = 0.015

    def __post_init__(self) -> None:
        if self.pieces < 1 or not 0 < self.min_facing < 1:
            raise InputError(
                "TextureConfig: pieces must be 1 or more and min_facing between 0 and 1, found "
                f"{self.pieces} and {self.min_facing}."
            )


@dataclass(frozen=True)
class KeyframeConfig:
    """Memory of the looks of an object whose mesh has no colours: confident frames of a track.

    Renderings take the colours that keyframes show of the surface, the oldest first: later ones
    only add what those before did not see.

    Args:
        enabled: whether to do it at all.
        count: keyframes of an object at most, some 1.5 MB each.
        spread: degrees that the side a new one shows is turned from those of all others, at least.
        reach: degrees from the side that is seen, up to which keyframes are looked at.
        min_confidence: a frame of less is no keyframe.
        hidden: a point so far off the surface that a keyframe saw, in diameters, was hidden.
        depth_edge: a jump of depth from one pixel to the next by more, in diameters, is an edge.
        facing: cosines to the viewing ray between which the weight of a surface rises from 0 to 1.
        edge_margin: distances from an edge, where colours mix, between which it does, in pixels of
            a keyframe (two to one of the crop).
        enough: later keyframes are left out where older ones show such a share of the object.
        min_pixels: pixels of the crop; with fewer remembered ones a rendering stays as it is.
        gain: smallest and largest factor by which the mesh's colours are matched to the remembered
            ones.
    """

    enabled: bool = False
    count: int = 24
    spread: float = 25.0
    reach: float = 60.0
    min_confidence: float = 0.8
    hidden: float = 0.015
    depth_edge: float = 0.04
    facing: tuple[float, float] = (0.15, 0.35)
    edge_margin: tuple[float, float] = (0.5, 2.0)
    enough: float = 0.6
    min_pixels: float = 50.0
    gain: tuple[float, float] = (0.2, 5.0)

    def __post_init__(self) -> None:
        if self.count < 1 or not self.spread > 0 or not self.reach > 0:
            raise InputError(
                "KeyframeConfig: count must be 1 or more, spread and reach positive, found "
                f"{self.count}, {self.spread} and {self.reach}."
            )
        if not self.hidden > 0 or not self.depth_edge > 0:
            raise InputError(
                "KeyframeConfig: hidden and depth_edge must be positive, found "
                f"{self.hidden} and {self.depth_edge}."
            )
        for name in ("facing", "edge_margin"):
            low, high = getattr(self, name)
            if not low < high:
                raise InputError(
                    f"KeyframeConfig: {name} must be two numbers, the smaller first, found "
                    f"{low} and {high}."
                )
        if not 0 < self.gain[0] <= self.gain[1]:
            raise InputError(
                "KeyframeConfig: gain must be two positive numbers, the smaller first, found "
                f"{self.gain[0]} and {self.gain[1]}."
            )


@dataclass(frozen=True)
class TrackerConfig:
    """Everything that decides a track or a detection besides the policy and the renderer.

    Args:
        low_confidence: below it a pose is taken to be wrong: recovery starts, no histograms.
        high_confidence: from it on a motion is continued and a pose is gone back to; in between an
            object is half occluded or blurred, and its seeming motion would mislead.
        loop: the refinement loop.
        multi_start: refinement from perturbed starts.
        single_image: how likely the pose found in a single image is right.
        motion: the constant-velocity model.
        contour: region-based refinement.
        calibration: calibration from the first frame.
        texture: painting of meshes without colours from the first frame.
        detection: search of a whole image for an object.
        recovery: when an object counts as lost, and how it is looked for then.
        keyframes: memory of the looks of objects without colours.

    Examples:
        >>> from moveit6d import TrackerConfig
        >>> from moveit6d.config import ContourConfig
        >>> TrackerConfig(contour=ContourConfig(enabled=False)).contour.enabled
        False
    """

    low_confidence: float = 0.5
    high_confidence: float = 0.65
    loop: LoopConfig = field(default_factory=LoopConfig)
    multi_start: MultiStartConfig = field(default_factory=MultiStartConfig)
    single_image: SingleImageConfig = field(default_factory=SingleImageConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    contour: ContourConfig = field(default_factory=ContourConfig)
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    texture: TextureConfig = field(default_factory=TextureConfig)
    detection: DetectorConfig = field(default_factory=DetectorConfig)
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)
    keyframes: KeyframeConfig = field(default_factory=KeyframeConfig)

    def __post_init__(self) -> None:
        check_types(self)
        if not 0 <= self.low_confidence <= self.high_confidence <= 1:
            raise InputError(
                "TrackerConfig: 0 ≤ low_confidence ≤ high_confidence ≤ 1 is needed, found "
                f"{self.low_confidence} and {self.high_confidence}."
            )

    def as_dict(self) -> dict[str, Any]:
        """Every setting as plain values, nested as here."""
        return dataclasses.asdict(self)


# The paper's method without anything beyond it.
PAPER_CONFIG = TrackerConfig(
    loop=LoopConfig(mode="single", fine_stage=False, augment=False),
    multi_start=MultiStartConfig(enabled=False),
    motion=MotionConfig(enabled=False),
    contour=ContourConfig(enabled=False),
    calibration=CalibrationConfig(enabled=False),
    recovery=RecoveryConfig(enabled=False),
)
