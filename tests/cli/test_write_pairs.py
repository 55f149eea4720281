"""`moveit6d write-pairs`: parts that are kept, and parts that are none."""

from pathlib import Path

import pytest

from moveit6d.cli.main import main
from moveit6d.synthesis.training.shards import open_shards, read_shard
from tests.support.pairs import CONFIGS

pytestmark = pytest.mark.filterwarnings("ignore")


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


def test_a_seed_that_is_none_is_refused_before_the_folder_is_claimed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "pairs"
    with pytest.raises(SystemExit) as end:
        main(["write-pairs", "--output", str(folder), "--shards", "2", "--seed", "-1"])
    assert end.value.code == 2 and not folder.exists()
    assert "must be a whole number, 0 or above" in capsys.readouterr().err


def test_templates_are_refused_unless_they_are_switched_off(
    tmp_path: Path, small: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["write-pairs", "--config", str(CONFIGS / "fit" / "compact.yaml"), *small]
    command += ["--set", "data.batch_size=2", "--output", str(tmp_path / "pairs")]
    command += ["--shards", "1", "--batches", "1"]
    assert main(command) == 2
    assert "set data.pairs.views.share to 0" in capsys.readouterr().err
    assert main([*command, "--set", "data.pairs.views.share=0"]) == 0
    assert "1 shards written" in capsys.readouterr().out
