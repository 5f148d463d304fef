"""The page of `railctl watch` in Chromium, over a real cluster: it shows, follows, steers, plays, and finds back."""

import gzip
import json
import shutil

import pytest
from made_playback import STEPS, made_playback
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys as Press
from selenium.webdriver.support.wait import WebDriverWait
from served_page import Served

pytestmark = pytest.mark.browser

PATIENCE_S = 120.0
NARROW = {"width": 375, "height": 800, "deviceScaleFactor": 1, "mobile": True}
QUIET = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
LONG = ("--episodes", "100000", "--detach")


class Browser:
    """Chromium, and what a user does with it."""

    def __init__(self, pictures):
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
        driver = shutil.which("chromedriver")
        assert options.binary_location, "no Chromium: apt-get install chromium chromium-driver"
        assert driver, "no driver of Chromium: apt-get install chromium-driver"
        for option in (*QUIET, "--window-size=1280,1000", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
        self._pictures = pictures

    def open(self, url):
        self.driver.get("about:blank")  # or another fragment would not load it anew
        self.driver.get(url)

    def look(self, **features):
        named = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": named})

    def size(self, metrics):
        if metrics is None:
            self.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        else:
            self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def all(self, selector):
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def text(self, selector):
        """The text of the first element, or nothing."""
        script = "return document.querySelector(arguments[0])?.textContent ?? ''"
        return self.driver.execute_script(script, selector)

    def until(self, is_true):
        WebDriverWait(self.driver, PATIENCE_S, poll_frequency=0.1).until(lambda _driver: is_true())

    def until_text(self, selector, words):
        self.until(lambda: words in self.text(selector))

    def click(self, selector):
        self.until(lambda: any(found.is_displayed() and found.is_enabled() for found in self.all(selector)))
        self.all(selector)[0].click()

    def press(self, *keys):
        for key in keys:
            webdriver.ActionChains(self.driver).send_keys(key).perform()

    def width(self):
        return self.driver.execute_script("return document.documentElement.scrollWidth")

    def complaints(self):
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def picture(self, name):
        self.driver.save_screenshot(str(self._pictures / f"{name}.png"))


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("pages"))
    yield browser
    browser.driver.quit()


@pytest.fixture
def browser(chromium):
    """A browser that remembers nothing; in the end nothing has been complained of."""
    chromium.size(None)
    chromium.look(prefers_color_scheme="light")
    chromium.complaints()
    yield chromium
    assert chromium.complaints() == []


@pytest.fixture(scope="module")
def root(clusters):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAILCTL_RUNS", str(clusters.root))
        yield clusters.root


@pytest.fixture(scope="module")
def served(root):
    page = Served()

    async def content(module, key, request):
        *_run, player, _level, _number = json.loads(key)
        return gzip.compress(made_playback(f"played by {player}").encode())

    page.page.tasks.content = content
    yield page
    page.end()


@pytest.fixture(scope="module")
def over(clusters, root):
    """A run that is over."""
    clusters.up("over")
    return "over"


@pytest.fixture(scope="module")
def going(clusters, root):
    """A run that goes on for longer than the tests."""
    clusters.up("going", *LONG)
    yield "going"
    clusters.railctl("down", "going")


def at(served, path, *, key=True):
    return f"http://{served.host}{path}" + (f"#key={served.keys.key}" if key else "")


def done(browser):
    """The episodes that the page says are trained."""
    return int("".join(filter(str.isdigit, browser.text(".progress .text span").partition("of")[0])) or 0)


def test_a_run_that_is_over_is_shown_from_its_files(browser, served, over):
    browser.open(at(served, "/runs/over"))
    browser.until_text("#connection", "from files")
    browser.until_text(".badge", "finished")
    browser.until(lambda: browser.all(".chart .mark"))
    assert len(browser.all("tbody tr")) == 2  # evaluations
    assert "key=" not in browser.driver.current_url
    assert [card.is_displayed() for card in browser.all(".actors")] == [False]
    browser.picture("over")


def test_a_running_run_goes_on_on_the_page(browser, served, going):
    browser.open(at(served, "/runs/going"))
    browser.until_text("#connection", "live")
    browser.until(lambda: done(browser) > 0)
    before = done(browser)
    browser.until(lambda: done(browser) > before)
    browser.until(lambda: browser.all(".chart .line[d^=M]"))
    browser.picture("going")


def test_actors_are_scaled_by_buttons(browser, served, going, clusters):
    browser.open(at(served, "/runs/going"))
    browser.until_text(".actors output", "0")
    browser.click("button[aria-label='One actor more for easy']")
    browser.until_text(".toast", "actors are now easy=1")
    browser.until(lambda: clusters.folder("going").cluster().actors == {"easy": 1})
    browser.until_text(".actors .level", "1 alive")
    browser.until_text(".events", "actors are now easy=1")
    browser.click("button[aria-label='One actor fewer for easy']")
    browser.until(lambda: clusters.folder("going").cluster().actors == {"easy": 0})


