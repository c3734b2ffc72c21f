"""One browser for all pages that are tested in one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import browser as chromium
import pytest


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    if missing := chromium.missing():
        (pytest.fail if os.environ.get("TRAJOPT_BROWSER") == "required" else pytest.skip)(missing)
    pytest.importorskip("selenium.webdriver")
    with chromium.opened(tmp_path_factory.mktemp("profile")) as driver:
        yield driver
