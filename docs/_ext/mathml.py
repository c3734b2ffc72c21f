"""Write formulas as MathML, which browsers draw without a script from a network.

`\\tag{1.2}` numbers an equation, and `(1.2)` in the text of the mathematics is a link to it.
"""

from __future__ import annotations

import re
from itertools import pairwise

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.writers.html5 import HTML5Translator

TAG = re.compile(r"\s*\\tag\{([\d.]+)\}\s*$")
CITED = re.compile(r"\((\d+\.\d+)\)")
OPENING = ("{", r"\left", r"\begin")
CLOSING = ("}", r"\right", r"\end")
SPACES = (r"\quad", r"\qquad")
TOKEN = re.compile(r"\\[a-zA-Z]+|\\.|[{}=]")
MATHEMATICS = "mathematics"  # the page and the folder whose citations are links


def inline(writer: HTML5Translator, node: nodes.math) -> None:
    """Write a formula within a line."""
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def block(writer: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula on a line of its own, with its number where it has one."""
    text = node.astext()
    found = TAG.search(text)
    number = f'<span class="eqno">({found[1]})</span>' if found else ""
    place = f' id="{anchor(found[1])}"' if found else ""
    formula = "".join(convert(part, display="block") for part in parts(TAG.sub("", text)))
    writer.body.append(
        f'<div class="math numbered"{place}><div class="formula">{formula}</div>{number}</div>'
    )
    raise nodes.SkipNode


def parts(text: str) -> list[str]:
    """Return what may stand on a line of its own: between wide spaces, or from a first relation."""
    depth = 0
    ends = []
    relation = None
    for found in TOKEN.finditer(text):
        token = found[0]
        depth += token in OPENING
        depth -= token in CLOSING
        if depth == 0 and token in SPACES:
            ends.append(found.end())
        if depth == 0 and token == "=" and relation is None:
            relation = found.start()
    if not ends and relation:
        ends = [relation]
    return [text[start:end] for start, end in pairwise([0, *ends, len(text)])]


def anchor(number: str) -> str:
    """Return the place of an equation in its page."""
    return f"equation-{number.replace('.', '-')}"


def equations(env: BuildEnvironment) -> dict[str, str]:
    """Return the page of each numbered equation."""
    found: dict[str, str] = {}
    for name in env.found_docs:
        if name.startswith(MATHEMATICS):
            for node in env.get_doctree(name).findall(nodes.math_block):
                tag = TAG.search(node.astext())
                if tag:
                    found[tag[1]] = name
    return found


def link(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Turn `(1.2)` into a link to the equation."""
    if not name.startswith(MATHEMATICS):
        return
    pages = equations(app.env)
    for text in list(doctree.findall(nodes.Text)):
        if isinstance(text.parent, (nodes.literal, nodes.math, nodes.math_block)):
            continue
        parts: list[nodes.Node] = []
        for place, part in enumerate(CITED.split(text)):
            if place % 2 and part in pages:
                target = app.builder.get_relative_uri(name, pages[part]) + f"#{anchor(part)}"
                parts.append(nodes.reference("", f"({part})", refuri=target, internal=True))
            elif part:
                parts.append(nodes.Text(f"({part})" if place % 2 else part))
        if len(parts) > 1:
            text.parent.replace(text, parts)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register both as the page's renderer of formulas, and the links."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.config.html_math_renderer = "mathml"
    app.connect("doctree-resolved", link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