def test_a_run_is_paused_and_resumed_by_buttons(browser, served, going):
    browser.open(at(served, "/runs/going"))
    browser.until(lambda: done(browser) > 0)
    browser.click(".actions button:first-child")
    browser.until_text(".badge", "paused")
    browser.until_text(".actions", "Resume")
    browser.click(".actions button:first-child")
    browser.until_text(".badge", "running")


def test_without_the_key_the_page_only_shows(browser, served, going):
    browser.open("about:blank")
    browser.open(at(served, "/", key=False))
    browser.driver.execute_script("localStorage.clear()")
    browser.open(at(served, "/runs/going", key=False))
    browser.until_text("#connection", "live")
    browser.until(lambda: browser.all(".actions button"))
    buttons = browser.all(".actions button, .stepper button")
    assert [button.is_enabled() for button in buttons] == [False] * len(buttons)
    assert "Read-only" in buttons[0].get_attribute("title")


def test_a_run_that_stops_and_starts_again_is_found_back(browser, served, clusters, root):
    clusters.up("again", *LONG)
    browser.open(at(served, "/runs/again"))
    browser.until_text("#connection", "live")
    browser.until(lambda: done(browser) > 0)
    clusters.railctl("down", "again")
    browser.until_text(".badge", "stopped")
    browser.until_text("#connection", "from files")
    before = done(browser)
    clusters.railctl("up", "--name", "again", "--detach")
    browser.until_text("#connection", "live")
    browser.until(lambda: done(browser) > before)
    clusters.railctl("down", "again")


def test_a_server_that_goes_is_said_and_found_back(chromium, root, over):
    browser, first = chromium, Served()
    browser.open(at(first, "/runs/over"))
    browser.until_text(".badge", "finished")
    first.end()
    browser.until_text("#banner", "Nothing has come from railctl watch since")
    browser.until_text("#connection", "no answer")
    second = Served(port=first.port)
    browser.until_text("#banner", "was started again: this page now only shows")
    browser.until_text("#connection", "from files")
    browser.open(at(second, "/runs/over"))
    browser.until_text(".badge", "finished")
    assert browser.text("#banner") == ""
    second.end()
    assert all("ERR_CONNECTION" in text or "ERR_INCOMPLETE" in text for text in browser.complaints())


@pytest.fixture
def trains(browser, served, over):
    """The tab of trains, with an episode in it."""
    browser.open(at(served, "/runs/over"))
    browser.click("#tab-trains")
    browser.until_text(".place", f"step 0 / {STEPS}")
    return browser


def test_trains_are_played_step_by_step(trains):
    assert "played by checkpoint:40: 1 of 2 trains arrived" in trains.text(".trains .card > header")
    assert len(trains.all(".map .train")) == 2
    trains.press(Press.ARROW_RIGHT, Press.ARROW_RIGHT)
    trains.until_text(".place", "step 2 /")
    trains.press(Press.ARROW_LEFT)
    trains.until_text(".place", "step 1 /")
    trains.press(Press.END)
    trains.until_text(".place", f"step {STEPS} /")
    assert trains.all(".map .train.is-arrived")
    trains.press(Press.HOME, Press.SPACE)
    trains.until_text(".place", f"step {STEPS} /")  # it plays to the end
    trains.press("[")
    trains.until_text(".place", "step 4 /")  # the last decision
    trains.picture("trains")


def test_a_train_that_is_chosen_says_what_it_thought_and_saw(trains):
    assert "Train 0" in trains.text(".inspector h2")
    trains.press(Press.ARROW_DOWN)
    assert "Train 1" in trains.text(".inspector h2")
    assert "has not decided anything yet" in trains.text(".inspector")
    trains.press("]")
    trains.until_text(".place", "step 3 /")
    choices = trains.text(".choices")
    assert "Decides now: forward" in choices
    assert "forward, chosen75%" in choices
    assert "left, not allowed" in choices
    assert "near1" in trains.text(".saw")
    assert trains.all(".map .train.selected title")[0].get_attribute("textContent") == "Train 1, moving"
    trains.click("#train-0")
    assert "Train 0" in trains.text(".inspector h2")


def test_a_button_that_is_drawn_anew_keeps_the_focus(trains):
    trains.driver.execute_script("document.querySelector('.inspector button:last-child').focus()")
    trains.press(Press.ENTER)
    trains.until_text(".place", "step 4 /")
    assert "decision" in trains.driver.switch_to.active_element.text


