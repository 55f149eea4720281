"""Packages that only some commands need, installed as extras: `pip install 'moveit6d[report]'`.

Never imports one of them.
"""

from __future__ import annotations

from importlib.util import find_spec

from .errors import InputError

# The packages of each extra, as they are imported.
EXTRAS = {
    "train": ("pytorch_lightning",),
    "gl": ("pyrender",),
    "report": ("jinja2", "matplotlib"),
    "rerun": ("rerun",),
    "ray": ("ray",),
}


def require(extra: str, what: str) -> None:
    """`InputError` that says what to install if a package of an extra is missing.

    `what` needs it, as the subject of a sentence: "--report".
    """
    missing = [name for name in EXTRAS[extra] if find_spec(name) is None]
    if missing:
        names = " and ".join(missing)
        raise InputError(f"{what} needs {names}: pip install 'moveit6d[{extra}]'.")
