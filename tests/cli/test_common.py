"""Options that several commands share."""

import argparse

import pytest

from moveit6d.cli.common import Setting, add_tracking_options, set_up, tools
from moveit6d.policies import NetworkPolicy


@pytest.mark.parametrize("elsewhere", [False, True])
def test_float32_reaches_the_network_here_and_in_other_processes(
    elsewhere: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("moveit6d.networks.inference.is_bfloat16_fast", lambda: True)
    parser = argparse.ArgumentParser()
    add_tracking_options(parser)
    for options, asked in (([], True), (["--float32"], False)):
        args = parser.parse_args(options)
        policy, _ = tools(Setting.of(args)) if elsewhere else set_up(args)
        assert isinstance(policy, NetworkPolicy)
        assert policy.network.is_bfloat16 is asked
