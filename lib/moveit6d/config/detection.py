"""Settings of the search of a whole image for an object.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from ..errors import InputError
from .loop import LoopConfig
from .ranges import check_range


@dataclass(frozen=True)
class TemplateConfig:
    """What a mesh is prepared for.

    Args:
        rotations: sides from which the object is described, spread evenly over all rotations.
        width: width of the object's bounding sphere in these templates, pixels, a multiple of 8.
        coarse_rotations: sides of the smaller set that finds places in the image.
        coarse_width: width of the sphere in that set, which is matched with the whole image.
        channels: numbers of a descriptor, which is projected to the axes that tell the object's
            cells apart best.
        colour: weight of three channels of coarse colour beside the smaller set's descriptors.
        distance: distance from which templates are rendered, in diameters of the sphere: far enough
            to be nearly without perspective.
    """

    rotations: int = 600
    width: int = 120
    coarse_rotations: int = 150
    coarse_width: int = 64
    channels: int = 32
    colour: float = 0.22
    distance: float = 5.0

    def __post_init__(self) -> None:
        if min(self.rotations, self.coarse_rotations, self.channels) < 1:
            raise InputError(
                "TemplateConfig: rotations, coarse_rotations and channels must be 1 or more."
            )
        for width in (self.width, self.coarse_width):
            if width < 8 or width % 8:
                raise InputError(
                    f"TemplateConfig: widths must be multiples of 8 pixels, found {width}."
                )
        if not self.distance >= 1:
            raise InputError(
                f"TemplateConfig: distance must be 1 diameter or more, found {self.distance}."
            )


@dataclass(frozen=True)
class MatchConfig:
    """How an image is searched.

    Args:
        widths: smallest and largest width of the object's bounding sphere that is looked for, in
            shares of the image's shorter side.
        step: ratio of one width to the next.
        places: how many places are looked into, thinned so that no two of them are the same.
        more_places: how many more, in single images, where no pose at the first ones is accepted:
            those where a half of the object stands out, as the other half may be hidden.
        views: rotations that are kept of each place at most.
        visible: share of the object over which a view is compared with the image, where it agrees
            best; the rest may be hidden.
        neighbourhood: cells a side of the neighbourhoods that agree or are hidden together, odd.
        samples: random positions in each level of the image from which the usual score of a coarse
            template, its mean and spread, is measured.
        background: random patches of the image from which that of the other templates is measured.
        reach: cells around a place in which each template looks for its own best position.
        same_place: peaks nearer than this, in widths of the object, are one place if their widths
            are also the same.
        same_width: largest ratio of two widths that count as the same.
        min_spread: smallest spread of a template's score, in means of all templates' spreads: one
            that scores nearly the same everywhere must not stand out by its small spread.
        shortlist: how many times as many peaks of a level as `places`, and views of a place as
            `views`, are looked at before they are thinned and scored again.
    """

    widths: tuple[float, float] = (0.1, 0.75)
    step: float = 1.22
    places: int = 20
    more_places: int = 40
    views: int = 5
    visible: float = 0.4
    neighbourhood: int = 5
    samples: int = 100
    background: int = 16
    reach: int = 1
    same_place: float = 0.35
    same_width: float = 1.43
    min_spread: float = 0.2
    shortlist: int = 24

    def __post_init__(self) -> None:
        low, high = self.widths
        if not 0 < low <= high or self.step <= 1:
            raise InputError(
                "MatchConfig: widths must be two positive shares, the smaller first, and step must "
                f"be above 1, found {self.widths} and {self.step}."
            )
        if min(self.places, self.views) < 1:
            raise InputError("MatchConfig: places and views must be 1 or more.")
        if self.more_places < 0:
            raise InputError(
                f"MatchConfig: more_places must be 0 or more, found {self.more_places}."
            )
        if self.neighbourhood < 1 or self.neighbourhood % 2 == 0:
            raise InputError(
                "MatchConfig: neighbourhood must be an odd number of cells, found "
                f"{self.neighbourhood}."
            )
        if min(self.samples, self.background) < 2 or self.reach < 0 or self.same_width < 1:
            raise InputError(
                "MatchConfig: samples and background must be 2 or more, reach 0 or more and "
                f"same_width 1 or more, found {self.samples}, {self.background}, {self.reach} and "
                f"{self.same_width}."
            )
        if self.min_spread < 0 or self.shortlist < 1 or not 0 < self.visible <= 1:
            raise InputError(
                "MatchConfig: min_spread must be 0 or more, shortlist 1 or more, visible above 0 "
                f"and 1 at most, found {self.min_spread}, {self.shortlist} and {self.visible}."
            )


@dataclass(frozen=True)
class RegionConfig:
    """How closely candidates must agree with what is known of where the object is.

    Args:
        near_shift: largest distance in the image from a pose that is roughly right, in widths of
            the object.
        near_ratio: largest ratio of its width there to a candidate's, either way.
        box_overlap: intersection over union from which a candidate's box agrees with the given one.
        part_covered: where the given box shows a part of a covered object: share of it that a
            candidate's box must hold.
        part_overlap: where it does: intersection over union that is enough.
        box_ratio: smallest and largest width of the object's bounding sphere that is tried, in
            longer sides of the box.
        longest_ratio: by which a box or mask may be longer still, before a distance contradicts it.
        distance_ratio: by which the distance of a pose may be off what is given, beside the
            object's radius: what people measure is rough.
        least_covered: share of the box or mask, which may be larger than the object, that a pose
            must cover.
        margin: margin around the box within which the image is searched, in widths of the object.
        background_scale: where only a part of the image is searched, a template's usual score is
            measured in the whole image, scaled by this factor at most.
        stages: stages of the tournament (`DetectorConfig.stages`) where a box or a mask is given:
            what the search of the whole image would cost is spent on the candidates.
    """

    near_shift: float = 0.75
    near_ratio: float = 1.5
    box_overlap: float = 0.5
    part_covered: float = 0.9
    part_overlap: float = 0.3
    box_ratio: tuple[float, float] = (0.85, 2.5)
    longest_ratio: float = 1.5
    distance_ratio: float = 1.1
    least_covered: float = 0.3
    margin: float = 0.6
    background_scale: float = 0.6
    stages: tuple[tuple[int, int], ...] = ((48, 2), (16, 3), (6, 6))

    def __post_init__(self) -> None:
        low, high = self.box_ratio
        if not 0 < low <= 1 <= high or not self.near_ratio >= 1:
            raise InputError(
                "RegionConfig: box_ratio must be two positive numbers around 1 and near_ratio 1 or "
                f"more, found {self.box_ratio} and {self.near_ratio}."
            )
        if not (self.near_shift > 0 and self.margin >= 0 and self.background_scale > 0):
            raise InputError(
                "RegionConfig: near_shift and background_scale must be positive and margin 0 or "
                f"more, found {self.near_shift}, {self.background_scale} and {self.margin}."
            )
        check_range(self, "1 or more", "longest_ratio", "distance_ratio")
        check_range(self, "from 0 to 1", "least_covered")
        check_stages("RegionConfig", self.stages)


@dataclass(frozen=True)
class VerificationConfig:
    """The probability that a pose is right, by logistic regression on what is seen there.

    Fitted on candidates of searches in synthetic pictures (motion blur, occlusion, clutter,
    tabletops, other objects' pictures) of eight training meshes that were held out; there the
    contour's agreement, the correlation of grey values and the length of the next update added
    nothing to these two.

    Args:
        confidence: weight of the log odds of the network's confidence for searches at the end of
            the refinement.
        similarity: weight of the mean cosine of descriptors, image against rendering.
        intercept: intercept of the regression.
        present: log odds more where the object is known to be in the image, as the targets of a
            data set are; the other weights count with objects that are not there.
    """

    confidence: float = 1.07
    similarity: float = 3.91
    intercept: float = -3.39
    present: float = 1.0


@dataclass(frozen=True)
class DetectorConfig:
    """How an object is looked for in an image by templates.

    Args:
        templates: what a mesh is prepared for.
        match: how an image is searched.
        region: how closely candidates must agree with what is known of where the object is.
        verification: how likely a refined pose is right.
        stages: stages of the tournament: how many candidates are refined in each, and by how many
            iterations. Where none is accepted, single images go on with as many candidates of
            `more_places`.
        half_turns: so many of the best candidates start turned by half about the axes of the
            object's box, too, in the last stage; 0 none.
        accepted: probability from which the object counts as found.
        same_instance: poses nearer than this in the image, in widths of the object, are one
            instance.
        least_distance: diameters between the centres of two solid instances, at least: those of
            coasters in a stack are farther apart.
    """

    templates: TemplateConfig = field(default_factory=TemplateConfig)
    match: MatchConfig = field(default_factory=MatchConfig)
    region: RegionConfig = field(default_factory=RegionConfig)
    verification: VerificationConfig = field(default_factory=VerificationConfig)
    stages: tuple[tuple[int, int], ...] = ((40, 1), (20, 1), (10, 3), (4, 6))
    half_turns: int = 1
    accepted: float = 0.3
    same_instance: float = 0.4
    least_distance: float = 0.03

    def __post_init__(self) -> None:
        check_stages("DetectorConfig", self.stages)
        if not (0 <= self.accepted <= 1 and min(self.half_turns, self.same_instance) >= 0):
            raise InputError(
                "DetectorConfig: accepted must be a probability, half_turns and same_instance 0 or "
                f"more, found {self.accepted}, {self.half_turns} and {self.same_instance}."
            )
        check_range(self, "0 or more", "least_distance")


def check_stages(owner: str, stages: tuple[tuple[int, int], ...]) -> None:
    """Refuse a tournament that cannot be held."""
    if not stages or any(len(stage) != 2 or min(stage) < 1 for stage in stages):
        raise InputError(
            f"{owner}: stages must be one or more pairs, how many candidates and how many "
            f"iterations, each 1 or more, found {stages}."
        )


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
        seed: seed of the random orientations.
        criterion: chooses the candidate: the policy's confidence, or as in the paper the fewest
            iterations to stop, among equals the shortest path.
        spacing: distance between seeds, in widths of the object as it is seeded.
        max_seeds: seeds in a row or column of the image at most: in a large image they are farther
            apart.
        smoothing: standard deviation of the Gaussian that smooths the field, in widths of the
            object as it is seeded. On eight rendered objects in front of photos the object was
            among the three strongest sinks six times with 0.25 and four times with 0.4 and 0.6.
        extent: width of the part of a sink above half its peak, in widths of the object. It was 0.8
            for objects seeded at 0.7 of their width, 1.2 at 1.2 and 1.6 at 1.7: it says less of the
            object than of the seeds, so that several sizes must be tried.
        extent_ratio: smallest and largest width that an extent may stand for, in seeded widths;
            farther off the network sees too little for the extent to mean anything.
        same_place: sinks nearer than this, in widths of the object, are one place.
        loop: the refinement loop of each candidate; with criterion iterations `max_iterations` None
            means the paper's 30, so that loops end by themselves.
    """

    sizes: tuple[float, ...] = (0.13, 0.2, 0.3)
    poses: int = 4
    sinks: int = 3
    rotations: int = 60
    seed: int = 0
    criterion: Literal["confidence", "iterations"] = "confidence"
    spacing: float = 0.4
    max_seeds: int = 40
    smoothing: float = 0.25
    extent: float = 1.1
    extent_ratio: tuple[float, float] = (0.6, 1.6)
    same_place: float = 0.5
    loop: LoopConfig = field(default_factory=LoopConfig)

    def __post_init__(self) -> None:
        if not self.sizes or min(self.sizes) <= 0:
            raise InputError(
                f"SeedDetectorConfig: sizes must be positive shares, found {self.sizes}."
            )
        if min(self.poses, self.sinks, self.rotations) < 1:
            raise InputError("SeedDetectorConfig: poses, sinks and rotations must be 1 or more.")
        if not min(self.spacing, self.extent) > 0 or self.smoothing < 0 or self.max_seeds < 3:
            raise InputError(
                "SeedDetectorConfig: spacing and extent must be positive, smoothing 0 or more and "
                f"max_seeds 3 or more, found {self.spacing}, {self.extent}, {self.smoothing} and "
                f"{self.max_seeds}."
            )
        if self.criterion not in list(SelectionCriterion):
            raise InputError(
                f"SeedDetectorConfig: there is no criterion {self.criterion!r}; choose one of "
                f"{', '.join(SelectionCriterion)}."
            )
