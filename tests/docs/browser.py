#!/usr/bin/python3
"""Looks at every page of the documentation site in a browser, as a reader does who opens its files: nothing is missing, no script fails,
nothing is wider than a window of 360, 1000 or 1400 pixels but by a bar of its own, the switch of the theme works, and the search finds.
Ends with 77, skipped, where Chromium or the site is missing.

browser.py --site DIR/html [--screenshots DIR PAGE...]
browser.py --self-test      each check fails on a page made for it"""
import argparse
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import browser as browsers  # noqa: E402

WIDTHS = (360, 1000, 1400)
# What a reader cannot reach: parts that end beyond the window, neither in a box with a bar of its own nor in a drawer that is shut.
WIDE = r"""
(() => {
  const width = document.documentElement.clientWidth, faults = [];
  if (document.documentElement.scrollWidth > width + 1) faults.push("the page is " + document.documentElement.scrollWidth + " pixels wide");
  const scrolls = e => { for (; e && e !== document.body; e = e.parentElement) {
    const style = getComputedStyle(e);
    if (["auto", "scroll"].includes(style.overflowX) || style.position === "fixed" || style.visibility === "hidden") return true;
  } return false; };
  for (const e of document.querySelectorAll("body *")) {
    const r = e.getBoundingClientRect();
    if (r.width > 0 && r.height > 0 && r.right > width + 1 && !scrolls(e.parentElement) && getComputedStyle(e).position !== "fixed" && !e.closest("svg"))
      faults.push(e.tagName.toLowerCase() + " ends at " + Math.round(r.right) + ": " + e.textContent.trim().slice(0, 40));
  }
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = texts.nextNode());) {  // one word of a table's head on several lines
    const line = document.createRange();
    line.selectNodeContents(node);
    if (node.parentElement.closest("th") && !/[\s-]/.test(node.data.trim()) && new Set([...line.getClientRects()].map(r => Math.round(r.top))).size > 1)
      faults.push("a word is broken: " + node.data.trim());
  }
  return faults.slice(0, 3);
})()
"""
SHOWN_SWITCH = "[...document.querySelectorAll('.theme-toggle')].find(e => e.getBoundingClientRect().width > 0)"
THEME = "[document.body.dataset.theme, getComputedStyle(document.body).backgroundColor, getComputedStyle(document.querySelector('.highlight') || document.body).backgroundColor]"


def page_faults(browser, path, name):
    """Returns what is wrong with a page at any of the widths."""
    browser.troubles.clear()
    browser.resize(WIDTHS[-1])
    browser.open(path.as_uri())
    faults = []
    for width in WIDTHS:
        browser.resize(width)
        faults += [f"{name} at {width} pixels: {fault}" for fault in browser.value(WIDE)]
    faults += [f"{name}: {trouble}" for trouble in browser.troubles]
    return faults


def theme_faults(browser, path, other):
    """Returns what is wrong with the switch of the theme: from the colours of the system to dark, light and back, and on the next page."""
    browser.resize(WIDTHS[-1])
    browser.open(path.as_uri())
    if not browser.value(f"Boolean({SHOWN_SWITCH})"):
        return ["no switch of the theme is seen"]
    found = [browser.value(THEME)]
    for _ in range(3):
        browser.value(f"{SHOWN_SWITCH}.click()")
        found.append(browser.value(THEME))
    faults = [] if [theme for theme, *_ in found] == ["auto", "dark", "light", "auto"] else [f"the switch goes through {found}"]
    for part, what in ((1, "paper"), (2, "code")):
        if not (found[0][part] == found[2][part] == found[3][part] != found[1][part]):
            faults.append(f"the {what} of the themes is {[colours[part] for colours in found]}")
    browser.value(f"{SHOWN_SWITCH}.click()")
    browser.open(other.as_uri())
    if browser.value("document.body.dataset.theme") != "dark":
        faults.append("the next page forgets the theme")
    browser.value("localStorage.clear()")
    browser.resize(WIDTHS[-1], "dark")  # the colours of the system are those of the switch
    browser.open(path.as_uri())
    if browser.value(THEME)[1] != found[1][1]:
        faults.append(f"dark is {browser.value(THEME)[1]} by the system, {found[1][1]} by the switch")
    browser.resize(WIDTHS[-1])
    return faults


