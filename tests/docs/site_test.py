#!/usr/bin/env python3
"""site_test.py: builds the site with mkdocs --strict and looks at its pages: nothing comes from the network, and every link
within the site leads to a file and a place in it. Exit status 77 without mkdocs, unless INTERFLECT_TEST_REQUIRE names it."""

import html.parser
import os
import shutil
import subprocess
import sys
import tempfile
import urllib.parse

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


class Page(html.parser.HTMLParser):
    """What a page loads, what it links to, and the places in it."""

    def __init__(self, text):
        super().__init__()
        self.loads, self.links, self.places = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if "id" in values:
            self.places.add(values["id"])
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        elif tag == "link" and values.get("rel") in ("stylesheet", "icon", "shortcut icon", "preload"):
            self.loads.append(values["href"])
        elif tag in ("script", "img", "iframe", "source", "video") and values.get("src"):
            self.loads.append(values["src"])


def complaints(site):
    pages = {}
    for folder, _, names in os.walk(site):
        for name in names:
            path = os.path.join(folder, name)
            if name.endswith(".html"):
                with open(path, encoding="utf-8") as file:
                    pages[path] = Page(file.read())
            elif name.endswith(".css"):
                with open(path, encoding="utf-8") as file:
                    text = file.read()
                if "url(http" in text or "url(//" in text or "@import" in text:
                    yield f"{name} loads from the network"
    for path, page in pages.items():
        if path.endswith("404.html"):
            continue  # for servers: its links begin at their root
        where = os.path.relpath(path, site)
        for address in page.loads + page.links:
            parts = urllib.parse.urlsplit(address)
            if parts.scheme or parts.netloc:
                if address in page.loads and parts.scheme != "data":
                    yield f"{where} loads {address}"
                continue
            target = os.path.normpath(os.path.join(os.path.dirname(path), urllib.parse.unquote(parts.path))) if parts.path else path
            if not os.path.isfile(target):
                yield f"{where}: {address} leads nowhere"
            elif parts.fragment and target in pages and parts.fragment not in pages[target].places:
                yield f"{where}: {address}: no such place"


def build(folder, source=ROOT):
    """The site of `source` in `folder`; what mkdocs said when it failed."""
    result = subprocess.run(["mkdocs", "build", "--strict", "--site-dir", folder, "--config-file",
                             os.path.join(source, "mkdocs.yml")], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                            check=False)
    return result.stdout or "failed" if result.returncode else ""


def main():
    if shutil.which("mkdocs") is None:
        print("SKIPPED: mkdocs is not installed")
        sys.exit(1 if "mkdocs" in os.environ.get("INTERFLECT_TEST_REQUIRE", "").split(",") else 77)
    with tempfile.TemporaryDirectory() as folder:
        site = os.path.join(folder, "site")
        wrong = [said for said in [build(site)] if said] or list(complaints(site))
        if wrong:
            sys.exit("\n".join(wrong))
        # A site that is broken in three ways, which must be found.
        source, other = os.path.join(folder, "source"), os.path.join(folder, "other")
        os.makedirs(os.path.join(source, "docs"))
        shutil.copy(os.path.join(ROOT, "mkdocs.yml"), source)
        shutil.copytree(os.path.join(ROOT, "scripts"), os.path.join(source, "scripts"))
        with open(os.path.join(source, "mkdocs.yml"), "a", encoding="utf-8") as file:
            file.write("extra_javascript: ['https://example.com/x.js']\n")
        shutil.copytree(os.path.join(ROOT, "docs"), os.path.join(source, "docs"), dirs_exist_ok=True)
        with open(os.path.join(source, "docs", "index.md"), "a", encoding="utf-8") as file:
            file.write("\n[there](tutorial.md#nowhere)\n\n<a href='absent.html'>there</a>\n")
        assert not build(other, source)
        found = "\n".join(complaints(other))
        for part in ("loads https://example.com/x.js", "tutorial.html#nowhere: no such place", "absent.html leads nowhere"):
            assert part in found, f"not found: {part}, but:\n{found}"
        with open(os.path.join(source, "docs", "index.md"), "a", encoding="utf-8") as file:
            file.write("\n[there](absent.md)\n")
        assert "absent.md" in build(other, source), "mkdocs --strict takes a link to a page that is not there"
    print("the site builds")


if __name__ == "__main__":
    main()
