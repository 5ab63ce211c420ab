"""A built site needs no network, has no dead links, and is found by the words of its users: `python docs/_ext/check.py out/site`;
exit code 1 where it is not so."""

from __future__ import annotations

import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

#: what a page loads by itself, by element
LOADED = {"script": "src", "img": "src", "source": "src", "video": "src", "iframe": "src", "link": "href"}
#: words that engineers type into the search
WORDS = ("latch backlash motor spring damper pid cable limit stop hinge bearing wear gear units csv video jacobian "
         "eigenfrequency belt brake rope friction contact clearance controller frequency")
ELSEWHERE = re.compile(r"(https?:)?//")


class Page(HTMLParser):
    """Anchors, links and loaded files of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect."""
        given = dict(attrs)
        self.anchors |= {value for name in ("id", "name") if (value := given.get(name))}
        if tag == "a" and given.get("href"):
            self.links.append(str(given["href"]))
        elif target := given.get(LOADED.get(tag, "")):
            self.loads.append(str(target))


def wrong(site: Path) -> list[str]:
    """Everything that leads nowhere or elsewhere."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    found = []
    for path, page in pages.items():
        here = path.relative_to(site.resolve())
        found += [f"{here} loads {target}" for target in page.loads if ELSEWHERE.match(target)]
        for target in page.links + page.loads:
            parts = urlsplit(target)
            if parts.scheme or target.startswith("//"):
                continue
            there = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not there.exists():
                found.append(f"{here} links to {target}")
            elif parts.fragment and there in pages and unquote(parts.fragment) not in pages[there].anchors | {"top"}:
                found.append(f"{here} links to {target}: no such anchor")
    styles = (path for path in site.rglob("*.css") if re.search(r"url\(\s*['\"]?(https?:)?//", path.read_text(encoding="utf-8")))
    return found + [f"{path.relative_to(site)} loads from elsewhere" for path in styles]


def unfound(site: Path) -> list[str]:
    """Words that no sentence of the site has: the index of its search holds their stems."""
    from sphinx.search.en import SearchEnglish

    text = (site / "searchindex.js").read_text(encoding="utf-8")
    index, stem = json.loads(text[text.index("(") + 1 : text.rindex(")")]), SearchEnglish({}).stem
    return [f"the search does not find '{word}'" for word in WORDS.split() if stem(word) not in index["terms"]]


if __name__ == "__main__":
    problems = wrong(Path(sys.argv[1])) + unfound(Path(sys.argv[1]))
    print("\n".join(problems) or f"{sum(1 for _ in Path(sys.argv[1]).rglob('*.html'))} pages, every link leads somewhere")
    sys.exit(bool(problems))
