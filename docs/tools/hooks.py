"""What MkDocs calls while it builds the site: generated text, equations as MathML, and a look at what was built.

A marker `<!-- generated: NAME -->` in a page is replaced by what `GENERATED[NAME]` returns.
"""

from __future__ import annotations

import html
import inspect
import re
import unicodedata
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from typer.testing import CliRunner

from jaxdem.cli.main import app
from jaxdem.closures import DRAG_LAWS

MARKER = re.compile(r"<!-- generated: (\w+) -->")
INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
STYLED = re.compile(r'<mi mathvariant="(bold|bold-italic|sans-serif)">([^<]+)</mi>')
LOADED = re.compile(r'<(?:script|img|iframe|source)\b[^>]*\bsrc="(?:https?:)?//|<link\b[^>]*rel="stylesheet"[^>]*//')


def command_line() -> str:
    """The help of every command as the terminal shows it."""
    terminal = CliRunner(env={"COLUMNS": "96", "NO_COLOR": "1", "TERM": "dumb"})
    parts = []
    for command in app.registered_commands:
        name = command.name or command.callback.__name__
        shown = terminal.invoke(app, [name, "--help"], prog_name="jaxdem")
        parts += [f"## `jaxdem {name}`", "", "```text", shown.output.strip("\n"), "```", ""]
    return "\n".join(parts)


def drag_laws() -> str:
    """Every drag law that a scene can name: equation, range and source from its docstring."""
    parts = []
    for name, law in DRAG_LAWS.items():
        first, _, rest = inspect.cleandoc(law.__doc__ or "").partition("\n\n")
        paragraphs = [html.escape(part, quote=False) for part in rest.split("\n\n")]
        text = [part.replace("*", "\\*").replace("_", "\\_") for part in paragraphs]
        parts += [f"## `{name}`", "", first, "", *(line for part in text for line in (part, ""))]
    return "\n".join(parts)


GENERATED = {"command_line": command_line, "drag_laws": drag_laws}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its generated parts."""
    return MARKER.sub(lambda match: GENERATED[match[1]](), markdown)


def in_style(match: re.Match[str]) -> str:
    """A letter of a style as its own Unicode letter: browsers no longer know the attribute `mathvariant`."""
    _, size, _, letter = unicodedata.name(html.unescape(match[2])).split()
    style = match[1].upper().replace("BOLD-ITALIC", "BOLD ITALIC")
    return f"<mi>{unicodedata.lookup(f'MATHEMATICAL {style} {size} {letter}')}</mi>"


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """The page with its equations as MathML, which browsers show without a script."""

    def rendered(match: re.Match[str], display: str) -> str:
        source = html.unescape(match[1])
        try:
            return STYLED.sub(in_style, convert(source, display=display))
        except Exception as error:  # the converter raises many kinds
            raise PluginError(f"{page.file.src_path}: cannot render {source!r}: {error!r}") from error

    content = BLOCK.sub(lambda match: rendered(match, "block"), content)
    return INLINE.sub(lambda match: rendered(match, "inline"), content)


def on_nav(nav: Any, files: Any, **_: Any) -> Any:
    """Refuses a page that nobody can find."""
    listed = {page.file.src_path for page in nav.pages}
    lost = [file.src_path for file in files.documentation_pages() if file.src_path not in listed]
    if lost:
        raise PluginError(f"not in the navigation of mkdocs.yml: {', '.join(lost)}")
    return nav


def on_post_build(config: Any, **_: Any) -> None:
    """Refuses a site that would load anything from elsewhere."""
    for path in Path(config.site_dir).rglob("*.html"):
        found = LOADED.search(path.read_text("utf-8"))
        if found:
            raise PluginError(f"{path.name} loads from the network: {found[0]}")