def search_faults(browser, site, words, page):
    """Returns what is wrong with the search for words that a page has, by the field at its side."""
    browser.troubles.clear()
    browser.open((site / "index.html").as_uri())
    browser.value(f"(() => {{ const field = document.querySelector('.sidebar-search'); field.value = '{words}'; field.form.submit(); }})()")
    if not browser.wait("location.pathname.endsWith('search.html') && document.querySelectorAll('#search-results li').length > 0"):
        return [f"the search for {words!r} finds nothing"] + browser.troubles
    browser.wait(f"[...document.querySelectorAll('#search-results a')].some(a => a.getAttribute('href').startsWith('{page}'))", 5.0)
    found = browser.value("[...document.querySelectorAll('#search-results a')].map(a => a.getAttribute('href'))")
    return [f"the search for {words!r} finds {found[:8]}, not {page}"] * (not any(link.startswith(page) for link in found)) + browser.troubles


def site_faults(site):
    with tempfile.TemporaryDirectory() as profile:
        browser = browsers.Browser(profile)
        try:
            pages = sorted(site.rglob("*.html"))
            faults = [fault for path in pages for fault in page_faults(browser, path, path.relative_to(site).as_posix())]
            faults += theme_faults(browser, site / "tutorials/couple.html", site / "reference/scene.html")
            for words, page in (("friction_coefficient", "reference/scene.html"), ("rollback", "reference/c.html"), ("drain", "reference/programs.html")):
                faults += search_faults(browser, site, words, page)
        finally:
            browser.close()
    print(f"{len(pages)} pages were looked at")
    return faults


def self_test():
    """Returns the checks that did not fail."""
    pages = {"<div style='width:1500px'>wide</div>": "1400 pixels: the page is", "<div style='overflow:hidden'><p style='width:1200px'>cut</p></div>": "1000 pixels: p ends at 12",
             "<article><table><tr><th style='width:1em;overflow-wrap:anywhere'><div style='width:1em'>broken</div>": "a word is broken: broken", "<script>import x from './x.js'</script>": "import", "<script>throw new Error('torn')</script>": "torn", "<link rel=stylesheet href=gone.css>": "gone.css was not loaded",
             "<style>@import url(/gone.css)</style>": "gone.css was not loaded", "<script>console.error('said')</script>": "said"}
    faults = []
    with tempfile.TemporaryDirectory() as scratch:
        browser, page = browsers.Browser(scratch + "/profile"), pathlib.Path(scratch, "page.html")
        try:
            for body, expected in {**pages, "<div style='overflow-x:auto'><pre style='width:3000px'>wide</pre></div>": ""}.items():
                page.write_text("<!DOCTYPE html><body style='margin:0'>" + body)
                found = " ".join(page_faults(browser, page, "page"))
                if expected not in found or bool(expected) != bool(found):
                    faults.append(f"self-test: expected {expected!r} of {body}, found {found!r}")
            page.write_text("<!DOCTYPE html><body data-theme=auto><button class=theme-toggle>switch</button>")
            if not theme_faults(browser, page, page):
                faults.append("self-test: a switch that does nothing was accepted")
        finally:
            browser.close()
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--site", type=pathlib.Path)
    parser.add_argument("--screenshots", type=pathlib.Path, help="keeps pictures of these pages")
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("pages", nargs="*")
    options = parser.parse_args()
    if not browsers.CHROMIUM.exists():
        print("skipped: chromium is missing")
        sys.exit(77)
    if options.self_test:
        faults = self_test()
        print("\n".join(faults) or "the checks of the pages can fail")
        sys.exit(bool(faults))
    if not (options.site / "index.html").is_file():
        print("skipped: there is no site; docs.site builds it")
        sys.exit(77)
    if options.screenshots:
        options.screenshots.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as profile:
            browser = browsers.Browser(profile)
            for page in options.pages:
                for width in WIDTHS:
                    browser.resize(width)
                    browser.open((options.site.resolve() / page).as_uri())
                    browser.screenshot(options.screenshots / f"{page.replace('/', '_')}-{width}.png", width, 1600)
            browser.close()
        return
    faults = site_faults(options.site.resolve())
    print("\n".join(faults))
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
