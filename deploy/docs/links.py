#!/usr/bin/python3
"""Checks every link inside of a site of HTML pages, with its anchor: links.py DIR. Links to other hosts are not followed."""
import html.parser
import pathlib
import sys
import urllib.parse


class Page(html.parser.HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.anchors, self.links = set(), []
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.anchors |= {values[name] for name in ("id", "name") if values.get(name)}
        self.links += [values[name] for name in ("href", "src") if values.get(name)]


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    pages = {path: Page(path) for path in root.rglob("*.html")}
    dead, checked = [], 0
    for path, page in pages.items():
        for link in page.links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme not in ("", "http", "https", "mailto", "data"):  # an endpoint in a text, such as file://path, is no link
                dead.append(f"{path.relative_to(root)}: dead link {link}")
            if parts.scheme or parts.netloc:
                continue
            checked += 1
            target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            anchor = urllib.parse.unquote(parts.fragment)
            if not target.is_file() or (anchor and target in pages and anchor not in pages[target].anchors):
                dead.append(f"{path.relative_to(root)}: dead link {link}")
    print("\n".join(dead) if dead else f"{len(pages)} pages, {checked} links inside of the site, none dead")
    sys.exit(bool(dead) or not pages or not checked)


if __name__ == "__main__":
    main()
