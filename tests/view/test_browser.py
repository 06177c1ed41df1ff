"""What a real browser shows; in software, so that a picture takes about a second."""

import io
import time

import numpy as np
import pytest

pytest.importorskip("viser")

pytestmark = pytest.mark.slow


def seen(page):
    """Pixels of the scene, (height, width, 3)."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(page.locator("canvas").first.screenshot())).convert("RGB")).astype(int)


def share(pixels, colour, within=45):
    """Share of pixels whose hue is about a colour's."""
    return float((np.abs(pixels - np.array(colour)).max(axis=-1) < within).mean())


def until(true, tick=lambda: None, seconds=60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        tick()
        if true():
            return True
        time.sleep(0.03)
    return False


def drawn(page):
    pixels = seen(page)
    return len(np.unique(pixels.reshape(-1, 3) // 16, axis=0)) > 20 and float((pixels < 235).any(axis=-1).mean()) > 0.05


def magenta(pixels):
    """Lit, or lit under a ghost."""
    return float(((pixels[..., 0] > pixels[..., 1] + 40) & (pixels[..., 2] > pixels[..., 1] + 25)).mean())


def orange(pixels):
    return float(((pixels[..., 0] > pixels[..., 2] + 50) & (pixels[..., 1] > pixels[..., 2] + 15)).mean())


def test_the_saved_page_opens_without_a_server_and_plays(page, known, tmp_path):
    from tiago_mj.view.page import write

    path = tmp_path / "scene.html"
    write(known.story("pi-001"), path)
    page.emulate_media(color_scheme="dark")
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    assert until(lambda: len(np.unique(seen(page).reshape(-1, 3) // 16, axis=0)) > 20)
    assert page.locator("html").get_attribute("data-mantine-color-scheme") == "dark"
    page.emulate_media(color_scheme="light")
    page.goto(path.as_uri())
    assert until(lambda: drawn(page))
    assert page.locator("html").get_attribute("data-mantine-color-scheme") == "light"
    assert [url for url in asked if url.startswith(("http", "ws"))] == []
    first = page.locator("#now").inner_text()
    assert until(lambda: page.locator("#now").inner_text() != first)
    assert magenta(seen(page)) > 0.002
    # A click on a curve goes to that time: the middle of the grasp.
    page.locator("#watch svg").first.click(position={"x": 211, "y": 60})
    assert until(lambda: abs(float(page.locator("#now").inner_text().split()[0]) - 0.625) < 0.02)


def test_a_ghost_differs_from_the_measured_robot_where_the_gap_is(page, known):
    from tiago_mj.view.player import Player
    from tiago_mj.view.server import serving

    with serving(0, "test") as server:
        player = Player(server, ["pi-000", "pi-001"], known.story, "pi-001")
        player._hide("repaired", True)
        page.goto(f"http://127.0.0.1:{server.get_port()}")
        page.get_by_text("Go to the gap").click()
        assert until(lambda: drawn(page), player.tick)
        until(lambda: False, player.tick, 4)
        mark = player.stage.story.marks[0].start
        assert player.stage.story.time[player.stage.row] == pytest.approx(mark, abs=0.01)
        player._go(0.2)
        until(lambda: False, player.tick, 4)
        there = orange(seen(page))
        player.stage.larger = 1
        player._again = True
        until(lambda: False, player.tick, 4)
        assert there > orange(seen(page)) > 0  # drawn larger, more of the ghost stands clear of the robot
        player.stage.arrange(True)
        until(lambda: False, player.tick, 4)
        assert orange(seen(page)) > 0  # away from the measured robot, and solid
        player._want("pi-000")
        assert until(lambda: player.stage.story.signals.trial == "pi-000", player.tick)


def test_a_slider_moves_the_robot_and_an_effect_is_felt(page):
    from tiago_mj.view.live import Live
    from tiago_mj.view.server import serving
    from tiago_mj.view.session import session

    watched = session("GripperTactile-v0")
    with serving(0, "test") as server:
        live = Live(server, watched)
        page.goto(f"http://127.0.0.1:{server.get_port()}")
        assert until(lambda: drawn(page), live.tick)
        before, opened = seen(page), watched.core.state.position.copy()
        slider = page.get_by_role("slider").first
        slider.focus()
        slider.press("Home")
        assert until(lambda: watched.core.state.position[0] < opened[0] - 0.01, live.tick)
        assert watched.action[0] == pytest.approx(-1)
        assert watched.core.state.position[1] == pytest.approx(opened[1], abs=1e-3)
        until(lambda: False, live.tick, 3)
        assert np.abs(seen(page) - before).max() > 60
        page.get_by_text("Add this effect").click()
        assert until(lambda: [one.name for one in watched.effects] == ["backlash"], live.tick)
        page.get_by_text("width [mm]").wait_for()
        page.get_by_role("checkbox").last.click()
        assert until(lambda: watched.effects == (), live.tick)
    watched.close()


def test_an_address_gives_its_layout_back_and_follows_it(page):
    from tiago_mj.view import layout
    from tiago_mj.view.live import Live
    from tiago_mj.view.server import serving
    from tiago_mj.view.session import session

    watched = session("GripperTactile-v0")
    with serving(0, "test") as server:
        live = Live(server, watched)
        page.emulate_media(color_scheme="dark")
        page.set_viewport_size({"width": 1300, "height": 800})
        asked = "effects=backlash~all~width:0.003&over=reward,force-right-n&paused=yes&camera=0.9,-0.4,0.5,0,0,0.1"
        page.goto(f"http://127.0.0.1:{server.get_port()}/?{asked}&panel=folded&joint=%3Cscript%3E")
        assert until(lambda: [one.parameters for one in watched.effects] == [{"width": 0.003}], live.tick)
        assert live._layout()["over"] == "reward,force-right-n"
        (client,) = server.get_clients().values()
        assert until(lambda: np.allclose(client.camera.position, (0.9, -0.4, 0.5), atol=1e-3), live.tick)

        def address():
            return page.evaluate("location.search")  # page.url is as old as the last event that was waited for

        assert until(lambda: {"panel=folded", "policy=by-hand"} <= set(address()[1:].split("&")), live.tick)
        assert page.get_by_text("Add this effect").count() == 0 or not page.get_by_text("Add this effect").is_visible()
        assert page.locator("html").get_attribute("data-mantine-color-scheme") == "dark"
        # The address follows what is done, and is the same after it is opened again.
        live._policy.value = "pi"
        assert until(lambda: "policy=pi" in address(), live.tick)
        there = layout.read(address())
        assert there["effects"] == "backlash~all~width:0.003"
        live._apply(layout.read("policy=by-hand&effects=none&paused=no"))
        page.goto("about:blank")
        page.goto(f"http://127.0.0.1:{server.get_port()}/?{layout.write(there)}")
        assert until(lambda: live._layout()["policy"] == "pi", live.tick)
        assert layout.write({**live._layout(), "camera": there["camera"]}) == layout.write(there)
    watched.close()
