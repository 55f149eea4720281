"""`moveit6d doctor` says what works, and its exit code what does not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from moveit6d import policies
from moveit6d.cli.main import main
from moveit6d.errors import RenderingUnavailable
from moveit6d.rendering import backends


@pytest.fixture(autouse=True)
def weights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights that load."""

    class Loaded:
        source = "a model (sha256 0123)"

    monkeypatch.setattr(policies, "load_policy", lambda path=None: Loaded())


def without(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which one renderer does not run."""
    make: Callable[[str], Any] = backends.make_renderer

    def refuse(asked: str = "embree") -> Any:
        if asked == name:
            raise RenderingUnavailable(f"install lib{name}.")
        return make("embree")

    monkeypatch.setattr(backends, "make_renderer", refuse)


def test_a_machine_without_opengl_is_healthy(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    without("pyrender", monkeypatch)
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert "pyrender   does not run here: install libpyrender." in text
    assert "embree     works" in text and "sha256 0123" in text and "mp4" in text
    assert "torch" in text and "cores" in text and "network    " in text


@pytest.mark.parametrize("option", [["--output", "a.png"], ["--mesh_unit", "mm"]])
def test_options_of_a_mesh_need_one(option: list[str], capsys: Any) -> None:
    assert main(["doctor", *option]) == 2
    assert f"{option[0]} needs --mesh" in capsys.readouterr().err


def test_without_the_default_renderer_nothing_goes(
    monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    without("embree", monkeypatch)
    assert main(["doctor"]) == 3
    assert "install libembree." in capsys.readouterr().out


def test_missing_weights_are_said(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    without("pyrender", monkeypatch)
    monkeypatch.undo()
    monkeypatch.setattr(policies, "SHIPPED_WEIGHTS", Path("nowhere.safetensors"))
    without("pyrender", monkeypatch)
    assert main(["doctor"]) == 2
    assert "nowhere.safetensors does not exist" in capsys.readouterr().out
