"""The regression finds the weights that made the data."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    path = Path(__file__).parents[2] / "tools" / "fit_probabilities.py"
    spec = importlib.util.spec_from_file_location("fit_probabilities", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules["fit_probabilities"] = module
    spec.loader.exec_module(module)
    return module


def test_the_weights_come_back(tool: Any) -> None:
    random = np.random.default_rng(0)
    values = random.random((20000, 2))
    true = np.array([9.0, 4.0, -7.0])
    right = random.random(len(values)) < tool.probability(true, values)
    np.testing.assert_allclose(tool.fit(values, right), true, atol=0.4)


def test_borderline_poses_teach_nothing(tool: Any, brick: Any, capsys: Any) -> None:
    errors = (0.05, 0.12, 0.2, float("inf"))
    found = [one.right for error in errors for one in tool.example((0.5, 0.5), error, brick)]
    assert found == [True, False, False]
    examples = [tool.Example((a, a), a > 0.5, name) for name in "xy" for a in np.linspace(0, 1, 40)]
    tool.report("VerificationConfig", ("confidence", "similarity"), examples)
    assert "VerificationConfig: confidence" in capsys.readouterr().out
