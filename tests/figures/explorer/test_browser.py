"""The page in a real browser, opened from a file: what is clicked, dragged, typed and linked."""

import io
import json

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from knitlab.cubes.case_file import in_cloth
from knitlab.cubes.cube_file import open_cube
from knitlab.cubes.model_line import model_line
from knitlab.figures.explorer.explorer import write_explorer
from tests.figures.explorer.conftest import HOSTILE, PREVIEW, REFERENCE, started

selenium = pytest.importorskip("selenium", reason="Selenium is not installed")
from selenium.common.exceptions import StaleElementReferenceException  # noqa: E402
from selenium.webdriver import ActionChains, Keys  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.support.ui import Select, WebDriverWait  # noqa: E402

PATIENCE = 20
"""Longest time to wait for the page [s]."""
LOADED = "return document.querySelectorAll('#map [data-design]').length > 0"
CLOSED = "file:", "data:", "blob:"


class Page:
    """An open page, by what a user sees of it."""

    def __init__(self, driver, path, view=""):
        self.driver = driver
        self.path = path
        for kind in ("browser", "performance"):
            driver.get_log(kind)
        driver.get("about:blank")
        driver.get(path.as_uri() + view)
        self.until(lambda: driver.execute_script(LOADED))

    def until(self, condition):
        # What is looked at may be drawn again meanwhile.
        wait = WebDriverWait(self.driver, PATIENCE, 0.1, [StaleElementReferenceException])
        return wait.until(lambda _: condition())

    def one(self, selector):
        return self.driver.find_element(By.CSS_SELECTOR, selector)

    def all(self, selector):
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def cell(self, text):
        """The cell of the map whose description begins with a text."""
        return self.one(f'#map [aria-label^="{text}:"]')

    def press(self, selector):
        """Click what a selector finds, and wait for what it changes."""
        self.one(selector).click()
        self.settle()

    def choose(self, text):
        # In one step: between finding a cell and clicking it, the map may be drawn again.
        self.driver.execute_script(
            "document.querySelector(`#map [aria-label^='${arguments[0]}:']`)"
            ".dispatchEvent(new MouseEvent('click', { bubbles: true }))",
            text,
        )
        self.until(lambda: self.selected == text)
        self.settle()

    def slide(self, place):
        self.driver.execute_script(
            "const slider = document.getElementById('strain'); slider.value = arguments[0];"
            "slider.dispatchEvent(new Event('input'))",
            place,
        )
        self.until(lambda: int(self.one("#strain").get_property("value")) == place)
        self.settle()

    def settle(self):
        """Wait until the page has drawn what was set."""
        self.driver.execute_async_script(
            "const done = arguments[0];"
            "requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 200)))"
        )

    @property
    def selected(self):
        return self.one("#map [aria-pressed='true']").get_attribute("aria-label").split(":")[0]

    @property
    def strain(self):
        return self.one("#strain-value").text

    @property
    def curve(self):
        """The line of the selected design in the upper chart."""
        return self.one("#curves svg .line.selected").get_attribute("d")

    @property
    def shown(self):
        """Design and strain of the shape on the stage."""
        stage = self.one("#stage")
        return stage.get_attribute("data-design"), stage.get_attribute("data-strain")

    def stage(self):
        """The picture of the shape."""
        self.settle()
        return np.asarray(Image.open(io.BytesIO(self.one("#stage").screenshot_as_png)))

    def until_shape(self, design):
        self.until(lambda: self.shown[0] == design)
        return self.stage()

    def hash(self):
        self.settle()
        return self.driver.execute_script("return location.hash")

    def is_quiet(self):
        """Whether the page made no error and asked for nothing but itself."""
        errors = [each for each in self.driver.get_log("browser") if each["level"] == "SEVERE"]
        events = [
            json.loads(each["message"])["message"] for each in self.driver.get_log("performance")
        ]
        asked = [
            each["params"]["request"]["url"]
            for each in events
            if each["method"] == "Network.requestWillBeSent"
        ]
        assert asked, "the log of requests is empty"
        assert not errors
        return all(url.startswith(CLOSED) or url == "about:blank" for url in asked)


@pytest.fixture
def preview(browser, page):
    return Page(browser, page)


@pytest.fixture
def trouble(browser, troubled_page):
    return Page(browser, troubled_page)


def differs(one, other):
    """Part of the pixels that differ between two pictures of the same size."""
    return float((np.abs(one.astype(int) - other.astype(int)).max(axis=-1) > 16).mean())


