"""Fixtures for tests of the site: its folder, the address of a server of it, and a browser without a window."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)


class Quiet(SimpleHTTPRequestHandler):
    """A request handler that serves files and logs nothing."""

    def log_message(self, *args: object) -> None:
        """Print nothing."""


@pytest.fixture(scope="session")
def site() -> Path:
    """The folder of the built site, from the environment variable PHASEBENCH_SITE, by default build/site."""
    folder = Path(os.environ.get("PHASEBENCH_SITE", "build/site"))
    if not (folder / "index.html").exists():
        pytest.fail(f"{folder} has no index.html: build the site first (python -m sphinx -W -b html docs {folder})")
    return folder


@pytest.fixture(scope="session")
def address(site: Path) -> Iterator[str]:
    """The address of a local server of the site, such as http://127.0.0.1:8000, while the tests run."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


@pytest.fixture(scope="session")
def browser(tmp_path_factory) -> Iterator[webdriver.Chrome]:
    """Chromium driven by Selenium, without a window, with an empty profile."""
    options = webdriver.ChromeOptions()
    for flag in FLAGS.split():
        options.add_argument(flag)
    options.add_argument(f"--user-data-dir={tmp_path_factory.mktemp('profile')}")
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    if not options.binary_location or not shutil.which("chromedriver"):
        pytest.fail("chromium and chromedriver are needed (Debian: chromium, chromium-driver)")
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    yield driver
    driver.quit()
