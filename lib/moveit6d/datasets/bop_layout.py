"""Where the files of a BOP data set lie, also where folders and names are not padded with zeros.

Never opens a file.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

TESTED = "test"  # how the names of those splits begin that BOP's targets are of: test_primesense
IMAGE_SUFFIXES = (".png", ".jpg", ".tif", ".jpeg")
MODEL_SUFFIXES = (".ply", ".obj", ".glb", ".gltf", ".dae", ".stl", ".off")
MODEL_FOLDERS = ("models", "models_cad", "models_eval", "models_reconst")


def scene_folders(split: Path) -> dict[int, Path]:
    """The folders of a split by scene number; one with padding before one without."""
    found: dict[int, Path] = {}
    for place in sorted(split.iterdir(), key=lambda path: (-len(path.name), path.name)):
        if place.name.isdecimal() and place.is_dir():
            found.setdefault(int(place.name), place)
    return found


def image_files(folder: Path) -> dict[int, Path]:
    """The images of a folder by number, in any letter case of their suffixes; PNG before others."""
    found: dict[int, Path] = {}
    if not folder.is_dir():
        return found
    for path in sorted(folder.iterdir(), key=_preference):
        if path.suffix.lower() in IMAGE_SUFFIXES and path.stem.isdecimal():
            found.setdefault(int(path.stem), path)
    return found


def model_file(folder: Path, number: int) -> Path | None:
    """The mesh of an object: obj_000005.ply or, where that is missing, another format or name."""
    exact = folder / f"obj_{number:06d}.ply"
    if exact.exists():
        return exact
    for suffix in MODEL_SUFFIXES:
        for path in sorted(folder.glob("obj_*")):
            digits = path.stem.removeprefix("obj_")
            if path.suffix.lower() == suffix and digits.isdecimal() and int(digits) == number:
                return path
    return None


def model_folders(root: Path) -> Iterable[Path]:
    """The folders of models that are there: those that have a models_info.json first."""
    there = [root / name for name in MODEL_FOLDERS if (root / name).is_dir()]
    return sorted(there, key=lambda folder: not (folder / "models_info.json").exists())


def _preference(path: Path) -> tuple[int, int, str]:
    suffix = path.suffix.lower()
    known = IMAGE_SUFFIXES.index(suffix) if suffix in IMAGE_SUFFIXES else len(IMAGE_SUFFIXES)
    return known, -len(path.stem), path.name
