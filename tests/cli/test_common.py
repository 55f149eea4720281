"""Options that several commands share."""

import argparse
from pathlib import Path

import pytest

from moveit6d.cli.common import (
    CLUSTERS,
    Setting,
    add_tracking_options,
    make_tools,
    new_folder,
    tools,
)
from moveit6d.errors import InputError
from moveit6d.io import check_writable
from moveit6d.policies import NetworkPolicy
from moveit6d.synthesis.training import clusters


def test_what_is_named_twice_is_the_same() -> None:
    assert CLUSTERS == clusters.CLUSTERS, "named again, because importing them takes long"


@pytest.mark.parametrize("elsewhere", [False, True])
def test_float32_reaches_the_network_here_and_in_other_processes(
    elsewhere: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("moveit6d.networks.inference.is_bfloat16_fast", lambda: True)
    parser = argparse.ArgumentParser()
    add_tracking_options(parser)
    for options, asked in (([], True), (["--float32"], False)):
        args = parser.parse_args(options)
        policy, _ = tools(Setting.of(args)) if elsewhere else make_tools(Setting.of(args))
        assert isinstance(policy, NetworkPolicy)
        assert policy.network.is_bfloat16 is asked


def test_a_folder_for_results_may_hold_anything(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    assert new_folder(tmp_path) == tmp_path
    assert [one.name for one in tmp_path.iterdir()] == ["results"]
    with pytest.raises(InputError) as error:
        check_writable(tmp_path / "results")
    assert str(error.value) == (
        f"{tmp_path / 'results'} is a folder; a file of that name was to be written."
    )