def test_it_opens_from_a_file_at_the_most_auxetic_state(preview):
    ratio = open_cube(PREVIEW)["poisson_ratio"]
    lowest = ratio.where(ratio == ratio.min(), drop=True)
    assert preview.selected == ", ".join(f"{dim} {lowest[dim].item()}" for dim in lowest.dims[:2])
    assert preview.strain == f"{100 * lowest['applied_strain'].item():.0f} %"
    assert len(preview.all("#map [data-design]")) == 10
    picture = preview.until_shape("8~64")
    assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 100
    assert preview.is_quiet()
    assert model_line(open_cube(PREVIEW)) in preview.one("#model").text


@pytest.mark.slow
def test_a_click_on_the_map_changes_the_curve_and_the_shape(preview):
    picture, curve = preview.until_shape("8~64"), preview.curve
    preview.choose("n_stripe 4, n_subunit 16")
    assert differs(preview.until_shape("4~16"), picture) > 0.05
    assert preview.curve != curve
    assert "n_stripe 4, n_subunit 16" in preview.one("#readings").text
    assert preview.is_quiet()


@pytest.mark.slow
def test_a_design_without_its_file_has_curves_and_says_that_it_has_no_shape(preview):
    preview.choose("n_stripe 6, n_subunit 36")
    assert preview.curve
    assert "no shape" in preview.one("#stage .message").text


@pytest.mark.slow
def test_the_slider_changes_map_curves_and_shape(preview):
    picture, label = preview.until_shape("8~64"), preview.cell(preview.selected).text
    preview.slide(15)
    assert preview.strain == "45 %"
    assert preview.shown == ("8~64", "0.45")
    assert differs(preview.stage(), picture) > 0.05
    assert preview.cell(preview.selected).text != label
    assert "45 %" in preview.one("#shape-title").text


@pytest.mark.slow
def test_play_runs_through_the_test(preview):
    preview.slide(10)
    preview.press("#play")
    preview.until(lambda: preview.strain == "45 %")
    preview.until(lambda: preview.one("#play").text == "▶")
    assert preview.is_quiet()


@pytest.mark.slow
def test_the_shape_turns_by_mouse_keys_and_touch(preview):
    before = preview.until_shape("8~64")
    canvas = preview.one("#shape")
    ActionChains(preview.driver).click_and_hold(canvas).move_by_offset(90, 40).release().perform()
    dragged = preview.stage()
    assert differs(dragged, before) > 0.05
    canvas.send_keys(Keys.ARROW_LEFT, Keys.ARROW_LEFT, "+")
    keyed = preview.stage()
    assert differs(keyed, dragged) > 0.05
    box = canvas.rect
    scroll = preview.driver.execute_script("return scrollY")
    for kind, shift in (("touchStart", 0), ("touchMove", 70), ("touchEnd", None)):
        at = {"x": box["x"] + 150 + (shift or 0), "y": box["y"] - scroll + 200}
        points = [] if shift is None else [at]
        preview.driver.execute_cdp_cmd(
            "Input.dispatchTouchEvent", {"type": kind, "touchPoints": points}
        )
    assert differs(preview.stage(), keyed) > 0.05
    canvas.send_keys("0")
    assert differs(preview.stage(), before) < 0.02


@pytest.mark.slow
def test_pins_stay_beside_the_selected_design(preview):
    preview.press("#readings button")
    preview.choose("n_stripe 4, n_subunit 16")
    preview.cell("n_stripe 4, n_subunit 16").send_keys("p")
    preview.choose("n_stripe 2, n_subunit 16")
    keys = [each.get_attribute("data-key") for each in preview.all("#pins .card")]
    assert keys == ["8~64", "4~16"]
    assert len(preview.all("#curves svg:first-of-type .line")) == 3
    looks = {
        (line.get_attribute("stroke"), line.get_attribute("stroke-dasharray"))
        for line in preview.all("#curves svg:first-of-type .line")
    }
    assert len(looks) == 3
    preview.press("#pins .card button:last-of-type")
    preview.until(lambda: len(preview.all("#pins .card")) == 1)
    assert preview.is_quiet()


