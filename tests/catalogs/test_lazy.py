"""Public names that load when first used."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

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
        ("insitu.render_member", "vtkmodules", "insitu"),
        ("render.render_views", "vtkmodules", "insitu"),
        ("surrogate.Surrogate", "torch", "surrogate"),
        pytest.param("surrogate.show", "aiohttp", "explore", marks=pytest.mark.slow),
    ],
)
def test_a_missing_dependency_is_named_with_the_extra_that_brings_it(name: str, missing: str, extra: str) -> None:
    package, _, public = name.partition(".")
    program = f"import sys; sys.modules[{missing!r}] = None; import {package}; {package}.{public}"
    refused = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    expected = f"ModuleNotFoundError: {name} needs the package {missing}"
    assert refused.stderr.splitlines()[-1].startswith(expected)
    assert refused.stderr.splitlines()[-1].endswith(f": pip install 'gs-surrogate[{extra}]'")
