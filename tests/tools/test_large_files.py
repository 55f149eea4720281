"""Files that are too large for the repository are named."""

from pathlib import Path

from tools.large_files import main, too_large


def test_only_files_above_the_limit_are_named(tmp_path: Path) -> None:
    small, large = tmp_path / "small", tmp_path / "large"
    small.write_bytes(bytes(10))
    large.write_bytes(bytes(11))
    (line,) = too_large([small, large, tmp_path / "gone"], limit=10)
    assert str(large) in line and "11 bytes" in line
    assert main([str(small), str(large)]) == 0, "both far below the real limit"
