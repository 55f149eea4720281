"""What tests of training share: a small source of pairs, and pairs of it on disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.synthesis.training.shards import ShardPlan
from moveit6d.synthesis.training.source import PairSource
from tests.support.pairs import small_source, write_every_shard


@pytest.fixture(scope="session")
def source(tmp_path_factory: pytest.TempPathFactory) -> PairSource:
    """Three pictures and one procedural shape."""
    return small_source(tmp_path_factory.mktemp("photos"))


@pytest.fixture(scope="session")
def written(source: PairSource, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four shards of two batches of two pairs."""
    plan = ShardPlan(4, batches=2, batch_size=2)
    return write_every_shard(source, plan, tmp_path_factory.mktemp("pairs"))
