"""Fixtures that all tests share."""

import os
from importlib import import_module
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


class Data:
    """The real data, file by file; a test that needs a file which is not there skips and says which."""

    def __init__(self):
        self.root = Path(os.environ.get("BLENDCAP_DATA", HERE.parent.parent / "shared" / "data"))

    def __call__(self, name: str) -> Path:
        path = self.root / name
        if not path.exists():
            pytest.skip(f"needs {name} of the real data; set BLENDCAP_DATA to their folder")
        return path


@pytest.fixture
def benchmark_module(monkeypatch):
    """Imports a module of the benchmarks by its name."""
    monkeypatch.syspath_prepend(str(HERE.parent / "benchmarks"))
    return import_module


@pytest.fixture(scope="session")
def data() -> Data:
    return Data()
