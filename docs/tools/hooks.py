"""What MkDocs calls while it builds the site: generated text, equations as MathML, and a look at what was built.

A marker `<!-- generated: NAME -->` in a page is replaced by what `GENERATED[NAME]` returns.
"""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path
from typing import Any

import typer
from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

sys.path.insert(0, str(Path(__file__).parent))

import scene_reference  # noqa: E402 - beside this file

MARKER = re.compile(r"<!-- generated: (\w+) -->")
INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
LOADED = re.compile(r'<(?:script|img|iframe|source)\b[^>]*\bsrc="(?:https?:)?//|<link\b[^>]*rel="stylesheet"[^>]*//')


def command_line() -> str:
    """The help of every command, as the terminal shows it to a program that reads it."""
    from jaxdem.cli import app

    group = typer.main.get_command(app)
    parts = []
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        context = command.make_context(name, [], resilient_parsing=True)
        usage = " ".join(command.collect_usage_pieces(context))
        parts += [f"## `jaxdem {name}`", "", f"    jaxdem {name} {usage}", "", command.help or "", ""]
        parts += ["| argument | meaning | default |", "| --- | --- | --- |"]
        for parameter in command.params:
            label = parameter.opts[-1] if parameter.opts[-1].startswith("--") else ""
            label = " ".join(word for word in (label, parameter.make_metavar(context)) if word)
            unset = parameter.required or not parameter.default or callable(parameter.default)
            default = "required" if parameter.required else "" if unset else f"`{parameter.default}`"
            parts.append(f"| `{label}` | {getattr(parameter, 'help', '') or ''} | {default} |")
        parts.append("")
    return "\n".join(parts)


GENERATED = {"scene_keys": scene_reference.markdown, "command_line": command_line}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its generated parts."""
    return MARKER.sub(lambda match: GENERATED[match[1]](), markdown)


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """The page with its equations as MathML, which browsers show without a script."""

    def rendered(match: re.Match[str], display: str) -> str:
        source = html.unescape(match[1])
        try:
            return convert(source, display=display)
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