def test_another_policy_plays_another_level(trains):
    trains.click("select option[value='planner']")
    trains.until_text(".trains .card > header", "played by planner")
    trains.click("button[aria-label='Next level']")
    trains.until(lambda: trains.all(".numbers input")[0].get_attribute("value") == "1")


def test_a_curve_is_read_with_arrow_keys(browser, served, over):
    browser.open(at(served, "/runs/over"))
    browser.until(lambda: browser.all(".chart .mark"))
    browser.driver.execute_script("document.querySelector('.chart svg').focus()")
    browser.press(Press.ARROW_LEFT, Press.ARROW_LEFT)
    browser.until_text(".tip", "training, median")
    assert "episode" in browser.text(".chart [aria-live]")
    browser.press(Press.ESCAPE)
    assert not browser.all(".tip")[0].is_displayed()


def test_tabs_are_turned_with_arrow_keys(browser, served, over):
    browser.open(at(served, "/runs/over"))
    browser.click("#tab-overview")
    browser.driver.execute_script("document.querySelector('#tab-overview').focus()")  # as the tabulator does
    browser.press(Press.ARROW_LEFT)
    assert browser.driver.switch_to.active_element.text == "Learning"
    assert [panel.is_displayed() for panel in browser.all("[role=tabpanel]")] == [False, False, True]


@pytest.mark.parametrize("tab", ["overview", "trains", "learning"])
def test_a_narrow_window_shows_all_without_scrolling_sideways(browser, served, over, tab):
    browser.size(NARROW)
    browser.open(at(served, "/runs/over"))
    browser.click(f"#tab-{tab}")
    browser.until(lambda: browser.all(f"#panel-{tab} .card"))
    if tab == "trains":
        browser.until_text(".place", "step 0 /")
    assert browser.width() == NARROW["width"]
    browser.picture(f"narrow-{tab}")


def brightness(browser):
    colour = browser.driver.execute_script("return getComputedStyle(document.body).backgroundColor")
    return sum(map(int, colour.removeprefix("rgb(").removesuffix(")").split(","))) / 3


def test_the_page_is_dark_where_it_shall_be(browser, served, over):
    browser.look(prefers_color_scheme="dark")
    browser.open(at(served, "/runs/over"))
    browser.until(lambda: browser.all(".chart .mark"))
    assert brightness(browser) < 40
    browser.picture("dark")
    browser.click("#theme")
    assert brightness(browser) > 200
    browser.open(at(served, "/runs/over"))
    browser.until(lambda: brightness(browser) > 200)  # it remembers
    browser.driver.execute_script("localStorage.removeItem('railctl-theme')")


def test_runs_are_chosen_from_the_list_and_compared(browser, served, over, going):
    browser.open(at(served, "/"))
    browser.click("input[aria-label='Choose over']")
    browser.click("input[aria-label='Choose going']")
    browser.click("button.main")
    browser.until(lambda: len(browser.all("tbody tr")) == 2 and browser.all(".chart .mark"))
    browser.until_text("tbody", "finished")
    browser.click(".chooser input:checked")
    browser.until(lambda: len(browser.all("tbody tr")) == 1)


def test_a_run_that_is_not_there_is_said_so(browser, served):
    browser.open(at(served, "/runs/nosuch"))
    browser.until_text("main", "no run named 'nosuch'")


def test_a_study_is_shown_with_its_curves(browser, served, clusters, root):
    study = root / "mini"
    study.mkdir()
    text = "{name: mini, contenders: [dqn, ppo], levels: [easy], seeds: [1], episodes: 40, judgement: {block: 10}}"
    (study / "study.yaml").write_text(text)
    (study / "runs").mkdir()
    clusters.up("mini-made")
    (root / "mini-made").rename(study / "runs" / "dqn-easy-1")
    browser.open(at(served, "/studies/mini"))
    browser.until_text("main", "0 of 2 runs done")  # its network is not scored yet
    browser.until(lambda: browser.all(".chart .line[d^=M]"))
    browser.click(".seeds a")
    browser.until_text("h1", "mini/runs/dqn-easy-1")


def test_a_level_that_is_laid_on_its_side_is_the_same_after_four_turns(browser, served):
    browser.open(at(served, "/"))
    script = """
        const done = arguments[0];
        Promise.all([import('/static/turning.js'), import('/static/rails.js')]).then(([turning, rails]) => {
            const grid = [[32800, 1025, 4608], [16386, 33825, 0]];
            let turned = grid;
            for (let turn = 0; turn < 4; turn++) turned = turning.turnedGrid(turned);
            const same = JSON.stringify(turned) === JSON.stringify(grid);
            done([same, turning.turnedCell(0b1000000000100000), rails.ways(1025)]);
        });
    """
    same, lying, ways = browser.driver.execute_async_script(script)
    assert same
    assert lying == 0b0000010000000001  # a straight track from north to south lies from west to east
    assert ways == [[1, 3]]
