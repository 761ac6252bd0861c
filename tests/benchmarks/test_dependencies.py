"""Dependencies of an installation: licences, sizes and requirements, read from package metadata."""

from types import SimpleNamespace

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.catalogue import dependencies, page
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count


def install(licences, **columns):
    """A page's data: a fabricated table of installed packages with these licences, REBOUND first, and with columns."""
    names = ["rebound", *(f"p{k}" for k in range(len(licences) - 1))]
    table = pd.DataFrame({"package": names, "licence": licences, "direct": True, "MB": range(len(names))})
    return {"dependencies": table.assign(**columns)}.get


@pytest.mark.parametrize(
    ("licences", "outcome", "where"),
    [
        (["GPL-3.0-only", "MIT"], PASS, ""),
        (["MIT", "MIT"], PASS, ""),
        (["GPL-3.0-only", "GPL-2.0-only"], FAIL, "p0"),
        (["MIT", "LGPL-3.0-or-later"], PASS, ""),
        (["AGPL-3.0-only", "AGPL-3.0-only"], FAIL, "p0"),
    ],
)
def test_only_peer_packages_may_be_under_the_gpl(licences, outcome, where):
    found = page.copyleft(install(licences))
    assert (found.outcome, found.where) == (outcome, where)
    assert found.measured == Count(len(where) // 2, 2)


def test_package_without_a_licence_is_a_finding():
    silent = page.licences(install(["MIT", None]))
    assert (silent.outcome, silent.measured, silent.where) == (FINDING, Count(1, 2), "p0")
    assert page.licences(install(["MIT", "BSD"])).outcome == PASS


def test_answer_has_the_largest_packages_and_the_sum():
    answer = page.weigh(install(["MIT"] * 4, MB=[1.0, 40.0, 3.0, 2.0]))
    assert [x for x in answer.split() if x.isdigit()] == ["4", "46", "40", "3", "2"]


class About(dict):
    """Stand-in for the metadata of an installed package; the values of a repeated field are stored under its plural."""

    def get_all(self, name):
        return self.get(name + "s")


@pytest.mark.parametrize(
    ("about", "name"),
    [
        ({"License-Expression": "MIT", "License": "x"}, "MIT"),
        ({"License": "BSD 3-Clause"}, "BSD 3-Clause"),
        ({"License": "A text " * 40, "Classifiers": ["License :: OSI Approved :: MIT License"]}, "MIT"),
        ({"Classifiers": ["Topic :: X", "License :: OSI Approved"]}, ""),
        ({}, ""),
        ({"License": "x" * 60, "Classifiers": ["License :: OSI Approved :: MIT License"]}, "x" * 60),
        ({"License": "x" * 61, "Classifiers": ["License :: OSI Approved :: MIT License"]}, "MIT"),
        ({"License": "Unknown", "Classifiers": ["License :: OSI Approved :: BSD License"]}, "BSD"),
        ({"License-Expression": "UNKNOWN", "License": "Apache Software License"}, "Apache-2.0"),
        (
            {"Classifiers": ["License :: OSI Approved :: MIT License", "License :: Public Domain"]},
            "MIT or Public Domain",
        ),
    ],
)
def test_licence_is_read_from_any_metadata_field(about, name):
    assert dependencies.licence(About(about)) == name


def test_requirements_of_other_platforms_are_dropped():
    texts = ["NumPy>=1", 'colorama; sys_platform == "win32"', 'x_y; extra == "test"', 'tomli; python_version < "3.11"']
    assert dependencies.requirement_names(texts) == ["numpy"]
    assert dependencies.requirement_names(texts, "test") == ["numpy", "x-y"]


def test_installed_packages_and_their_dependencies():
    rows = {r["package"]: r for r in dependencies.frame()}
    assert {"numpy", "heyoka", "rebound", "llvmlite"} <= rows.keys()
    assert rows["numba"]["direct"]
    assert not rows["llvmlite"]["direct"]
    assert "numba" in rows["llvmlite"]["needed by"]
    assert all(r["version"] for r in rows.values())
    assert rows["numpy"]["MB"] > 1
    order = [(not r["direct"], -r["MB"]) for r in rows.values()]
    assert order == sorted(order), "the direct ones first, then by size"


def test_size_of_a_distribution_excludes_bytecode(monkeypatch, tmp_path):
    sizes = {"a.py": 1_000_000, "b.so": 2_500_000, "c.pyc": 7_000_000}
    for name, size in sizes.items():
        (tmp_path / name).write_bytes(bytes(size))
    files = [SimpleNamespace(locate=lambda name=name: tmp_path / name) for name in (*sizes, "removed.py")]
    about = SimpleNamespace(files=files, version="1.2", metadata=About(License="MIT"))
    monkeypatch.setattr(dependencies.metadata, "distribution", {"x": about}.get)
    assert dependencies._row("x", {"b", "a"}, True) == {
        "package": "x", "version": "1.2", "licence": "MIT", "direct": True, "needed by": "a, b", "MB": 3.5,
    }  # fmt: skip