@pytest.mark.slow
def test_a_window_keeps_the_designs_within_it(preview):
    with xr.open_dataset(PREVIEW / "cube.nc") as cube:
        sizes, ratios = cube["knit_cell_x"].values, cube["poisson_ratio"].values
    preview.one('[data-variable="knit_cell_x"] input[aria-label^="to"]').send_keys("80", Keys.TAB)
    kept = int((sizes < 80).sum())
    assert 1 < kept < 10
    preview.until(lambda: preview.one("#filter-count").text == f"{kept} of 10 designs")
    assert len(preview.all("#designs tbody tr")) == kept
    assert len(preview.all("#map .cell.out")) == 10 - kept
    brush = preview.one('[data-variable="poisson_ratio"] .brush')
    drag = ActionChains(preview.driver).move_to_element_with_offset(brush, -100, 0)
    drag.click_and_hold().move_by_offset(120, 0).release().perform()
    low = preview.one('[data-variable="poisson_ratio"] input[aria-label^="from"]')
    assert np.nanmin(ratios) < float(low.get_property("value")) < -0.4
    preview.until(lambda: len(preview.all("#designs tbody tr")) < kept)
    assert preview.is_quiet()


@pytest.mark.slow
def test_the_map_shows_any_variable_over_any_two_dimensions(preview):
    def choose(place, value):
        Select(preview.all("#map-choices select")[place]).select_by_value(value)

    choose(0, "knit_cell_x")
    preview.until(lambda: "finished unit cell" in preview.one("#map-legend").text)
    assert "mm" in preview.one("#map-legend").text
    choose(1, "n_subunit")
    preview.until(lambda: "n_subunit: stitches" in preview.one("#map").text)
    labels = [each.text for each in preview.all("#map .tick")]
    assert {"16", "24", "32", "36", "48", "64"} <= set(labels)


@pytest.mark.slow
def test_arrow_keys_move_on_the_map(preview):
    preview.cell(preview.selected).send_keys(Keys.ARROW_DOWN)
    preview.until(lambda: preview.selected == "n_stripe 6, n_subunit 48")
    preview.settle()
    focused = preview.driver.switch_to.active_element
    assert focused.get_attribute("aria-label").startswith("n_stripe 6, n_subunit 48")
    focused.send_keys(Keys.ARROW_LEFT)
    preview.until(lambda: preview.selected == "n_stripe 6, n_subunit 36")


@pytest.mark.slow
def test_a_link_restores_the_view(preview, page):
    preview.choose("n_stripe 4, n_subunit 16")
    preview.slide(7)
    preview.press("#readings button")
    Select(preview.one("#shape-choices select")).select_by_value("height")
    preview.one("#shape").send_keys(Keys.ARROW_RIGHT)
    preview.one('[data-variable="reaction_force"] input').send_keys("0.2", Keys.TAB)
    preview.press("#theme")
    view, picture = preview.hash(), preview.until_shape("4~16")
    shown = [preview.one(name).text for name in ("#strain-value", "#readings", "#filter-count")]
    again = Page(preview.driver, page, view)
    assert differs(again.until_shape("4~16"), picture) < 0.02
    assert shown == [
        again.one(name).text for name in ("#strain-value", "#readings", "#filter-count")
    ]
    assert again.selected == "n_stripe 4, n_subunit 16"
    assert again.one("html").get_attribute("data-theme") == "dark"
    assert again.hash() == view
    # A link that is followed on the open page, too.
    again.driver.execute_script("location.hash = '#design=8~64&strain=0.3'")
    again.until(lambda: again.selected == "n_stripe 8, n_subunit 64" and again.strain == "30 %")
    assert again.one("html").get_attribute("data-theme") == "light"
    assert again.is_quiet()


@pytest.mark.slow
def test_a_link_of_another_page_does_no_harm(browser, page):
    view = "#design=9~9&strain=x&of=nothing&pins=7:1~1;0:8~64&turn=a&filters=no:1:2&tab=none&x=y"
    opened = Page(browser, page, view)
    assert opened.selected == "n_stripe 8, n_subunit 64"
    assert opened.is_quiet()


@pytest.mark.slow
def test_what_failed_ended_early_or_folds_through_looks_it(trouble):
    assert "failed" in trouble.cell("n_stripe 6, n_subunit 48").text
    assert trouble.cell("n_stripe 6, n_subunit 48").find_element(
        By.CSS_SELECTOR, "[fill='url(#hatching-failed)']"
    )
    assert "pending" in trouble.cell("n_stripe 8, n_subunit 32").text
    trouble.choose("n_stripe 6, n_subunit 48")
    assert "failed" in trouble.one("#stage .message").text
    trouble.choose("n_stripe 4, n_subunit 24")
    trouble.slide(8)
    assert "not converged" in trouble.cell("n_stripe 4, n_subunit 24").text
    trouble.choose("n_stripe 8, n_subunit 64")
    trouble.slide(2)
    trouble.until_shape("8~64")
    assert "17 pairs" in trouble.one("#stage .banner").text
    assert trouble.cell("n_stripe 8, n_subunit 64").find_elements(By.CSS_SELECTOR, ".through")
    assert len(trouble.all("#curves svg:first-of-type [fill='var(--panel)']")) >= 1  # hollow
    trouble.choose("n_stripe 6, n_subunit 36")
    assert trouble.curve.count("M") == 2  # a gap where it snapped
    assert trouble.is_quiet()


