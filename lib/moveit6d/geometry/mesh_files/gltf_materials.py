"""The looks of a glTF primitive: pictures, factors and vertex colours of every kind.

Never lights anything: metal, roughness, normal maps and lamps do not count.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .content import FileMaterial, MeshContent, MeshPart
from .cutout import cut_out
from .gltf_buffers import GltfFile
from .pictures import Picture, decode_picture, tinted, to_linear, to_srgb

WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
# Where a texture's picture stands; the first that can be decoded is taken.
SOURCES = ("EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds")
INVISIBLE = 4.0  # alpha (0 to 255) below which a blended surface is not there
# trimesh writes this factor beside textures and means no factor by it.
TRIMESH_GREY = 102 / 255


class Looks:
    """Materials and pictures of one file, each decoded once."""

    def __init__(self, file: GltfFile, content: MeshContent) -> None:
        self.file, self.content = file, content
        self._pictures: dict[int, Picture | None] = {}
        self._described: set[int] = set()

    def applied(
        self, part: MeshPart, material: int | None, attributes: dict[str, NDArray[Any]]
    ) -> MeshPart:
        """The part with its texture, its vertex colours and its factor."""
        light = self._vertex_light(attributes)
        if material is None:
            if light is not None:
                part.colors = to_srgb(light)
            return part
        entry = self.file.items("materials")[material]
        name = str(entry.get("name") or f"number {material}")
        self.content.name(f"material {name}")
        info, factor = _shown(entry)
        picture = None if info is None else self._picture(info, name)
        factor = self._meant(factor, picture)
        self._describe(material, name, info, picture, factor)
        if picture is None:
            if light is not None:
                part.colors = to_srgb(light * factor)
            elif info is None or (factor != 1).any():
                part.color = to_srgb(factor)
            return part
        return self._textured(part, entry, info or {}, picture, factor, light, attributes, name)

    def invisible(self, material: int | None) -> str | None:
        """The name of a material whose factor's alpha alone hides it all; None if it shows."""
        if material is None:
            return None
        entry = self.file.items("materials")[material]
        cutoff = _cutoff(entry)
        hides = cutoff is not None and 255 * _opacity(entry) < cutoff
        return str(entry.get("name") or f"number {material}") if hides else None

    def _textured(
        self, part: MeshPart, entry: dict[str, Any], info: dict[str, Any], picture: Picture,
        factor: NDArray[np.float64], light: NDArray[np.float64] | None,
        attributes: dict[str, NDArray[Any]], name: str,
    ) -> MeshPart:  # fmt: skip
        transform = (info.get("extensions") or {}).get("KHR_texture_transform") or {}
        number = transform.get("texCoord", info.get("texCoord", 0))
        coordinates = attributes.get(f"TEXCOORD_{number}")
        if coordinates is None:
            self.content.lost(
                f"the material {name!r} shows a picture, but its faces have no TEXCOORD_{number}",
                "export the mesh with UV coordinates",
            )
            if light is not None:
                part.colors = to_srgb(light * factor)
            return part
        uv = _transformed(np.asarray(coordinates, np.float64)[:, :2], transform)
        part.uv = np.stack([uv[:, 0], 1 - uv[:, 1]], -1).astype(np.float32)
        part.texture = tinted(picture.pixels, factor)
        part.wrap = self._wrap(info)
        if light is not None and not (light == 1).all():
            part.colors = to_srgb(light)
        cutoff = _cutoff(entry)
        if picture.alpha is not None and cutoff is not None:
            opacity = _opacity(entry)
            if opacity == 0 or 255 * opacity < cutoff:  # shown where there is nothing else
                opacity = 1.0
            part = cut_out(part, picture.alpha, cutoff / opacity)
        return part

    def _vertex_light(self, attributes: dict[str, NDArray[Any]]) -> NDArray[np.float64] | None:
        """COLOR_0 (V, 3) as linear light, as the specification says of every type but bytes.

        Bytes are what trimesh, Open3D and MeshLab write, and those write display colours.
        """
        values = attributes.get("COLOR_0")
        if values is None:
            return None
        self.content.name("vertex colours")
        kind = values.dtype
        light = np.asarray(values, np.float64)[:, :3]
        if kind.kind in "iu":
            light = light / float(np.iinfo(kind).max)
        light = np.nan_to_num(light).clip(0, 1)
        return to_linear(255 * light) if kind.itemsize == 1 else light

    def _picture(self, info: dict[str, Any], name: str) -> Picture | None:
        index = int(info["index"])
        if index in self._pictures:
            return self._pictures[index]
        self.content.name(f"picture of material {name}")
        self._pictures[index] = None
        texture = self.file.items("textures")[index]
        extensions = texture.get("extensions") or {}
        sources = [extensions[key].get("source") for key in SOURCES if key in extensions]
        sources = [one for one in [texture.get("source"), *sources] if one is not None]
        problem = f"its texture {index} has no picture"
        if "KHR_texture_basisu" in extensions and not sources:
            problem = "its picture is KHR_texture_basisu, which is not understood"
        for source in sources:
            try:
                self._pictures[index] = self._decoded(source)
                return self._pictures[index]
            except InputError as error:
                problem = str(error).rstrip(".")
        self.content.lost(
            f"the picture of material {name!r} cannot be shown: {problem}",
            "export the mesh with PNG or JPEG pictures",
        )
        return None

    def _decoded(self, source: int) -> Picture:
        image = self.file.items("images")[source]
        where = f"picture {source}"
        if image.get("bufferView") is not None:
            return decode_picture(self.file.view(image["bufferView"]), where)
        return decode_picture(self.file.resource(image["uri"], where), where)

    def _wrap(self, info: dict[str, Any]) -> tuple[str, str]:
        texture = self.file.items("textures")[info["index"]]
        if texture.get("sampler") is None:
            return "repeat", "repeat"
        sampler = self.file.items("samplers")[texture["sampler"]]
        return WRAPS[sampler.get("wrapS", 10497)], WRAPS[sampler.get("wrapT", 10497)]

    def _meant(self, factor: NDArray[np.float64], picture: Picture | None) -> NDArray[np.float64]:
        generator = str(self.file.json["asset"].get("generator", ""))
        grey = np.abs(factor - TRIMESH_GREY).max() < 1e-6
        return np.ones(3) if picture is not None and "trimesh" in generator and grey else factor

    def _describe(
        self, index: int, name: str, info: dict[str, Any] | None, picture: Picture | None,
        factor: NDArray[np.float64],
    ) -> None:  # fmt: skip
        if index in self._described:
            return
        self._described.add(index)
        color = None if picture is not None else tuple(int(one) for one in to_srgb(factor))
        shown = "" if picture is None or info is None else f"texture {info['index']}"
        size = (0, 0) if picture is None else picture.size
        self.content.materials.append(FileMaterial(name, shown, size, color))


