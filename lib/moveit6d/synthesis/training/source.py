"""The source of training pairs: mesh files, procedural shapes, photographs, and a `PairConfig`.

Never draws a pair; small enough to be sent to other processes and machines.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...geometry.mesh import Mesh, Unit
from ...geometry.mesh_files import SUFFIXES
from ...geometry.mesh_files.digest import mesh_digest
from ..augmentation.backgrounds import procedural_photo
from ..augmentation.photos import load_photos, photo_files
from ..objects.shapes import random_object
from ..objects.slender import slender_copy
from ..objects.symmetric_shapes import symmetric_object
from ..objects.untextured import untextured_copy
from .pairs import PairConfig, PairGenerator

PROCEDURAL_PHOTOS = 64  # pictures that are made where there is no folder of photographs


@dataclass(frozen=True)
class PairSource:
    """Files, number of procedural shapes, and all that is random about a pair.

    `symmetric` is the share of procedural shapes that declare symmetries, `untextured` that of
    copies of the meshes without their texture, `slender` that of slender copies of the meshes and
    of other shapes, half each; `occluders` are meshes for the occluder bank, where it is not filled
    with the same ones. `lasting` is the seed of procedural shapes that stay the same whoever draws
    pairs of them; None: everybody makes new ones.
    """

    meshes: tuple[Path, ...]
    mesh_unit: Unit
    photos: Path | None
    photo_limit: int | None
    shapes: int
    pairs: PairConfig
    symmetric: float = 0.0
    occluders: tuple[Path, ...] = ()
    untextured: float = 0.0
    slender: float = 0.0
    lasting: int | None = None

    def load_photos(self, random: np.random.Generator) -> list[np.ndarray]:
        """The photographs of the folder, or generated pictures."""
        if self.photos is not None:
            return load_photos(Path(self.photos), self.photo_limit)
        return [procedural_photo(random, (200, 260)) for _ in range(PROCEDURAL_PHOTOS)]

    def load(self, path: Path) -> Mesh:
        """One of the files, with the symmetries that are declared beside it."""
        return Mesh.load(path, unit=self.mesh_unit, allow_flat=True)

    def load_meshes(self) -> list[Mesh]:
        """The meshes of the files."""
        return [self.load(path) for path in self.meshes]

    def load_occluders(self) -> list[Mesh] | None:
        """The meshes for the bank, or None."""
        return [self.load(path) for path in self.occluders] or None

    def shape(
        self, random: np.random.Generator, photos: Sequence[np.ndarray], meshes: Sequence[Mesh] = ()
    ) -> Mesh:
        """One new procedural shape, or an untextured or slender copy of one of the meshes."""
        # No number is drawn for nothing: without those kinds the others stay the same.
        if self.slender > 0 and random.random() < self.slender:
            if meshes and random.random() < 0.5:
                return slender_copy(random, meshes[int(random.integers(len(meshes)))])
            return slender_copy(random, random_object(random, photos))
        if self.symmetric > 0 and random.random() < self.symmetric:
            return symmetric_object(random, photos)
        if self.untextured > 0 and meshes and random.random() < self.untextured:
            return untextured_copy(random, meshes[int(random.integers(len(meshes)))])
        return random_object(random, photos)

    def make_shapes(
        self, random: np.random.Generator, photos: Sequence[np.ndarray], meshes: Sequence[Mesh] = ()
    ) -> list[Mesh]:
        """All the procedural shapes: from `random`, or those that last."""
        if self.lasting is not None and self.shapes:
            random = np.random.default_rng(self.lasting)
            if self.photos is None:  # generated ones are not everybody's
                photos = self.load_photos(random)
        return [self.shape(random, photos, meshes) for _ in range(self.shapes)]

    def generator(
        self, random: np.random.Generator, photos: list[np.ndarray], meshes: list[Mesh],
        occluders: list[Mesh] | None = None,
    ) -> PairGenerator:  # fmt: skip
        """A generator over loaded things, with a seed from `random`."""
        seed = int(random.integers(2**62))
        return PairGenerator(meshes, photos, self.pairs, seed, occluders)

    def facts(self) -> dict[str, Any]:
        """What pairs depend on, by name: the same wherever the same files lie."""
        facts = {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}
        for name in ("meshes", "occluders"):
            facts[name] = _digest([(path.name, mesh_digest(path)) for path in facts[name]])
        return {
            **facts, "photos": _digest(self._photo_sizes()), "pairs": dataclasses.asdict(self.pairs)
        }  # fmt: skip

    def digest(self) -> str:
        """A fingerprint of the facts."""
        return _digest(self.facts())

    def _photo_sizes(self) -> list[tuple[str, int]]:
        paths = [] if self.photos is None else photo_files(self.photos)
        return [(path.name, path.stat().st_size) for path in paths]


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def mesh_files(folder: Path) -> list[Path]:
    """Mesh files of a folder in order of their names; `InputError` if there is none."""
    paths = sorted(p for p in Path(folder).glob("*") if p.suffix.lower() in SUFFIXES)
    if not paths:
        raise InputError(f"Mesh folder {folder} holds no {', '.join(SUFFIXES)} file.")
    return paths
