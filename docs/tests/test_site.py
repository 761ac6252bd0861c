"""Tests of the built site: links, search and chooser work, nothing comes from other hosts, no page scrolls sideways.

The chooser is the page "Which integrator should I use?".
"""

from __future__ import annotations

import random
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

#: Pages that are looked at besides one of every kind, drawn with this seed.
SAMPLE, SEED = 60, 28
#: Kinds of pages: the folders, and pages that are one of their own.
ALONE = ("index.html", "choose.html", "start.html", "faq.html", "search.html", "genindex.html")
KINDS = (
    "tutorials",
    "how-to",
    "explanation",
    "methods",
    "methods/families",
    "problems",
    "packages",
    "reports",
    "reference",
)
ADVISE = "phasebench advise"
THEME = "return document.documentElement.dataset.theme"


class Links(HTMLParser):
    """Parser of a page, which collects its ``links``, the files that it ``loads``, and the ``names`` of its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Add the link, the loaded file and the anchor names of an HTML element to those of the page."""
        found = {key: value for key, value in attrs if value}
        self.names |= {found[key] for key in ("id", "name") if key in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        if tag in ("script", "img", "source", "iframe") and "src" in found:
            self.loads.append(found["src"])
        if tag == "link" and "href" in found and found.get("rel") in ("stylesheet", "preload", "icon"):
            self.loads.append(found["href"])


def parse(site: Path) -> dict[Path, Links]:
    """Parse every page of a site: return path -> `Links`."""
    found = (path for path in sorted(site.rglob("*.html")) if "_static" not in path.parts)
    return {path: Links(path.read_text(encoding="utf-8")) for path in found}


def broken(pages: dict[Path, Links]) -> list[str]:
    """The internal links of a site whose target file or anchor does not exist, and files to load that do not exist.

    Each is a text "page: link"; ``pages`` are those of `parse`.
    """
    out = []
    for path, page in pages.items():
        for link in page.links + page.loads:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
            known = pages.get(target)
            lost = not target.is_file() or (parts.fragment and known and unquote(parts.fragment) not in known.names)
            if lost and not (parts.fragment == "" and not parts.path):
                out.append(f"{path}: {link}")
    return out


def external(pages: dict[Path, Links]) -> list[str]:
    """The files that pages load from other hosts, as texts "page: link"."""
    return [f"{path}: {link}" for path, page in pages.items() for link in page.loads if urlsplit(link).netloc]


def chosen(site: Path) -> list[str]:
    """The names of pages to look at: one page of every kind, all indices, and a random sample of the others."""
    names = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html") if "_static" not in path.parts)
    first = [next((n for n in names if n.startswith(f"{kind}/") and "index" not in n), None) for kind in KINDS]
    indices = [name for name in names if name.endswith("/index.html")]
    known = dict.fromkeys([*(n for n in ALONE if n in names), *filter(None, first), *indices])
    rest = [name for name in names if name not in known]
    return [*known, *random.Random(SEED).sample(rest, min(SAMPLE, len(rest)))]


def look(browser, width: int, theme: str) -> None:
    """Set the width of the browser's window in pixels, and the theme that it prefers, "light" or "dark"."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    features = [{"name": "prefers-color-scheme", "value": theme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def overhang(browser) -> int:
    """How many pixels the page is wider than its window."""
    return browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth")


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Links]:
    """Every page of the site, parsed once: path -> `Links`."""
    return parse(site.resolve())


def test_internal_links_hold(pages):
    assert len(pages) > SAMPLE
    assert broken(pages) == []


def test_a_broken_link_and_a_broken_anchor_are_found(tmp_path):
    (tmp_path / "a.html").write_text('<p id="x"></p><a href="b.html">1</a><a href="#y">2</a><a href="#x">3</a>')
    assert len(broken(parse(tmp_path))) == 2


def test_nothing_is_loaded_from_another_host(pages):
    assert external(pages) == []


def test_a_script_of_another_host_is_found(tmp_path):
    (tmp_path / "a.html").write_text('<script src="https://example.org/a.js"></script>')
    assert len(external(parse(tmp_path))) == 1


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1200, 400])
def test_no_page_scrolls_sideways(browser, address, site, width, theme):
    look(browser, width, theme)
    wide = {}
    for name in chosen(site):
        browser.get(f"{address}/{name}")
        WebDriverWait(browser, 10).until(lambda b: b.execute_script(THEME) == theme)
        if overhang(browser) > 0:
            wide[name] = overhang(browser)
    assert wide == {}


def test_a_wide_element_is_seen_to_scroll(browser, address):
    look(browser, 400, "light")
    browser.get(f"{address}/choose.html")
    browser.execute_script(
        "document.querySelector('main').insertAdjacentHTML('beforeend', '<div style=width:2000px>x</div>')"
    )
    assert overhang(browser) > 0


@pytest.mark.parametrize(("words", "found"), [("scheme-v", "methods/scheme-v.html"), ("qqqzzz", None)])
def test_search_finds_a_method(browser, address, words, found):
    browser.get(f"{address}/search.html?q={words}")
    summary = "return document.querySelector('#search-results .search-summary')?.textContent"
    WebDriverWait(browser, 20).until(lambda b: "earch" in (b.execute_script(summary) or ""))
    links = [a.get_attribute("href") for a in browser.find_elements(By.CSS_SELECTOR, "#search-results a")]
    assert any(found in link for link in links) if found else not links


def test_chooser_names_an_integrator_for_every_class(browser, address):
    browser.get(f"{address}/choose.html")
    kinds = [o.get_attribute("value") for o in Select(browser.find_element(By.ID, "choose-class")).options]
    commands = set()
    for kind in kinds:
        Select(browser.find_element(By.ID, "choose-class")).select_by_value(kind)
        assert browser.find_element(By.CSS_SELECTOR, "#choice .chosen").text
        commands.add(browser.find_element(By.CSS_SELECTOR, "#choice pre").text)
    assert len(commands) == len(kinds) >= 7
    assert all(command.startswith("phasebench integrate ") for command in commands)


def test_chooser_refers_to_advise_where_no_run_is_stored(browser, address):
    browser.get(f"{address}/choose.html")
    for field, value in (("class", "poisson"), ("keep", "energy"), ("accuracy", "1e-12")):
        Select(browser.find_element(By.ID, f"choose-{field}")).select_by_value(value)
    assert not browser.find_elements(By.CSS_SELECTOR, "#choice .chosen")
    assert browser.find_element(By.CSS_SELECTOR, "#choice pre").text.startswith(ADVISE)


def test_a_click_on_a_head_sorts_and_words_filter(browser, address):
    browser.get(f"{address}/methods/index.html")
    order = "return [...document.querySelectorAll('tbody tr:not([hidden]) td:nth-child(2)')].map((c) => +c.textContent)"
    browser.execute_script("document.querySelectorAll('thead th')[1].click()")
    values = browser.execute_script(order)
    assert values == sorted(values)
    browser.execute_script("document.querySelectorAll('thead th')[1].click()")
    assert browser.execute_script(order) == sorted(values, reverse=True)
    browser.find_element(By.CSS_SELECTOR, "input.filter").send_keys("yoshida")
    assert 0 < len(browser.execute_script(order)) < len(values)
