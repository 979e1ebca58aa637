"""Public names that load when first used."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

PROJECT = Path(__file__).resolve().parents[2]
PACKAGES = ("catalogs", "insitu", "render", "surrogate")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_one_of_the_stub(package: str) -> None:
    module = import_module(package)
    stub = Path(str(module.__file__)).with_suffix(".pyi")
    imports = [node for node in ast.walk(ast.parse(stub.read_text())) if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: str(node.module) for node in imports for alias in node.names}
    assert list(homes) == module.__all__
    assert {*homes, "__version__"} == set(dir(module))
    for name, home in homes.items():
        assert getattr(module, name) is getattr(import_module(home), name)


@pytest.mark.parametrize("package", PACKAGES)
def test_an_unknown_name_is_refused_with_those_that_there_are(package: str) -> None:
    module = import_module(package)
    with pytest.raises(AttributeError, match=rf"'{package}' has no attribute 'nothing'; it has .*{module.__all__[0]}"):
        _ = module.nothing
    with pytest.raises(ImportError, match="nothing"):
        exec(f"from {package} import nothing", {})


@pytest.mark.parametrize(
    ("name", "missing", "extra"),
    [
        ("insitu.Session", "numpy", "insitu"),
        ("surrogate.Surrogate", "torch", "surrogate"),
        ("surrogate.show", "aiohttp", "explore"),
    ],
)
def test_a_missing_dependency_is_named_with_the_extra_that_brings_it(name: str, missing: str, extra: str) -> None:
    package, _, public = name.partition(".")
    program = f"import sys; sys.modules[{missing!r}] = None; import {package}; {package}.{public}"
    refused = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    expected = f"ModuleNotFoundError: {name} needs the package {missing}"
    assert refused.stderr.splitlines()[-1].startswith(expected)
    assert refused.stderr.splitlines()[-1].endswith(f": pip install 'gs-surrogate[{extra}]'")


@pytest.mark.parametrize(
    ("package", "words", "missing"),
    [
        ("surrogate", ["show", "."], "torch"),
        ("surrogate", ["export", ".", "-o", "a.png"], "torch"),
        ("insitu", ["probe", "field.npy"], "vtkmodules"),
    ],
)
def test_a_command_names_the_extra_of_a_missing_package_in_one_sentence(
    tmp_path: Path, package: str, words: list[str], missing: str
) -> None:
    np.save(tmp_path / "field.npy", np.zeros((4, 4, 4)))
    program = f"import sys; sys.modules[{missing!r}] = None; from {package}.cli import main; main({words})"
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    command = [sys.executable, "-c", program]
    refused = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert refused.returncode == 1
    assert "Traceback" not in refused.stderr
    assert f"needs the package {missing}" in refused.stderr
    assert "pip install 'gs-surrogate[" in refused.stderr
