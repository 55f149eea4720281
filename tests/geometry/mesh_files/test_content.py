"""What is taken note of while a mesh file is read: looks that are lost, each once."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh_files.content import ALLOW, MeshContent


def test_lost_looks_are_refused_with_the_remedy() -> None:
    content = MeshContent(Path("drill.obj"))
    with pytest.raises(InputError) as caught:
        content.lost("skin.png is missing", "put it beside the file")
    assert str(caught.value) == (
        f"drill.obj: skin.png is missing; put it beside the file, or {ALLOW}."
    )
    assert content.warnings == []


def test_a_reader_of_data_sets_is_not_told_of_an_option_that_it_lacks() -> None:
    content = MeshContent(Path("drill.obj"), allow_flat=True)
    with pytest.raises(InputError, match=r"^drill\.obj: skin\.png is missing; put it beside it\.$"):
        content.lost("skin.png is missing", "put it beside it")


def test_where_it_is_allowed_each_loss_is_one_warning() -> None:
    content = MeshContent(Path("drill.obj"), allow_untextured=True)
    for what in ("skin.png is missing", "material steel is missing", "skin.png is missing"):
        content.lost(what, "put it beside the file")
    assert content.warnings == ["skin.png is missing", "material steel is missing"]


def test_what_the_file_names_is_listed_once() -> None:
    content = MeshContent(Path("drill.obj"))
    for name in ("steel", "rubber", "steel"):
        content.name(name)
    assert content.named == ["steel", "rubber"]


def test_only_a_unit_that_the_file_contradicts_is_worth_a_word() -> None:
    content = MeshContent(Path("drill.dae"))
    assert content.other_unit(1.0) is None
    content.unit = 0.0254
    assert content.other_unit(0.0254) is None
    assert content.other_unit(0.01) == (
        "by the file one unit is 0.0254 m, but the unit given is 0.01 m"
    )
