"""Workflows, issue forms, citation and changelog: they parse, agree with the project, and name commands that exist."""

from __future__ import annotations

import os
import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from surrogate.cli import main as surrogate

ROOT = Path(__file__).resolve().parent.parent
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
OF_THE_MACHINE = {"apt-get", "git", "make", "pipx", "python"}


def read(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_parse_and_their_commands_exist(path: Path) -> None:
    workflow = read(path)
    assert workflow[True], "`on` is a boolean of YAML 1.1"
    assert workflow["permissions"] == {"contents": "read"}
    assert path.read_text().startswith("# Never run here")
    for job in workflow["jobs"].values():
        assert job["runs-on"]
        assert set(job.get("needs", [])) <= workflow["jobs"].keys()
        for step in job["steps"]:
            assert len({"run", "uses"} & step.keys()) == 1
            assert re.fullmatch(r"[\w-]+/[\w-]+@(release/)?v[\d.]+", step.get("uses", "a/b@v1"))
            for command in re.split(r"&&|\n", step.get("run", "")):
                check_command(command.split())


def check_command(words: list[str]) -> None:
    if not words:
        return
    program, *arguments = words
    if program == "python":
        assert (ROOT / arguments[0]).is_file()
    elif program not in OF_THE_MACHINE:
        assert os.access(ROOT / program, os.X_OK), program


@pytest.mark.parametrize("command", ["python .ci/nothing.py", ".ci/nothing", "cargo test"])
def test_a_command_that_does_not_exist_is_noticed(command: str) -> None:
    with pytest.raises(AssertionError):
        check_command(command.split())


def test_the_pythons_that_are_built_are_those_that_are_tested() -> None:
    tested = read(ROOT / ".github/workflows/tests.yml")["jobs"]["packages"]["strategy"]["matrix"]["python"]
    built = PROJECT["tool"]["cibuildwheel"]["build"]
    assert built == [f"cp{version.replace('.', '')}-*" for version in tested]
    assert PROJECT["project"]["requires-python"] == f">={tested[0]}"


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_issue_forms_are_complete(path: Path) -> None:
    form = read(path)
    assert {"name", "description", "body"} <= form.keys()
    names = [field["id"] for field in form["body"]]
    assert len(set(names)) == len(names)
    for field in form["body"]:
        assert field["type"] == "textarea"
        assert {"label", "description"} <= field["attributes"].keys()


def test_bug_reports_need_the_doctor() -> None:
    (field,) = (
        field for field in read(ROOT / ".github/ISSUE_TEMPLATE/bug_report.yml")["body"] if field["id"] == "doctor"
    )
    assert field["validations"]["required"]
    assert "`surrogate doctor`" in field["attributes"]["description"]
    assert "doctor" in surrogate.commands


def test_the_citation_is_of_this_project() -> None:
    citation, project = read(ROOT / "CITATION.cff"), PROJECT["project"]
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    assert citation["authors"] == [{"name": "The gs-surrogate developers"}]


def test_links_of_the_readme_become_absolute_for_pypi() -> None:
    absolute = runpy.run_path(str(ROOT / ".ci" / "absolute_links.py"))["absolute"]
    text = "![a](docs/a.webp) [b](docs/b.md#c) [d](https://example.org/d) [e](#f)"
    assert absolute(text, "https://host/us/it", "v1") == (
        "![a](https://host/us/it/raw/v1/docs/a.webp) [b](https://host/us/it/blob/v1/docs/b.md#c) "
        "[d](https://example.org/d) [e](#f)"
    )
    readme = absolute((ROOT / "README.md").read_text(), "https://host/us/it", "v1")
    assert {link for link in re.findall(r"\]\(([^)]+)\)", readme) if "://" not in link} == set()


def test_the_changelog_begins_with_what_is_not_released() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    assert re.findall(r"^## (.*)$", text, re.MULTILINE)[0] == "[Unreleased]"
    assert set(re.findall(r"^### (.*)$", text, re.MULTILINE)) <= {
        "Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"
    }  # fmt: skip
