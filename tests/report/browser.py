"""A headless Chromium, driven over its debugging pipe: no library, no network, no port."""

import base64
import json
import os
import select
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager

# Only for a browser that hangs: however busy the machine is, the rest takes less.
_DEADLINE = 600.0

# The browser reads commands from 3 and writes answers to 4; either may be taken already.
_CONNECT = """
import fcntl, os, sys
commands, answers = (fcntl.fcntl(int(end), fcntl.F_DUPFD, 16) for end in sys.argv[1:3])
os.dup2(commands, 3)
os.dup2(answers, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Browser:
    """One page of a Chromium."""

    def __init__(self, process, write, read):
        self._process, self._write, self._read = process, write, read
        self._number, self._buffer, self._session = 0, b"", None
        self.console, self.requests = [], []
        self.shown = None

    def attach(self):
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def open(self, path, width=1360, height=900):
        """Show a file in a window of this size."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.call("Page.navigate", url=path.absolute().as_uri())
        self.wait("document.readyState === 'complete'")
        self.shown = path, width

    def run(self, expression):
        """Return the value of an expression in the page; a promise is waited for."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, condition):
        end = time.monotonic() + _DEADLINE
        while not self.run(condition):
            assert time.monotonic() < end, f"{condition} did not become true; {self.console}"
            time.sleep(0.1)

    def frames(self, count):
        """Wait until the page was drawn so many times."""
        self.run(
            f"new Promise(done => {{ let left = {count};"
            " const next = () => left-- > 0 ? requestAnimationFrame(next) : done(true);"
            " next(); })"
        )

    def screenshot(self, selector=None, whole=False):
        options = {"format": "png"}
        if selector:
            box = self.run(
                f"(() => {{ const e = document.querySelector({selector!r});"
                " e.scrollIntoView({behavior: 'instant'});"
                " const r = e.getBoundingClientRect(); return {x: r.x + scrollX, y: r.y + scrollY,"
                " width: r.width, height: r.height, scale: 1}; })()"
            )
            options |= {"clip": box, "captureBeyondViewport": True}
        if whole:
            size = self.call("Page.getLayoutMetrics")["cssContentSize"]
            options |= {"clip": {**size, "scale": 1}, "captureBeyondViewport": True}
        return base64.b64decode(self.call("Page.captureScreenshot", **options)["data"])

    def pdf(self):
        found = self.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
        return base64.b64decode(found["data"])

    def call(self, method, **parameters):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._message()
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self._note(answer)

    def _note(self, event):
        method, details = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.console.append(details["exceptionDetails"])
        elif method == "Runtime.consoleAPICalled" and details["type"] in ("error", "warning"):
            self.console.append([argument.get("value", argument) for argument in details["args"]])
        elif method == "Log.entryAdded" and details["entry"]["level"] in ("error", "warning"):
            self.console.append(details["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(details["request"]["url"].partition(",")[0])

    def _message(self):
        end = time.monotonic() + _DEADLINE
        while b"\0" not in self._buffer:
            left = end - time.monotonic()
            assert left > 0, "the browser does not answer"
            if select.select([self._read], [], [], left)[0]:
                part = os.read(self._read, 1 << 20)
                assert part, "the browser has ended"
                self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)


@contextmanager
def chromium(folder):
    """Start a Chromium with a profile of its own; it ends with the block."""
    to_browser, write = os.pipe()
    read, from_browser = os.pipe()
    command = [
        shutil.which("chromium"),
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--no-first-run",
        "--hide-scrollbars",
        "--force-color-profile=srgb",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--remote-debugging-pipe",
        f"--user-data-dir={folder / 'profile'}",
        "about:blank",
    ]

    process = subprocess.Popen(
        [sys.executable, "-c", _CONNECT, str(to_browser), str(from_browser), *command],
        pass_fds=(to_browser, from_browser),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "HOME": str(folder)},
        start_new_session=True,
    )
    os.close(to_browser)
    os.close(from_browser)
    try:
        browser = Browser(process, write, read)
        browser.attach()
        yield browser
    finally:
        os.close(write)
        process.terminate()
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        os.close(read)
