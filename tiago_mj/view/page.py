"""A story as one HTML file that needs neither a server nor a network: viser's own player, the recording and curves.

viser's client is taken from the installed package when the file is made.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import markupsafe
import numpy as np

from tiago_mj.io import atomic, pages
from tiago_mj.view import colours, plots
from tiago_mj.view.server import serving
from tiago_mj.view.stage import Stage
from tiago_mj.view.story import Story

#: Pictures a second of the player, and the most in all.
FPS: Final = 30.0
MAX_PICTURES: Final = 360
#: It plays this long at least, if need be slower than life [s]; and how much slower that may be.
LONG_ENOUGH: Final = 5.0
SLOWER: Final = (1, 2, 4, 5, 10, 20)
#: Whether the browser prefers a dark page, asked when it opens the file.
DARK: Final = 'matchMedia("(prefers-color-scheme: dark)").matches'


def write(story: Story, path: Path, *, beside: bool = False) -> None:
    """Write the file whole."""
    atomic.write_text(path, render(story, beside=beside))


def render(story: Story, *, beside: bool = False) -> str:
    """The page.

    Args:
        story: what is shown.
        beside: whether the robots stand side by side; else as ghosts in one place.
    """
    duration = float(story.time[-1] - story.time[0])
    slower = slow_motion(duration)
    count = int(np.clip(np.ceil(duration * slower * FPS), 2, MAX_PICTURES))
    at = np.linspace(story.time[0], story.time[-1], count)
    with serving(0, "tiago-mj view") as server:
        stage = Stage(server, story, beside=beside)
        recording = server.get_scene_serializer()
        for row in np.searchsorted(story.time, at - 1e-9).clip(0, len(story.time) - 1):
            stage.show(int(row))
            recording.insert_sleep(duration * slower / count)
        page = str(recording.as_html())
        larger = stage.larger
    return with_panel(page, story, slower=slower, larger=larger)


def with_panel(page: str, story: Story, *, slower: int, larger: int) -> str:
    """viser's page with legend and curves beside the scene."""
    environment = pages.environment("tiago_mj.view")
    roles = [motion.role for motion in story.motions]
    panel = environment.get_template("panel.html.j2").render(
        story=story,
        looks=[(role, colours.LOOKS[role]) for role in roles],
        colour={role: look.colour for role, look in colours.LOOKS.items()},
        lit=colours.LIT,
        plots=plots.plots(story),
        width=plots.WIDTH,
        height=plots.HEIGHT,
        around=plots.AROUND,
        slower=slower,
        larger=larger,
        start=float(story.time[0]),
        end=float(story.time[-1]),
        ghosts=len(roles) > 1,
    )
    title = f"<title>tiago-mj view: {markupsafe.escape(pages.shown(story.robot))}</title>"
    head, _, rest = page.partition("<title>")
    _, _, after = rest.partition("</title>")
    page = head + title + after if after else page
    page = page.replace("<head>", f"<head>{pages.of_application()}", 1)
    page = page.replace("{darkMode:false}", f"{{darkMode:{DARK}}}", 1)  # else viser's player is light in a dark page
    end = page.rindex("</body>")
    return page[:end] + panel + page[end:]


def slow_motion(duration: float) -> int:
    """Slow-motion factor for a recording of so many seconds."""
    return next((k for k in SLOWER if k * duration >= LONG_ENOUGH), SLOWER[-1])
