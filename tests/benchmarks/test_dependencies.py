"""What an installation brings: read from the metadata, judged by what they say."""

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
