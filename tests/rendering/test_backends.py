"""Back ends by name."""

import subprocess
import sys

import pytest

from moveit6d.errors import InputError
from moveit6d.rendering import make_renderer


def test_embree_is_the_default():
    assert make_renderer().name == "embree"


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"'opengl'.*embree, pyrender"):
        make_renderer("opengl")


def test_importing_loads_no_back_end_and_changes_no_environment():
    code = (
        "import os, sys; before = dict(os.environ); import moveit6d.rendering;"
        "assert dict(os.environ) == before;"
        "heavy = ('embreex', 'pyrender', 'OpenGL', 'cv2', 'trimesh', 'scipy', 'matplotlib');"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
