"""Hooks of MkDocs for the site (mkdocs.yml): which files are pages, and what is generated.

The site has the paths of the repository, so that one relative link serves both: README.md, docs/, data/README.md and
notebooks/ lie where they lie here. Generated pages are below ``reference/``.
"""

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pymdownx.slugs import slugify

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from docs.site.api import api_pages  # noqa: E402
from docs.site.commands import command_pages  # noqa: E402
from docs.site.flowcharts import svg  # noqa: E402
from docs.site.notebook_pages import notebook_page  # noqa: E402
from docs.site.tables import StackedTables  # noqa: E402

OUTSIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "data/README.md", "LICENSE", "CITATION.cff")
"""Files outside ``docs`` that pages lead to, besides the notebooks."""
FOREIGN = re.compile(r'<(?:script|link|img|iframe|source)\b[^>]*\b(?:src|href)="?(?:https?:)?//[^>]*>')
"""What a browser would load from another host."""


class NotebookFile(File):
    """A notebook, which is a page like those in Markdown."""

    def is_documentation_page(self) -> bool:
        """Tell that it is a page."""
        return True


def on_config(config: MkDocsConfig) -> None:
    """Set what mkdocs.yml cannot say without naming Python objects: names of anchors, flowcharts, tables."""
    config.mdx_configs.setdefault("toc", {})["slugify"] = slugify(case="lower")  # the anchors of forges
    fence = {"name": "mermaid", "class": "flowchart", "format": flowchart}
    config.mdx_configs.setdefault("pymdownx.superfences", {})["custom_fences"] = [fence]
    config.markdown_extensions.append(StackedTables())


def flowchart(source: str, *_: Any, **__: Any) -> str:  # noqa: ANN401 - what the Markdown extension passes on
    """Return the HTML of a block of Mermaid."""
    return f"<figure>{svg(source)}</figure>"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Give all files the paths of the repository, and add those outside ``docs`` and the generated ones."""
    docs = Path(config.docs_dir)
    kept = [file for file in files if file.src_dir != config.docs_dir]
    for file in files.src_uris.values():
        if file.src_dir == config.docs_dir:
            kept.append(repository_file(f"{docs.name}/{file.src_uri}", config, file.inclusion))
    kept += [repository_file(path, config) for path in OUTSIDE if (ROOT / path).exists()]
    generated: dict[str, str | bytes] = {**api_pages(), **command_pages()}
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        text, pictures = notebook_page(notebook, "notebooks")
        kept.append(NotebookFile.generated(config, f"notebooks/{notebook.name}", content=text))
        generated |= pictures
    kept += [File.generated(config, path, content=content) for path, content in generated.items()]
    return Files(kept)


def repository_file(path: str, config: MkDocsConfig, *inclusion: Any) -> File:  # noqa: ANN401 - passed on to MkDocs
    """Return a file of the repository under its own path."""
    options = {"inclusion": inclusion[0]} if inclusion else {}
    return File(path, str(ROOT), config.site_dir, config.use_directory_urls, **options)


def on_page_markdown(markdown: str, page: Page, **_: Any) -> None:  # noqa: ANN401 - what MkDocs tells besides
    """Leave out the empty column of navigation beside the first page."""
    if page.is_homepage:
        page.meta["hide"] = ["navigation"]


def on_post_build(config: MkDocsConfig) -> None:
    """Check that no page loads anything from another host.

    Raises:
        PluginError: If a page does.
    """
    for page in sorted(Path(config.site_dir).rglob("*.html")):
        if found := FOREIGN.search(page.read_text()):
            raise PluginError(f"{page.name} loads from another host: {found[0]}")
