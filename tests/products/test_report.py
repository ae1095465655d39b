"""The report: one file that needs no other, says what the products say, and refuses what it cannot show."""

from __future__ import annotations

import base64
import html
import json
import math
import re
import shutil
import subprocess
import sys
from dataclasses import asdict
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.checks import Check, read_checks, write_checks
from polfuse_lab.products.optics import UNITS
from polfuse_lab.products.store import Products
from polfuse_lab.report import report
from polfuse_lab.report.text import check_texts, size_text, value_text
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import stokes_image

CHECKS = [
    Check("dihedral_rcs", 24.1, 24.5, 1.0, "dBsm", "Against <the> scene & its truth."),
    Check("samples_lost", 0, 0, 0),
    Check("rma_correlation", 0.98, 1.0, 0.01, sense="at_least"),
]


@pytest.fixture(scope="module")
def products(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "field & co.h5"
    angles = np.radians([0.0, 45.0, 90.0, 135.0])
    series = PolarizerSeries(tuple(angles), (2,) * 4, (0.004,) * 4, 800.0, SensorNoise(5.0, 1.0))
    light = 5_000.0 * (1 + 0.3 * np.cos(2 * (angles - 0.4)))[:, None, None] * np.ones((4, 24, 32))
    image = stokes_image(light, np.zeros((24, 32), dtype=bool), series)
    Products(path).write(
        "optics",
        {name: getattr(image, name) for name in UNITS},
        settings={"series": asdict(series), "condition_number": series.condition, "note": "<script>alert(1)</script>"},
        inputs=[Path(__file__)],
        units=UNITS,
    )
    write_checks(path, CHECKS)
    return path


@pytest.fixture(scope="module")
def page(products: Path) -> str:
    return report(products, products.with_suffix(".html")).read_text(encoding="utf-8")


class Links(HTMLParser):
    """Everything that a page refers to."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")]
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_needs_no_other_file(page: str) -> None:
    links = Links()
    links.feed(page)
    assert links.open == []
    assert any(link.startswith("data:image/png;base64,") for link in links.found)
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in links.found)
    assert "@import" not in page
    assert "url(" not in page
    assert 'name="viewport"' in page
    assert "@media print" in page


def test_pictures_are_whole(page: str) -> None:
    for data in re.findall(r"data:image/png;base64,([^\"]+)", page):
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG")


def test_texts_are_escaped(page: str) -> None:
    assert page.count("<script>") == 1  # the page's own; the settings hold another, which is text
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "Against &lt;the&gt; scene &amp; its truth." in page
    assert "<title>Light: field &amp; co</title>" in page


def test_it_tells_checks_numbers_and_where_all_comes_from(page: str, products: Path) -> None:
    assert "1 of 3 checks failed." in page
    assert page.count('class="mark">passed') == 2
    assert page.count('class="mark">failed') == 1
    # DOLP of 1 + 0.3 cos 2(...) is 0.3 / (799/801) for a polarizer of 800:1, less sd^2 / 2p for the noise's bias.
    assert f"{0.3 * 801 / 799 - 0.0069**2 / 0.6:.4f} ± 0.0069" in page
    origin = Products(products).provenance("optics")
    assert origin["sha256"] in page
    assert origin["inputs"][0]["sha256"] in page
    assert Path(__file__).name in page


def test_checks_come_back(products: Path) -> None:
    assert read_checks(products) == CHECKS
    assert read_checks(products.with_name("none.h5")) == []


@pytest.mark.parametrize(
    ("check", "ok"),
    [
        (Check("a", 1.0, 1.5, 0.5), True),
        (Check("a", 1.0, 1.6, 0.5), False),
        (Check("a", math.nan, 1.0, 0.5), False),
        (Check("a", 1.0, 1.0, math.nan), False),
        (Check("a", 1.0, 1.0, math.inf), False),
        (Check("a", 2.0, 1.0, 0.1, sense="at_least"), True),
        (Check("a", 0.95, 1.0, 0.1, sense="at_least"), True),
        (Check("a", 0.85, 1.0, 0.1, sense="at_least"), False),
    ],
)
def test_when_a_check_holds(check: Check, ok: bool) -> None:
    assert check.ok is ok


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (30.784, 0.123, "30.78 ± 0.12"),
        (-4.449, 0.0521, "−4.449 ± 0.052"),
        (1234.5, 31.0, "1234 ± 31"),
        (-4.44999, None, "−4.45"),
        (1.26e-20, None, "1.26 × 10⁻²⁰"),
        (math.nan, None, "—"),
        (2.5, math.nan, "2.5"),
        (2.5, 0.0, "2.5"),
        (27_320.0, None, "27\u202f320"),
        (-1804.0, None, "−1804"),
    ],
)
def test_numbers_have_the_digits_that_their_uncertainty_allows(value: float, sd: float | None, text: str) -> None:
    assert value_text(value, sd) == text


def test_checks_have_the_decimals_that_their_tolerance_asks_for() -> None:
    assert check_texts(0.10001, 0.1, 0.00142) == ("0.1000", "0.1000", "0.0014")
    assert check_texts(-1e-5, 0.0, 0.1) == ("0.00", "0.00", "0.10")
    assert check_texts(61, 61, 0) == ("61", "61", "0")
    assert check_texts(math.nan, 1.0, 0.5)[0] == "—"


@given(st.floats(), st.floats() | st.none())
def test_any_number_has_a_text(value: float, sd: float | None) -> None:
    assert value_text(value, sd)
    assert all(check_texts(value, 1.0, 0.1 if sd is None else sd))


def test_sizes() -> None:
    assert (size_text(1_500), size_text(23_400_000)) == ("1.5 kB", "23.4 MB")


def test_what_cannot_be_reported(tmp_path: Path, products: Path) -> None:
    with pytest.raises(PolfuseError, match=r"nothing to report.*polfuse focus"):
        report(tmp_path / "none.h5", tmp_path / "r.html")
    with pytest.raises(PolfuseError, match="cannot be written"):
        report(products, tmp_path / "no" / "r.html", pictures=[])


def test_the_command(tmp_path: Path, products: Path) -> None:
    out = tmp_path / "r.html"
    run = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "report"]
    made = subprocess.run([*run, str(products), "-o", str(out), "--json"], capture_output=True, text=True, timeout=100)
    assert made.returncode == 0, made.stderr
    assert json.loads(made.stdout) == {"report": str(out)}
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")
    failed = subprocess.run(
        [*run, str(tmp_path / "none.h5"), "-o", str(out)], capture_output=True, text=True, timeout=100
    )
    assert (failed.returncode, failed.stdout, failed.stderr.count("\n")) == (1, "", 1)


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed (scripts/system-packages test)")
MEASURE = """<script>window.addEventListener("load", async () => {
  const whole = document.documentElement, pictures = [...document.images];
  document.body.dataset.measured = JSON.stringify({
    width: window.innerWidth, needed: whole.scrollWidth,
    drawn: pictures.filter(picture => picture.complete && picture.naturalWidth > 0).length, pictures: pictures.length,
    letters: parseFloat(getComputedStyle(document.body).fontSize),
    links: [...document.links].filter(link => document.querySelector(link.getAttribute("href"))).length,
    asked: performance.getEntriesByType("resource").filter(entry => !entry.name.startsWith("data:")).length,
  });
  const press = (key, on) => on.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true}));
  const number = () => pictures.findIndex(picture => picture.src === document.querySelector("#viewer img").src);
  const [first] = pictures, used = {shown: []};
  first.click();
  const viewer = document.querySelector("#viewer");
  used.open = viewer.open;
  for (const key of ["ArrowRight", "Home", "ArrowLeft"]) { press(key, viewer); used.shown.push(number()); }
  const large = document.querySelector("#viewer img");
  for (let n = 0; n < 200 && !(large.complete && large.naturalWidth > 0); n++)
    await new Promise(go => setTimeout(go, 50));
  const box = document.querySelector("#viewer img").getBoundingClientRect();
  used.fits = box.right <= window.innerWidth && box.bottom <= window.innerHeight && box.width > 0;
  [...viewer.querySelectorAll("button")].at(-1).click();
  used.closed = !viewer.open;
  const table = document.querySelector("table.checks"), head = table.tHead.rows[0].cells[1];
  used.orders = [0, 1, 2].map(() => {
    head.click();
    return [head.ariaSort, ...[...table.tBodies[0].rows].map(row => row.cells[1].textContent.trim())];
  });
  const page = document.documentElement, button = document.querySelector("#theme");
  const look = () => [page.dataset.theme, getComputedStyle(document.body).backgroundColor];
  used.looks = [look()];
  for (const _ of [1, 2, 3]) { button.click(); used.looks.push(look()); }
  used.system = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  document.body.dataset.used = JSON.stringify(used);
})</script></body>"""


def in_browser(page: Path, *words: str) -> str:
    """What Chromium says of a page, without a network and with a profile of its own."""
    profile = f"--user-data-dir={page.parent / 'profile'}"
    command = [
        str(CHROMIUM), "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
        "--hide-scrollbars", "--host-resolver-rules=MAP * ~NOTFOUND", profile, *words, page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=90, check=True)
    return done.stdout


@browser
@pytest.mark.parametrize(("width", "height"), [(1366, 768), (500, 900)])
def test_a_browser_shows_all_of_it_on_a_screen_and_on_a_phone(
    page: str, tmp_path: Path, width: int, height: int
) -> None:
    copy = tmp_path / "report.html"
    copy.write_text(page.replace("</body>", MEASURE), encoding="utf-8")
    for _ in range(3):  # on a busy machine the browser's virtual time runs out while a picture is decoded
        shown = in_browser(copy, f"--window-size={width},{height}", "--virtual-time-budget=20000", "--dump-dom")
        if 'data-used="' in shown:
            break
    measured = json.loads(html.unescape(re.search(r'data-measured="([^"]*)"', shown)[1]))
    assert measured["width"] == width
    assert measured["needed"] <= width, "it has to be moved sideways"
    assert measured["drawn"] == measured["pictures"] > 0
    assert measured["links"] == page.count('href="#')
    assert measured["asked"] == 0
    assert measured["letters"] >= 16
    used = json.loads(html.unescape(re.search(r'data-used="([^"]*)"', shown)[1]))
    assert used["open"]
    assert used["closed"]
    last = measured["pictures"] - 1
    assert used["shown"] == [1, 0, last]  # to the next, to the first, and before that is the last
    assert used["fits"]
    # As numbers, not as words: 0, 0.980 and 24.1; the other way round; as written.
    assert used["orders"] == [
        ["ascending", "0", "0.980", "24.1"],
        ["descending", "24.1", "0.980", "0"],
        [None, "24.1", "0", "0.980"],
    ]
    system, light, dark, again = used["looks"]
    assert (light[0], dark[0]) == ("light", "dark")
    assert light[1] != dark[1]
    assert system == again == (light if used["system"] == "light" else dark)


@browser
def test_a_browser_prints_it(page: str, tmp_path: Path) -> None:
    copy = tmp_path / "report.html"
    copy.write_text(page, encoding="utf-8")
    in_browser(copy, f"--print-to-pdf={tmp_path / 'report.pdf'}", "--no-pdf-header-footer")
    printed = (tmp_path / "report.pdf").read_bytes()
    assert printed.startswith(b"%PDF-")
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 6
