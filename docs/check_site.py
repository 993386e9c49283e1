"""Checks the built site: `python docs/check_site.py site`. Needs nothing but Python.

Every link and picture of every page must lead to a file of the site, every `#part` to an element
there, and no page may load anything (scripts, styles, fonts, pictures) from another server.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlparse

#: Attributes by tag that the browser loads by itself.
LOADED = {"img": "src", "script": "src", "link": "href", "iframe": "src", "source": "src"}
#: Relations of `<link>` that load nothing.
NAMED_ONLY = {"canonical", "prev", "next", "alternate"}


class Page(HTMLParser):
    """Links, loaded files and ids of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes what a tag refers to."""
        given = dict(attrs)
        for name in ("id", "name"):
            if given.get(name):
                self.ids.add(str(given[name]))
        if tag == "a" and given.get("href"):
            self.links.append(str(given["href"]))
        target = given.get(LOADED.get(tag, ""))
        if target and not NAMED_ONLY & set((given.get("rel") or "").split()):
            self.loads.append(target)


def problems(site: Path) -> Iterator[str]:
    """One line a problem."""
    files = [path for path in site.rglob("*.html") if "rust" not in path.relative_to(site).parts]
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in files}
    for path, page in pages.items():
        here = path.relative_to(site.resolve())
        if here.name == "404.html":  # Its links are those of the server's root.
            continue
        for target in page.loads:
            if urlparse(target).netloc:
                yield f"{here} loads {target}"
        for target in [*page.links, *page.loads]:
            parts = urlparse(target)
            if parts.scheme or parts.netloc:
                continue
            file, part = urldefrag(target)
            found = (path.parent / unquote(file)).resolve() if file else path
            if found.is_dir():
                found /= "index.html"
            if not found.is_file():
                yield f"{here} links to {target}, which is not there"
            elif part and found in pages and unquote(part) not in pages[found].ids:
                yield f"{here} links to {target}, which has no such part"


if __name__ == "__main__":
    found = sorted(set(problems(Path(sys.argv[1]))))
    print(
        "\n".join(found)
        or f"{sys.argv[1]}: every link leads somewhere, nothing is loaded from elsewhere"
    )
    sys.exit(bool(found))
