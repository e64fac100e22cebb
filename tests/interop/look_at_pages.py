#!/usr/bin/env python3
"""Opens pages in headless Chromium on a screen and a phone, light and dark, and on paper, keeps a picture of each, and checks what a
program can see.

usage: look_at_pages.py --pictures FOLDER PAGE.html...

Checked in every way of looking: nothing is wider than the page, no text of a drawing is printed over another, text
stands out from what is behind it (WCAG 2.1: 4.5 to 1, large text 3 to 1), every drawing and every control has a name,
what can be clicked can be reached by keyboard, and the console is free of errors. Without --pictures only the findings
are printed. Needs Chromium (CHROMIUM, default `chromium` on the PATH) and nothing but Python's library.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

# Width [px], colours, medium; paper is A4 with margins of 10 mm.
WAYS = ((1400, "light", "screen"), (1400, "dark", "screen"), (390, "light", "screen"), (390, "dark", "screen"), (718, "light", "print"))
TALLEST = 12_000

# Runs in the page; returns sentences.
LOOK = r"""
(() => {
  const found = [];
  const shown = (e) => { const r = e.getBoundingClientRect(); const s = getComputedStyle(e);
    return r.width > 0 && r.height > 0 && s.visibility !== 'hidden' && s.display !== 'none' && +s.opacity > 0; };
  const named = (e) => `<${e.tagName.toLowerCase()}${e.id ? '#' + e.id : ''}> ${(e.textContent || '').trim().slice(0, 40)}`;
  const root = document.documentElement;
  if (root.scrollWidth > root.clientWidth + 1) {
    const wide = [...document.body.querySelectorAll('*')].filter((e) => shown(e) && e.getBoundingClientRect().right > root.clientWidth + 1
      && ![...ancestors(e)].some((a) => ['auto', 'scroll', 'hidden', 'clip'].includes(getComputedStyle(a).overflowX)));
    found.push(`wider than the page: ${root.scrollWidth} of ${root.clientWidth} px: ${wide.slice(0, 3).map(named).join('; ')}`);
  }
  function* ancestors(e) { for (let a = e.parentElement; a && a !== document.body; a = a.parentElement) yield a; }
  // Text of a drawing over text of the same drawing.
  for (const svg of document.querySelectorAll('svg')) {
    const texts = [...svg.querySelectorAll('text')].filter((t) => t.textContent.trim() && shown(t));
    const boxes = texts.map((t) => t.getBoundingClientRect());
    for (let i = 0; i < texts.length; i++) for (let j = i + 1; j < texts.length; j++) {
      const [a, b] = [boxes[i], boxes[j]];
      const w = Math.min(a.right, b.right) - Math.max(a.left, b.left), h = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (w > 2 && h > 0.35 * Math.min(a.height, b.height)) found.push(`overprinted: "${texts[i].textContent}" and "${texts[j].textContent}"`);
    }
  }
  // Contrast.
  const parse = (c) => { const m = c.match(/[\d.]+(?:e-?\d+)?/g).map(Number);
    // Mixed colours are written as shares of one.
    if (c.startsWith('color(')) for (let k = 0; k < 3; k++) m[k] *= 255;
    return { rgb: m.slice(0, 3), a: m[3] ?? 1 }; };
  const light = (rgb) => { const [r, g, b] = rgb.map((v) => { v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const behind = (e) => { for (let a = e; a; a = a.parentElement) { const c = parse(getComputedStyle(a).backgroundColor); if (c.a > 0.5) return c.rgb; }
    return matchMedia('(prefers-color-scheme: dark)').matches && getComputedStyle(root).colorScheme.includes('dark') ? [18, 18, 18] : [255, 255, 255]; };
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const told = new Set();
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const e = node.parentElement;
    if (!node.textContent.trim() || !e || ['SCRIPT', 'STYLE', 'OPTION', 'TITLE', 'DESC'].includes(e.tagName.toUpperCase()) || !shown(e)) continue;
    if (e.closest('[disabled], [aria-hidden=true]')) continue;
    const s = getComputedStyle(e), ink = parse(e instanceof SVGElement ? s.fill : s.color);
    const [a, b] = [light(ink.rgb), light(behind(e))].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05), large = parseFloat(s.fontSize) >= 24 || (parseFloat(s.fontSize) >= 18.66 && +s.fontWeight >= 700);
    const key = `${s.color} ${behind(e)}`;
    if (ratio < (large ? 3 : 4.5) && !told.has(key)) { told.add(key); found.push(`contrast ${ratio.toFixed(1)} of ${named(e)}`); }
  }
  // Names of drawings and controls.
  const name = (e) => e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || e.title || e.alt || e.querySelector?.('title')?.textContent
    || (e.labels && e.labels.length ? e.labels[0].textContent : '') || (['BUTTON', 'A', 'SUMMARY'].includes(e.tagName) ? e.textContent : '');
  for (const e of document.querySelectorAll('svg, canvas, img, [role=img], input, select, button, a[href]'))
    if (shown(e) && !(name(e) || '').trim() && !e.closest('[role=img], [aria-hidden=true]')?.matches(':not(svg):not(canvas)') && !e.parentElement.closest('svg'))
      found.push(`without a name: ${named(e)}`);
  for (const e of document.querySelectorAll('[onclick], [role=button], th[data-sort]'))
    if (shown(e) && e.tabIndex < 0 && !e.querySelector('button, a[href]')) found.push(`not reachable by keyboard: ${named(e)}`);
  return found;
})()
"""


class Browser:
    """Chromium at the other end of a pair of pipes (--remote-debugging-pipe)."""

    def __init__(self, profile: str, reached: tuple[str, ...] = ()) -> None:
        """Of all hosts only those in `reached` are found."""
        program = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
        if program is None:
            sys.exit("chromium is not installed")
        commands, answers = os.pipe(), os.pipe()
        for fd in (commands[0], answers[1]):
            os.set_inheritable(fd, True)
        wanted = f'exec "$@" 3<&{commands[0]} 4>&{answers[1]}'
        self.process = subprocess.Popen(
            ["sh", "-c", wanted, "sh", program, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--hide-scrollbars", "--no-first-run", f"--user-data-dir={profile}", "--remote-debugging-pipe",
             "--host-resolver-rules=" + ", ".join(["MAP * ~NOTFOUND", *(f"EXCLUDE {host}" for host in reached)])],
            close_fds=False, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        )
        os.close(commands[0])
        os.close(answers[1])
        self.commands, self.answers = os.fdopen(commands[1], "wb"), os.fdopen(answers[0], "rb")
        self.rest, self.number, self.events = b"", 0, []

    def message(self) -> dict:
        while b"\0" not in self.rest:
            more = os.read(self.answers.fileno(), 1 << 20)
            if not more:
                sys.exit("chromium has ended")
            self.rest += more
        first, self.rest = self.rest.split(b"\0", 1)
        return json.loads(first)

    def call(self, method: str, session: str | None = None, **parameters) -> dict:
        self.number += 1
        request = {"id": self.number, "method": method, "params": parameters}
        if session:
            request["sessionId"] = session
        self.commands.write(json.dumps(request).encode() + b"\0")
        self.commands.flush()
        while True:
            message = self.message()
            if message.get("id") == self.number:
                if "error" in message:
                    sys.exit(f"{method}: {message['error']}")
                return message["result"]
            self.events.append(message)

    def value(self, session: str, expression: str):
        result = self.call("Runtime.evaluate", session, expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            sys.exit(f"{result['exceptionDetails']}")
        return result["result"].get("value")


def look(browser: Browser, page: Path, pictures: Path | None) -> list[str]:
    findings = []
    for width, colours, medium in WAYS:
        way = f"{width}_{colours if medium == 'screen' else medium}"
        target = browser.call("Target.createTarget", url="about:blank")["targetId"]
        session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        browser.events.clear()
        browser.call("Runtime.enable", session)
        browser.call("Page.enable", session)
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        browser.call("Emulation.setDeviceMetricsOverride", session, **size)
        browser.call("Emulation.setEmulatedMedia", session, media=medium,
                     features=[{"name": "prefers-color-scheme", "value": colours}])
        browser.call("Page.navigate", session, url=page.resolve().as_uri())
        browser.value(session, "new Promise((r) => document.readyState === 'complete' ? r() : addEventListener('load', r))")
        browser.value(session, "new Promise((r) => setTimeout(r, 400))")
        height = min(browser.value(session, "Math.ceil(document.documentElement.scrollHeight)"), TALLEST)
        # Plots draw themselves when they come into view.
        browser.call("Emulation.setDeviceMetricsOverride", session, **{**size, "height": max(900, height)})
        drawn = "!document.getElementById('data') || document.body.dataset.drawn"
        browser.value(session, f"new Promise(async (r) => {{ for (let k = 0; k < 100 && !({drawn}); k++) await new Promise((s) => setTimeout(s, 100)); setTimeout(r, 500); }})")
        for said in browser.value(session, LOOK):
            findings.append(f"{page.name} {way}: {said}")
        for event in browser.events:
            if event.get("method") == "Runtime.exceptionThrown":
                findings.append(f"{page.name} {way}: console: {event['params']['exceptionDetails'].get('text')}")
        if pictures is not None:
            shot = browser.call("Page.captureScreenshot", session, format="png")
            (pictures / f"{page.stem}_{way}.png").write_bytes(base64.b64decode(shot["data"]))
        browser.call("Target.closeTarget", targetId=target)
    return findings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    findings = []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(profile)
        for page in arguments.pages:
            findings += look(browser, page, arguments.pictures)
        browser.call("Browser.close")
        browser.process.wait(timeout=30)
    for finding in findings:
        print(finding)
    print(f"{len(arguments.pages)} pages, {len(WAYS)} ways of looking: {len(findings)} findings")
    sys.exit(bool(findings))


if __name__ == "__main__":
    main()
