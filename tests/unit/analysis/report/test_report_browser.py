"""The page in Chromium, without a network: it shows, complains of nothing, and asks for nothing."""

import re
import shutil
import subprocess

import pytest
from matplotlib.image import imread

pytestmark = pytest.mark.browser

NAMES = ("chromium", "chromium-browser", "google-chrome")
QUIET = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
NO_NETWORK = ("--host-resolver-rules=MAP * ~NOTFOUND",)
ITS_OWN = "not an origin"  # what Chromium asks for by itself, without a page
REQUEST = re.compile(r'"initiator":"([^"]*)".*?"url":"((?!file:|data:)[^"]*)"')


@pytest.fixture
def opened(tmp_path):
    """Opens a page; returns what it said on the console, what it asked for, and its picture."""
    found = [path for path in map(shutil.which, NAMES) if path]
    assert found, "no Chromium: apt-get install chromium"

    def open_page(path, *options):
        picture, log = tmp_path / "page.png", tmp_path / "net.json"
        where = (f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={picture}", f"--log-net-log={log}")
        size = ("--window-size=1200,4000", "--hide-scrollbars", "--enable-logging=stderr")
        command = [found[0], *QUIET, *NO_NETWORK, *where, *size, *options, path.as_uri()]
        process = subprocess.run(command, capture_output=True, text=True, check=True, timeout=240)
        console = [line for line in process.stderr.splitlines() if ":CONSOLE" in line]
        asked = [url for initiator, url in REQUEST.findall(log.read_text()) if initiator != ITS_OWN]
        return console, asked, imread(picture)

    return open_page


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_stands_alone(made, opened, scheme):
    options = ["--blink-settings=preferredColorScheme=0"] if scheme == "dark" else []
    console, asked, picture = opened(made.report / "report.html", *options)
    assert (console, asked) == ([], [])
    corner, colours = picture[0, 0, :3].mean(), {tuple(pixel) for pixel in picture[::7, ::7].reshape(-1, 4)}
    assert corner > 0.9 if scheme == "light" else corner < 0.2
    assert len(colours) > 100  # its figures are there


def test_what_a_page_asks_for_or_says_is_noticed(tmp_path, opened):
    path = tmp_path / "bad.html"
    path.write_text("<img src='https://example.org/a.png'><script>console.error('no')</script>")
    console, asked, _ = opened(path)
    assert len(console) == 1
    assert set(asked) == {"https://example.org/a.png"}
