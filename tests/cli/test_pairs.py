"""`moveit6d contact-sheet` and `moveit6d write-pairs`."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.cli.main import main
from moveit6d.synthesis.training.shards import open_shards, read_shard
from tests.support.pairs import CONFIGS, photos

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture
def small(tmp_path: Path) -> list[str]:
    """Options for one made object and one picture."""
    folder = tmp_path / "photos"
    folder.mkdir()
    Image.fromarray(photos()[0]).save(folder / "0.png")
    return ["--set", f"data.photos={folder}", "--set", "data.shapes=1"]


def test_a_contact_sheet_without_a_configuration(tmp_path: Path, small: list[str]) -> None:
    path = tmp_path / "sheet.png"
    assert main(["contact-sheet", *small, "--count", "2", "--output", str(path)]) == 0
    sheet = np.asarray(Image.open(path))
    assert sheet.shape == (140, 2 * 524, 3) and sheet[6:134, 6:134].std() > 5


def test_pairs_are_written_in_parts_and_kept(
    tmp_path: Path, small: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "pairs"
    command = [
        "write-pairs",
        "--config",
        str(CONFIGS / "fit" / "multi_object.yaml"),
        *small,
        "--set",
        "data.batch_size=2",
        "--set",
        "data.pairs.bank.new_per_batch=1",
        "--output",
        str(folder),
        "--shards",
        "3",
        "--batches",
        "1",
    ]
    assert main([*command, "--part", "1/2"]) == 0
    assert "2 shards written, 0 kept" in capsys.readouterr().out
    assert main(command) == 0
    assert "1 shards written, 2 kept" in capsys.readouterr().out
    plan, paths = open_shards(folder)
    assert plan.batch_size == 2 and len(paths) == 3
    assert all(len(list(read_shard(path, 2))) == 1 for path in paths)


@pytest.mark.parametrize("part", ["0/2", "3/2", "1", "a/b"])
def test_parts_that_are_none_are_refused(part: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["write-pairs", "--output", "x", "--shards", "2", "--part", part])
    assert "must be I/N" in capsys.readouterr().err
