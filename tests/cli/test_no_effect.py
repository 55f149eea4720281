"""Settings that change nothing are named."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import Any

from moveit6d import Mesh, OraclePolicy, Pose, TrackerConfig
from moveit6d.cli.no_effect import note_without_effect
from tests.support.clip import Clip


def test_what_changes_nothing_is_said(scene: Any, capsys: Any) -> None:
    plain = Mesh.from_arrays("plain", scene.mesh.vertices, scene.mesh.faces)
    policy, base = OraclePolicy(Pose.stack([scene.pose(0)])), TrackerConfig()
    keyframes = replace(base, keyframes=replace(base.keyframes, enabled=True))
    limited = replace(base, recovery=replace(base.recovery, max_milliseconds=50.0))
    off = replace(base, recovery=replace(limited.recovery, enabled=False))

    def said(mesh: Mesh, config: TrackerConfig, paint: bool) -> str:
        note_without_effect(Namespace(texture_from_start=paint), [mesh], config, policy)
        return str(capsys.readouterr().err)

    assert said(scene.mesh, base, False) == said(plain, base, True) == ""
    assert said(plain, keyframes, False) == ""
    assert "--texture_from_start changes nothing: the mesh has colours" in said(
        scene.mesh, base, True
    )
    assert "--keyframes.enabled true changes nothing: the" in said(scene.mesh, keyframes, False)
    assert "changes nothing once --texture_from_start" in said(plain, keyframes, True)
    assert "--max_milliseconds changes nothing: with these weights" in said(plain, limited, False)
    assert "--max_milliseconds changes nothing: with --no_recovery" in said(plain, off, False)


def test_a_track_says_it(clip: Clip, capsys: Any) -> None:
    assert clip.track("--no_overlay", "--no_recovery", "--max_milliseconds", "50") == 0
    assert "--max_milliseconds changes nothing: with --no_recovery" in capsys.readouterr().err
