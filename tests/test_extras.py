"""What is missing is named, with the command that installs it."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest

from moveit6d.errors import InputError
from moveit6d.extras import EXTRAS, require

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
PACKAGES = {"pytorch_lightning": "pytorch-lightning", "rerun": "rerun-sdk"}


@pytest.mark.parametrize("extra", sorted(EXTRAS))
def test_a_missing_package_is_named(extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in EXTRAS[extra]:
        monkeypatch.setitem(sys.modules, name, None)
    message = rf"--this needs {' and '.join(EXTRAS[extra])}: pip install 'moveit6d\[{extra}\]'"
    with pytest.raises(InputError, match=message):
        require(extra, "--this")


def test_what_is_there_is_no_error() -> None:
    require("report", "--report")


@pytest.mark.parametrize("extra", sorted(EXTRAS))
def test_extras_are_those_of_the_project(extra: str) -> None:
    wanted = " ".join(PROJECT["optional-dependencies"][extra])
    assert all(PACKAGES.get(name, name) in wanted for name in EXTRAS[extra])
    everything = PROJECT["optional-dependencies"]["all"][0]
    assert extra in everything
