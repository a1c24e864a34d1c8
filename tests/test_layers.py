"""The order of imports, and what `import hairfit` may cost."""

import ast
import pathlib
import subprocess
import sys
import time

import pytest

PACKAGE = pathlib.Path(__file__).parent.parent / "hairfit"

# A part may import itself and those before it. `render` is its JAX half.
ORDER = (
    {"errors", "types", "transforms", "abreast", "host"},
    {"model"},
    {"io"},
    {"render"},
    {"capture"},
    {"evaluate"},
    {"fit"},
    {"render.gl"},
    {"report"},
    {"synthetic"},
    {"edit"},
    {"cli"},
)
# Imported inside the functions that need them, so that `import hairfit` is fast.
HEAVY = {"cv2", "igl", "kornia", "moderngl", "pycolmap", "torch", "trimesh", "usd"}
FILES = sorted(PACKAGE.rglob("*.py"))


def part_of(module: str) -> str:
    """Return the part of hairfit that a module such as `hairfit.model.tree` is in."""
    names = module.split(".")[1:3]
    return ".".join(names) if names == ["render", "gl"] else names[0]


def rank_of(part: str) -> int:
    ranks = [i for i, parts in enumerate(ORDER) if part in parts]
    assert ranks, f"hairfit/{part} has no place in the order of imports; add it here."
    return ranks[0]


def module_of(file: pathlib.Path) -> str:
    names = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(names[:-1] if names[-1] == "__init__" else names)


def imported(node: ast.AST, file: pathlib.Path) -> list[str]:
    """Return the full names of the modules, or what is in them, that a node imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    base = node.module or ""
    if node.level:
        package = file.relative_to(PACKAGE.parent).parent.parts
        above = ".".join(package[: len(package) - node.level + 1])
        base = f"{above}.{base}" if base else above
    return [f"{base}.{alias.name}" for alias in node.names]


@pytest.mark.parametrize("file", FILES, ids=module_of)
def test_imports_follow_the_order_of_the_parts(file):
    if file.parent == PACKAGE and file.stem in ("__init__", "__main__"):
        return  # what is public comes from everywhere
    mine = part_of(module_of(file))
    for node in ast.walk(ast.parse(file.read_text())):
        for name in imported(node, file):
            if name.startswith("hairfit."):
                theirs = part_of(name)
                assert rank_of(theirs) <= rank_of(mine), (
                    f"{file} imports {name}: {mine} may not see {theirs}."
                )
                same = rank_of(theirs) == rank_of(mine) and mine != theirs
                assert not same or rank_of(mine) == 0


@pytest.mark.parametrize("file", FILES, ids=module_of)
def test_heavy_libraries_are_imported_where_they_are_used(file):
    inside = set()
    tree = ast.parse(file.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            inside |= {id(child) for child in ast.walk(node)}
        typing_only = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(
            node.test
        )
        if typing_only:
            inside |= {id(child) for child in ast.walk(node)}
    for node in ast.walk(tree):
        for name in imported(node, file):
            heavy = name.split(".")[0] in HEAVY
            assert not heavy or id(node) in inside, (
                f"{file} imports {name} for the whole module, not in a function."
            )


def test_the_order_catches_an_import_to_the_right():
    relative = ast.parse("from ..fit import solve").body[0]
    file = PACKAGE / "model" / "tree.py"
    assert imported(relative, file) == ["hairfit.fit.solve"]
    assert rank_of(part_of("hairfit.fit.solve")) > rank_of(part_of(module_of(file)))
    preview = PACKAGE / "render" / "gl" / "preview.py"
    assert rank_of(part_of(module_of(preview))) > rank_of("fit") > rank_of("render")


def test_importing_hairfit_is_fast_and_pulls_no_heavy_library():
    code = (
        "import sys, hairfit; print(*sys.modules, sep='\\n'); "
        "hairfit.HairTree; hairfit.InputError; print(*sys.modules, sep='\\n')"
    )
    times = []
    for _ in range(3):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import hairfit"], check=True)
        times.append(time.perf_counter() - start)
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    )
    assert not HEAVY & {name.split(".")[0] for name in done.stdout.split()}
    assert min(times) < 1.0


def test_everything_public_can_be_imported():
    import hairfit

    for name in hairfit.__all__:
        assert getattr(hairfit, name) is not None
    assert set(hairfit.__all__) <= set(dir(hairfit))
    with pytest.raises(AttributeError, match="module 'hairfit' has no attribute 'wig'"):
        hairfit.wig  # noqa: B018
