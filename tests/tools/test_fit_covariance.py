"""The table beside covariances, and the factor that it proposes."""

from pathlib import Path

import numpy as np
import pytest

from moveit6d.config import LoopConfig
from moveit6d.errors import InputError
from tools import fit_covariance
from tools.fit_covariance import BINS, report


def test_errors_twice_as_large_as_said_ask_for_twice_the_factor() -> None:
    random = np.random.default_rng(0)
    said = np.exp(random.uniform(-3, 3, 8000))
    found = np.column_stack([said, 2 * said * random.normal(size=len(said))])
    lines = report(found).splitlines()
    fitted = float(lines[-1].split(", ")[1].split()[0])
    assert abs(fitted / (2 * LoopConfig().displacement_error) - 1) < 0.03
    rows = [line for line in lines if " to " in line]
    assert len(rows) == BINS
    within = [int(row.split("|")[4].split()[0]) for row in rows]
    assert all(33 < share < 44 for share in within)  # 38 % of normal errors are below half of σ


def test_sequences_of_no_use_are_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fit_covariance, "open_dataset", lambda *_: [])
    with pytest.raises(InputError, match="There are no examples"):
        fit_covariance.main([str(tmp_path)])
