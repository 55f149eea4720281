"""Settings of the search of a whole image for an object.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from ..errors import InputError
from .loop import LoopConfig


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
        candidates: poses that are refined. Where none is accepted, single images go on with as many
            more.
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
class VerificationConfig:
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
    """How an object is looked for in an image by templates.

    Args:
        templates: what a mesh is prepared for.
        match: how an image is searched.
        verification: how likely a refined pose is right.
        stages: of the tournament: how many candidates are refined, and by how many iterations.
        accepted: probability from which the object counts as found.
    """

    templates: TemplateConfig = field(default_factory=TemplateConfig)
    match: MatchConfig = field(default_factory=MatchConfig)
    verification: VerificationConfig = field(default_factory=VerificationConfig)
    stages: tuple[tuple[int, int], ...] = ((48, 1), (12, 2), (4, 6))
    accepted: float = 0.5


class SelectionCriterion(StrEnum):
    """How the best of a detector's candidates is chosen."""

    ITERATIONS = "iterations"  # the paper: the fewest iterations; among equals the shortest path
    CONFIDENCE = "confidence"  # the policy's confidence in the last pose


@dataclass(frozen=True)
class SeedDetectorConfig:
    """How an object is looked for in an image in the paper's way, by seeds.

    Args:
        sizes: widths of the object that are tried, in shares of the image's shorter side; the
            extent of the field's sink then says more.
        poses: random orientations that the seeds show. The paper has one; the mean of several is
            much steadier.
        sinks: how many of the strongest sinks of all sizes are refined. The paper has one.
        rotations: size of the coarse grid over all rotations, at every sink.
        seed: of the random orientations.
        criterion: chooses the candidate: the policy's confidence, or as in the paper the fewest
            iterations to stop, among equals the shortest path.
        loop: the refinement loop of each candidate; with criterion iterations `max_iterations` None
            means the paper's 30, so that loops end by themselves.
    """

    sizes: tuple[float, ...] = (0.13, 0.2, 0.3)
    poses: int = 4
    sinks: int = 3
    rotations: int = 60
    seed: int = 0
    criterion: Literal["confidence", "iterations"] = "confidence"
    loop: LoopConfig = field(default_factory=LoopConfig)

    def __post_init__(self) -> None:
        if not self.sizes or min(self.sizes) <= 0:
            raise InputError(
                f"SeedDetectorConfig: sizes must be positive shares, found {self.sizes}."
            )
        if min(self.poses, self.sinks, self.rotations) < 1:
            raise InputError("SeedDetectorConfig: poses, sinks and rotations must be 1 or more.")
        if self.criterion not in list(SelectionCriterion):
            raise InputError(
                f"SeedDetectorConfig: there is no criterion {self.criterion!r}; choose one of "
                f"{', '.join(SelectionCriterion)}."
            )
