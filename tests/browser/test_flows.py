"""What people come to do, from the first gesture to the picture."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Locator, Page, ViewportSize, expect
from tests.browser.conftest import OpenPage
from tests.browser.files import ARTEFACTS, green_map, hold_over, keep, let_go, mushroom
from tests.browser.pictures import Picture, see_until, settled
from tests.browser.publisher import Publisher, distant_light
from tests.browser.server import ServerProcess
from tests.support.jobs import make_capture
from tests.support.shapes import sphere

from lightwell.io.glb import encode_glb

pytestmark = [pytest.mark.browser, pytest.mark.timeout(300)]

SIZE: ViewportSize = {"width": 900, "height": 620}
BARE = "stream=room&hud=0&backdrop=off&ev=0&theme=dark"
JOB_MS = 150_000
"""Executors start and compile, on machines that do much else."""


@pytest.fixture(scope="module")
def captures(server: ServerProcess) -> Path:
    folder = server.directory / "data" / "captures"
    make_capture(folder / "rig")
    make_capture(folder / "slow", probes=1500, size=64)
    return folder


def tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=re.compile(f"^{name}")).click()


def arrival(page: Page, name: str) -> Locator:
    return page.get_by_test_id("arrival").filter(has_text=name)


def register(page: Page, folder: str) -> None:
    page.get_by_text("Register a capture").click()
    page.get_by_label("Folder").fill(folder)
    page.get_by_role("button", name="Register", exact=True).click()


def stage(picture: Picture) -> Picture:
    """Cut out what lies left of the panel."""
    return picture[60:560, 40:520]


def test_a_dropped_mesh_gets_shadows(open_page: OpenPage, room: Publisher) -> None:
    room.coefficients = distant_light((0.2, -0.3, 1))
    page = open_page(f"#{BARE}", size=SIZE)
    expect(page.get_by_test_id("badge")).to_have_text("Live")
    hold_over(page, {"mushroom.glb": mushroom()})
    expect(page.get_by_test_id("drop")).to_contain_text("GLB, OBJ, PLY")
    keep(page, "drop-overlay")
    let_go(page)
    expect(page.get_by_test_id("drop")).to_have_count(0)
    row = arrival(page, "mushroom.glb")
    expect(row.get_by_role("progressbar")).to_be_visible()
    expect(row).to_contain_text("shadows", timeout=JOB_MS)
    tab(page, "Jobs")
    job = page.get_by_test_id("job").first
    expect(job).to_contain_text("Mesh shadows")
    expect(job).to_contain_text("mushroom.glb")
    keep(page, "drop-computing")
    # Whoever reloads the page meanwhile finds the file where it was, and sees how far it is.
    page.reload()
    expect(row).to_contain_text(re.compile("shadows: [a-z]+.*%|is shown"), timeout=JOB_MS)
    expect(row).to_have_count(1)
    expect(row).to_contain_text("is shown, with shadows", timeout=JOB_MS)
    expect(job).to_have_attribute("data-state", "succeeded")
    page.wait_for_function("location.hash.includes('object=')")
    row.get_by_role("button", name="Dismiss").click()
    tab(page, "Scene")
    expect(page.get_by_label("Object", exact=True).locator("option:checked")).to_have_text("mushroom.glb")
    with_shadows = see_until(page, lambda picture: bool(stage(picture).std() > 15))
    keep(page, "drop-shown")
    # Shadows darken, and only in places: under the cap, not on the rim of the ground.
    page.get_by_label("Shadows").uncheck()
    without = see_until(page, lambda picture: bool(np.abs(stage(picture) - stage(with_shadows)).max() > 40))
    difference = (stage(without) - stage(with_shadows)).mean(2)
    assert difference.max() > 40
    assert (np.abs(difference) < 4).mean() > 0.4
    assert difference.mean() > 0.5
    # The same is seen by whoever gets the address.
    page.get_by_label("Shadows").check()
    page.wait_for_function("!location.hash.includes('shadows=')")
    address = page.evaluate("location.hash")
    page.reload()
    again = see_until(page, lambda picture: bool(np.abs(stage(picture) - stage(with_shadows)).mean() < 2))
    assert np.abs(stage(again) - stage(with_shadows)).mean() < 2
    assert page.evaluate("location.hash") == address


def test_a_file_is_computed_again_and_deleted(open_page: OpenPage, room: Publisher, server: ServerProcess) -> None:
    httpx.post(f"{server.url}/api/v1/uploads", params={"name": "toadstool.glb"}, content=mushroom(0.9), timeout=120)
    page = open_page(f"#{BARE}&tab=files", size=SIZE)
    card = page.get_by_test_id("file").filter(has_text="toadstool.glb")
    expect(card).to_contain_text("Not used")
    expect(card).to_contain_text(re.compile(r"\d+ vertices"))
    card.get_by_role("button", name="Compute shadows…").click()
    form = page.get_by_role("form", name="New job")
    expect(form.get_by_label("Mesh").locator("option:checked")).to_have_text("toadstool.glb")
    form.get_by_label("Directions").fill("64")
    form.get_by_label("Queued").select_option("before others")
    form.get_by_role("button", name="Submit").click()
    expect(form).to_have_count(0)
    job = page.get_by_test_id("job").filter(has_text="toadstool.glb")
    expect(job).to_have_attribute("data-state", "succeeded", timeout=JOB_MS)
    tab(page, "Files")
    expect(card).to_contain_text("Used: object with shadows")
    card.get_by_role("button", name="Show").click()
    expect(card).to_contain_text("in the picture")
    # Once more, from the settings of the last time.
    card.get_by_role("button", name="Other settings…").click()
    expect(form.get_by_label("Directions")).to_have_value("64")
    form.get_by_text("More settings").click()
    expect(form.get_by_label("Ground", exact=True)).to_be_checked()
    keep(page, "transfer-again")
    form.get_by_role("button", name="Close").click()
    tab(page, "Files")
    keep(page, "files")
    card.get_by_role("button", name="Delete").click()
    card.get_by_role("button", name="Delete the file? Its objects stay").click()
    expect(card).to_have_count(0)
    tab(page, "Scene")
    expect(page.get_by_label("Object", exact=True)).not_to_have_value("stilllife")


def test_a_transfer_is_cancelled_from_its_line(open_page: OpenPage, room: Publisher) -> None:
    page = open_page(f"#{BARE}", size=SIZE)
    dense = encode_glb([sphere(240, 300, name="dense")])
    hold_over(page, {"dense.glb": dense})
    let_go(page)
    row = arrival(page, "dense.glb")
    expect(row).to_contain_text("trace", timeout=JOB_MS)
    started = time.monotonic()
    row.get_by_role("button", name="Cancel").click()
    expect(row).to_contain_text("cancelled", timeout=60_000)
    seconds = time.monotonic() - started
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    (ARTEFACTS / "cancel-transfer.txt").write_text(
        f"a running transfer was cancelled after {seconds:.2f} s, load {load:.1f} a core\n"
    )
    assert seconds < 1 + 2 * max(1, load)  # two seconds on a machine that does nothing else
    row.get_by_role("button", name="Job").click()
    expect(page.get_by_test_id("job").first).to_have_attribute("data-state", "cancelled")


def test_a_map_becomes_a_stream(
    open_page: OpenPage, room: Publisher, server: ServerProcess, tmp_path: Path, console: list[str]
) -> None:
    page = open_page(f"#{BARE}", size=SIZE)
    expect(page.get_by_test_id("badge")).to_have_text("Live")
    file = tmp_path / "Green Field.exr"
    file.write_bytes(green_map(tmp_path))
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Add a mesh or a map…").click()
    chooser.value.set_files(file)
    expect(arrival(page, "Green Field.exr")).to_contain_text("is the stream green-field", timeout=60_000)
    expect(page.get_by_label("Stream", exact=True)).to_have_value("green-field")
    expect(page.get_by_test_id("badge")).to_have_text("Static", timeout=60_000)

    def is_green(picture: Picture) -> bool:
        middle = stage(picture).mean((0, 1))
        return bool(middle[1] > 2 * middle[0])

    assert is_green(see_until(page, is_green))
    keep(page, "map-as-stream")
    tab(page, "Files")
    kept = page.get_by_test_id("file").filter(has_text="Green Field.exr")
    expect(kept).to_contain_text("64 × 32 pixels")
    expect(kept).to_contain_text("Used: stream green-field")
    kept.get_by_role("button", name="Delete").click()
    kept.get_by_role("button", name="Delete the file?").click()
    expect(kept.get_by_role("alert")).to_contain_text("delete the stream first")
    # Chromium itself reports the answer that was an error.
    assert all("409" in line for line in console), console
    console.clear()
    tab(page, "Streams")
    card = page.get_by_test_id("stream").filter(has_text="green-field")
    expect(card).to_contain_text("upload:")
    assert str(server.directory) not in card.inner_text()
    card.get_by_role("button", name="Remove").click()
    card.get_by_role("button", name="Remove it for good?").click()
    expect(card).to_have_count(0)
    expect(page.get_by_test_id("badge")).to_have_text("Live", timeout=20_000)
    tab(page, "Files")
    expect(kept).to_contain_text("Not used")
    kept.get_by_role("button", name="Make it a stream").click()
    page.wait_for_function("location.hash.includes('stream=green-field')")
    expect(kept).to_contain_text("in the picture")


def test_what_is_not_taken_is_said_in_words(open_page: OpenPage, room: Publisher, console: list[str]) -> None:
    page = open_page(f"#{BARE}", size=SIZE)
    files = {"notes.txt": b"hello", "photo.jpg": b"\xff\xd8", "empty.glb": b"", "broken.glb": mushroom()[:300]}
    hold_over(page, files)
    let_go(page)
    expect(arrival(page, "notes.txt")).to_contain_text("neither a mesh")
    expect(arrival(page, "photo.jpg")).to_contain_text(".exr or .hdr")
    expect(arrival(page, "empty.glb")).to_contain_text("is empty")
    expect(arrival(page, "broken.glb")).to_contain_text("It is cut short or damaged", timeout=60_000)
    expect(arrival(page, "broken.glb").get_by_role("button", name="Try again")).to_have_count(0)
    keep(page, "refusals")
    for name in files:
        page.get_by_role("button", name=f"Dismiss {name}").click()
    expect(page.get_by_test_id("arrival")).to_have_count(0)
    # Chromium itself reports each answer that is an error.
    assert all("422" in line for line in console), console
    console.clear()


def test_a_grid_from_a_capture_to_the_picture(
    open_page: OpenPage, room: Publisher, captures: Path, console: list[str]
) -> None:
    page = open_page(f"#{BARE}&tab=captures", size=SIZE)
    register(page, "captures/rig")
    start = see_until(page, lambda picture: bool(stage(picture).std() > 15))
    card = page.get_by_test_id("capture").filter(has_text="rig")
    expect(card).to_contain_text("40 probes")
    card.get_by_text("Look into it").click()
    expect(card).to_contain_text("mirror-sphere")
    keep(page, "captures")
    card.get_by_role("button", name="Make a grid…").click()
    form = page.get_by_role("form", name="New job")
    expect(form.get_by_label("Capture")).to_have_value("rig")
    form.get_by_label("Resolutions").fill("8")
    form.get_by_label("Bands").fill("9")
    form.get_by_role("button", name="What will it take?").click()
    expect(form.locator(".field.invalid")).to_contain_text("9")
    form.get_by_label("Bands").fill("5")
    form.get_by_role("button", name="What will it take?").click()
    expect(page.get_by_test_id("estimate")).to_contain_text("MB")
    keep(page, "job-form")
    form.get_by_role("button", name="Submit").click()
    expect(form).to_have_count(0)
    job = page.get_by_test_id("job").first
    expect(job).to_contain_text("Light grid")
    expect(job.get_by_role("button", name="Open the grid")).to_be_visible(timeout=JOB_MS)
    expect(job.get_by_role("img")).to_have_count(0)  # the preview is decoration of a button
    expect(job.locator("img")).to_be_visible()
    job.get_by_text("Results").click()
    expect(job.get_by_role("link", name="report.json")).to_be_visible()
    job.get_by_text("Log").click()
    expect(job.locator("pre").first).to_contain_text("succeeded")
    keep(page, "job-done")
    job.get_by_role("button", name="Open the grid").click()
    page.wait_for_function("location.hash.includes('light=grid') && location.hash.includes('grid=')")
    expect(page.get_by_test_id("at")).to_contain_text(" m")
    expect(page.get_by_label("Which grid").locator("option:checked")).to_contain_text("8×8×8")
    page.get_by_label("Slice", exact=True).fill("0.25")
    page.wait_for_function("location.hash.includes('slice=0.25')")
    expect(page.get_by_test_id("badge")).to_have_text("Grid")  # until it has come, the stream's light stays
    first = settled(page)
    assert stage(first).std() > 8
    keep(page, "grid-open")
    page.get_by_role("radio", name="Both").check(force=True)
    expect(page.get_by_test_id("modulation")).to_contain_text("Gain", timeout=20_000)
    page.get_by_role("radio", name="Grid").check(force=True)
    page.wait_for_function("location.hash.includes('light=grid')")
    page.reload()
    again = see_until(page, lambda picture: bool(np.abs(stage(picture) - stage(first)).mean() < 2))
    assert np.abs(stage(again) - stage(first)).mean() < 2
    tab(page, "Grids")
    grid = page.get_by_test_id("grid").first
    expect(grid).to_contain_text("shown")
    grid.get_by_text("Look into it").click()
    expect(grid).to_contain_text("relative")
    grid.get_by_role("radio", name="down").check(force=True)
    expect(grid.locator("img")).to_have_attribute("src", re.compile("normal=0,0,-1"))
    grid.get_by_role("button", name="Sample at").click()
    # The server's first sample compiles a kernel.
    expect(page.get_by_test_id("sample")).to_contain_text("of the sphere", timeout=60_000)
    expect(grid).to_contain_text("lightwell grid export")
    keep(page, "grids")
    grid.get_by_role("button", name="Slices with axes").click()
    expect(page.get_by_role("dialog").locator("img")).to_be_visible()
    page.keyboard.press("Escape")
    grid.get_by_role("button", name="Back to the stream").click()
    page.wait_for_function("!location.hash.includes('light=')")
    # The camera comes along: the objects are framed as at first.
    home = see_until(page, lambda picture: bool(np.abs(stage(picture) - stage(start)).mean() < 2))
    assert np.abs(stage(home) - stage(start)).mean() < 2
    # Chromium itself reports the answer that was an error.
    assert all("422" in line for line in console), console
    console.clear()


def test_a_job_is_cancelled_tried_again_and_deleted(open_page: OpenPage, room: Publisher, captures: Path) -> None:
    page = open_page(f"#{BARE}&tab=captures", size=SIZE)
    register(page, "captures/slow")
    page.get_by_test_id("capture").filter(has_text="slow").get_by_role("button", name="Make a grid…").click()
    form = page.get_by_role("form", name="New job")
    form.get_by_label("Resolutions").fill("64")
    form.get_by_text("More settings").click()
    form.get_by_label("Checkpoint (s)").fill("0.5")
    form.get_by_role("button", name="Submit").click()
    job = page.get_by_test_id("job").first
    expect(job).to_have_attribute("data-state", "running", timeout=JOB_MS)
    expect(page.get_by_role("tab", name=re.compile("^Jobs"))).to_contain_text("1")
    expect(job.get_by_role("progressbar")).to_have_attribute("aria-valuenow", re.compile(r"\d+"), timeout=JOB_MS)
    # What there is so far is drawn.
    page.wait_for_function("document.querySelector('[data-testid=job] img')?.naturalWidth > 0", timeout=JOB_MS)
    expect(job).to_have_attribute("data-state", "running")
    keep(page, "job-running")
    job.get_by_role("button", name="Cancel").click()
    expect(job).to_have_attribute("data-state", "cancelled", timeout=30_000)
    job.get_by_role("button", name="Retry").click()
    expect(job).to_have_attribute("data-state", "running", timeout=JOB_MS)
    job.get_by_role("button", name="Cancel").click()
    expect(job).to_have_attribute("data-state", "cancelled", timeout=30_000)
    count = page.get_by_test_id("job").count()
    job.get_by_role("button", name="Delete").click()
    job.get_by_role("button", name="Delete it and its results?").click()
    expect(page.get_by_test_id("job")).to_have_count(count - 1)


def test_a_thinned_capture_is_registered(
    open_page: OpenPage, room: Publisher, server: ServerProcess, captures: Path
) -> None:
    settings = {"capture": "captures/rig", "tolerance": 0.3}
    body = {"kind": "capture-reduce", "settings": settings}
    made = httpx.post(f"{server.url}/api/v1/jobs", json=body, timeout=60).json()
    page = open_page(f"#{BARE}&tab=jobs&jobKind=capture-reduce", size=SIZE)
    job = page.get_by_test_id("job").filter(has_text="Thinned capture")
    job.get_by_role("button", name="Use as a capture").click(timeout=JOB_MS)
    expect(page.get_by_role("tab", name="Captures")).to_have_attribute("aria-selected", "true")
    card = page.get_by_test_id("capture").filter(has_text=f"reduced-{made['id'][:6]}")
    expect(card).to_contain_text(re.compile(r"\d+ probes"))
    card.get_by_role("button", name="Make a grid…").click()
    expect(page.get_by_role("form", name="New job").get_by_label("Capture")).to_have_value(re.compile("^reduced-"))


def test_a_film_is_rendered(open_page: OpenPage, room: Publisher, server: ServerProcess) -> None:
    scenes = server.directory / "data" / "scenes"
    scenes.mkdir(exist_ok=True)
    (scenes / "ball.toml").write_text(
        'method = "igi"\ncamera.position = [0, -4, 1]\n[[objects]]\nshape = "sphere"\nemission = 2\n'
    )
    page = open_page(f"#{BARE}&tab=jobs", size=SIZE)
    page.get_by_role("button", name="New job…").click()
    form = page.get_by_role("form", name="New job")
    form.get_by_label("Kind", exact=True).select_option("igi-render")
    form.get_by_label("Scene", exact=True).fill("scenes/ball.toml")
    form.get_by_role("button", name="Add what is shown now").click()
    expect(form.get_by_label("Camera: path 1: Fov (°)")).to_have_value("36")
    form.get_by_role("button", name="Remove 1").click()
    form.get_by_label("Camera: orbit (°)").fill("90")
    form.get_by_label("Width", exact=True).fill("64")
    form.get_by_label("Height", exact=True).fill("48")
    form.get_by_text("More settings").click()
    form.get_by_label("Frames", exact=True).fill("3")
    form.get_by_role("button", name="Submit").click()
    job = page.get_by_test_id("job").filter(has_text="Render ball.toml")
    expect(job).to_have_attribute("data-state", "succeeded", timeout=JOB_MS)
    page.wait_for_function("document.querySelector('[data-testid=job] img')?.naturalWidth == 64", timeout=JOB_MS)
    with page.context.expect_page() as opened:
        job.get_by_role("button", name="Open the film").click()
    assert opened.value.request.get(opened.value.url).headers["content-type"] == "video/mp4"


def test_jobs_are_found_among_many(open_page: OpenPage, room: Publisher, server: ServerProcess, captures: Path) -> None:
    body = {"kind": "ilf-grid", "settings": {"capture": "captures/slow", "resolutions": 48}, "priority": 1000}
    with httpx.Client(base_url=f"{server.url}/api/v1", timeout=60) as api:
        for _ in range(25):
            job = api.post("/jobs", json=body).json()["id"]
            api.post(f"/jobs/{job}/cancel").raise_for_status()
    page = open_page(f"#{BARE}&tab=jobs", size=SIZE)
    jobs = page.get_by_test_id("job")
    expect(jobs).to_have_count(20)
    page.get_by_label("State").select_option("cancelled")
    page.get_by_label("Kind of job").select_option("Light grid")
    page.wait_for_function("location.hash.includes('jobState=cancelled') && location.hash.includes('jobKind=ilf-grid')")
    expect(jobs).to_have_count(20)
    page.get_by_role("button", name="Older jobs").click()
    expect(jobs.nth(24)).to_have_attribute("data-state", "cancelled")
    page.reload()
    expect(page.get_by_label("State")).to_have_value("cancelled")
    expect(jobs).to_have_count(20)
    page.get_by_label("State").select_option("queued")
    expect(page.get_by_text("None of these")).to_be_visible()
    keep(page, "jobs-none")
    page.get_by_role("button", name="List all").click()
    expect(jobs).to_have_count(20)
    keep(page, "jobs-many")
