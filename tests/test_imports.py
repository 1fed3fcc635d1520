"""The floors of the house, and how fast its door opens."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import blendcap

ROOT = Path(__file__).resolve().parent.parent
HEAVY = ("numba", "scipy", "cv2", "matplotlib", "trimesh", "ezc3d", "igl", "sklearn", "rich.progress")


def run(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)


def seconds(*arguments: str) -> float:
    """The processor time of the quickest of five runs: what the program needs, not what a busy machine adds."""
    times = []
    for _ in range(5):
        before = os.times()
        subprocess.run([sys.executable, *arguments], capture_output=True, check=True)
        after = os.times()
        times.append(after.children_user + after.children_system - before.children_user - before.children_system)
    return min(times)


def test_imports_go_down_the_floors_only():
    answer = run("-c", "from importlinter.cli import lint_imports; raise SystemExit(lint_imports())")
    assert answer.returncode == 0, answer.stdout + answer.stderr


def test_the_package_imports_nothing_until_it_is_asked():
    loaded = run("-c", "import sys, blendcap; print(*sys.modules)").stdout.split()
    assert "blendcap" in loaded
    assert not {"numpy", *HEAVY} & set(loaded)


def test_the_help_loads_nothing_heavy():
    script = "import sys, blendcap.cli; blendcap.cli.main(['--help']); print(*sys.modules)"
    loaded = run("-c", script).stdout.split()
    assert "cyclopts" in loaded
    assert not {"numpy", *HEAVY} & set(loaded)


@pytest.mark.slow
def test_the_package_imports_in_a_third_of_a_second():
    assert seconds("-c", "import blendcap") < 0.3


@pytest.mark.slow
def test_the_help_costs_little_beyond_what_prints_it():
    """Twice as much, half a second where this was written; numpy and scipy would make it four times."""
    libraries = seconds("-c", "import cyclopts, rich.console, rich.markdown")
    assert seconds("-m", "blendcap", "--help") < 3 * libraries


@pytest.mark.parametrize("name", blendcap.__all__)
def test_every_public_name_is_there_and_says_what_it_is(name):
    value = getattr(blendcap, name)
    assert value.__doc__
    assert name in dir(blendcap)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'blendcap' has no attribute 'sovle'"):
        _ = blendcap.sovle  # pyright: ignore[reportAttributeAccessIssue]


def test_the_type_checker_knows_every_public_name():
    """The lazy table and the list under TYPE_CHECKING say the same."""
    tree = ast.parse(Path(blendcap.__file__).read_text(encoding="utf-8"))
    block = next(n for n in tree.body if isinstance(n, ast.If))
    typed = {(n.module, alias.name) for n in block.body if isinstance(n, ast.ImportFrom) for alias in n.names}
    lazy = {(f"blendcap.{home}", name) for name, home in blendcap._HOMES.items()}
    assert typed == lazy


def test_nothing_in_the_library_prints_or_loads_pickles():
    for path in (ROOT / "src").rglob("*.py"):
        calls = [n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
        names = {n.func.id for n in calls if isinstance(n.func, ast.Name)}
        words = {(k.arg, getattr(k.value, "value", None)) for n in calls for k in n.keywords}
        assert "print" not in names or path.parent.name == "cli", path
        assert ("allow_pickle", True) not in words and "eval" not in names, path
