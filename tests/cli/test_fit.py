"""`moveit6d fit` hands its arguments to the trainer's command line."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from moveit6d.cli import fit
from moveit6d.cli.main import main


@pytest.mark.parametrize(
    ("given", "forwarded"),
    [
        (["--config", "a.yaml", "--trainer.max_steps", "3"],) * 2,
        (["--all_options"], ["--help"]),
    ],
)
def test_fit_forwards_its_arguments(
    given: list[str], forwarded: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[list[str]] = []
    stub = SimpleNamespace(main=seen.append)  # the real one takes long to import
    monkeypatch.setitem(sys.modules, "lightning_modules", SimpleNamespace(cli=stub))
    monkeypatch.setitem(sys.modules, "lightning_modules.cli", stub)
    assert main(["fit", *given]) == 0
    assert main(["-q", "fit", *given]) == 0
    assert seen == [forwarded, forwarded]
    assert fit.forward([]) == 0