def _shown(entry: dict[str, Any]) -> tuple[dict[str, Any] | None, NDArray[np.float64]]:
    """The texture reference that shows the surface's own colour, and its factor (3,)."""
    rough = entry.get("pbrMetallicRoughness") or {}
    gloss = (entry.get("extensions") or {}).get("KHR_materials_pbrSpecularGlossiness") or {}
    factor = _factor(rough.get("baseColorFactor"))
    if rough.get("baseColorTexture") is not None:
        return rough["baseColorTexture"], factor
    if gloss.get("diffuseTexture") is not None:
        return gloss["diffuseTexture"], _factor(gloss.get("diffuseFactor"))
    glow = _factor(entry.get("emissiveFactor") or (0, 0, 0))
    if entry.get("emissiveTexture") is not None:  # unlit scans, and baked light
        return entry["emissiveTexture"], glow if glow.any() else np.ones(3)
    if rough.get("baseColorFactor") is None and gloss.get("diffuseFactor") is not None:
        return None, _factor(gloss["diffuseFactor"])
    if glow.any() and not factor.any():
        return None, glow
    return None, factor


def _cutoff(entry: dict[str, Any]) -> float | None:
    """The alpha (0 to 255) below which a material is not there; None for one that is opaque."""
    mode = entry.get("alphaMode", "OPAQUE")
    if mode == "MASK":
        cutoff = entry.get("alphaCutoff")
        return 255 * (0.5 if cutoff is None else float(cutoff))
    return INVISIBLE if mode == "BLEND" else None


def _opacity(entry: dict[str, Any]) -> float:
    """The alpha (0 to 1) of the factor that `_shown` takes."""
    rough = entry.get("pbrMetallicRoughness") or {}
    gloss = (entry.get("extensions") or {}).get("KHR_materials_pbrSpecularGlossiness") or {}
    values = rough.get("baseColorFactor")
    glossy = values is None or gloss.get("diffuseTexture") is not None
    if rough.get("baseColorTexture") is None and glossy:
        values = gloss.get("diffuseFactor")
    if values is None or len(values) < 4 or not math.isfinite(values[3]):
        return 1.0
    return min(max(float(values[3]), 0.0), 1.0)


def _factor(values: Any) -> NDArray[np.float64]:
    factor = np.array((1, 1, 1) if values is None else values[:3], np.float64)
    if factor.shape != (3,) or not np.isfinite(factor).all():
        raise InputError(f"a colour factor is {values!r}, not three or four numbers.")
    return factor.clip(0, 1)


def _transformed(uv: NDArray[np.float64], transform: dict[str, Any]) -> NDArray[np.float64]:
    """KHR_texture_transform on coordinates (V, 2), v down: scale, then rotation, then offset.

    The rotation is the one that all implementations agree on (KhronosGroup/glTF#1563), the other
    way round than the extension's sample code.
    """
    scaled = uv * np.array(transform.get("scale") or (1, 1), np.float64)
    angle = float(transform.get("rotation") or 0.0)
    c, s = math.cos(angle), math.sin(angle)
    turned = scaled @ np.array([[c, -s], [s, c]])
    return np.asarray(turned + np.array(transform.get("offset") or (0, 0), np.float64))
