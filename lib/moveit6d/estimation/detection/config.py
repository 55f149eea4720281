"""Every setting of a detection.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ...errors import InputError


@dataclass(frozen=True)
class TemplateConfig:
    """What a mesh is prepared for.

    Args:
        rotations: sides from which it is described, spread evenly over all rotations.
        coarse_rotations: of the fewer ones that look for places.
        channels: of a descriptor, projected to the axes that tell the object's cells apart best.
        colour: weight of three channels of coarse colour beside them.
    """

    rotations: int = 600
    coarse_rotations: int = 150
    channels: int = 32
    colour: float = 0.22

    def __post_init__(self) -> None:
        if min(self.rotations, self.coarse_rotations, self.channels) < 1:
            raise InputError("TemplateConfig: every number must be 1 or more.")


@dataclass(frozen=True)
class MatchConfig:
    """How an image is searched.

    Args:
        widths: smallest and largest width of the object's bounding sphere that is looked for, in
            shares of the image's shorter side.
        step: ratio of one width to the next.
        local_mean: cells a side over which the image's descriptors are centred.
        places: how many places are looked into, thinned so that no two of them are the same.
        views: rotations that are kept of each place at most.
        candidates: poses that are refined; as many more are, if none of these is accepted.
        tolerance_weight: of the score in which each cell may lie one cell beside where it should,
            against the score in units of a template's spread over the image.
    """

    widths: tuple[float, float] = (0.1, 0.75)
    step: float = 1.22
    local_mean: int = 13
    places: int = 20
    views: int = 12
    candidates: int = 48
    tolerance_weight: float = 12.0

    def __post_init__(self) -> None:
        low, high = self.widths
        if not 0 < low <= high or self.step <= 1:
            raise InputError(
                "MatchConfig: widths must be two positive shares, the smaller first, and step must "
                f"be above 1, found {self.widths} and {self.step}."
            )
        if min(self.places, self.views, self.candidates, self.local_mean) < 1:
            raise InputError("MatchConfig: every number must be 1 or more.")


@dataclass(frozen=True)
class JudgeConfig:
    """The probability that a pose is right, by logistic regression on what is seen there.

    Fitted on candidates of searches in made pictures (motion blur, occlusion, clutter, tabletops,
    other objects' pictures) of eight training meshes that were held out; there the contour's
    agreement, the correlation of grey values and the length of the next update added nothing to
    these two.

    Args:
        confidence: weight of the network's confidence at the end of the refinement.
        similarity: weight of the mean cosine of descriptors, image against rendering.
        intercept: of the regression.
    """

    confidence: float = 11.0
    similarity: float = 8.5
    intercept: float = -15.8


@dataclass(frozen=True)
class DetectorConfig:
    """Every setting of a `PoseDetector`.

    Args:
        templates: what a mesh is prepared for.
        match: how an image is searched.
        judge: how poses are judged.
        stages: of the tournament: how many candidates are refined, and by how many iterations.
        accepted: probability from which the object counts as found.
    """

    templates: TemplateConfig = field(default_factory=TemplateConfig)
    match: MatchConfig = field(default_factory=MatchConfig)
    judge: JudgeConfig = field(default_factory=JudgeConfig)
    stages: tuple[tuple[int, int], ...] = ((48, 1), (12, 2), (4, 6))
    accepted: float = 0.5
