"""Mesh files of every format as one surface with the looks that the file describes.

Never changes units or frames and never computes normals; `Mesh` does.
"""

from .read import SUFFIXES, read_mesh_file

__all__ = ["SUFFIXES", "read_mesh_file"]
