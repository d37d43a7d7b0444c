"""A page in headless Chromium: what its own script finds there, and what went wrong."""

import json
import queue
import shutil
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
"""The browser, None where there is none."""

_FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    # The page of a file may tell this machine what it found.
    "--disable-features=LocalNetworkAccessChecks",
    "--remote-debugging-port=0",
]
_HEAD = """
window.troubles = [];
for (const level of ["error", "warn"]) {
  const say = console[level];
  console[level] = (...what) => { troubles.push(what.map(String).join(" ")); say(...what); };
}
window.addEventListener("error", event => troubles.push(String(event.message)), true);
window.addEventListener("unhandledrejection", event => troubles.push(String(event.reason)));
"""
_TAIL = """
(async () => {
  let found;
  try { found = await (async () => { %s })(); } catch (error) { troubles.push(String(error)); }
  fetch("http://127.0.0.1:%d", {
    method: "POST", mode: "no-cors", body: JSON.stringify({found, troubles})});
})();
"""


class _Listener(HTTPServer):
    """Takes what one page found, on a port of this machine."""

    def __init__(self):
        super().__init__(("127.0.0.1", 0), _Answer)
        self.told = queue.SimpleQueue()


class _Answer(BaseHTTPRequestHandler):
    def do_POST(self):
        told = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(204)
        self.end_headers()
        self.server.told.put(json.loads(told))

    def log_message(self, *_):
        """Stay silent."""


def probe(html, folder, script, seconds=1200, width=1200):
    """Open a page, run the body of an asynchronous function in it.

    Returns what the function returns, and the list of errors and warnings of the page. The page
    tells it when it is done, in real time: a loaded machine only takes longer.
    """
    with _Listener() as listener:
        threading.Thread(target=listener.serve_forever, daemon=True).start()
        page = folder / "probed.html"
        tail = _TAIL % (script, listener.server_port)
        head, tail = (f"<script>{text}</script>" for text in (_HEAD, tail))
        html = html.replace("<head>", f"<head>{head}", 1)
        # The page's own scripts hold the closing tag as text, so it is the last one that counts.
        before, after = html.rsplit("</body>", 1)
        page.write_text(f"{before}{tail}</body>{after}", encoding="utf-8")
        complaints = folder / "browser.log"
        with complaints.open("w") as log:
            browser = subprocess.Popen(
                [CHROMIUM, *_FLAGS, f"--window-size={width},800",
                 f"--user-data-dir={folder / 'profile'}", page.as_uri()],
                stdout=log, stderr=log,
            )  # fmt: skip
        try:
            told = listener.told.get(timeout=seconds)
        except queue.Empty:
            end = complaints.read_text(encoding="utf-8", errors="replace")[-2000:]
            raise AssertionError(f"the page did not finish in {seconds} s: {end}") from None
        finally:
            browser.kill()
            browser.wait()
            listener.shutdown()
    return told.get("found"), told["troubles"]
