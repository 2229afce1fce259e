"""The report in a real browser: what it loads, draws and answers."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import pom

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture
from report_pages import html

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.slow, pytest.mark.browser]
WORDS = {"pass": "pass", "fail": "FAIL", "invalid": "invalid", "not_tested": "not tested"}
CASE = "#case-short_period_full_flaps"


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    return pom.write_report(
        fixture.results(),
        folder,
        title="T-37 flight model",
        provenance=fixture.PROVENANCE,
        databases=fixture.databases(),
        diagnoses={"short_period_full_flaps": fixture.diagnosis()},
        fits=fixture.fits(),
        paper=None,
    ).as_uri()


@pytest.fixture
def page(page):
    """A page that loads nothing but the report itself."""
    page.set_viewport_size({"width": 1400, "height": 1000})
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    yield page
    assert [url for url in asked if not url.startswith("data:")] == [page.url.partition("#")[0]]


def open_case(page, address, case=CASE):
    """Open the page of a case; its panels are drawn last."""
    page.goto(address + case)
    page.wait_for_selector(f"{case.partition('&')[0]} .panel canvas")


@pytest.fixture(scope="module", params=[20_000, 0], ids=["cases apart", "list of the cases apart"])
def long_report(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("long")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pom.report.page.MOST_HELD", request.param)
        given = {
            "title": "T-37 flight model",
            "provenance": fixture.PROVENANCE,
            "databases": fixture.databases(),
        }
        return pom.write_report(fixture.results(), folder, paper=None, **given)


def test_a_long_report_loads_a_case_when_it_is_opened(new_page, long_report):
    page, (asked, complaints) = new_page(), ([], [])
    page.on("request", lambda request: asked.append(Path(request.url.partition("#")[0]).name))
    page.on("console", lambda message: complaints.append(message.text))
    page.goto(long_report.as_uri())
    page.evaluate("report.unpacked")
    listed = [path.name for path in (long_report.parent / "pages").glob("index.js")]
    assert asked == ["report.html", *listed]
    for rows in ("#matrix tbody tr", "main > .case"):
        expect(page.locator(rows)).to_have_count(len(fixture.results()))
    expect(page.locator("#inputs tr").nth(1)).to_be_attached()
    open_case(page, long_report.as_uri())
    file = f"{CASE.removeprefix('#')}.js"
    assert file in asked
    expect(page.locator(f"{CASE} .panel canvas")).to_have_count(10)
    page.goto(f"{long_report.as_uri()}#models")
    page.locator("#models .body table").first.wait_for()
    assert "models.js" in asked
    page.goto(f"{long_report.as_uri()}#term-CL-gear")
    page.locator("#models-1-CL .body figure").first.wait_for()
    assert "models-1-CL.js" in asked
    other = next(
        path for path in (long_report.parent / "pages").glob("case-*.js") if path.name != file
    )
    kept = other.read_bytes()
    other.unlink()
    page.goto(f"{long_report.as_uri()}#{other.stem}")
    page.locator(f"#{other.stem} .body", has_text="results.json").wait_for()
    other.write_bytes(kept)
    assert any(f"pages/{other.name} is not next to report.html" in text for text in complaints)


def spans(page):
    """Limits of the time axis of the case as its fields have them."""
    return [float(page.locator(f"{CASE} .{end}").input_value()) for end in ("from", "to")]


def expect_spans(page, start, stop):
    """Wait until the fields of the time axis have these texts, regular expressions or not."""
    for end, text in (("from", start), ("to", stop)):
        expect(page.locator(f"{CASE} .{end}")).to_have_value(text)


PIXELS = """canvas => {
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data,
    seen = new Set();
  for (let i = 0; i < data.length; i += 4) if (data[i + 3] > 200) seen.add(data[i] + ',' + data[i + 1] + ',' + data[i + 2]);
  return [...seen];
}"""


def test_the_page_of_a_case_names_its_report(page, address):
    open_case(page, address)
    expect(page.locator(f"{CASE} .of-report")).to_have_text("T-37 flight model")


def test_all_panels_are_drawn_in_their_colours(page, address):
    open_case(page, address)
    channels = page.locator(f"{CASE} .panel").evaluate_all(
        "panels => panels.map(p => p.dataset.channel)"
    )
    assert channels == ["theta", "q", "nz", "delta_e", "engine1.thrust_drive", "alpha", "V"]
    canvases = page.locator(f"{CASE} .panel canvas")
    expect(canvases).to_have_count(
        10
    )  # three judged channels with a residual strip each, two inputs, two more
    colours = [set(canvases.nth(i).evaluate(PIXELS)) for i in range(10)]
    band, flight, final = "219,233,246", "0,0,0", "0,114,178"
    assert all(len(seen) > 10 for seen in colours)
    assert {band, flight, final} <= colours[0]
    assert {band, final} <= colours[1]
    assert flight in colours[7]
    assert band not in colours[7]


def test_a_drag_zooms_every_panel_and_a_double_click_resets(page, address):
    open_case(page, address)
    expect_spans(page, "4.00", "18.00")
    area = page.locator(f"{CASE} .u-over").nth(2).bounding_box()
    x, y = area["x"], area["y"] + area["height"] / 2
    page.mouse.move(x + area["width"] * 0.25, y)
    page.mouse.down()
    page.mouse.move(x + area["width"] * 0.5, y, steps=5)
    page.mouse.up()
    expect_spans(page, re.compile(r"^7\."), re.compile(r"^1[01]\."))
    assert spans(page) == pytest.approx([7.5, 11.0], abs=0.1)
    limits = page.evaluate("report.limits()")
    assert len(limits) == 10
    assert limits == [limits[0]] * 10
    assert limits[0] == pytest.approx([7.5, 11.0], abs=0.1)
    expect(page).to_have_url(re.compile(r"#case-short_period_full_flaps&t=7\.\d+,1[01]\.\d+$"))
    page.mouse.dblclick(x + 20, y)
    expect_spans(page, "4.00", "18.00")
    expect(page).to_have_url(address + CASE)


def test_the_address_opens_the_same_view(page, address):
    open_case(page, address, CASE + "&t=6.00,9.50")
    expect_spans(page, "6.00", "9.50")
    assert page.evaluate("report.limits()")[0] == [6.0, 9.5]


def test_a_click_on_a_verdict_goes_to_the_exit(page, address):
    open_case(page, address)
    link = page.locator(f'{CASE} tr[data-criterion="pitch angle"][data-run="datcom"] a.jump').last
    at = float(link.text_content())
    link.click()
    expect(page).to_have_url(re.compile("&t="))  # written last
    start, stop = spans(page)
    assert start < at < stop
    assert stop - start < 3.0


def test_keys(page, address):
    page.goto(address)
    page.wait_for_selector("#overview:not([hidden])")
    second = "#case-approach_elevator_step"
    places = (("n", CASE), ("n", second), ("p", CASE), ("f", second), ("o", "#overview"))
    for key, place in places:
        page.keyboard.press(key)
        expect(page.locator(place)).to_be_visible()
        expect(page).to_have_url(address + place)
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).to_be_hidden()


def test_the_skip_link_stays_on_its_page(page, address):
    open_case(page, address)
    page.locator("a.skip").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#main")).to_be_focused()
    expect(page).to_have_url(address + "#main")
    expect(page.locator(f"{CASE} .panel canvas").first).to_be_visible()


def colours_of_first(page):
    return set(page.locator(f"{CASE} .panel canvas").first.evaluate(PIXELS))


def test_number_keys_hide_and_show_a_trace(page, address):
    open_case(page, address)
    final, shown = "0,114,178", page.locator(f'{CASE} .legend button[data-run="final"]')
    assert final in colours_of_first(page)
    page.keyboard.press("4")
    expect(shown).to_have_attribute(
        "aria-pressed", "false"
    )  # the panels are drawn in the same turn
    assert final not in colours_of_first(page)
    page.keyboard.press("4")
    expect(shown).to_have_attribute("aria-pressed", "true")
    assert final in colours_of_first(page)


def test_one_cursor_reads_all_panels(page, address):
    open_case(page, address)
    area = page.locator(f"{CASE} .u-over").first.bounding_box()
    page.mouse.move(area["x"] + area["width"] / 2, area["y"] + 40)
    values = page.locator(f"{CASE} .panel-values")
    expect(values).to_have_text([re.compile(r"^t 11\.0")] * 7)
    heads = values.all_text_contents()
    theta = (
        fixture.short_period_result()
        .signals["theta"]
        .sel(run="final")
        .interp(time=float(heads[0].split()[1]))
    )
    assert f"{float(theta) * 57.29578:.2f}" in heads[0]


def test_scales_of_script_and_print_agree(page, address):
    open_case(page, address)
    whole = page.evaluate("report.scales()")
    page.evaluate(
        "report.zoom([4.0001, 17.9999])"
    )  # the script's own rule instead of the limits that came with the data
    expect(page).to_have_url(re.compile("&t="))
    for a, b in zip(whole, page.evaluate("report.scales()"), strict=True):
        assert b == pytest.approx(a, abs=0.01 * (a[1] - a[0]))


def test_verdicts_of_the_overview_are_those_of_json(page, address):
    document = json.loads(
        Path(address.removeprefix("file://")).with_name("results.json").read_text(encoding="utf-8")
    )
    page.goto(address)
    rows = page.locator("#matrix tbody tr")
    for i, item in enumerate(document["results"]):
        expected = [re.compile(rf"^\S+ {WORDS[item['status'][run]]}$") for run in fixture.RUNS]
        expect(rows.nth(i).locator(".verdict")).to_have_text(expected)


def test_filters_and_order_of_the_overview(page, address):
    page.goto(address)

    first, roll, step = (
        "Short period, full flaps, gear down",
        "Roll response, clean",
        "Elevator step in approach",
    )
    shown = page.locator("#matrix tbody tr:visible a")
    expect(shown).to_have_text([first, step, roll])
    page.get_by_role("button", name="not run or not judged").click()
    expect(shown).to_have_text([step])
    expect(page.locator("#shown-count")).to_have_text("1 of 3 cases")
    page.get_by_role("button", name="all", exact=True).click()
    page.locator("#chapter").select_option("2.d")
    expect(shown).to_have_text([roll])
    page.locator("#chapter").select_option("")
    sort = page.get_by_role("button", name="sort by the ratio of datcom")
    sort.click()
    expect(shown.last).to_have_text(roll)  # 1.53 against 1.63
    expect(page.locator("#matrix th[aria-sort]")).to_have_attribute("aria-sort", "descending")
    sort.click()
    expect(shown.first).to_have_text(roll)
    sort.click()
    expect(shown.first).to_have_text(first)
    expect(page.locator("#matrix th[aria-sort]")).to_have_count(0)


ROWS = """rows => rows.map(row => [row.dataset.criterion, row.dataset.run,
                               row.querySelector('.ratio').textContent,
                                 row.querySelector('.state').textContent])"""


def printed(page):
    """Ratio and verdict of every row of the verdict table, by criterion and model."""
    rows = page.locator(f"{CASE} .verdicts tr[data-row]").evaluate_all(ROWS)
    return {
        (criterion, run): (ratio, word.split(maxsplit=1)[1]) for criterion, run, ratio, word in rows
    }


def outcome(page):
    return page.locator(f"{CASE} .outcome .state").all_text_contents()


def test_another_share_of_the_tolerance_is_shown_and_taken_back(page, address):
    open_case(page, address)
    whole, before = printed(page), outcome(page)
    page.get_by_role("button", name="20 %").click()
    expect(page).to_have_url(f"{address}{CASE}&f=20")  # written last
    expect(page.locator(f"{CASE} .asked-note")).to_contain_text("Shown at 20 % of the tolerance")
    fifth = printed(page)
    for item in fixture.short_period_result().verdict.to_dict("records"):
        ratio, word = fifth[(item["criterion"].replace("_", " "), item["run"])]
        assert ratio == f"{5 * item['worst_ratio']:.2f}"
        assert word == ("pass" if 5 * item["worst_ratio"] <= 1 else "FAIL")
    assert fifth != whole
    assert [word.split()[1] for word in outcome(page)] == ["FAIL", "FAIL", "pass"]
    exits = page.evaluate("report.exits()")
    assert set(exits["theta"]) == {"datcom", "corrected"}
    page.keyboard.press("n")
    page.wait_for_selector("#case-approach_elevator_step .panel canvas")
    expect(page).to_have_url(address + "#case-approach_elevator_step&f=20")
    page.goto(address + CASE)
    page.wait_for_selector(f"{CASE} .panel canvas")
    expect(page.locator(f"{CASE} .asked-note")).to_be_hidden()
    assert printed(page) == whole
    assert outcome(page) == before


def test_the_verdicts_of_the_page_stay_those_of_the_file(page, address):
    """What the script shows at the share that was applied is what Python wrote."""
    open_case(page, address)
    page.get_by_role("button", name="40 %").click()
    expect(page).to_have_url(f"{address}{CASE}&f=40")
    page.get_by_role("button", name="100 %").click()
    expect(page).to_have_url(address + CASE)
    document = json.loads(
        Path(address.removeprefix("file://")).with_name("results.json").read_text(encoding="utf-8")
    )
    for item in document["results"][0]["verdict"]:
        assert printed(page)[(item["criterion"].replace("_", " "), item["run"])] == (
            f"{item['worst_ratio']:.2f}",
            WORDS[item["verdict"]],
        )


def test_without_script_tables_and_figures_stand(new_page, address):
    page = new_page(java_script_enabled=False)
    page.goto(address)
    expect(page.locator("#matrix tbody tr")).to_have_count(3)
    expect(page.locator("article.case")).to_have_count(3)
    for i in range(3):
        case = page.locator("article.case").nth(i)
        assert case.locator("tbody tr").count() >= 3
        figure = case.locator("figure svg").first
        expect(figure).to_be_visible()
        assert figure.bounding_box()["height"] > 200
        assert figure.locator("path.trace").count() >= 6


def test_a_browser_that_cannot_unpack_shows_the_figures(new_page, address):
    page = new_page()
    page.add_init_script("delete window.DecompressionStream")
    page.goto(address + CASE)
    page.wait_for_selector(f"{CASE} .body figure svg")
    expect(page.locator(f"{CASE} .body tbody tr")).to_have_count(9)


def test_print_of_the_overview_holds_everything(new_page, address):
    page = new_page()
    page.goto(address)
    page.evaluate("report.unpacked")
    page.emulate_media(media="print")
    page.wait_for_selector("#case-roll_response_clean .paper svg")
    for key in ("short_period_full_flaps", "roll_response_clean", "approach_elevator_step"):
        expect(page.locator(f"#case-{key} .paper svg path.trace").first).to_be_visible()
        expect(page.locator(f"#case-{key} .verdicts")).to_be_visible()
    expect(page.locator("#models-1-CL .figure").first).to_be_visible()
    expect(page.locator(".bar")).to_be_hidden()
    assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"]
    page.emulate_media(media="screen")
    page.goto(address + CASE)
    page.wait_for_selector(f"{CASE} .panel canvas")
    page.emulate_media(media="print")
    page.wait_for_selector(f"{CASE} .paper svg")
    expect(page.locator("article.page:visible")).to_have_count(1)
    expect(page.locator(f"{CASE} .panels")).to_be_hidden()
    expect(
        page.locator(f"{CASE} .paper svg .exit").nth(1)
    ).to_be_attached()  # hatched, for paper without colours


def test_paper_shows_the_panels_of_the_screen(page, address):
    open_case(page, address)
    page.emulate_media(media="print")
    page.wait_for_selector(f"{CASE} .paper svg")
    own_text = (
        "all => all.map(title => title.childNodes[title.querySelector('.symbol') ? 1 : "
        "0].textContent)"
    )
    words = page.locator(f"{CASE} .panel-title").evaluate_all(own_text)
    expect(page.locator(f"{CASE} .paper svg .title")).to_have_text(words)
    traces = page.locator(f"{CASE} .paper svg path.trace")
    expect(traces).to_have_count(
        3 * 4 + 3 * 3 + 2 + 2 * 4
    )  # judged with their strips, inputs, the rest
    frame = page.locator(f"{CASE} .paper rect.frame").first.evaluate(
        "r => ['x', 'y', 'width', 'height'].map(n => +r.getAttribute(n))"
    )
    path = traces.first.get_attribute("d")
    drawn = [tuple(map(float, point.split())) for point in re.split("[ML]", path)[1:]]
    flight = np.degrees(fixture.short_period_result().signals["theta"].sel(run="flight").values)
    low, high = page.evaluate("report.scales()")[0]
    time = (np.array([x for x, _ in drawn]) - frame[0]) / frame[2] * 14.0 + 4.0
    theta = low + (frame[1] + frame[3] - np.array([y for _, y in drawn])) / frame[3] * (high - low)
    slack = (
        0.5 / frame[3] * (high - low) + 12.0 * 0.2 / frame[2] * 14.0
    )  # thinning and rounding; the same in time on a slope of 12 deg/s
    record = fixture.short_period_result().signals["time"].values
    assert np.abs(np.interp(record, time, theta) - flight).max() < slack


def test_a_term_of_the_cause_leads_to_its_tables(page, address):
    open_case(page, address)
    page.locator(f"{CASE} details:has(.cause) summary").click()
    page.locator(f"{CASE} .cause a", has_text="CL/gear").first.click()
    expect(page.locator("#models-1-CL")).to_be_visible()
    expect(page.locator(".bar a[aria-current]")).to_have_text("Models")
    # The last term of a page cannot stand at the top.
    in_view = (
        "() => { const { y } = "
        "document.querySelector('#term-CL-gear').getBoundingClientRect(); return 0 <= y && y < "
        "innerHeight; }"
    )
    page.wait_for_function(in_view)  # scrolled to, once the page is unpacked


def test_a_sweep_is_a_cross_plot_on_screen_and_paper(page, tmp_path):
    result = fixture.column_sweep_result()
    document = tmp_path / "report.html"
    document.write_text(html([result])["report.html"], encoding="utf-8")
    page.goto(document.as_uri() + "#case-column_sweep")
    page.wait_for_selector("#case-column_sweep .crosses svg path.trace")
    lines = page.locator("#case-column_sweep .crosses path.trace")
    expect(lines).to_have_count(4)
    expect(page.locator("#case-column_sweep .crosses .bars-of-band")).to_be_visible()
    page.keyboard.press("2")
    expect(lines).to_have_count(3)
    page.keyboard.press("2")
    expect(lines).to_have_count(4)
    bars = page.locator("#case-column_sweep .crosses .bars-of-band")
    height = (
        "bars => { const [top, bottom] = bars.getAttribute('d').match(/ "
        "([\\d.]+)V([\\d.]+)/).slice(1).map(Number); return bottom - top; }"
    )
    whole = bars.evaluate(height)
    page.get_by_role("button", name="40 %").click()
    expect(page).to_have_url(re.compile("&f=40$"))
    assert (
        0.35 < bars.evaluate(height) / whole < 0.6
    )  # 0.4, on a scale that the smaller band leaves tighter
    page.emulate_media(media="print")
    expect(lines.first).to_be_visible()


def test_a_local_model_is_drawn_when_it_is_opened(page, address):
    page.goto(address + "#identification")
    page.wait_for_selector("#identification h1")
    expect(page.locator(".fit-figure svg")).to_have_count(0)
    page.locator('#identification a[href="#fit-1"]').click()
    page.wait_for_selector("#fit-1 .fit-figure svg path.trace")
    expect(page.locator("#fit-1 .fit-figure svg path.trace")).to_have_count(
        3
    )  # measured, fitted, residual
    expect(page.locator("#fit-1 tbody tr")).to_have_count(2)
    page.goto(address + "#fit-0")
    page.wait_for_selector("#fit-0 .fit-figure svg path.trace")


def laid_out(page, address, place):
    """Open a page of the report; it is laid out when the report has unpacked all."""
    page.goto(address + place)
    expect(page.locator(f"{place} h1")).to_be_visible()
    page.evaluate("report.unpacked")
    if place == CASE:
        expect(page.locator(f"{place} .panel canvas")).to_have_count(10)


def test_a_narrow_screen_needs_no_sideways_scrolling(new_page, address):
    for place in ("#overview", CASE, "#models", "#identification", "#provenance"):
        page = new_page(viewport={"width": 400, "height": 800})
        laid_out(page, address, place)
        assert page.evaluate("document.documentElement.scrollWidth") <= 400, place


PROBLEMS = """() => {
  const all = (query) => [...document.querySelectorAll(query)].filter((node) => node.checkVisibility()), found = [];
  const nameOf = (node) => node.getAttribute('aria-label') || node.textContent.trim()
    || node.closest('label')?.textContent.trim();
  const hasText = (image) => image.closest('[aria-hidden]')
    || (image.getAttribute('role') === 'img' && image.getAttribute('aria-label'));
  const start = (node) => node.outerHTML.slice(0, 80);
  for (const node of all('button, a[href], input, select')) if (!nameOf(node)) found.push('no name: ' + start(node));
  for (const table of all('table')) if (!table.querySelector('th[scope]')) found.push('no heads: ' + start(table));
  for (const cell of all('th')) if (!cell.scope) found.push('no scope: ' + start(cell));
  for (const image of all('svg')) if (!hasText(image)) found.push('no text: ' + start(image));
  for (const panel of all('.panel')) if (!panel.getAttribute('aria-label')) found.push('no text: ' + start(panel));
  const ids = [...document.querySelectorAll('[id]')].map((node) => node.id),
    twice = ids.filter((id, i) => ids.indexOf(id) !== i);
  if (twice.length) found.push('id twice: ' + twice);
  if (all('h1').length !== 1) found.push('headings of first level: ' + all('h1').length);
  const unlabelled = (node) => !document.getElementById(node.getAttribute('aria-labelledby'));
  for (const node of all('[aria-labelledby]')) if (unlabelled(node)) found.push('no label: ' + start(node));
  return found;
}"""


def test_tables_have_heads_and_controls_have_names(page, address):
    for place in ("#overview", CASE, "#models", "#identification", "#provenance"):
        laid_out(page, address, place)
        assert page.evaluate(PROBLEMS) == [], place


# WCAG 2.2: relative luminance, and the least contrast of texts against the ground of the page
CONTRAST = """() => {
  const channel = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = (text) => text.match(/[\\d.]+/g).slice(0, 3).reduce((sum, v,
    i) => sum + channel(v / 255) * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = light(getComputedStyle(document.documentElement).backgroundColor);
  const texts = [...document.querySelectorAll('p, td, th, a, h1, h2, .verdict, .quiet, button:enabled')];
  const shown = texts.filter((node) => node.checkVisibility() && node.textContent.trim());
  const found = shown.map((node) => light(getComputedStyle(node).color));
  return Math.min(...found.map((l) => (Math.max(l, ground) + 0.05) / (Math.min(l, ground) + 0.05)));
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_stand_out(new_page, address, scheme):
    page = new_page(color_scheme=scheme)
    open_case(page, address)
    assert page.evaluate(CONTRAST) >= 4.5  # WCAG 2.2, 1.4.3


@pytest.mark.nightly  # a key at a time through the whole page
def test_the_page_is_used_by_keyboard_alone(page, address):
    page.goto(address)
    page.wait_for_selector("#overview:not([hidden])")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent") == "Roll response, clean":
            break
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"
    page.keyboard.press("Enter")
    page.wait_for_selector("#case-roll_response_clean .panel canvas")
    page.locator("#case-roll_response_clean .from").focus()
    page.keyboard.press("Control+A")
    page.keyboard.type("32")
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile(r"&t=32\.00,40\.00$"))
    assert page.evaluate("report.limits()")[0] == [32.0, 40.0]


@pytest.mark.nightly
def test_a_narrow_page_shows_the_verdicts_and_print_fits_the_sheet(page, address):
    page.set_viewport_size({"width": 800, "height": 900})
    open_case(page, address)
    edges = page.locator(f"{CASE} .verdicts .state").evaluate_all(
        "cells => cells.map(cell => cell.getBoundingClientRect().right)"
    )
    assert edges
    assert max(edges) <= 800.0
    # the tolerance stands in the cell of its criterion
    expect(page.locator(f"{CASE} .verdicts .narrow-only").first).to_be_visible()
    # no table of the pages next to the cases is cut
    for place in ("#overview", "#models", "#identification"):
        laid_out(page, address, place)
        cut = page.locator(f"{place} .wide").evaluate_all(
            "boxes => boxes.filter(box => box.scrollWidth > box.clientWidth + 1).length"
        )
        assert cut == 0, place
    open_case(page, address)
    # A4 without its margins is 680 px wide: a wider table shrinks the whole page
    page.set_viewport_size({"width": 680, "height": 900})
    page.emulate_media(media="print")
    widths = page.locator(f"{CASE} table").evaluate_all(
        "tables => tables.map(table => table.getBoundingClientRect().right)"
    )
    assert max(widths) <= 690.0
