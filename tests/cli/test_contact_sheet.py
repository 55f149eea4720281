"""`moveit6d contact-sheet` and `moveit6d write-pairs`."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.cli.main import main

pytestmark = pytest.mark.filterwarnings("ignore")


def test_a_contact_sheet_without_a_configuration(tmp_path: Path, small: list[str]) -> None:
    path = tmp_path / "sheet.png"
    assert main(["contact-sheet", *small, "--count", "2", "--output", str(path)]) == 0
    sheet = np.asarray(Image.open(path))
    assert sheet.shape == (140, 2 * 524, 3) and sheet[6:134, 6:134].std() > 5
