"""A page in headless Chromium: what its own script finds there, and what went wrong."""

import json
import re
import shutil
import subprocess

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
  const note = document.createElement("pre");
  note.id = "probe";
  note.textContent = JSON.stringify({found, troubles});
  document.body.append(note);
})();
"""


def probe(html, folder, script, seconds=40, width=1200):
    """Open a page, run the body of an asynchronous function in it.

    Returns what the function returns, and the list of errors and warnings of the page.
    """
    page = folder / "probed.html"
    head, tail = (f"<script>{text}</script>" for text in (_HEAD, _TAIL % script))
    html = html.replace("<head>", f"<head>{head}", 1)
    # The page's own scripts hold the closing tag as text, so it is the last one that counts.
    before, after = html.rsplit("</body>", 1)
    page.write_text(f"{before}{tail}</body>{after}", encoding="utf-8")
    done = subprocess.run(
        [CHROMIUM, *_FLAGS, f"--window-size={width},800", f"--user-data-dir={folder / 'profile'}",
         f"--virtual-time-budget={1000 * seconds}", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, check=False, timeout=180,
    )  # fmt: skip
    note = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    assert note, f"the page did not finish: {done.stderr[-2000:]}"
    plain = note[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    told = json.loads(plain)
    return told.get("found"), told["troubles"]
