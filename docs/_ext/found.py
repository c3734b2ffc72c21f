"""What search engines and previews read: each page's description and picture, and a sitemap."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

PREVIEW = "_static/race.png"
LENGTH = 160  # characters of a description that search engines show


def description(doctree: nodes.document | None) -> str:
    """Return the first sentences of a page, at most `LENGTH` characters."""
    if doctree is None:
        return ""
    for paragraph in doctree.findall(nodes.paragraph):
        text = " ".join(paragraph.astext().split())
        inside = isinstance(paragraph.parent, (nodes.section, nodes.document))
        if inside and len(text) > 20:
            return text if len(text) <= LENGTH else f"{text[: LENGTH - 2].rsplit(' ', 1)[0]} …"
    return ""


def describe(
    app: Sphinx, name: str, template: str, context: dict[str, Any], doctree: nodes.document | None
) -> None:
    """Add a page's description and preview to its head."""
    if doctree is None:
        return
    base = app.config.html_baseurl
    picture = base + PREVIEW if base else context["pathto"](PREVIEW, resource=True)
    said = description(doctree)
    title = str(context.get("title", "")).replace("<", "").replace(">", "")
    entries = {"og:title": title, "og:description": said, "og:image": picture, "og:type": "article"}
    tags = [f'<meta property="{key}" content="{escape(text)}" />' for key, text in entries.items()]
    if said:
        tags.append(f'<meta name="description" content="{escape(said)}" />')
    tags.append('<meta name="twitter:card" content="summary_large_image" />')
    context["metatags"] = context.get("metatags", "") + "\n".join(tags)


def sitemap(app: Sphinx, error: Exception | None) -> None:
    """Write the addresses of all pages; without a base they are relative to the site."""
    if error or app.builder.name != "html":
        return
    base = app.config.html_baseurl
    pages = [f"{base}{app.builder.get_target_uri(name)}" for name in sorted(app.env.found_docs)]
    urls = "\n".join(f"  <url><loc>{escape(page)}</loc></url>" for page in pages)
    text = (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f'<urlset xmlns="http://www.sitemaps.org/schemas/sitemap/0.9">\n{urls}\n</urlset>\n'
    )
    (Path(app.outdir) / "sitemap.xml").write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Run where a page is written, and when all are."""
    app.connect("html-page-context", describe)
    app.connect("build-finished", sitemap)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
