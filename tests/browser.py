"""A headless Chromium for tests, driven through chromedriver's own protocol; tests skip where either is missing."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import urllib.request
from pathlib import Path
from typing import Any

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--autoplay-policy=no-user-gesture-required",
)

PLAY = """
const done = arguments[arguments.length - 1];
Promise.all([...document.querySelectorAll('video')].map(v => new Promise((yes, no) => {
  v.muted = true; v.loop = false;
  v.addEventListener('error', () => no('error ' + (v.error && v.error.message)));
  v.addEventListener('timeupdate', () => { if (v.currentTime > 0 && v.videoWidth > 0) yes(v.videoWidth); });
  v.play().catch(e => no(String(e)));
}))).then(widths => done(['played', widths])).catch(e => done(['failed', String(e)]));
"""
"""Plays every film of a page until its clock has moved."""


def found() -> bool:
    """Whether there is a browser to test with."""
    return all(shutil.which(name) for name in ("chromium", "chromedriver"))


class Browser:
    """One browser with a profile of its own; close it."""

    def __init__(self, profile: Path) -> None:
        self.driver = subprocess.Popen(
            ["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert self.driver.stdout is not None
        port = next(m[1] for line in self.driver.stdout if (m := re.search(r"on port ([1-9]\d*)", line)))
        self.root = f"http://127.0.0.1:{port}"
        self.opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        options = {"args": [*FLAGS, f"--user-data-dir={profile}"]}
        wanted = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        session = self.call("session", {"capabilities": {"alwaysMatch": wanted}})
        self.session = f"session/{session['sessionId']}"
        self.call(f"{self.session}/timeouts", {"script": 60_000, "pageLoad": 60_000})

    def call(self, path: str, body: object = None, method: str = "POST") -> Any:
        data = None if method != "POST" else json.dumps(body or {}).encode()
        request = urllib.request.Request(
            f"{self.root}/{path}", data, {"Content-Type": "application/json"}, method=method
        )
        with self.opener.open(request, timeout=90) as reply:
            return json.load(reply)["value"]

    def look(self, page: Path, width: int) -> tuple[list[str], list[Any], int, bytes]:
        """Open a page at that width: its complaints, how its films played, its own width, and a picture of it."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        self.cdp("Emulation.setDeviceMetricsOverride", size)
        self.call(f"{self.session}/url", {"url": page.resolve().as_uri()})
        played = self.call(f"{self.session}/execute/async", {"script": PLAY, "args": []})
        script = "return document.documentElement.scrollWidth"
        wide = self.call(f"{self.session}/execute/sync", {"script": script, "args": []})
        broken = "return [...document.images].filter(i => !i.naturalWidth).map(i => 'broken picture ' + i.alt)"
        words = self.call(f"{self.session}/execute/sync", {"script": broken, "args": []})
        words += [entry["message"] for entry in self.call(f"{self.session}/se/log", {"type": "browser"})]
        shot = self.cdp("Page.captureScreenshot", {"captureBeyondViewport": True})
        return words, played, wide, base64.b64decode(shot["data"])

    def cdp(self, command: str, parameters: dict[str, Any]) -> Any:
        return self.call(f"{self.session}/goog/cdp/execute", {"cmd": command, "params": parameters})

    def close(self) -> None:
        try:
            self.call(self.session, method="DELETE")
        finally:
            self.driver.terminate()
            self.driver.wait()
