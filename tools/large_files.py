"""Refuses committed files that are too large for a source repository. Run in its root.

python tools/large_files.py [FILE ...]
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

LIMIT = 4_000_000  # bytes; the largest weights file has 3.0 million


def too_large(paths: list[Path], limit: int = LIMIT) -> list[str]:
    """A line for each file above the limit."""
    sizes = [(path, path.stat().st_size) for path in paths if path.is_file()]
    return [f"{path}: {size} bytes, more than {limit}" for path, size in sizes if size > limit]


def main(names: list[str]) -> int:
    """Check the given files, or all that git knows."""
    if not names:
        listed = subprocess.run(["git", "ls-files", "-z"], capture_output=True, text=True)
        names = [name for name in listed.stdout.split("\0") if name]
    found = too_large([Path(name) for name in names])
    print("\n".join(found), end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
