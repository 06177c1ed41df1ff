"""``tiago-mj view``: an environment live, or recordings beside their simulators, in a browser or as a file."""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any, Final

from tiago_mj.io import extra
from tiago_mj.recordings.recording import RecordingError
from tiago_mj.robots import options as robots
from tiago_mj.view import live, page, player
from tiago_mj.view.recordings import Shelf
from tiago_mj.view.server import HOST, check, serving

#: Options that an environment which is watched live has no use for.
OF_RECORDINGS: Final = (
    *("diagnosis", "model", "robot", "menagerie", "map", "gains", "fix-base", "like", "tie"),
    *("trial", "beside", "save"),
)


def run(arguments: argparse.Namespace) -> int:
    """Serve until interrupted, or write the file.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    if not arguments.recordings and not arguments.env:
        raise ValueError("nothing to watch: give --env ID, or recordings")
    extra.load("viser", "tiago-mj view", "view")
    if arguments.recordings:
        return _recordings(arguments)
    for option in OF_RECORDINGS:
        if getattr(arguments, option.replace("-", "_")):
            raise ValueError(f"--{option} is of recordings: name them, or leave it out")
    return _live(arguments)


def _recordings(arguments: argparse.Namespace) -> int:
    for option, given in (("policy", arguments.policy), ("env-option", arguments.env_option)):
        if given:
            raise ValueError(f"--{option} is of an environment that is watched live: leave out the recordings, or it")
    which = [f"--{option}" for option in ("env", "model", "robot") if getattr(arguments, option)]
    if len(which) > 1:
        raise ValueError(f"{' and '.join(which)} say which robot this is: give one")
    extra.load("pandas", "reading recordings")

    if arguments.save is not None and arguments.save.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"--save {arguments.save}: name an HTML file, such as scene.html")
    if arguments.save is None:
        check(arguments.port)
    with tempfile.TemporaryDirectory() as dropped:
        return _shown(arguments, Path(dropped))


def _shown(arguments: argparse.Namespace, dropped: Path) -> int:
    try:
        shelf = Shelf(
            arguments.recordings,
            dropped,
            robot=robots.said(arguments),
            map_file=arguments.map,
            folder=arguments.diagnosis,
            effects=arguments.effects,
        )
        known, names = shelf.library, shelf.names()
        first = arguments.trial or known.first
        if first not in names:
            raise ValueError(f"--trial {first}: there is no such recording: these are {', '.join(names)}")
        if arguments.save is not None:
            page.write(known.story(first), arguments.save, beside=arguments.beside)
            size = arguments.save.stat().st_size
            if arguments.json:
                print(json.dumps({"file": str(arguments.save), "recording": first, "bytes": size}))
            else:
                print(f"{arguments.save}: {first} in {size / 1e6:.1f} MB; it opens in any browser, without a server")
            return 0
        with serving(arguments.port, f"{known.plant.name}: recordings") as server:
            shown = player.Player(server, names, shelf.story, first, beside=arguments.beside, add=shelf.add)
            _say(server, arguments.json)
            shown.run()
    except RecordingError as fault:
        raise ValueError(str(fault)) from fault
    return 0


def _live(arguments: argparse.Namespace) -> int:
    check(arguments.port)
    session = live.session(
        arguments.env,
        arguments.env_option,
        effects=arguments.effects,
        policy=arguments.policy,
        seed=arguments.seed,
        trust=arguments.trust,
    )
    try:
        with serving(arguments.port, session.name) as server:
            shown = live.Live(server, session)
            _say(server, arguments.json)
            shown.run()
    finally:
        session.close()
    return 0


def _say(server: Any, as_json: bool) -> None:
    url = f"http://{HOST}:{server.get_port()}"
    print(json.dumps({"url": url}) if as_json else f"watch it at {url}; Ctrl-C ends it", flush=True)
