"""Still pictures of a race, for where nothing moves: `NAME.png`, and of a phone `NAME-phone.png`.

Each is there for dark pages too, `NAME-dark.png`.

trajopt race six-axis --seeds 30 --out race.html
python tests/race_pictures.py race.html docs/_static
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import browser as chromium

SIZES = {"": (1040, 1.5), "-phone": (390, 2.0)}  # width, px, and pixels of the picture per px
AT = 1.2  # s
READY = """while (!document.querySelector(".race").dataset.ready)
    await new Promise((go) => setTimeout(go, 20));
for (const own of [".race-controls", ".race-yours"]) document.querySelector(own).hidden = true;
document.documentElement.style.overflow = "hidden";
return document.documentElement.scrollHeight;"""


def main(page: Path, folder: Path) -> None:
    with tempfile.TemporaryDirectory() as profile, chromium.opened(Path(profile)) as browser:
        for scheme, ending in (("light", ""), ("dark", "-dark")):
            for kind, (width, scale) in SIZES.items():
                chromium.prefer(browser, scheme)
                chromium.resize(browser, width, 600, scale)
                browser.get("about:blank")
                browser.get(f"{page.absolute().as_uri()}#{AT}")
                height = chromium.run(browser, READY)
                chromium.resize(browser, width, height, scale)
                file = folder / f"{page.stem}{kind}{ending}.png"
                file.write_bytes(browser.get_screenshot_as_png())


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
