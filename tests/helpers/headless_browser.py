"""Chromium without a window, spoken to in its DevTools protocol over two pipes: no library, no port."""
import json
import os
import shutil
import subprocess
import time
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = ("--headless", "--no-sandbox", "--remote-debugging-pipe", "--hide-scrollbars", "--disable-gpu-sandbox",
           "--disable-background-networking", "--disable-component-update", "--no-first-run", "--mute-audio",
           "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
TIMEOUT = 60.0  # s


def find_browser() -> str | None:
    """Return the path of a browser; None where there is none."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Browser:
    """One page in a browser.

    Attributes
    ----------
    events : what the browser has told on its own so far, name and parameters.
    """

    def __init__(self, path: str, profile: Path):
        (read_by_it, self._to), (self._from, written_by_it) = os.pipe(), os.pipe()
        # The protocol has 3 for what the browser reads and 4 for what it writes.
        shell = f'exec "$0" "$@" 3<&{read_by_it} 4>&{written_by_it}'
        self._process = subprocess.Popen(
            ["bash", "-c", shell, path, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(read_by_it, written_by_it), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(read_by_it)
        os.close(written_by_it)
        os.set_blocking(self._from, False)
        self.events: list[tuple[str, dict]] = []
        self._count, self._rest, self._session = 0, b"", None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters):
        """Call a method of the protocol and return its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + TIMEOUT
        while time.monotonic() < end:
            for answer in self._messages():
                if answer.get("id") == self._count:
                    assert "error" not in answer, answer["error"]
                    return answer["result"]
                if "method" in answer:
                    self.events.append((answer["method"], answer["params"]))
        raise TimeoutError(f"the browser did not answer {method}")

    def _messages(self):
        """Return the messages that have come in whole."""
        try:
            self._rest += os.read(self._from, 2**20)
        except BlockingIOError:
            time.sleep(0.01)
        *whole, self._rest = self._rest.split(b"\0")
        return map(json.loads, whole)

    def open(self, page: Path, width: int, height: int = 900, phone: bool = False) -> None:
        """Open a file in a window of a size in pixels, or on a phone, and wait until it is there."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone)
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)
        self.call("Page.navigate", url=page.resolve().as_uri())
        self.run("new Promise(done => document.readyState == 'complete' ? done() : addEventListener('load', done))")

    def run(self, script: str):
        """Return the value of a script, or what it promises."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def middle(self, selector: str) -> tuple[float, float]:
        """Return the place in the window of the middle of an element, scrolled to where it can be seen."""
        return self.run(f"""(() => {{ const element = document.querySelector("{selector}");
            element.scrollIntoView({{block: "center"}}); const box = element.getBoundingClientRect();
            return [box.x + box.width / 2, box.y + box.height / 2]; }})()""")

    def wait_for_drawing(self) -> None:
        """Wait until what was asked for has been drawn."""
        self.run("new Promise(requestAnimationFrame).then(() => new Promise(requestAnimationFrame)).then(() => 0)")

    def touch(self, selector: str, right: int, down: int, steps: int = 6) -> None:
        """Draw a finger over a screen, from the middle of an element."""
        x, y = self.middle(selector)
        for step in range(steps + 1):
            at = {"x": x + right * step / steps, "y": y + down * step / steps}
            self.call("Input.dispatchTouchEvent", type="touchMove" if step else "touchStart", touchPoints=[at])
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.wait_for_drawing()

    def drag(self, selector: str, right: int, down: int) -> None:
        """Drag the mouse from the middle of an element."""
        x, y = self.middle(selector)
        for kind, part in (("mousePressed", 0.0), ("mouseMoved", 0.5), ("mouseMoved", 1.0), ("mouseReleased", 1.0)):
            self.call("Input.dispatchMouseEvent", type=kind, x=x + part * right, y=y + part * down, button="left",
                      buttons=0 if kind == "mouseReleased" else 1, clickCount=1)
        self.wait_for_drawing()

    def requests(self) -> list[str]:
        """Return what the page has asked others for: neither its own file nor what it holds."""
        urls = [parameters["request"]["url"] for name, parameters in self.events if name == "Network.requestWillBeSent"]
        return [url for url in urls if not url.startswith(("file:", "data:", "blob:", "about:"))]

    def errors(self) -> list[str]:
        """Return what the page has complained about."""
        found = [parameters["exceptionDetails"]["text"] for name, parameters in self.events
                 if name == "Runtime.exceptionThrown"]
        found += [parameters["entry"]["text"] for name, parameters in self.events
                  if name == "Log.entryAdded" and parameters["entry"]["level"] == "error"]
        return found + [str(parameters["args"]) for name, parameters in self.events
                        if name == "Runtime.consoleAPICalled" and parameters["type"] == "error"]

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait()
        os.close(self._to)
        os.close(self._from)
