"""How likely the pose found in a single image is right: both confidences of the network together.

Never changes a pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..config import ActionMode, LoopConfig, SingleImageConfig, TrackerConfig
from ..policies import NetworkPolicy, Policy, mode_of
from ..rendering.renderer import Renderer
from .refine import once_more
from .results import Refined, Start
from .states import from_log_odds, log_odds


def with_both_confidences(
    starts: Sequence[Start],
    results: Sequence[Refined],
    *,
    policy: Policy,
    renderer: Renderer,
    config: TrackerConfig,
) -> list[Refined]:
    """Results whose confidence is the probability by both confidences (`SingleImageConfig`).

    A network with a confidence for searches is asked once more, at the pose that was found: what
    chose between starts by the first one thinks too well of it. Others' results stay as they are.
    """
    found = list(results)
    if mode_of(policy, config.loop.mode) is not ActionMode.ALL_AXES:
        return found
    asked = search_confidences(starts, results, policy=policy, renderer=renderer, loop=config.loop)
    for i, said in asked.items():
        found[i] = replace(
            results[i],
            confidence=probability(config.single_image, results[i].confidence, said.confidence),
            milliseconds=results[i].milliseconds + said.milliseconds,
        )
    return found


def search_confidences(
    starts: Sequence[Start],
    results: Sequence[Refined],
    *,
    policy: Policy,
    renderer: Renderer,
    loop: LoopConfig,
) -> dict[int, Refined]:
    """One more iteration, with the confidence for searches; by index of those that have a pose.

    Empty for a policy that has none.
    """
    if not isinstance(policy, NetworkPolicy) or policy.for_search is policy:
        return {}
    return once_more(starts, results, policy=policy.for_search, renderer=renderer, loop=loop)


def probability(config: SingleImageConfig, confidence: float, search_confidence: float) -> float:
    """That a pose is right, by both confidences, in [0, 1]."""
    return from_log_odds(
        config.intercept
        + config.confidence * log_odds(confidence)
        + config.search_confidence * log_odds(search_confidence)
    )
