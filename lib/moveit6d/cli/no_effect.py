"""Says which of a track's settings change nothing, by its meshes and its network.

Never decides anything.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .messages import note

if TYPE_CHECKING:
    from ..config import TrackerConfig
    from ..geometry.mesh import Mesh
    from ..policies import Policy


def note_without_effect(
    args: argparse.Namespace, meshes: Sequence[Mesh], config: TrackerConfig, policy: Policy
) -> None:
    """A note for each setting that was asked for and changes nothing here."""
    from ..estimation.detection import can_search

    plain = any(not mesh.has_colours for mesh in meshes)
    whose = "the mesh has" if len(meshes) == 1 else "the meshes have"
    if args.texture_from_start and not plain:
        note(f"--texture_from_start changes nothing: {whose} colours.")
    if config.keyframes.enabled and not plain:
        note(f"--keyframes.enabled true changes nothing: {whose} colours.")
    elif config.keyframes.enabled and args.texture_from_start:
        note("--keyframes.enabled true changes nothing once --texture_from_start has painted.")
    if config.recovery.max_milliseconds is not None and not can_search(policy, config):
        why = "with these weights or this --mode a lost object cannot be looked for."
        if not config.recovery.enabled:
            why = "with --no_recovery a lost object is not looked for."
        note(f"--max_milliseconds changes nothing: {why}")
