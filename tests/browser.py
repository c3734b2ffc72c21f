"""A page in headless Chromium, offline, at the sizes of the screens that people have."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from trajopt.core.exceptions import MissingBackend

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-prefers-reduced-motion",
    "--window-size=1280,900",
)
PROGRAMS = {"chromium": "chromium", "chromium-driver": "chromedriver"}  # package: its program
PHONE_WIDTH = 640  # px: below it a screen is a phone's

READY = """while (!document.documentElement.dataset.ready)
    await new Promise((go) => setTimeout(go, 20));"""


def missing() -> str:
    """List what must be installed before a page can be opened."""
    absent = [package for package, program in PROGRAMS.items() if shutil.which(program) is None]
    if not absent:
        return ""
    return f"needs a browser: apt install {' '.join(absent)}"


@contextmanager
def opened(profile: Path) -> Iterator[Any]:
    """A driver of Chromium, which keeps what it must in the folder `profile`, and its logs.

    Raises `MissingBackend` without selenium.
    """
    try:
        from selenium import webdriver
    except ImportError as error:
        raise MissingBackend("selenium", "test") from error
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which(PROGRAMS["chromium"]) or ""
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(shutil.which(PROGRAMS["chromium-driver"]))
    driver = webdriver.Chrome(options=options, service=service)
    try:
        yield driver
    finally:
        driver.quit()


def run(browser: Any, text: str, *arguments: Any) -> Any:
    """Run asynchronous JavaScript and return its value: `text` is the body of a function."""
    body = f"const done = arguments[arguments.length - 1]; (async (...args) => {{ {text} }})"
    return browser.execute_async_script(f"{body}(...arguments).then(done)", *arguments)


def resize(browser: Any, width: int, height: int, scale: float = 1.0) -> None:
    """Give the page a screen of so many pixels; a narrow one is a phone's."""
    size = {
        "width": width,
        "height": height,
        "deviceScaleFactor": scale,
        "mobile": width < PHONE_WIDTH,
    }
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def leave_size(browser: Any) -> None:
    """Give the page the window's own size again."""
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def prefer(browser: Any, scheme: str) -> None:
    """Prefer `"light"` or `"dark"` pages, or with `""` neither."""
    wish = {"name": "prefers-color-scheme", "value": scheme}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": [wish]})
