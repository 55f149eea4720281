"""`moveit6d contact-sheet` and `moveit6d write-pairs`."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.cli.main import main
from moveit6d.synthesis.training.contact_sheet import contact_sheet
from moveit6d.synthesis.training.shards import ShardPlan, read_shard
from tests.support.pairs import CONFIGS, small_source, write_every_shard

pytestmark = pytest.mark.filterwarnings("ignore")


def test_a_contact_sheet_without_a_configuration(tmp_path: Path, small: list[str]) -> None:
    path = tmp_path / "sheet.png"
    assert main(["contact-sheet", *small, "--count", "2", "--output", str(path)]) == 0
    sheet = np.asarray(Image.open(path))
    assert sheet.shape == (140, 2 * 524, 3) and sheet[6:134, 6:134].std() > 5


def test_pairs_are_looked_at_without_the_weights_of_the_fit(
    tmp_path: Path, small: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)  # where the teacher of compact.yaml is not
    config = str(CONFIGS / "fit" / "compact.yaml")
    command = ["contact-sheet", "--config", config, *small, "--count", "1", "--output", "one.png"]
    assert main(command) == 0
    assert (elsewhere / "one.png").is_file()


def test_written_pairs_are_looked_at_as_they_were_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("photos", "pairs"):
        (tmp_path / name).mkdir()
    plan = ShardPlan(1, batches=2, batch_size=1)
    pairs = write_every_shard(small_source(tmp_path / "photos"), plan, tmp_path / "pairs")
    path = tmp_path / "sheet.png"
    command = ["contact-sheet", "--set", f"data.written={pairs}", "--output", str(path)]
    assert main([*command, "--count", "2"]) == 0
    (shard,) = pairs.glob("*.safetensors")
    expected = contact_sheet(next(read_shard(shard, 2)))
    assert np.array_equal(np.asarray(Image.open(path)), expected)
    assert main([*command, "--count", "3"]) == 2
    assert "--count is 3, and a shard" in capsys.readouterr().err
    assert main([*command, "--count", "2", "--cluster", "near"]) == 2
    assert "--cluster is for pairs that are drawn" in capsys.readouterr().err
    assert main([*command[:-1], str(pairs / "pairs.json"), "--count", "2"]) == 2


@pytest.mark.parametrize("seed", ["-1", "a", "²"])
@pytest.mark.parametrize(
    "command",
    [
        "contact-sheet --output x",
        "synthesize --output x",
        "demo",
        "benchmark refinement --objects x --photos x",
        "benchmark motion",
    ],
)
def test_a_seed_that_is_none_is_refused(
    command: str, seed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main([*command.split(), "--seed", seed])
    assert end.value.code == 2
    assert "must be a whole number, 0 or above" in capsys.readouterr().err
