"""`python -m moveit6d VERB …`: the same as the command `moveit6d`, where that is not on the path.

Never more than that.
"""

from __future__ import annotations

import sys

from .cli.main import main

if __name__ == "__main__":
    sys.exit(main())
