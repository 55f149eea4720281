"""The kinds of networks that a weights file may hold.

Never builds one; `weights_file` does.
"""

from __future__ import annotations

from typing import Any, TypeAlias

from .action_net import ActionConfig, ActionNet
from .compact import CompactConfig, CompactCorrelationNet
from .correlation import CorrelationConfig, CorrelationNet

MatchingNet: TypeAlias = CorrelationNet | CompactCorrelationNet
PoseNet: TypeAlias = MatchingNet | ActionNet

# Name in a weights file's header → network and configuration.
KINDS: dict[str, tuple[type[Any], type[Any]]] = {
    "correlation": (CorrelationNet, CorrelationConfig),
    "compact": (CompactCorrelationNet, CompactConfig),
    "action": (ActionNet, ActionConfig),
}
