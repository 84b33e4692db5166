"""Chromium without a screen, for the tests that look at pages as a reader does."""
import base64
import json
import os
import pathlib
import subprocess
import time

CHROMIUM = pathlib.Path("/usr/bin/chromium")
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", "--hide-scrollbars", "--remote-debugging-pipe"]


class Browser:
    """One page, driven by the browser's protocol over a pipe. troubles: what went wrong since the list was emptied, as
    text: errors on the console, scripts that threw, files that could not be loaded."""

    def __init__(self, profile):
        to_it, self.commands = os.pipe()
        self.answers, from_it = os.pipe()

        # The browser reads commands from descriptor 3 and answers on 4.
        renumber = ["bash", "-c", 'exec 3<&"$1" 4>&"$2"; shift 2; exec "$@"', "bash", str(to_it), str(from_it)]
        self.process = subprocess.Popen([*renumber, str(CHROMIUM), *FLAGS, f"--user-data-dir={profile}", "about:blank"], pass_fds=(to_it, from_it),
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_it)
        os.close(from_it)
        self.sent, self.rest, self.session, self.troubles, self.urls = 0, b"", None, [], {}
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def message(self):
        while b"\0" not in self.rest:
            part = os.read(self.answers, 1 << 20)
            if not part:
                raise RuntimeError("the browser ended")
            self.rest += part
        found, self.rest = self.rest.split(b"\0", 1)
        return json.loads(found)

    def call(self, method, **parameters):
        self.sent += 1
        text = json.dumps({"id": self.sent, "method": method, "params": parameters, **({"sessionId": self.session} if self.session else {})})
        os.write(self.commands, text.encode() + b"\0")
        while (answer := self.message()).get("id") != self.sent:
            self.note(answer.get("method"), answer.get("params", {}))
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        return answer["result"]

    def note(self, event, said):
        """Keeps an event that tells of a trouble."""
        if event == "Network.requestWillBeSent":
            self.urls[said["requestId"]] = said["request"]["url"]
        elif event == "Network.loadingFailed" and not said.get("canceled"):
            self.troubles.append(f"{self.urls.get(said['requestId'])} was not loaded: {said['errorText']}")
        elif event == "Network.responseReceived" and said["response"]["status"] >= 400:
            self.troubles.append(f"{said['response']['url']} was answered with {said['response']['status']}")
        elif event == "Log.entryAdded" and said["entry"]["level"] == "error":
            self.troubles.append(f"{said['entry']['text']} {said['entry'].get('url', '')}")
        elif event == "Runtime.exceptionThrown":
            details = said["exceptionDetails"]
            self.troubles.append(f"{details.get('url', '')}: {details.get('exception', {}).get('description', details['text'])}")
        elif event == "Runtime.consoleAPICalled" and said["type"] in ("error", "assert"):
            self.troubles.append(" ".join(str(part.get("value", part.get("description", ""))) for part in said["args"]))

    def resize(self, width, theme="light", height=900):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])

    def open(self, url):
        """Opens a page of file: and waits until it is loaded."""
        self.call("Page.navigate", url=url)
        self.wait("document.readyState + location.protocol === 'completefile:'")

    def wait(self, condition, seconds=20.0):
        """Waits until an expression is true, across a change of page. Returns whether it is."""
        end, true = time.monotonic() + seconds, False
        while not true and time.monotonic() < end:
            try:
                true = self.value(condition)
            except RuntimeError as fault:
                if "Inspected target navigated" not in str(fault):  # the page changed while it was asked
                    raise
            if not true:
                time.sleep(0.02)
        return true

    def value(self, expression):
        """Returns the value of an expression in the page."""
        done = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in done:
            raise RuntimeError(f"{expression[:80]}: {done['exceptionDetails']}")
        return done["result"].get("value")

    def screenshot(self, path, width, height):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def close(self):
        self.process.terminate()
        self.process.wait(20)
