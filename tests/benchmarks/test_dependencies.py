"""What an installation brings: read from the metadata, judged by what they say."""

from types import SimpleNamespace

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.catalogue import dependencies, page


class Data(dict):
    """Tables by name."""

    def __call__(self, name):
        return self.get(name)


def said(licences, direct=True):
    names = ["rebound", *(f"p{k}" for k in range(len(licences) - 1))]
    table = pd.DataFrame({"package": names, "licence": licences, "direct": direct, "MB": range(len(names))})
    return page.licences(Data(dependencies=table))


@pytest.mark.parametrize(
    ("licences", "holds", "text"),
    [
        (["GPL-3.0-only", "MIT"], True, "under the GPL: rebound; each states"),
        (["MIT", "MIT"], True, "none is under the GPL"),
        (["GPL-3.0-only", "GPL-2.0-only"], False, "not a comparison alone: p0"),
        (["MIT", "LGPL-3.0-or-later"], True, "none is under the GPL"),
        (["MIT", None], False, "without a stated licence: p0"),
        (["AGPL-3.0-only", "AGPL-3.0-only"], False, "not a comparison alone: p0"),
    ],
)
def test_the_verdict_on_licences_follows_the_table(licences, holds, text):
    found = said(licences)
    assert found.holds is holds
    assert text in found.text


def test_the_largest_are_named():
    table = pd.DataFrame({"package": list("abcd"), "MB": [1.0, 40.0, 3.0, 2.0]})
    assert "46 MB; the largest are b (40 MB), c (3 MB)" in page.weight(Data(dependencies=table)).text


class About(dict):
    """Metadata."""

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
def test_a_licence_is_read_where_it_stands(about, name):
    assert dependencies.licence(About(about)) == name


def test_requirements_of_other_platforms_and_extras_are_none():
    texts = ["NumPy>=1", 'colorama; sys_platform == "win32"', 'x_y; extra == "test"', 'tomli; python_version < "3.11"']
    assert dependencies.needed(texts) == ["numpy"]
    assert dependencies.needed(texts, "test") == ["numpy", "x-y"]


def test_what_is_installed_is_found_with_all_that_it_needs():
    rows = {r["package"]: r for r in dependencies.frame()}
    assert {"numpy", "heyoka", "rebound", "llvmlite"} <= rows.keys()
    assert rows["numba"]["direct"]
    assert not rows["llvmlite"]["direct"]
    assert "numba" in rows["llvmlite"]["needed by"]
    assert all(r["version"] and r["MB"] >= 0 for r in rows.values())
    order = [(not r["direct"], -r["MB"]) for r in rows.values()]
    assert order == sorted(order), "the direct ones first, then by size"


def test_a_distribution_takes_the_bytes_of_its_files_without_bytecode(monkeypatch, tmp_path):
    sizes = {"a.py": 1_000_000, "b.so": 2_500_000, "c.pyc": 7_000_000}
    for name, size in sizes.items():
        (tmp_path / name).write_bytes(bytes(size))
    files = [SimpleNamespace(locate=lambda name=name: tmp_path / name) for name in (*sizes, "removed.py")]
    about = SimpleNamespace(files=files, version="1.2", metadata=About(License="MIT"))
    monkeypatch.setattr(dependencies.metadata, "distribution", {"x": about}.get)
    assert dependencies._row("x", {"b", "a"}, True) == {
        "package": "x", "version": "1.2", "licence": "MIT", "direct": True, "needed by": "a, b", "MB": 3.5,
    }  # fmt: skip