@pytest.mark.slow
def test_hostile_text_is_only_text(trouble):
    trouble.press("#tab-report")
    trouble.until(lambda: HOSTILE in trouble.one("#report").text)
    assert trouble.driver.title == "knitlab explorer: troubled"
    assert not trouble.all("img[onerror]")
    assert trouble.is_quiet()


@pytest.mark.slow
def test_the_report_is_the_other_tab(preview):
    preview.press("#tab-report")
    preview.until(lambda: preview.one("#report").is_displayed())
    assert not preview.one("#explore").is_displayed()
    text = preview.one("#report").text
    assert open_cube(PREVIEW).attrs["title"] in text
    assert "Every design is ok." in text
    assert "jax=" in text
    images = preview.all("#report img")
    assert len(images) == len(list((PREVIEW / "figures").glob("*.png"))) > 0
    preview.driver.execute_script("arguments[0].scrollIntoView()", images[0])
    preview.until(lambda: images[0].get_property("naturalWidth") > 500)
    assert preview.is_quiet()


def luminance(page):
    words = page.driver.execute_script("return getComputedStyle(document.body).backgroundColor")
    return sum(float(each) for each in words.removeprefix("rgb(").removesuffix(")").split(",")) / 3


@pytest.mark.slow
def test_it_is_dark_where_the_system_is_and_at_a_press(browser, page):
    def prefer(scheme):
        feature = {"name": "prefers-color-scheme", "value": scheme}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    prefer("dark")
    try:
        opened = Page(browser, page)
        assert luminance(opened) < 60
        opened.press("#theme")
        opened.until(lambda: luminance(opened) > 200)
        assert opened.is_quiet()
    finally:
        prefer("light")


@pytest.mark.slow
@pytest.mark.nightly
def test_cubes_of_every_kind_are_shown_on_one_page(browser, tmp_path):
    names = ["sensor", "stripes", "options", "laboratory", "graded", "relaxation", "paper"]
    output = tmp_path / "many.html"
    write_explorer([open_cube(REFERENCE / name) for name in names], output)
    opened = Page(browser, output)
    for place, name in enumerate(names):
        Select(opened.one("#cube")).select_by_visible_text(name)
        opened.until(lambda name=name, place=place: f"cube={name}" in opened.hash() or not place)
        assert opened.all("#map [data-design]"), name
        assert opened.all("#designs tbody tr"), name
    assert opened.is_quiet()


@pytest.mark.slow
def test_the_browser_unpacks_what_was_packed(preview):
    with xr.open_dataset(next((PREVIEW / "cases").glob("8-64-*.nc"))) as case:
        design = open_cube(PREVIEW).sel(n_stripe=8, n_subunit=64)
        wanted = in_cloth(case.load(), design)["position"].values
    shape, found = preview.driver.execute_async_script(
        """
        const done = arguments[0];
        const { cubes } = JSON.parse(document.getElementById("content").textContent);
        const { shape } = cubes[0].designs.find(({ case_id }) => case_id.startsWith("8-64"));
        import("explorer/positions")
          .then(({ positionsOf }) => positionsOf(shape))
          .then((frames) => done([shape, frames.map((frame) => [...frame])]));
        """
    )
    error = np.abs(np.reshape(found, wanted.shape) - wanted).max(axis=(0, 1, 2))
    assert (error <= np.array(shape["error"]) + 1e-5).all()  # the browser has single precision


@pytest.mark.slow
def test_without_webgl_the_shape_is_painted(page, tmp_path):
    with started(tmp_path / "profile", "--disable-3d-apis") as driver:
        opened = Page(driver, page)
        picture = opened.until_shape("8~64")
        assert opened.one("#stage").get_attribute("data-renderer") == "canvas"
        assert "no WebGL" in opened.one("#shape-legend").text
        assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 100
        assert opened.is_quiet()
