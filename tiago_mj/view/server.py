"""Web server of a view: reachable from this machine alone, at a given port, closed with its context."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import logging
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from tiago_mj.io import extra

HOST: Final = "127.0.0.1"
PORT: Final = 8080
#: Windows that are narrower are a phone's [pixel].
PHONE: Final = 700


@contextmanager
def serving(port: int, title: str) -> Iterator[Any]:
    """A ``viser.ViserServer``.

    Args:
        port: on this machine; 0: any that is free.
        title: over its panel, and of the browser's tab.

    Raises:
        ValueError: the port is in use, or no port.
        ModuleNotFoundError: viser is not installed.
    """
    viser = extra.load("viser", "tiago-mj view", "view")
    check(port)
    logging.getLogger("websockets.server").addHandler(logging.NullHandler())  # who hangs up early is no news
    with contextlib.redirect_stdout(io.StringIO()):  # a banner; the command says where it is served
        server = viser.ViserServer(host=HOST, port=port, label=title, verbose=False)
    try:
        if port and server.get_port() != port:  # taken between the check and now
            raise ValueError(in_use(port))
        theme(server.gui, dark=False)  # until a browser says what it prefers
        server.on_client_connect(lambda client: in_browser(client, opened(title)))
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):  # it says that it stopped
            server.stop()


def theme(gui: Any, *, dark: bool) -> None:
    """Colours of the panels, of a server's browsers or of one of them."""
    gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, brand_color=(0, 114, 178))


def in_browser(client: Any, script: str) -> None:
    """Run a script in one browser, by the message with which viser loads its own."""
    messages = importlib.import_module("viser._messages")
    client.gui._websock_interface.queue_message(messages.RunJavascriptMessage(source=script))


def opened(title: str) -> str:
    """Script for a browser that opens the view: the tab is called by what is watched, and on a phone the panel, which
    would hide the robot, is folded until its head is touched, unless the address asks for it."""
    return f"""(() => {{
  const title = {json.dumps(title)};
  document.title = title;
  if (innerWidth >= {PHONE} || window.tiagoFolded || /[?&]panel=open(&|$)/.test(location.search)) return;
  window.tiagoFolded = window.tiagoFolding = true;
  let left = 100;
  const timer = setInterval(() => {{
    const leaves = [...document.querySelectorAll("div")].filter((one) => !one.children.length);
    const head = leaves.find((one) => one.textContent.trim() === title);
    if (head) head.click();
    if (!head && --left) return;
    clearInterval(timer);
    setTimeout(() => {{ window.tiagoFolding = false; }}, 1000);  // while it folds it is seen
  }}, 100);
}})();"""


#: Script for a browser: a file that is dropped on the page goes the way of the button that takes one.
DROPPED: Final = """(() => {
  if (window.tiagoDrops) return;
  window.tiagoDrops = true;
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    const field = document.querySelector("input[type=file]");
    if (!field || !event.dataTransfer.files.length) return;
    field.files = event.dataTransfer.files;
    field.dispatchEvent(new Event("change", { bubbles: true }));
  });
})();"""


def check(port: int) -> None:
    """Refuse a port that cannot be listened on.

    Raises:
        ValueError: says which, and what to do.
    """
    if not 0 <= port <= 65535:
        raise ValueError(f"--port is {port}: give 1 to 65535, or 0 for any that is free")
    if port == 0:
        return
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as fault:
            raise ValueError(in_use(port)) from fault


def in_use(port: int) -> str:
    """Message on a port that another program uses."""
    return f"--port {port}: another program listens there; give another port, or 0 for any that is free"


def wait(tick: Callable[[], None], period: float) -> None:
    """Call a function every so many seconds until the program is told to end (SIGINT, SIGTERM)."""
    told: list[int] = []  # no Event: its lock may be held where the handler would take it, in this very thread
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in before:
        signal.signal(number, lambda got, _: told.append(got))
    try:
        due = time.monotonic()
        while not told:
            tick()
            due = max(due + period, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0.0))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
