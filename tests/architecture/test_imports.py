"""Imports go downward only, modules say what they are for, and nothing grows without bound."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIBRARY = ROOT / "lib" / "moveit6d"
LIGHTNING = ROOT / "lightning_modules"

# From the bottom up; a package may import from lower layers and from its own layer.
LAYERS = (
    ("errors",),
    ("extras",),
    ("checks", "io", "parallel", "threads", "typing", "config"),
    ("geometry",),
    ("frame", "camera_calibration"),
    ("actions",),
    ("rendering",),
    ("observation",),
    ("contour",),
    ("networks",),
    ("policies",),
    ("estimation",),
    ("synthesis", "datasets", "evaluation", "visualization"),
    ("lightning_modules",),
    ("cli",),
)
LAYER_OF = {name: layer for layer, names in enumerate(LAYERS) for name in names}
MODULES = sorted([*LIBRARY.rglob("*.py"), *LIGHTNING.rglob("*.py")])
SLOW_IMPORTS = {
    "cv2", "pyrender", "matplotlib", "pytorch_lightning", "av", "ray", "rerun",
    "jinja2",
}  # fmt: skip


def module_name(path: Path, root: Path = ROOT) -> str:
    """`moveit6d.geometry.pose` for the file it lies in."""
    parts = path.relative_to(root).with_suffix("").parts
    parts = parts[1:] if parts[0] == "lib" else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(source: str, name: str, is_package: bool) -> Iterator[tuple[str, bool]]:
    """Every module that a module imports, in full, and whether it does so when it is loaded."""
    tree = ast.parse(source)
    late = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or _only_for_types(node)
        for inner in ast.walk(node)
    }
    package = name if is_package else name.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, id(node) not in late
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            for alias in node.names:
                yield f"{base}.{alias.name}", id(node) not in late


def package_of(module: str) -> str | None:
    """The package that a module belongs to, None for other people's and for `moveit6d` itself."""
    parts = module.split(".")
    if parts[0] == "lightning_modules":
        return parts[0]
    if parts[0] == "moveit6d" and len(parts) > 1 and parts[1] in LAYER_OF:
        return parts[1]
    return None


def upward(source: str, name: str, is_package: bool = False) -> list[str]:
    """Imports of a module from a higher layer."""
    here = package_of(name)
    if here is None:
        return []
    packages = {module: package_of(module) for module, _ in imports(source, name, is_package)}
    return [
        f"{name} imports {module}"
        for module, there in packages.items()
        if there is not None and LAYER_OF[there] > LAYER_OF[here]
    ]


def test_rule_catches_an_upward_import() -> None:
    assert upward("from ..estimation import PoseTracker", "moveit6d.rendering.embree")
    assert upward("def f():\n    import moveit6d.cli.main", "moveit6d.datasets.bop")
    assert upward("from . import cli", "moveit6d.policies") == [
        "moveit6d.policies imports moveit6d.cli"
    ]
    assert upward("from lightning_modules import losses", "moveit6d.networks.action_net")
    assert not upward("from ..geometry.pose import Pose", "moveit6d.rendering.embree")
    assert not upward("from .pose import Pose", "moveit6d.geometry", is_package=True)


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_imports_go_downward(path: Path) -> None:
    name = module_name(path)
    assert name in ("moveit6d", "moveit6d.__main__") or package_of(name), f"{name} has no layer"
    assert upward(path.read_text(encoding="utf-8"), name, path.name == "__init__.py") == []


def test_packages_of_one_layer_do_not_import_each_other_in_a_circle() -> None:
    edges: dict[str, set[str]] = {}
    for path in MODULES:
        name = module_name(path)
        here = package_of(name)
        if here is None:
            continue
        source = path.read_text(encoding="utf-8")
        for module, _ in imports(source, name, path.name == "__init__.py"):
            there = package_of(module)
            if there is not None and there != here and LAYER_OF[there] == LAYER_OF[here]:
                edges.setdefault(here, set()).add(there)
    remaining = set(edges)
    while remaining:
        free = {name for name in remaining if not edges[name] & remaining}
        assert free, f"a circle of imports among {sorted(remaining)}"
        remaining -= free


@pytest.mark.parametrize("path", sorted(LIBRARY.rglob("*.py")), ids=module_name)
def test_slow_packages_are_imported_where_they_are_used(path: Path) -> None:
    source, name = path.read_text(encoding="utf-8"), module_name(path)
    loaded = imports(source, name, path.name == "__init__.py")
    heavy = {module.split(".")[0] for module, at_load in loaded if at_load} & SLOW_IMPORTS
    assert not heavy, f"import {heavy} inside the functions that need it"


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_module_says_what_it_is_for_and_what_it_never_does(path: Path) -> None:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert text, "a module needs a docstring"
    assert "never" in text.lower(), "its docstring must say what the module never does"


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_modules_and_functions_stay_small(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    assert len(source.splitlines()) <= 400
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno is not None
            assert node.end_lineno - node.lineno < 60, f"{node.name} is longer than a screen"


def _only_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
