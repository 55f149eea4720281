"""The errors that users meet; each says what was wrong, where, and what to do.

Never imports anything else of the library.
"""

from __future__ import annotations


class InputError(ValueError):
    """Something given by the user (file, image, pose, mesh, option) cannot be used."""


class WeightsError(InputError):
    """A weights file is missing, damaged, or not one of ours."""


class RenderingUnavailable(RuntimeError):
    """A rendering back end cannot run on this machine; the message names what to install."""
